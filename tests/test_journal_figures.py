"""What a journal takes: widths, letters, signs, fonts as text, colours to compare, captions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from conftest import plane_of, turbulence

import torchliner as tl
from torchliner.records.averaged import Educed

pytest.importorskip("matplotlib")
from torchliner.report import figures
from torchliner.report.figure import WIDTHS, entry, finish, frame, styled, subplots
from torchliner.report.map_figures import map_limits
from torchliner.report.pictures import draw_pictures

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def planes():
    x, z = np.arange(6) * 1e-3, np.arange(5) * 1e-3
    return [
        plane_of(turbulence((5, 6, 480), seed=i, rms=1.0 + i), x=x, z=z, height=height,
                 name=f"y{i}.h5", title=f"case, y = {1e3 * height:g} mm",
                 reference={"true": 1 - 0.2j})
        for i, height in enumerate((2.5e-3, 1e-3, 0.5e-3))
    ]  # fmt: skip


@pytest.fixture(scope="module")
def maps(planes, liner):
    return [tl.educe(plane, liner) for plane in planes]


def letters(figure) -> list[str]:
    return [axis.get_title(loc="left") for axis in figure.axes]


def test_widths_are_those_asked_for(maps):
    """A text block by default; within the block another, and after it the default again."""
    assert figures.draw_along_x(maps).get_size_inches()[0] == WIDTHS["page"]
    for width, inches in (*WIDTHS.items(), (4.8, 4.8), ("4.8", 4.8)):
        with tl.figure_style(width):
            drawn = figures.draw_along_x(maps)
            assert drawn.get_size_inches()[0] == pytest.approx(inches)
    assert figures.draw_along_x(maps).get_size_inches()[0] == WIDTHS["page"]
    for bad in ("three", 0.5, 40):
        with pytest.raises(ValueError, match="must be one, page, two, or 2 to 20"), \
             tl.figure_style(bad):  # fmt: skip
            pass


def test_panels_of_a_column_stand_one_above_the_other(maps):
    """Side by side they would be unreadable; those that share their labels stay."""
    with tl.figure_style("one"):
        upper, lower = (axis.get_subplotspec() for axis in figures.draw_along_x(maps).axes)
        assert upper.colspan == lower.colspan
        assert upper.rowspan.stop == lower.rowspan.start
        left, right = (axis.get_subplotspec() for axis in subplots(1, 2, 2.0, beside=True)[1][0])
        assert left.rowspan == right.rowspan


def test_letters_name_panels_and_not_a_single_one(maps):
    """(a), (b) also for two in a row."""
    assert letters(figures.draw_along_x(maps)) == ["(a)", "(b)"]
    assert letters(figures.draw_against_height(maps)) == [""]


def test_the_caption_is_no_title(maps, tmp_path):
    """It stands in the file and at the figure; as a title only where asked for."""
    from PIL import Image

    figure = figures.draw_along_x(maps, tmp_path / "a.png")
    assert figure.caption.startswith("case, ")
    assert figure.get_suptitle() == ""
    assert Image.open(tmp_path / "a.png").text["Description"] == figure.caption
    with tl.figure_style(title=True):
        titled = figures.draw_along_x(maps)
    assert titled.get_suptitle() == titled.caption == figure.caption


def test_text_in_vector_files_is_text(maps, tmp_path):
    """A word can be found and edited: no outlines; TrueType and not bitmaps in PDF."""
    figures.draw_along_x(maps, tmp_path / "a.svg")
    figures.draw_along_x(maps, tmp_path / "a.pdf")
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "cells, velocity" in drawn
    assert "\N{MINUS SIGN}" in drawn
    stored = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in stored
    assert b"/Type3" not in stored


def test_maps_of_one_call_have_the_same_colours(planes, maps, tmp_path, monkeypatch):
    """Those to be compared; a map alone has its own."""
    seen = []
    monkeypatch.setattr(figures, "draw_map", lambda *a, limits=None: seen.append(limits))
    draw_pictures(maps, planes, tmp_path)
    assert len(seen) == 3
    assert all(one == seen[0] == map_limits(maps) for one in seen)
    own = [map_limits([one]) for one in maps]
    assert own[0] != own[1]
    for part in ("resistance", "reactance"):
        assert seen[0][part][1] < max(float(getattr(one, part).max()) for one in maps)


def test_clipping_is_said(maps):
    """Arrows at the ends that cut, and how many probes lie beyond; none where nothing is cut."""
    figure = figures.draw_map(maps[0])
    bars = [axis for axis in figure.axes if hasattr(axis, "_colorbar")]
    assert [bar._colorbar.extend for bar in bars] == ["both", "both"]
    assert bars[0].get_xlabel().endswith("2 of 30 probes beyond")
    assert "resistance 1 below and 1 above" in figure.caption
    wide = {"resistance": (-1e3, 1e3), "reactance": (-1e3, 1e3)}
    figure = figures.draw_map(maps[0], limits=wide)
    bars = [axis for axis in figure.axes if hasattr(axis, "_colorbar")]
    assert [bar._colorbar.extend for bar in bars] == ["neither", "neither"]
    assert "beyond" not in bars[0].get_xlabel()


def test_cells_are_drawn_on_maps(liner):
    """Squares of the liner's pitch about the centres; none over a hard wall."""
    pitch, points = liner.cell_pitch, 6
    x = (np.arange(2 * points) + 0.5) * pitch / points
    plane = plane_of(turbulence((points, 2 * points, 480)), x=x, z=x[:points])
    found = tl.educe(plane, liner)
    squares = borders(found)
    assert len(squares) == len(found.cell_x) == 2
    assert np.ptp(squares[0][:, 0]) == pytest.approx(1e3 * pitch)
    assert np.mean(squares[1][:4, 0]) == pytest.approx(1e3 * float(found.cell_x[1]))
    found.choices["surface"] = "hard wall"
    assert not borders(found)


def borders(found):
    """Vertices of the lines on a map of resistance."""
    lines = figures.draw_map(found).axes[0].collections[1:]
    return [path.vertices for one in lines for path in one.get_paths()]


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
    assert not frame(axis, np.array([np.nan]))


def test_many_heights_become_a_band_with_a_median(maps, liner):
    """The answer's cells stay markers, a height each; the legend names filled and open ones."""
    figure = figures.draw_along_x(maps)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "cells, velocity: range, median" in words
    assert "true" in words
    assert "$y$ = 0.5 mm" in words
    assert "cells, phase-locked" in words
    few = figures.draw_along_x(maps[:2])
    assert "cells, velocity" in [text.get_text() for text in few.legends[0].get_texts()]


def test_a_band_is_of_the_heights_that_know_the_cell(maps):
    """One that does not, excluded or not spanned, takes no other's band away."""
    cells = maps[0].cells["velocity"]
    unknown = Educed(torch.full_like(cells.reflection, complex(np.nan, np.nan)))
    heights = [dataclasses.replace(maps[0], cells={**maps[0].cells, "velocity": unknown}), *maps[1:]]
    bands = [bar for bar in figures.draw_along_x(heights).axes[0].collections
             if bar.get_zorder() == 2.1]  # fmt: skip
    ends = [[len(ends) for ends in bar.get_segments()] for bar in bands]
    assert ends == [[2] * len(maps[0].cell_x)] * 2


def test_a_legend_is_no_wider_than_its_figure():
    """Columns are taken away until it fits, and a high one makes the figure higher."""

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
