"""Cells, and the places of holes: read, carried, cut, scaled, drawn."""

import numpy as np
import pytest
import torch
from conftest import DATA
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.cli.main import main
from torchliner.records.cells import Cells

MM = 1e-3
TWO = tl.Holes((2 * MM, 6 * MM), (1 * MM, 1 * MM), (1 * MM, 1 * MM))


def a_plane(holes, rows=3):
    v = torch.randn(rows, 9, 600, generator=torch.Generator().manual_seed(0))
    return tl.VelocityPlane(
        v, sampling_rate=20e3, x=MM * np.arange(9), z=MM * np.arange(rows), frequency=1000.0, holes=holes
    )


def table(folder, text):
    path = folder / "holes.csv"
    path.write_text(text)
    return path


def test_slits_have_no_z_and_files_without_holes_have_none(tmp_path):
    slits = tl.Holes((2 * MM,), (0.5 * MM,))
    for holes in (slits, None):
        a_plane(holes).write(tmp_path / "plane.h5")
        assert tl.read_plane(tmp_path / "plane.h5").holes == holes


def test_a_region_cuts_them_and_a_scale_turns_them():
    plane = a_plane(TWO)
    assert plane.scaled(2.0, 1.0).holes == tl.Holes((4 * MM, 12 * MM), (2 * MM,) * 2, (2 * MM,) * 2)
    assert TWO.within(torch.tensor([3 * MM, 8 * MM]), None) == tl.Holes((6 * MM,), (MM,), (MM,))
    assert TWO.within(torch.tensor([3 * MM, 4 * MM]), None) is None
    assert len(TWO.within(torch.tensor([2.4 * MM, 8 * MM]), None)) == 2  # its edge is in there


def test_a_file_beside_the_plane(tmp_path):
    a_plane(None).write(tmp_path / "plane.h5")
    path = table(tmp_path, "diameter [mm]; z [m]; x [cm]\n# remark\n1; 0,001; 0,2\n1; 0,001; 0,6\n")
    assert tl.read_holes(path) == TWO
    assert tl.read_plane(tmp_path / "plane.h5", holes=path).holes == TWO
    part = tl.read_plane(tmp_path / "plane.h5", holes=path, region="0:0.004")
    assert part.holes == tl.Holes((2 * MM,), (MM,), (MM,))


def test_educe_takes_it_for_planes_and_for_moments(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plane, holes = str(DATA / "slit_n130_y2.5mm.h5"), str(DATA / "holes_slit_n.csv")
    wanted = tl.read_holes(holes)
    for source in (plane, "moments.h5"):
        if source != plane:
            assert main(["reduce", plane, "--liner", "lbm_slit", "-o", source, "--quiet"]) == 0
        assert main(["educe", source, "--holes", holes, "-o", "map.h5", "--quiet"]) == 0
        assert tl.read_map("map.h5").holes == wanted


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x [mm], z [mm], diameter [mm]\n2, 1, -1\n", r"holes.csv: .*hole at x = 0.002 m is -0.001 m; it must be pos"),
        ("x [mm], z [mm], diameter [m]\n2, 1, 0.684\n", r"is 0\.684 m; it must be positive, and at most 0\.1 m"),
        ("x, z [mm], diameter [mm]\n2, 1, 1\n", "holes.csv: column 'x' has no unit"),
        ("x [mm], z [mm]\n2, 1\n", "holes.csv: column 'diameter' is missing"),
        ("x [mm], y [mm], diameter [mm]\n2, 1, 1\n", r"unknown column 'y \[mm\]'.*write x \[mm\], z"),
        ("x [mm], z [mm], diameter [mm]\n2, nan, 1\n", "line 2, column 'z' is 'nan'"),
    ],
)
def test_tables_that_say_no_places(tmp_path, text, words):
    with pytest.raises(ValueError, match=words):
        tl.read_holes(table(tmp_path, text))


def test_holes_outside_the_plane_are_left_out():
    assert a_plane(tl.Holes((2 * MM, 60 * MM), (MM, MM), (MM, MM))).holes == tl.Holes((2 * MM,), (MM,), (MM,))
    for wrong in (tl.Holes((60 * MM,), (MM,)), [[2 * MM, MM]]):
        with pytest.raises(ValueError, match=r"none of them over the plane; give Holes\(x, diameter, z\)"):
            a_plane(wrong)
    with pytest.raises(ValueError, match="z has 1 values for 2 holes"):
        tl.Holes((0.0, 1.0), (MM, MM), (0.0,))


def test_maps_and_curves_name_them_in_the_legend():
    pytest.importorskip("matplotlib")
    plane = a_plane(TWO)
    found = tl.educe(plane, tl.load_liner("polito"))
    bare = tl.educe(a_plane(None), tl.load_liner("polito"))
    for one, drawn in ((found, True), (bare, False), (plane, True), (a_plane(None), False)):
        figure = one.plot()
        names = [text.get_text() for each in figure.legends for text in each.get_texts()]
        assert ("hole" in names) == drawn
    circles = [each for each in found.plot().axes[0].collections if hasattr(each, "get_offsets")]
    assert np.allclose(circles[-1].get_offsets(), [[2, 1], [6, 1]])
    assert found.plot().axes[0].get_xlim() == bare.plot().axes[0].get_xlim() == (-0.5, 8.5)


@pytest.mark.parametrize("case", ["slit_n130", "slit_g03_145", "orifice_o145", "orifice_t00_130", "orifice_t015_145"])
def test_shipped_tables_lie_on_their_planes_one_hole_a_cell(case):
    name = "orifice_t00" if "t00_" in case else case[: case.index("_") + 2]
    plane = tl.read_plane(DATA / f"{case}_y0.5mm.h5", lazy=True, holes=DATA / f"holes_{name}.csv")
    liner, holes = tl.load_liner(plane.liner), plane.holes
    assert holes.diameter == pytest.approx([liner.orifice_diameter] * len(holes), rel=5e-3)
    centres = liner.cell_pitch * (np.arange(len(holes)) + 0.5)
    assert holes.x == pytest.approx(centres, rel=2e-3)


@given(st.lists(st.tuples(st.integers(-1, 3), st.booleans()), min_size=1, max_size=12))
def test_an_average_is_the_product_with_the_averaging_matrix(probes):
    """Probes outside (-1) and left out count for nothing; a cell of which none is left is 0."""
    centres = torch.arange(4, dtype=torch.float64)
    cells = Cells(torch.tensor([label for label, _ in probes]), centres, torch.zeros_like(centres))
    used = torch.tensor([each for _, each in probes])
    values = torch.randn(2, len(probes), 3, generator=torch.Generator().manual_seed(1)).double()
    values = torch.complex(values, values.flip(0))
    matrix = ((cells.labels[:, None] == torch.arange(4)) & used[:, None]).double()
    wanted = torch.einsum("pc,apf->acf", (matrix / matrix.sum(0).clamp(min=1)).to(values), values)
    found = cells.average(values, used)
    torch.testing.assert_close(found, wanted, rtol=1e-14, atol=1e-15)
    last = cells.average(values.movedim(1, 2), used, axis=-1)
    torch.testing.assert_close(last, wanted.movedim(1, 2), rtol=1e-14, atol=1e-15)
