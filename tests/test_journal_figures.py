"""What a journal takes: widths, letters, signs, fonts as text, colours to compare, captions."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import plane_of, turbulence

import torchliner as tl

pytest.importorskip("matplotlib")
from torchliner.report import curves, pictures, planes
from torchliner.report import maps as drawn_maps
from torchliner.report.figure import WIDTHS, entry, finish, frame, styled, subplots

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def cases():
    x, z = np.arange(6) * 1e-3, np.arange(5) * 1e-3
    return [
        plane_of(
            turbulence((5, 6, 480), seed=i, rms=1.0 + i),
            x=x,
            z=z,
            height=height,
            name=f"y{i}.h5",
            title=f"case, y = {1e3 * height:g} mm",
            reference={"true": 1 - 0.2j},
        )
        for i, height in enumerate((2.5e-3, 1e-3, 0.5e-3))
    ]


@pytest.fixture(scope="module")
def maps(cases, liner):
    return [tl.educe(plane, liner) for plane in cases]


def test_widths_are_those_asked_for(maps):
    """A text block by default; within the block another, and after it the default again."""
    for width, inches in (*WIDTHS.items(), (4.8, 4.8), ("4.8", 4.8)):
        with tl.figure_style(width):
            assert curves.draw_along_x(maps).get_size_inches()[0] == pytest.approx(inches)
    assert curves.draw_along_x(maps).get_size_inches()[0] == WIDTHS["page"]
    for bad in ("three", 0.5, 40):
        with pytest.raises(ValueError, match="must be one, page, two, or 2 to 20"), tl.figure_style(bad):
            pass


def test_panels_of_a_column_stand_one_above_the_other(maps):
    """Side by side they would be unreadable; those that share their labels stay."""
    with tl.figure_style("one"):
        upper, lower = (axis.get_subplotspec() for axis in curves.draw_along_x(maps).axes)
        assert upper.colspan == lower.colspan
        assert upper.rowspan.stop == lower.rowspan.start
        left, right = (axis.get_subplotspec() for axis in subplots(1, 2, 2.0, beside=True)[1][0])
        assert left.rowspan == right.rowspan


def test_letters_name_panels_and_not_a_single_one(maps):
    """(a), (b) also for two in a row."""
    letters = [axis.get_title(loc="left") for axis in curves.draw_along_x(maps).axes]
    assert letters == ["(a)", "(b)"]
    assert planes.draw_against_height(maps).axes[0].get_title(loc="left") == ""


def test_the_caption_is_no_title(maps, tmp_path):
    """It stands in the file and at the figure; as a title only where asked for."""
    from PIL import Image

    figure = curves.draw_along_x(maps, tmp_path / "a.png")
    assert figure.caption.startswith("case, ")
    assert figure.get_suptitle() == ""
    assert Image.open(tmp_path / "a.png").text["Description"] == figure.caption
    with tl.figure_style(title=True):
        titled = curves.draw_along_x(maps)
    assert titled.get_suptitle() == titled.caption == figure.caption


def test_text_in_vector_files_is_text(maps, tmp_path):
    """A word can be found and edited: no outlines; TrueType and not bitmaps in PDF."""
    curves.draw_along_x(maps, tmp_path / "a.svg")
    curves.draw_along_x(maps, tmp_path / "a.pdf")
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert f"cells, {maps[0].averaging}" in drawn
    assert "\N{MINUS SIGN}" in drawn
    stored = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in stored
    assert b"/Type3" not in stored


def test_maps_of_one_call_have_the_same_colours_and_clipping_is_said(cases, maps, tmp_path, monkeypatch):
    """Those to be compared; a map alone has its own, with arrows at the ends that cut and how many lie beyond."""
    seen = []
    monkeypatch.setattr(pictures, "draw_map", lambda *a, limits=None: seen.append(limits))
    pictures.draw_pictures(maps, cases, tmp_path)
    assert len(seen) == 3
    assert all(one == seen[0] == drawn_maps.map_limits(maps) for one in seen)
    assert drawn_maps.map_limits(maps[:1]) != drawn_maps.map_limits(maps[1:2])
    for limits, extend in ((None, "both"), (dict.fromkeys(("resistance", "reactance"), (-1e3, 1e3)), "neither")):
        figure = drawn_maps.draw_map(maps[0], limits=limits)
        bars = [axis for axis in figure.axes if hasattr(axis, "_colorbar")]
        assert [bar._colorbar.extend for bar in bars] == [extend] * 2
        assert bars[0].get_xlabel().endswith("2 of 30 probes beyond") == (extend == "both")


def test_cells_are_drawn_on_maps(liner):
    """Squares of the liner's pitch about the centres; none over a hard wall."""
    pitch, points = liner.cell_pitch, 6
    x = (np.arange(2 * points) + 0.5) * pitch / points
    found = tl.educe(plane_of(turbulence((points, 2 * points, 480)), x=x, z=x[:points]), liner)

    def borders():
        lines = drawn_maps.draw_map(found).axes[0].collections[1:]
        return [path.vertices for one in lines for path in one.get_paths()]

    squares = borders()
    assert len(squares) == len(found.cell_x) == 2
    assert np.ptp(squares[0][:, 0]) == pytest.approx(1e3 * pitch)
    assert np.mean(squares[1][:4, 0]) == pytest.approx(1e3 * float(found.cell_x[1]))
    found.choices["surface"] = "hard wall"
    assert not borders()


def test_a_peak_does_not_squash_the_rest():
    """Positive values with a peak: logarithmic; wide bands are cut, and that is told."""
    axis = subplots(1, 1, 2.0)[1][0, 0]
    assert not frame(axis, np.array([0.1, 0.1, 0.1, 3.0]))
    assert axis.get_yscale() == "log"
    axis = subplots(1, 1, 2.0)[1][0, 0]
    assert frame(axis, np.array([-1.0, 0, 1]), np.array([-300.0, 0, 2]), [np.nan, np.inf, 0])
    assert axis.get_yscale() == "linear"
    assert -4 < axis.get_ylim()[0] < -3
    assert 2 < axis.get_ylim()[1] < 3
    assert not frame(subplots(1, 1, 2.0)[1][0, 0], np.array([np.nan]))


def test_a_legend_names_what_is_drawn_and_is_no_wider_than_its_figure(liner):
    """No cells without a place; columns are taken away until it fits, and a high one makes the figure higher."""
    for x, there in ((None, False), ([0.0, 0.01, 0.02], True)):
        figure = curves.draw_along_x([tl.educe(plane_of(turbulence((3, 480)), x=x), liner)])
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        assert any(name.startswith("cells") for name in names) == there

    @styled
    def drawn():
        figure, axes = subplots(1, 1, 2.0)
        for i in range(9):
            entry(axes[0, 0], f"a rather long name of curve {i}")
        finish(figure, None, legend=9)
        assert figure.legends[0].get_window_extent().width <= figure.bbox.width
        assert figure.get_size_inches()[1] > 2.0

    for width in ("one", "page", "two"):
        with tl.figure_style(width):
            drawn()
