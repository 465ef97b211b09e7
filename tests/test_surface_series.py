"""Sampled surfaces, one file a frame: OpenFOAM's folders of times and VTK series of all kinds."""

from __future__ import annotations

import json
import pickle
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import pyvista
import vtk
from conftest import SHARED
from hypothesis import given
from hypothesis import strategies as st
from plane_files import (
    FUZZED,
    POINTS,
    QUADS,
    STEP,
    UP,
    VALUES,
    answer_or_error,
    cuts,
    mutate,
    mutations,
    opened,
    recognised,
)

from torchliner.checks import DataWarning
from torchliner.io import planes
from torchliner.io.openfoam_surfaces import FORMAT as FOAM
from torchliner.io.plane_format import PlaneRequest
from torchliner.io.surface_frames import Surface
from torchliner.io.vtk_frames import parse_vtk
from torchliner.io.vtk_series import FORMAT as SERIES
from torchliner.records.origin import series_of

SAMPLES = SHARED / "data/openfoam/vtk_series"
STATED = PlaneRequest(normal="y", velocity_units="m/s", length_units="m", sampling_rate=1 / STEP)
ON_GRID = VALUES[..., 1].T.reshape(3, 4, 9)
ON_FACES = VALUES[:, :6]


def surface(frame, faces):
    """A frame as pyvista has it."""
    mesh = pyvista.PolyData(POINTS, np.insert(QUADS, 0, 4, 1).reshape(-1))
    if faces:
        mesh.cell_data["U"] = ON_FACES[frame]
    else:
        mesh.point_data["U"] = VALUES[frame]
    return mesh


def save(mesh, path, mode="ascii", packed=False):
    """A VTK file of one of the ways that its writers know."""
    if path.suffix == ".vtk":
        mesh.save(path, binary=mode != "ascii")
        return path
    kinds = {".vtp": vtk.vtkXMLPolyDataWriter, ".vtu": vtk.vtkXMLUnstructuredGridWriter,
             ".vti": vtk.vtkXMLImageDataWriter}  # fmt: skip
    writer = kinds[path.suffix]()
    writer.SetFileName(str(path))
    writer.SetInputData(mesh)
    writer.SetDataMode({"ascii": 0, "binary": 1, "raw": 2, "base64": 2}[mode])
    writer.SetEncodeAppendedData(mode == "base64")
    if packed:
        writer.SetCompressorTypeToZLib()
        writer.SetBlockSize(192)  # several blocks
    else:
        writer.SetCompressorTypeToNone()
    assert writer.Write()
    return path


def series(folder, ending=".vtp", faces=False, **how):
    """Numbered files of nine frames."""
    for i in range(9):
        save(surface(i, faces), folder / f"plane_{i:02d}{ending}", **how)
    return folder / f"plane_04{ending}"


@pytest.mark.parametrize(
    ("mode", "packed", "faces"),
    [*product(["ascii", "binary", "raw", "base64"], [False, True], [False, True])],
)
def test_every_way_of_vtk_xml(tmp_path, mode, packed, faces):
    """Values are those that vtk wrote, on a grid of points or at the middle of faces."""
    path = series(tmp_path, faces=faces, mode=mode, packed=packed and mode != "ascii")
    assert recognised(SERIES, path)
    plane = SERIES.open(path, STATED)
    wanted = ON_FACES[..., 1].T.reshape(2, 3, 9) if faces else ON_GRID
    assert np.allclose(plane.load().velocity.numpy(), wanted, atol=1e-7)
    if faces:
        assert np.allclose(plane.x, [5e-3, 15e-3, 25e-3])
        assert np.allclose(plane.area, 5e-5)
    assert opened(SERIES, tmp_path, STATED).shape == wanted.shape


@pytest.mark.parametrize(("version", "mode"), [*product([42, 51], ["ascii", "binary"])])
@pytest.mark.parametrize("faces", [False, True])
def test_legacy(tmp_path, version, mode, faces):
    for i in range(9):
        writer = vtk.vtkPolyDataWriter()
        writer.SetFileName(str(tmp_path / f"p{i}.vtk"))
        writer.SetFileVersion(version)
        writer.SetInputData(surface(i, faces))
        (writer.SetFileTypeToBinary if mode == "binary" else writer.SetFileTypeToASCII)()
        assert writer.Write()
    plane = SERIES.open(tmp_path, STATED)
    wanted = ON_FACES[..., 1].T.reshape(2, 3, 9) if faces else ON_GRID
    assert np.allclose(plane.load().velocity.numpy(), wanted, atol=1e-6)


def test_other_kinds_of_grid(tmp_path):
    """Unstructured grids and flat images, XML and legacy; a single component."""
    for kind, ending in product(("grid", "image"), ("xml", ".vtk")):
        folder = tmp_path / (kind + ending)
        folder.mkdir()
        for i in range(9):
            mesh = surface(i, False).cast_to_unstructured_grid()
            if kind == "image":
                mesh = pyvista.ImageData(dimensions=(4, 1, 3), spacing=(0.01, 1, 0.005))
                mesh.point_data["Velocity_y"] = VALUES[i, :, 1]
            suffix = {"grid": ".vtu", "image": ".vti"}[kind] if ending == "xml" else ending
            save(mesh, folder / f"p{i}{suffix}", "binary")
        found = opened(SERIES, folder, STATED)
        assert np.allclose(found, ON_GRID, atol=1e-6)


@pytest.mark.parametrize("ending", [".pvd", ".series"])
def test_collections_state_times(tmp_path, ending):
    series(tmp_path)
    names = [f"plane_{i:02d}.vtp" for i in range(9)]
    path = tmp_path / f"all{ending}"
    rows = "".join(f'<DataSet timestep="{i * STEP:.8g}" part="0" file="{n}"/>'
                   for i, n in enumerate(names))  # fmt: skip
    files = [{"name": n, "time": float(f"{i * STEP:.8g}")} for i, n in enumerate(names)]
    text = {".pvd": f'<?xml version="1.0"?>\n<VTKFile type="Collection"><Collection>{rows}'
                    "</Collection></VTKFile>",
            ".series": json.dumps({"file-series-version": "1.0", "files": files})}  # fmt: skip
    path.write_text(text[ending])
    plain = PlaneRequest(normal="y", velocity_units="mm/s", length_units="mm")
    assert recognised(SERIES, path)
    plane = SERIES.open(path, plain)
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    assert np.allclose(1e3 * plane.load().velocity.numpy(), ON_GRID, atol=1e-7)
    assert float(plane.x[-1]) == pytest.approx(0.03e-3)
    for stated, message in (
        (PlaneRequest(normal="y", length_units="m"), "no unit of velocity.*velocity_units='m/s'"),
        (PlaneRequest(normal="y", velocity_units="m/s"), "--length-units m"),
    ):
        with pytest.raises(ValueError, match=message):
            SERIES.open(path, stated)
    (tmp_path / names[3]).unlink()
    with pytest.raises(ValueError, match=r"1 frames of 9 are not there.*plane_03"):
        SERIES.open(path, plain)
    path.write_text(text[ending].replace("3e-05", "2e-05"))
    with pytest.raises(ValueError, match="several files for the time 2e-05"):
        SERIES.open(path, plain)


def test_a_glob_of_a_series_opens_it_once(tmp_path, monkeypatch):
    """Whether or not its points are sorted; two series are two planes."""
    series(tmp_path)
    mixed = pyvista.PolyData(POINTS[::-1].copy())
    for i in range(9):
        mixed.point_data["U"] = VALUES[i, ::-1]
        save(mixed, tmp_path / f"q_{i}.vtp")
    opened = []
    monkeypatch.setattr(planes, "join_planes", lambda found, *_: opened.extend(found) or found[0])
    for pattern, count in (("plane_*", 1), ("q_*", 1), ("*.vtp", 2)):
        opened.clear()
        stated = {"normal": "y", "velocity_units": "m/s", "length_units": "m"}
        plane = planes.read_plane(f"{tmp_path}/{pattern}", sampling_rate=1 / STEP, **stated)
        assert len(opened) == count
        assert np.allclose(plane.velocity.numpy(), ON_GRID, atol=1e-7)


def test_faults_of_a_series(tmp_path):
    """Another mesh in a later frame, no rate, two names, no velocity, another type of data."""
    path = series(tmp_path)
    bare = PlaneRequest(normal="y", velocity_units="m/s", length_units="m")
    with pytest.raises(ValueError, match=r"states no time.*sampling_rate"):
        SERIES.open(path, bare)
    with pytest.raises(ValueError, match=r"no variable 'T'.*it holds U"):
        SERIES.open(path, PlaneRequest(**{**STATED.__dict__, "variable": "T"}))
    small = pyvista.PolyData(POINTS[:8])
    small.point_data["U"] = VALUES[5, :8]
    save(small, tmp_path / "plane_05.vtp")
    plane = SERIES.open(path, STATED)
    with pytest.raises(ValueError, match=r"plane_05.vtp has 8 values of 'U', the first.*12"):
        plane.load()
    raw = save(surface(5, False), tmp_path / "plane_05.vtp", "raw").read_bytes()
    (tmp_path / "plane_05.vtp").write_bytes(raw.replace(b'ts="12"', b'ts="13"'))
    with pytest.raises(ValueError, match=r"cannot read all of .*plane_05.vtp"):
        plane.load()
    (tmp_path / "plane_05.vtp").write_bytes(raw.replace(b'Name="U"', b'Name="U" type="Float32"'))
    with pytest.raises(ValueError, match=r"plane_05.vtp is nothing that VTK reads"):
        plane.load()
    save(surface(0, False), tmp_path / "other_00.vtp")
    with pytest.raises(ValueError, match=r"series other_, plane_; name one as group"):
        SERIES.open(tmp_path, STATED)
    with pytest.raises(ValueError, match=r"other_00.vtp is one frame"):
        SERIES.open(tmp_path / "other_00.vtp", STATED)
    raw = path.read_bytes()
    (tmp_path / "other_01.vtp").write_bytes(raw.replace(b"PolyData", b"MultiBlock"))
    with pytest.raises(ValueError, match=r"other_01.vtp is nothing that VTK reads"):
        SERIES.open(tmp_path / "other_00.vtp", STATED).load()


def images(folder, names, times=None, about=""):
    """Images of 4 x 3 points, whose values are their places in the list of names."""
    folder.mkdir(exist_ok=True)
    for i, name in enumerate(names):
        time = "" if times is None else (
            '<FieldData><DataArray type="Float64" Name="TimeValue" format="ascii">'
            f"{times[i]!r}</DataArray></FieldData>")  # fmt: skip
        (folder / f"{name}.vti").write_text(
            '<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 0 0 2" Origin="0 0.001 -0.005"'
            f' Spacing="0.01 1 0.005" {about}>{time}<Piece Extent="0 3 0 0 0 2"><PointData>'
            '<DataArray type="Float32" Name="U" NumberOfComponents="3" format="ascii">'
            f"{f'0 {i} 0 ' * 12}</DataArray></PointData></Piece></ImageData></VTKFile>"
        )
    return folder


def order(path, request=STATED):
    """Places in the list of names, in the order of time."""
    return SERIES.open(path, request).load().velocity[0, 0].tolist()


@pytest.mark.parametrize("names", [
    [f"plane_{i * 1e-4:.6g}" for i in range(1, 25)],
    [f"plane_{i / 10:.1f}" for i in range(5, 15)],
    [f"plane_{i * 1e-5:.5e}" for i in range(5, 15)],
    [f"y1.{i}" for i in range(8, 12)],
    [f"plane_{i}" for i in (1000, 1033, 1071, 1100)],
])  # fmt: skip
def test_frames_are_in_the_order_of_their_numbers(tmp_path, names):
    """A decimal, as of a time, is one number; a count of uneven steps may be of even times."""
    images(tmp_path, names)
    for path in (tmp_path, tmp_path / f"{names[0]}.vti", tmp_path / f"{names[-1]}.vti"):
        assert order(path) == [*range(len(names))]
        assert path == tmp_path or len(series_of(path)) == len(names)


def test_counts_behind_a_number_and_a_point(tmp_path):
    """Two planes that are numbered are two series, not decimals of one."""
    images(tmp_path, [f"y{n}.{i:03d}" for n in (1, 2) for i in range(5)])
    assert order(tmp_path / "y2.003.vti") == [5, 6, 7, 8, 9]
    assert order(tmp_path, replace(STATED, group="y1.")) == [0, 1, 2, 3, 4]


WITHOUT = [i for i in range(20) if i not in (7, 8)]


@pytest.mark.parametrize(("names", "times", "message"), [
    ([f"p_{i:03d}" for i in WITHOUT], None, "2 frames are missing, the first of numbers 7, 8;"),
    ([f"p_{10 * i}" for i in WITHOUT], None, "2 frames are missing, the first of numbers 70, 80;"),
    ([f"p_{i / 10:g}" for i in WITHOUT], None, "names lacks 2 frames.* after sample 6"),
    (["p_1", "p_01", "p_2"], None, "p_(1|01).vti and p_(1|01).vti have one number"),
    ([f"p_{i}" for i in range(18)], WITHOUT, "times lacks 2 frames.* after sample 6"),
    ([f"p_{i}" for i in range(3)], [0, 2, 1], "times is out of order: sample 2"),
])  # fmt: skip
def test_a_stated_rate_closes_no_gap(tmp_path, names, times, message):
    """Times are tested whatever they count, or numbers where no times are stated."""
    images(tmp_path, names, times)
    with pytest.raises(ValueError, match=message):
        SERIES.open(tmp_path, STATED)


def test_times_of_another_unit_tell_the_start(tmp_path):
    """Of ms where the rate is stated: they count evenly, whatever they count."""
    images(tmp_path, [f"p_{i}" for i in range(3)], [5.0, 5.01, 5.02])
    plane = SERIES.open(tmp_path / "p_1.vti", STATED)
    assert (plane.sampling_rate, plane.start) == (1 / STEP, pytest.approx(5e-3))


def test_a_turned_image(tmp_path):
    """Its points are where vtk has them."""
    turned = 'Direction="0 0 1 0 1 0 -1 0 0"'
    path = images(tmp_path, ["p_0", "p_1"], about=turned) / "p_0.vti"
    wanted = pyvista.read(path).points
    found = parse_vtk(path).surface().points
    assert np.allclose(found, wanted)
    assert np.ptp(found[:, 2]) == pytest.approx(0.03)


def test_a_collection_is_xml(tmp_path):
    """Entries in remarks are none; a collection that was broken off is an error."""
    images(tmp_path, "abc")
    rows = [f'<DataSet timestep="{i * STEP:.8g}" file="{n}.vti"/>\n' for i, n in enumerate("abc")]
    text = '<VTKFile type="Collection"><Collection>\n{}</Collection></VTKFile>'
    path = tmp_path / "a.pvd"
    path.write_text(text.format("".join(rows[:2]) + f"<!-- {rows[2]} -->"))
    assert order(path) == [0, 1]
    path.write_text(text.format("".join(rows))[:-30])
    with pytest.raises(ValueError, match=r"a.pvd is no whole XML: .*; .*write it again"):
        SERIES.open(path, STATED)
    rows[2] = rows[2].replace("2e-05", "4e-05")
    path.write_text(text.format("".join(rows)))
    with pytest.raises(ValueError, match=r"a.pvd, times is not uniform|lacks"):
        SERIES.open(path, STATED)
    path.rename(tmp_path / "a.pvtp").write_text(text.replace("Collection", "PPolyData"))
    with pytest.raises(ValueError, match=r"a.pvtp lists the pieces of a frame.*merge them"):
        SERIES.open(tmp_path / "a.pvtp", STATED)


@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_pixels_are_rectangles(tmp_path, ending):
    """Their corners stand row by row, not around them."""
    mesh = pyvista.ImageData(dimensions=(4, 1, 3), spacing=(0.01, 1, 0.005))
    mesh = mesh.cast_to_unstructured_grid()
    assert set(mesh.celltypes) == {8}
    _, area = parse_vtk(save(mesh, tmp_path / f"a{ending}")).surface().faces("mesh")
    assert np.allclose(area, 5e-5)


@pytest.mark.parametrize(("made", "ending"), [
    ("uniform", ".vti"), ("uniform", ".vtk"), ("structured", ".vts"), ("structured", ".vtk"),
])  # fmt: skip
def test_values_on_the_cells_of_a_grid(tmp_path, made, ending):
    """They stand at the middles of the cells, as those of faces."""
    grid = pyvista.ImageData(dimensions=(4, 1, 3), spacing=(0.01, 1, 0.005), origin=(0, 1e-3, 0))
    if made == "structured":
        grid = grid.cast_to_structured_grid()
    for frame in range(2):
        grid.cell_data["U"] = ON_FACES[frame]
        grid.save(tmp_path / f"a_{frame}{ending}")
    plane = planes.open_plane(tmp_path, STATED)
    assert np.allclose(plane.load().velocity, ON_FACES[:2, :, 1].T.reshape(2, 3, 2))
    assert np.allclose(plane.x, [0.005, 0.015, 0.025])
    assert np.allclose(plane.z, [0.0025, 0.0075])
    assert np.allclose(plane.area, 5e-5)


def test_a_grid_of_other_points(tmp_path):
    grid = pyvista.ImageData(dimensions=(4, 1, 3)).cast_to_structured_grid()
    for frame in range(2):
        grid.point_data["U"] = VALUES[frame]
        path = tmp_path / f"a_{frame}.vtk"
        grid.save(path, binary=False)
        path.write_text(path.read_text().replace("DIMENSIONS 4 1 3", "DIMENSIONS 4 1 2"))
    with pytest.raises(ValueError, match=r"a_0.vtk: a grid of \[4, 1, 2\] points has 12"):
        planes.open_plane(tmp_path, STATED)


@pytest.mark.parametrize(("kind", "ring"), [(11, False), (12, True)])
def test_boxes_have_no_area(tmp_path, kind, ring):
    """Voxels and hexahedra of a slab one cell thick: places of their middles alone."""
    x, y, z = np.meshgrid([0, 0.01, 0.02], [0, 1e-3], [0, 0.005], indexing="ij")
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    number = np.arange(12).reshape(3, 2, 2)
    cells = [[number[i + a, b, c] for c in (0, 1) for b in (0, 1) for a in (0, 1)] for i in (0, 1)]
    order = [0, 1, 3, 2, 4, 5, 7, 6] if ring else list(range(8))
    flat = np.insert(np.array(cells)[:, order], 0, 8, 1).reshape(-1)
    for frame in range(2):
        grid = pyvista.UnstructuredGrid(flat, [kind, kind], points)
        grid.cell_data["U"] = VALUES[frame, :2]
        grid.save(tmp_path / f"a_{frame}.vtu")
    plane = planes.open_plane(tmp_path, STATED)
    assert plane.area is None
    assert np.allclose(plane.x, [0.005, 0.015])
    assert plane.provenance["normal_coordinate"] == pytest.approx(5e-4)


@pytest.mark.parametrize("mode", ["binary", "raw", "base64"])
def test_times_as_bytes(tmp_path, mode):
    """A frame may state its time behind all else."""
    for frame in range(3):
        mesh = surface(frame, False)
        mesh.field_data["TimeValue"] = np.array([0.5 + STEP * frame])
        save(mesh, tmp_path / f"a_{frame}.vtp", mode)
    plane = planes.open_plane(tmp_path, replace(STATED, sampling_rate=None))
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    assert plane.start == pytest.approx(0.5)


def foam(folder, kind, faces=False):
    """``postProcessing/NAME`` with a surface ``top`` at nine times."""
    for i in range(9):
        here = folder / f"{100 * STEP + i * STEP:.6g}"
        here.mkdir(parents=True)
        values = ON_FACES[i] if faces else VALUES[i]
        if kind == "vtp":
            save(surface(i, faces), here / "top.vtp")
        elif kind == "raw":
            centres = POINTS[QUADS].mean(1) if faces else POINTS
            head = f"# U  {'FACE' if faces else 'POINT'}_DATA {len(values)}\n#  x  y  z  U_x U_y U_z\n"
            rows = (" ".join(f"{n:.8g}" for n in row) for row in np.hstack([centres, values]))
            (here / "U_top.raw").write_text(head + "\n".join(rows) + "\n")
    return folder


@pytest.mark.parametrize(("kind", "faces"), [*product(["vtp", "raw"], [False, True])])
def test_openfoam_surfaces(tmp_path, kind, faces):
    """One answer from each format that the solver writes, from the folder and from a file in it."""
    folder = foam(tmp_path / "2024/planes", kind, faces)
    plane = FOAM.open(folder, UP)
    wanted = ON_FACES[..., 1].T.reshape(2, 3, 9) if faces else ON_GRID
    assert np.allclose(plane.load().velocity.numpy(), wanted, atol=1e-6)
    assert plane.sampling_rate == pytest.approx(1 / STEP, rel=1e-4)
    assert plane.start == pytest.approx(100 * STEP)
    if faces and kind != "raw":
        assert np.allclose(plane.area, 5e-5)
    for inside in (folder / "0.00103", next((folder / "0.00103").iterdir())):
        assert np.array_equal(opened(FOAM, inside), plane.load().velocity)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(3, 5), plane.velocity.load().flatten(0, 1).T[3:5])


def test_faults_of_openfoam_surfaces(tmp_path):
    folder = foam(tmp_path / "planes", "vtp")
    shutil.copy(folder / "0.001/top.vtp", folder / "0.001/side.vtp")
    with pytest.raises(ValueError, match=r"surfaces side, top; name one as group"):
        FOAM.open(folder, UP)
    with pytest.raises(ValueError, match=r"8 of 9 times, 0.00101.* have no surface 'side'"):
        FOAM.open(folder, PlaneRequest(group="side", normal="y"))
    assert FOAM.open(folder / "0.001/top.vtp", UP).samples == 9
    shutil.rmtree(folder / "0.00104")
    with pytest.raises(ValueError, match=r"lacks 1 frames.*after sample 3"):
        FOAM.open(folder, PlaneRequest(group="top", normal="y"))
    with pytest.warns(DataWarning, match=r"taken as \+y, since the points lie in a plane"):
        FOAM.open(foam(tmp_path / "b", "raw"), PlaneRequest())


@pytest.mark.parametrize("faces", [False, True])
def test_rows_of_raw_surfaces_stand_where_they_say(tmp_path, faces):
    """A restart on other cores writes them in another order; points that move are refused."""
    folder = foam(tmp_path / "planes", "raw", faces)
    wanted = opened(FOAM, folder)
    for number, path in enumerate(sorted(folder.glob("*/*"))[4:]):
        head, rows = path.read_text().split("U_z\n")
        rows = np.random.default_rng(number).permutation(rows.splitlines())
        path.write_text(head + "U_z\n" + "\n".join(rows) + "\n")
    assert np.array_equal(opened(FOAM, folder), wanted)
    row = rows[2].split()
    path.write_text(path.read_text().replace(rows[2], " ".join([row[0], "0.0011", *row[2:]])))
    with pytest.raises(ValueError, match=rf"{path}, row 3, is at \({row[0]} 0.0011 .* is \({row[0]} 0.001 "):
        opened(FOAM, folder)


def test_points_of_later_times_are_the_first(tmp_path):
    """A restart on other cores may write them in another order."""
    folder = foam(tmp_path / "planes", "vtp")
    mesh = surface(4, False)
    mesh.points = mesh.points[::-1].copy()
    save(mesh, folder / "0.00104/top.vtp")
    with pytest.raises(ValueError, match=r"0.00104/top.vtp has 12 points elsewhere than the first frame"):
        opened(FOAM, folder)


def test_faces_of_later_times_are_the_first(tmp_path):
    folder = foam(tmp_path / "planes", "vtp", faces=True)
    mesh = surface(4, True)
    mesh.faces = mesh.faces.reshape(-1, 5)[::-1].reshape(-1).copy()
    save(mesh, folder / "0.00104/top.vtp")
    with pytest.raises(ValueError, match=r"0.00104/top.vtp has other faces than the first frame"):
        opened(FOAM, folder)


def test_content_tells_the_kind_of_a_file_and_any_spelling_the_clock(tmp_path):
    for name in ("Time", "TIMEVALUE", "TimeValue"):
        mesh = surface(0, False)
        mesh.field_data[name] = [0.25]
        path = save(mesh, tmp_path / f"{name}.vtp", "raw")
        assert parse_vtk(path.rename(path.with_suffix(".dat"))).time == 0.25


def test_foam_files_are_refused_by_name(tmp_path):
    for time in ("0.1", "0.2"):
        (tmp_path / time / "top").mkdir(parents=True)
        (tmp_path / time / "top/points").write_text("1\n(\n(0 0 0)\n)\n")
    assert recognised(FOAM, tmp_path)
    with pytest.raises(ValueError, match=r"0.1/top is a surface in the format foamFile.* surfaceFormat vtk or raw"):
        FOAM.open(tmp_path, UP)


STORED = Path(__file__).parent / "stored/solver_files"


def test_what_solvers_wrote():
    """OpenFOAM v1912 states four times the bytes of its binary .vtp; ParaView has U on points and on cells."""
    found = {kind: opened(FOAM, STORED / kind) for kind in ("vtp", "legacy_binary", "legacy", "raw")}
    assert np.array_equal(found["vtp"], found["legacy_binary"])
    for text in ("legacy", "raw"):
        assert np.allclose(found[text], found["vtp"], atol=1e-5)
    of_cells = [SERIES.open(STORED / f"paraview/slice_0{ending}", STATED) for ending in (".vtp", ".vtk")]
    assert {plane.provenance["values"] for plane in of_cells} == {"faces"}
    assert np.array_equal(*(plane.load().velocity for plane in of_cells))


def test_faces_are_where_they_are():
    """A trapezoid's centroid and area by hand; folded out of a triangle and a pentagon."""
    points = np.array([[0, 0, 0], [4, 0, 0], [2, 0, 2], [0, 0, 2], [6, 0, 3], [3, 0, 5.0]])
    corners, ends = np.array([0, 1, 2, 3, 1, 4, 2]), np.array([4, 7])
    centres, areas = Surface(points, corners, ends).faces("mesh")
    assert np.allclose(areas, [6, 5])
    assert np.allclose(centres, [[14 / 9, 0, 8 / 9], [4, 0, 5 / 3]])


@FUZZED
@given(marks=mutations, cut=cuts, how=st.integers(0, 5))
def test_mutated_bytes(tmp_path_factory, marks, cut, how):
    """A frame of any encoding that is damaged is an error, or a plane."""
    mode, ending = (("ascii", ".vtp"), ("binary", ".vtp"), ("raw", ".vtp"), ("base64", ".vtp"),
                    ("ascii", ".vtk"), ("binary", ".vtk"))[how]  # fmt: skip
    path = tmp_path_factory.mktemp("vtk") / f"plane_00{ending}"
    for i in range(2):
        save(surface(i, bool(how % 2)), path.with_stem(f"plane_0{i}"), mode)
    clean = opened(SERIES, path, STATED)
    mutate(path, marks, cut)
    answer_or_error(SERIES, path, STATED, "plane_", clean)


@pytest.mark.skipif(not SAMPLES.exists(), reason="samples of a run are not here")
def test_real_surfaces():
    """Ten frames of 4940 triangles of a channel, against pyvista."""
    plane = FOAM.open(SAMPLES, UP)
    mesh = pyvista.read(SAMPLES / "501/y0052.vtp")
    sizes = mesh.compute_cell_sizes(length=False, volume=False)
    assert plane.sampling_rate == pytest.approx(5)
    assert np.array_equal(plane.load().velocity[:, 4].numpy(), mesh.cell_data["U"][:, 1])
    assert np.allclose(plane.x, mesh.cell_centers().points[:, 0], atol=1e-6)
    assert np.allclose(plane.area, sizes.cell_data["Area"], rtol=1e-4)
    assert parse_vtk(SAMPLES / "501/y0052.vtp").time == pytest.approx(501)
