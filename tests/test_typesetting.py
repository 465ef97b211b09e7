"""What becomes a true minus, and what stays a hyphen."""

from __future__ import annotations

import pytest

from torchliner.report.figure import typeset, typeset_label


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("-1.93 dB (-2.62 to -2.60)", "~1.93 dB (~2.62 to ~2.60)"),
        ("Z = 2.33-0.30j, -5-3j, -1j, 1+2j", "Z = 2.33~0.30j, ~5~3j, ~1j, 1+2j"),
        ("off by 1.2e-05, 4e-4.", "off by 1.2e~05, 4e~4."),
        *(
            (text, text)
            for text in (
                "2026-11-23, 2026-11-23T10:04:05",
                "300-3500 Hz, 5-95 %, two-wave, 1.5-2",
                "data/slit_n130-1.0mm.h5, run-3.h5, -3.h5, 1e-3.nc, data/-2/x",
                r"$v'_{\mathrm{rms}}$ s$^{-1}$ $-$",
                "a - b, case n130 - 2.5 mm",
                "10.1017/jfm.2026.11969, 3d5c-4e-12ab",
            )
        ),
    ],
)
def test_numbers_have_a_true_minus_and_hyphens_stay(given, wanted):
    """Real, imaginary and in exponents; not dates, ranges, files, formulas; twice is as once."""
    found = typeset(given)
    assert found == wanted.replace("~", "\N{MINUS SIGN}")
    assert typeset(found) == found


def test_labels_have_the_symbol_of_the_axes():
    assert typeset_label("y = 0.5 mm, R -1") == "$y$ = 0.5 mm, R \N{MINUS SIGN}1"
    assert typeset_label("$y = 2$") == "$y = 2$"


@pytest.mark.parametrize("text", ["-" + "1" * 200_000 + "a", "-1e" * 70_000 + "x", "+1" * 100_000 + " -2"])
def test_text_of_any_file_takes_a_moment(text):
    """Every end from every start would take hours: the notes of a file may hold such text."""
    assert len(typeset(text)) == len(text)
