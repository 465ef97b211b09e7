"""What becomes a true minus, and what stays a hyphen."""

from __future__ import annotations

import pytest

from torchliner.report.typesetting import typeset, typeset_label


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("-1.93 dB (-2.62 to -2.60)", "~1.93 dB (~2.62 to ~2.60)"),
        ("Z = 2.33-0.30j, -5-3j, -1j, 1+2j", "Z = 2.33~0.30j, ~5~3j, ~1j, 1+2j"),
        ("1.2e-05 and -3.5E-3, 1e-6j", "1.2e~05 and -3.5E-3, 1e~6j"),  # Python writes a small e
        ("off by 4e-4.", "off by 4e~4."),
        ("[-0.5, -.5], =-2, -inf", "[~0.5, ~.5], =~2, ~inf"),
        ("v' rms -0.5, u'", "v\u2032 rms ~0.5, u\u2032"),
        *(
            (text, text)
            for text in (
                "2026-11-23, 2026-11-23T10:04:05",
                "300-3500 Hz, 5-95 %, two-wave, 1.5-2",
                "--phase given --reference-phase -0.5, --band=-3 4, calibrate --closure",
                "data/slit_n130-1.0mm.h5, run-3.h5, -3.h5, 1e-3.nc, data/-2/x",
                "polito-2 eq. (A-1)",
                r"$v'_{\mathrm{rms}}$ s$^{-1}$ $-$",
                "no option is called 'v' or 'u'",
                "-",
                "a - b",
                "10.1017/jfm.2026.11969",
                "3d5c-4e-12ab",
                "case n130 - 2.5 mm",
            )
        ),
    ],
)
def test_numbers_have_a_true_minus_and_hyphens_stay(given, wanted):
    """Real, imaginary and in exponents; not dates, ranges, options, files, formulas; twice is as once."""
    found = typeset(given)
    assert found == wanted.replace("~", "\N{MINUS SIGN}")
    assert typeset(found) == found


def test_labels_have_the_symbol_of_the_axes():
    """The height of a plane as its axis has it."""
    assert typeset_label("y = 0.5 mm, R -1") == "$y$ = 0.5 mm, R \N{MINUS SIGN}1"
    assert typeset_label("$y = 2$") == "$y = 2$"


@pytest.mark.parametrize(
    ("text", "tells"),
    [
        ("-" + "1" * 200_000 + "a", 0),
        ("-1e" * 70_000 + "x", 0),
        ("+1" * 100_000 + " -2", 1),
        ("--a=" + "-1" * 70_000 + "x", 0),
    ],
    ids=["digits", "exponents", "sums", "option"],
)
def test_text_of_any_file_takes_a_moment(text, tells):
    """Every end from every start would take hours: the notes of a file may hold such text."""
    assert typeset(text).count("\N{MINUS SIGN}") == tells
