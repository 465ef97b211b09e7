"""What a journal takes: widths, letters, signs, fonts as text, colours to compare, captions."""

import numpy as np
import pytest
from conftest import plane_of, turbulence

import torchliner as tl

pytest.importorskip("matplotlib")
from torchliner.report import curves, maps, of_map
from torchliner.report.figure import WIDTHS, frame, subplots, typeset, typeset_label

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def cases():
    x, z = np.arange(6) * 1e-3, np.arange(5) * 1e-3
    about = {"x": x, "z": z, "reference": {"true": 1 - 0.2j}}
    heights = {f"y{i}.h5": height for i, height in enumerate((2.5e-3, 1e-3, 0.5e-3))}
    return [
        plane_of(v, name=name, height=height, title=f"case, y = {1e3 * height:g} mm", **about)
        for i, (name, height) in enumerate(heights.items())
        for v in [turbulence((5, 6, 480), seed=i, rms=1.0 + i)]
    ]


@pytest.fixture(scope="module")
def found(cases, liner):
    return [tl.educe(plane, liner) for plane in cases]


def test_widths_are_those_asked_for(found):
    for width, inches in (*WIDTHS.items(), (4.8, 4.8), ("4.8", 4.8)):
        with tl.figure_style(width):
            assert curves.draw_along_x(found).get_size_inches()[0] == pytest.approx(inches)
    assert curves.draw_along_x(found).get_size_inches()[0] == WIDTHS["page"]
    for bad in ("three", 0.5, 40):
        with pytest.raises(ValueError, match="must be one, page, two, or 2 to 20"), tl.figure_style(bad):
            pass


def test_the_caption_stands_in_the_file_and_text_is_text(found, tmp_path):
    from PIL import Image

    figure = curves.draw_along_x(found, tmp_path / "a.png")
    assert figure.caption.startswith("case, ")
    assert figure.get_suptitle() == ""
    assert Image.open(tmp_path / "a.png").text["Description"] == figure.caption
    figure.savefig(tmp_path / "a.svg")
    figure.savefig(tmp_path / "a.pdf")
    drawn, stored = (tmp_path / "a.svg").read_text(encoding="utf-8"), (tmp_path / "a.pdf").read_bytes()
    assert f"cells, {found[0].averaging}" in drawn
    assert "\N{MINUS SIGN}" in drawn
    assert b"/FontFile2" in stored
    assert b"/Type3" not in stored


def test_maps_of_one_call_have_the_same_colours(cases, found, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(of_map, "draw_map", lambda *a, limits=None: seen.append(limits))
    of_map.draw_pictures(found, cases, tmp_path)
    assert len(seen) == 3
    assert all(one == seen[0] == maps.map_limits(found) for one in seen)
    assert maps.map_limits(found[:1]) != maps.map_limits(found[1:2])


def test_cells_are_drawn_on_maps(liner):
    pitch, points = liner.cell_pitch, 6
    x = (np.arange(2 * points) + 0.5) * pitch / points
    found = tl.educe(plane_of(turbulence((points, 2 * points, 480)), x=x, z=x[:points]), liner)
    assert [line.get_xdata()[0] for line in maps.draw_map(found).axes[0].lines if line.get_xdata()[0] > 1] == [
        pytest.approx(1e3 * pitch)
    ]
    found.choices["surface"] = "hard wall"
    assert not maps.draw_map(found).axes[0].lines


def test_limits_show_values_and_break_at_poles():
    axis = subplots(1, 1, 2.0)[1][0, 0]
    x = np.linspace(0, 2, 201)
    axis.plot(x, 1 / (x - 0.995))
    frame(axis)
    assert axis.get_ylim()[1] > 100
    frame(axis, poles=True)
    assert axis.get_ylim()[1] < 50
    assert np.isnan(axis.lines[0].get_ydata()).any()


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
