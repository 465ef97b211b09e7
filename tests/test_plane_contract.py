"""One contract for all formats: the canonical plane in is the plane out, lazy as at once, whatever the order, the units
and the signs; and what each format refuses."""

import os
import pickle
import shutil
import warnings
from pathlib import Path

import h5py
import numpy as np
import plane_makers as make
import pytest
import pyvista
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plane_makers import MAKERS, POINTS, SI, STEP, SURFACES, TEXTS, UP, VALUES

import torchliner as tl
from torchliner.io.planes import format_of, paths_of
from torchliner.io.points import centres_of
from torchliner.io.vtk import read_frame
from torchliner.names import PLANE_FORMATS, resolve

WANTED = np.moveaxis(VALUES[..., 1].reshape(9, 3, 4), 0, -1)
STORED = Path(__file__).parent / "stored/solver_files"
EXACT = {"powerflow netcdf3", "powerflow hdf5"}  # but for the lattice unit
NAMED = {  # the row of the table that a maker's file is of
    **dict.fromkeys(("own", "netcdf4", "hdf5"), "hdf5"),
    **dict.fromkeys(("matlab5", "packed matlab5", "matlab73"), "matlab"),
    **dict.fromkeys(("foam vtp", "foam raw"), "openfoam-surfaces"),
    **dict.fromkeys(EXACT, "powerflow"),
    **dict.fromkeys(("histories", "listed histories"), "csv"),
    "probes": "openfoam-probes",
}


def made(name, folder, *more, **about):
    """A file of the table, in a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return MAKERS[name](folder, *more, **about)


def row_of(path):
    """The first row of the table that recognises a path."""
    head = b"" if path.is_dir() else path.read_bytes()[:4096]
    return next((row for row, home in PLANE_FORMATS.items() if resolve(home).recognises(path, head)), None)


def refused(path, match, error=ValueError, **stated):
    with pytest.raises(error, match=match) as caught:
        tl.read_plane(path, **stated)
    return str(caught.value)


@pytest.mark.parametrize("name", MAKERS)
def test_a_plane_in_is_the_plane_out(tmp_path, name):
    """To the bit, or to the digits of text; its slabs, here and in another process, are the whole."""
    values = VALUES.copy()
    values[7, 5] = np.nan
    path, stated = made(name, tmp_path, values)
    assert row_of(path) == NAMED.get(name, name if name in PLANE_FORMATS else "vtk")
    found, lazy = tl.read_plane(path, **stated), tl.read_plane(path, lazy=True, **stated)
    wanted = WANTED.copy()
    wanted[1, 1, 7] = np.nan
    rounding = 3e-7 if name in EXACT | TEXTS.keys() else 0
    assert np.allclose(found.velocity, wanted, rtol=rounding, atol=rounding, equal_nan=True)
    assert found.velocity.dtype == torch.float32
    assert np.allclose(found.x, make.X, atol=1e-9)
    assert np.allclose(found.z, make.Z, atol=1e-9)
    if name not in EXACT:
        assert found.sampling_rate == pytest.approx(1 / STEP)
        assert found.start == 0
    again = pickle.loads(pickle.dumps(lazy))
    for begin, end in ((0, 9), (2, 5), (8, 9), (6, 99)):
        for part in (lazy, again):
            assert torch.equal(part.read(begin, end).nan_to_num(7), found.read(begin, end).nan_to_num(7))
    assert isinstance(lazy.velocity, torch.Tensor) == (name not in EXACT | make.VARIABLES.keys())  # imported at once
    assert torch.equal(lazy.load().velocity.nan_to_num(7), found.velocity.nan_to_num(7))


@pytest.mark.parametrize("name", [name for name in make.VARIABLES if name != "own"])
@pytest.mark.parametrize("order", [("z", "x", "time"), ("x", "time", "z"), ("time", "x", "z"), ("x", "z", "time")])
@pytest.mark.parametrize("dtype", ["f8", ">f4"])
def test_order_of_axes_and_bytes_does_not_matter(tmp_path, name, order, dtype):
    if name == "zarr" and dtype == ">f4":
        return
    path, stated = made(name, tmp_path, VALUES.astype(dtype), order=order)
    for lazy in (False, True):
        found = tl.read_plane(path, lazy=lazy, **stated).load()
        assert np.array_equal(found.velocity, WANTED)
        assert found.velocity.dtype == (torch.float64 if dtype == "f8" else torch.float32)


@pytest.mark.parametrize("name", [name for name in SURFACES | TEXTS if name not in make.FIXED])
def test_order_of_points_does_not_matter(tmp_path, name):
    order = np.random.default_rng(0).permutation(12)
    path, stated = made(name, tmp_path, VALUES[:, order], POINTS[order])
    found = tl.read_plane(path, **stated)
    assert np.allclose(found.velocity, WANTED, atol=3e-7)
    assert found.provenance["normal"] == "y"
    assert found.provenance["normal_coordinate"] == pytest.approx(1e-3)
    down = tl.read_plane(path, **stated | {"normal": "-y"})
    assert torch.equal(down.velocity, -found.velocity)
    if name == "listed histories":  # named as a component
        return
    turned = VALUES if name == "histories" else VALUES[..., [1, 0, 2]]
    path, stated = made(name, tmp_path / "side", turned, POINTS[:, [1, 0, 2]])
    wanted = tl.read_plane(path, **stated | {"normal": "x"}).velocity
    assert np.allclose(wanted, WANTED, atol=3e-7)
    refused(path, "extend over .* state normal='y' or another", **stated | {"normal": None})


@pytest.mark.parametrize("name", [name for name in MAKERS if name not in ("probes", *EXACT, "foam vtp", "foam raw")])
def test_units_and_signs(tmp_path, name):
    if name in ("histories", "listed histories"):
        path, stated = made(name, tmp_path)
        unit = {"[m/s]": "[mm/s]"} if name == "histories" else {"[m/s]": "[mm/s]", "[ms]": "[us]"}
        for old, new in unit.items():
            path.write_text(path.read_text().replace(old, new))
        assert np.allclose(1e3 * tl.read_plane(path, **stated).velocity, WANTED, atol=1e-5)
        return
    path, stated = made(name, tmp_path)
    if name in ("own", "netcdf4", "netcdf3", "zarr", "hdf5"):
        assert np.array_equal(tl.read_plane(path, **stated, velocity_units="m/s").velocity, WANTED)
        refused(path, "by its own words, not in mm/s|mm/s", **stated, velocity_units="mm/s")
        return
    scaled = tl.read_plane(path, **stated | {"velocity_units": "mm/s", "length_units": "mm"})
    assert np.allclose(1e3 * scaled.velocity, WANTED, atol=1e-6)
    assert np.allclose(1e3 * scaled.x, make.X)
    turned = tl.read_plane(path, **stated | {"normal": "-y"})
    assert np.array_equal(turned.velocity, -WANTED)
    refused(path, "(no units attribute|no unit of velocity.*--velocity-units)", **stated | {"velocity_units": None})


@pytest.mark.parametrize("name", SURFACES)
def test_values_on_faces(tmp_path, name):
    path, stated = made(name, tmp_path, VALUES[:, :6])
    found = tl.read_plane(path, **stated)
    assert np.allclose(found.velocity.flatten(0, 1).T, VALUES[:, :6, 1], atol=3e-7)
    assert found.probe_shape == (2, 3)
    assert np.allclose(found.x, make.X[:-1] + 5e-3)
    if name != "foam raw":
        assert np.allclose(found.area, 5e-5)
        assert found.provenance.get("values", "faces") == "faces"


@pytest.mark.parametrize("name", ["vtp", "foam vtp", "foam raw", "vtkhdf", "pvd"])
@pytest.mark.parametrize("faces", [False, True])
def test_points_that_move_or_change_places_are_refused(tmp_path, name, faces):
    values = VALUES[:, :6] if faces else VALUES
    path, stated = made(name, tmp_path / "a", values)
    turned, _ = made(name, tmp_path / "b", values[:, ::-1], POINTS[::-1].copy())
    if name == "vtkhdf":
        assert torch.equal(tl.read_plane(turned, **stated).velocity, tl.read_plane(path, **stated).velocity)
        return
    root, other = (each if each.is_dir() else each.parent for each in (path, turned))
    pattern = "*/*" if name.startswith("foam") else "*.vtp"
    file = max(each.relative_to(root) for each in root.glob(pattern))
    shutil.copy(other / file, root / file)
    refused(path, "points or faces are others, or in another order", **stated)


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "is empty"), (b"hello\nworld", "begins with b'hello"), (b"\0\1\2\3", r"b'\\x00\\x01")],
)
def test_what_nobody_recognises_is_described(tmp_path, content, message):
    (tmp_path / "a.bin").write_bytes(content)
    refused(tmp_path / "a.bin", f"a.bin .*{message}.*of no format .*netCDF-3", OSError)
    (tmp_path / "folder").mkdir()
    refused(tmp_path / "folder", "is a folder of nothing ...; it is of no format", OSError)
    path, _ = made("netcdf3", tmp_path / "b")
    refused(path, "netCDF-3, which says group itself or has none", group="run")
    refused(path, "unexpected keyword argument 'varable'", TypeError, varable="v")
    assert paths_of([path, path]) == [path, path]


# Mutated bytes


MUTATED = [name for name in MAKERS if name != "zarr" and (name not in SURFACES or name in (*EXACT, "vtp", "vtp ascii"))]


@pytest.mark.parametrize("name", MUTATED)
def test_mutated_bytes_are_errors_or_answers(tmp_path_factory, name):
    """A clear error that names the file, or a plane; no other exception. (HDF5 of VTK may crash VTK.)"""
    path, stated = made(name, tmp_path_factory.mktemp("mutated"))
    file = path / "0/U" if path.is_dir() else path.with_stem("plane_05") if name in SURFACES and "vtp" in name else path
    clean = file.read_bytes()

    @settings(max_examples=40, suppress_health_check=[*HealthCheck])
    @given(st.integers(8, min(len(clean), 6000) - 1), st.integers(1, 255), st.booleans())
    def mutate(at, change, cut):
        content = bytearray(clean[:at] if cut else clean)
        if not cut:
            content[at] ^= change
        file.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                tl.read_plane(path, **stated)
            except (OSError, ValueError) as error:
                assert path.name in str(error) or file.name in str(error), error  # noqa: PT017

    mutate()


@pytest.mark.parametrize("keep", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("name", ["netcdf3", "npy", "matlab5", "packed matlab5", "matlab73"])
def test_a_truncated_file_is_named(tmp_path, name, keep):
    path, stated = made(name, tmp_path, np.tile(VALUES, (16, 1, 1)))
    whole, lazy = path.read_bytes(), tl.read_plane(path, lazy=True, **stated)
    path.write_bytes(whole[: int(keep * len(whole))])
    refused(path, path.name, (OSError, ValueError), **stated)
    with pytest.raises(OSError, match=rf"{path.name}.* cannot be read from .* the file shrank"):
        lazy.read(0, 9)


def test_a_pipe_behind_a_link_or_in_a_store_does_not_hang(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    path, _ = made("netcdf4", tmp_path / "a")
    for target in ("pipe", str(tmp_path / "pipe")):
        with h5py.File(tmp_path / "b.h5", "w") as file, h5py.File(path) as other:
            other.copy("time", file)
            file["v"] = h5py.ExternalLink(target, "/v")
        refused(tmp_path / "b.h5", "pipe is a device or a pipe", OSError)
    folder, _ = made("zarr", tmp_path / "c")
    chunk = next(each for each in folder.rglob("*/c/*") if each.is_file())
    chunk.unlink()
    os.mkfifo(chunk)
    refused(folder, f"{chunk.name} is a device or a pipe", OSError)


def test_a_file_that_is_replaced_while_it_is_read(tmp_path):
    values = np.random.default_rng(0).normal(size=(3, 9000)).astype("f4")
    plane = tl.VelocityPlane(values, sampling_rate=50e3, frequency=1000.0)
    plane.write(tmp_path / "a.h5")
    lazy = tl.read_plane(tmp_path / "a.h5", lazy=True)

    def replace(samples):
        plane.write(tmp_path / "b.h5")
        (tmp_path / "b.h5").rename(tmp_path / "a.h5")

    with pytest.raises(OSError, match=r"a.h5:/wall_normal_velocity was changed while it was read"):
        tl.educe(lazy, tl.load_liner("onera"), progress=replace, averaging="phase-locked", interval=None)


def test_what_solvers_wrote():
    """OpenFOAM v1912 states four times the bytes of its binary .vtp; ParaView has U on points and on cells; EnSight."""
    stated = SI | UP | {"sampling_rate": 5e4}
    found = {kind: tl.read_plane(STORED / kind, **UP) for kind in ("vtp", "legacy_binary", "legacy", "raw")}
    assert torch.equal(found["vtp"].velocity, found["legacy_binary"].velocity)
    found["ensight"] = tl.read_plane(STORED / "ensight/y1.case", **SI | UP)
    for each in found.values():
        assert torch.allclose(each.velocity, found["vtp"].velocity, atol=1e-5)
        assert each.sampling_rate == pytest.approx(5e4)
    refused(STORED / "ensight/y1.case", "no unit of velocity", normal="y")
    of_cells = [tl.read_plane(STORED / f"paraview/slice_0{ending}", **stated) for ending in (".vtp", ".vtk")]
    assert {plane.provenance["values"] for plane in of_cells} == {"faces"}
    assert torch.equal(*(plane.velocity for plane in of_cells))
    saturne = STORED / "code_saturne/probes_Velocity[Y].csv"
    table = np.loadtxt(saturne, delimiter=",", skiprows=1)
    points = STORED / "code_saturne/probes_coords.csv"
    of_table = tl.read_plane(saturne, points=points, **stated).velocity.reshape(6, -1).T
    assert np.allclose(of_table, table[:, 1:], rtol=1e-6)
    assert tl.read_plane(STORED / "probes", **UP).samples > 2
    wrong = (
        ("code_saturne/probes_Pressure.csv", stated | {"points": points}),
        ("probes", UP | {"variable": "p"}),
        ("probes/0/p", UP),
    )
    for path, more in wrong:
        refused(STORED / path, "(names no velocity|no direction).*--wall-normal-component", **more)
        assert tl.read_plane(STORED / path, **more, wall_normal_component=True).samples > 2


def test_names_of_files_that_speak_of_pressure(tmp_path):
    stated = {"axes": ["time", "x"], "velocity_units": "m/s", "sampling_rate": 1e3}
    for name in ("high_pressure_run", "fan_pressure_ratio", "pressure"):
        np.save(tmp_path / f"{name}.npy", np.zeros((8, 3)))
    refused(tmp_path / "pressure.npy", "names no velocity", **stated)
    assert tl.read_plane([tmp_path / "high_pressure_run.npy"], **stated).samples == 8
    assert tl.read_plane(tmp_path / "fan_pressure_ratio.npy", **stated).samples == 8


@pytest.mark.parametrize(
    ("name", "read"),
    [("y-velocity", True), ("v.y", True), ("W", False), ("vel_y", True), ("pressure", False), ("U_y", True)],
)
def test_one_value_a_point_names_its_direction(tmp_path, name, read):
    path, stated = make.numbered(tmp_path, ".vti", lambda frame: make.image(frame, name), VALUES[..., 1])
    stated |= {"variable": name}
    if not read:
        refused(path, rf"plane_00.vti:/{name} has one value a point.*--wall-normal-component", **stated)
        stated["wall_normal_component"] = True
    assert np.array_equal(tl.read_plane(path, **stated).velocity, WANTED)


def edit(change):
    return lambda path: path.write_text(change(path.read_text()))


def replaced(old, new, count=-1):
    return edit(lambda words: words.replace(old, new, count))


def hdf5(change):
    def changed(path):
        with h5py.File(path, "r+") as file:
            change(file["VTKHDF"])

    return changed


def unwritten(group):
    """Values of which no chunk was written, as after a run that was broken off."""
    shape, kind = group["PointData/U"].shape, group["PointData/U"].dtype
    del group["PointData/U"]
    group.create_dataset("PointData/U", shape, kind, chunks=(4, *shape[1:]))


def restart(values, first, points=POINTS, time="3e-05"):
    return lambda path: make.probes(path.parent, values, points, first, time=time)


def fewer():
    mesh = pyvista.PolyData(POINTS[:8])
    mesh.point_data["U"] = VALUES[5, :8]
    return mesh


def side(path):
    shutil.copy(path / "0/top.vtp", path / "0/side.vtp")


OTHER = VALUES[3:].copy()
OTHER[1, 7, 1] += 0.25
IN_U = {"file": "0/U"}
QUIRKS = [
    # maker, what is done to the file, what is stated beside, the refusal
    ("histories", replaced("1.0", "x", 1), {}, "could not convert|no number"),
    ("histories", replaced("# x, 0, 0.01", "# x, 0, O.01"), {}, "11 numbers in 12 cells as x"),
    ("histories", replaced("\n5e-05 ", "\n6.5e-05 "), {}, "not uniform|out of order"),
    ("histories", edit(lambda t: "".join(r for r in t.splitlines(True) if r[:5] != "5e-05")), {}, "lacks 1 frames"),
    ("histories", replaced("p3 [m/s]", "p3 [mm/s]"), {}, "are in m/s, mm/s; one unit"),
    ("histories", replaced("# time [s]", "# time"), {}, r"no unit; write 'time \[s\]'"),
    ("histories", replaced("# x, ", "#% x, "), {}, "line 1 looks like coordinates or data: '% x, 0, 0.01"),
    ("histories", edit(lambda t: "remark\n" + t), {}, "line 1 looks like coordinates or data: 'remark"),
    ("histories", edit(lambda t: t.partition("\n")[2]), {}, "0 numbers in 0 cells as x"),
    ("histories", replaced("\n3e-05 ", "\n3e-05 1.5 "), {}, "changed from 13 to 14 at row 4; 13 numbers a row"),
    ("histories", None, {"length_units": None}, "states no unit of length.*--length-units"),
    ("histories", None, {"sampling_rate": 5e3}, "its times are at .* states 5000 Hz"),
    ("listed histories", None, {"normal": "x"}, "is the velocity along y, but normal is 'x'"),
    ("listed histories", replaced(";p11 [m/s]", ""), {}, "names 11 columns .* first row has 12"),
    ("listed histories", replaced("p3 [m/s]", "iter [m/s]"), {}, "columns behind the time, of p, iter"),
    ("listed histories", replaced("p", "pressure_"), {}, "'pressure' names no velocity"),
    ("listed histories", replaced(".", ","), {}, "could not convert string '-2,5557'"),
    ("probes", replaced("(0.02 0.001 0)", "(0.02 0.001)"), IN_U, "numbers no probes"),
    ("probes", edit(lambda t: t.split("\n        ")[0] + "\n"), IN_U, "no row of numbers"),
    ("probes", None, {"normal": "x"}, r"9 of 12 points stand above others, x = 0 to 0\.03 m"),
    ("probes", None, {"variable": "T"}, "no 'T' in the folders of its times; there are: U"),
    ("probes", restart(OTHER, 3), {}, r"6 samples of .* from 3e-05 s on.* up to 0\.25 m/s.*--overlap"),
    ("probes", restart(VALUES, 11), {}, "2 samples of .* are missing between"),
    ("vtp", lambda p: make.save(fewer(), p.with_stem("plane_05")), {}, "plane_05.vtp has 8 values"),
    ("vtp", lambda p: p.with_stem("plane_05").write_text("<VTKFile>"), {}, "VTK cannot read all|nothing that VTK"),
    ("vtp", None, {"normal": None, "length_units": None}, "no unit of length.*--length-units m"),
    ("vtp", lambda p: make.save(fewer(), p.with_name("one_0.vtp")), {"file": ".."}, "series one_, plane_; n"),
    ("vtp", None, {"variable": "UU"}, "has no variable 'UU'.* it holds .*U.*name the velocity"),
    ("pvd", lambda p: (p.parent / "p3.vtp").unlink(), {}, "p3.vtp' is invalid or does not exist"),
    ("pvd", replaced("2e-05", "1e-05"), {}, "all.pvd has 2 blocks"),
    ("vtkhdf", hdf5(lambda g: g["Steps/PointDataOffsets/U"].__setitem__(8, 100)), {}, "VTK cannot read all of"),
    ("vtkhdf", hdf5(unwritten), {}, "PointData/U: .* chunks were never written"),
    ("foam vtp", lambda p: shutil.rmtree(p / "4e-05"), {}, "lacks 1 frames.*after sample 3"),
    ("foam vtp", side, {}, "surfaces side, top; .* name one as group"),
    ("foam vtp", side, {"group": "side"}, "8 of 9 times, 1e-05.*, have no surface 'side'"),
    ("netcdf4", None, {"variable": "vv"}, r"has no variable 'vv' \(did you mean 'v'\?\)"),
    ("npy", None, {"sampling_rate": None}, "give sampling_rate=..., in Hz"),
    ("npy", None, {"axes": "time,y,x"}, "a plane has x and z, or one row .*take one height"),
]


@pytest.mark.parametrize(("name", "change", "stated", "message"), QUIRKS, ids=range(len(QUIRKS)))
def test_faults_are_refused_with_their_place(tmp_path, name, change, stated, message):
    path, more = made(name, tmp_path)
    inside = stated.get("file", "")
    if change is not None:
        change(path / inside if inside not in ("", "..") else path)
    path = path.parent if inside == ".." else path
    more = more | {key: value for key, value in stated.items() if key != "file"}
    said = refused(path, message, (ValueError, OSError), **more)
    assert str(tmp_path) in said or "need" in said or "one of" in said


def test_zstd_is_refused_before_units_are_asked_for(tmp_path):
    path, _ = make.of_frames(".vtp", packer="ZLib")(tmp_path)
    for file in tmp_path.glob("*.vtp"):
        file.write_bytes(file.read_bytes().replace(b"vtkZLibDataCompressor", b"vtkZstdDataCompressor"))
    refused(path, "VTK cannot read all of .*plane_00.vtp")
    path, _ = made("vtp lz4", tmp_path / "lz4")
    refused(path, "no unit of velocity")


# Histories

HEADINGS = {
    "coordinates": [*make.coordinates(), "# " + make.names()],
    "coordinates with units": [line.replace(",", " [mm],", 1) for line in make.coordinates(scale=1e3)]
    + ["# " + make.names()],
    "unit line": ["# length_unit = mm", "# velocity_unit = m/s", *make.coordinates(scale=1e3), "# time [s] p"],
}


@pytest.mark.parametrize("heading", HEADINGS)
def test_points_in_a_heading(tmp_path, heading):
    remarks = "# run 2024 11 23", f"# seeds {'123456 ' * 11}"  # one number fewer than there are columns
    path = make.text(tmp_path / "v.csv", *remarks, *HEADINGS[heading][:-1], "# 4 blocks of 1 2 3", *make.rows())
    found = tl.read_plane(path, normal="y", length_units="m", velocity_units="m/s", sampling_rate=1 / STEP)
    assert np.allclose(found.velocity, WANTED, atol=1e-6)
    assert np.allclose(found.x, make.X)
    assert np.allclose(found.z, make.Z)


def test_lists_of_points(tmp_path):
    path, stated = make.text(tmp_path / "v.csv", *make.rows()), SI | UP | {"sampling_rate": 1 / STEP}
    lines = [f"{x:.6g} {z:.6g} {y:.6g}" for x, y, z in POINTS]
    listed = make.text(tmp_path / "points.txt", *lines[:11])
    refused(path, r"12 columns of values, its points are 11 \(.*txt\)", points=listed, **stated)
    found = tl.read_plane(path, points=make.text(listed, "x, z, y", *lines), **stated)
    assert np.allclose(found.velocity, WANTED, atol=1e-6)
    refused(path, "has 2 columns, x, y, z;", points=make.text(listed, *(line[:-6] for line in lines)), **stated)


@pytest.mark.parametrize("separator", ["\t", "  ", ";", ", "])
def test_what_parts_cells(tmp_path, separator):
    """A BOM is passed over; decimal commas are refused."""
    head, rows = "\ufeff" + make.names(separator, "time [us]"), make.rows(VALUES, separator, 1e6)
    path = make.text(tmp_path / "v.txt", head, *rows)
    assert np.allclose(tl.read_plane(path).velocity.T, VALUES[..., 1], atol=1e-6)
    commas = [row.replace(".", ",") for row in rows]
    refused(make.text(path, head, *commas), "could not convert|columns")
    if separator != ", ":
        refused(make.text(path, *commas), "could not convert", velocity_units="m/s", sampling_rate=1e5)


def test_an_index_of_pandas_is_no_time(tmp_path):
    """Where it is parted from time [s] it is passed over; where nothing names it, it is refused."""
    import pandas

    columns = {"time [s]": STEP * np.arange(9), "p0 [m/s]": VALUES[:, 0, 1], "p1 [m/s]": VALUES[:, 1, 1]}
    table = pandas.DataFrame(columns)
    path = tmp_path / "a.csv"
    for stated in ({}, {"index_label": "index"}, {"index": False}):
        table.to_csv(path, encoding="utf-8-sig", **stated)
        found = tl.read_plane(path)
        assert found.sampling_rate == pytest.approx(1 / STEP)
        assert np.allclose(found.velocity, VALUES[:, :2, 1].T, atol=1e-7)
    path.write_text(table.to_string() + "\n")
    refused(path, "its heading names 2 columns .* first row has 3")


def test_times_without_a_unit_and_a_last_row_without_end(tmp_path):
    """Whatever they count; a row that may go on is left out, and told; remarks stand where they begin."""
    for head, unit, off in (
        (make.names(), 1, 1),
        (make.names(time="time [ms]"), 1e3, 1),
        (make.names(time="t"), 7, 1.005),
    ):
        path = make.text(tmp_path / "v.csv", head, *make.rows(unit=unit)[3:])
        found = tl.read_plane(path, sampling_rate=1.005 / STEP)
        assert found.sampling_rate == pytest.approx(off / STEP)
        assert found.start == pytest.approx(3 * STEP, rel=6e-3)
    path = make.text(tmp_path / "v.csv", make.names(), make.rows()[0], " # a restart", *make.rows()[1:])
    assert tl.read_plane(path).samples == 9
    path.write_text(path.read_text()[:-4])
    with pytest.warns(tl.DataWarning, match="the last line has no end"):
        assert tl.read_plane(path).samples == 8


def test_restarts_of_probes_are_one_record(tmp_path):
    path, _ = make.probes(tmp_path / "whole")
    wanted = tl.read_plane(path, **UP).velocity
    path, _ = make.probes(tmp_path, VALUES[:5])
    make.probes(tmp_path, VALUES[3:], first=3, time="3e-05")
    with pytest.warns(tl.DataWarning, match="2 samples of .* count once"):
        assert torch.equal(tl.read_plane(path, **UP).velocity, wanted)
    make.probes(tmp_path, OTHER, first=3, time="3e-05")
    for overlap, value in (("earlier", VALUES[4, 7, 1]), ("later", OTHER[1, 7, 1])):
        with pytest.warns(tl.DataWarning, match=f"differ by up to .*the {overlap} ones count"):
            found = tl.read_plane(path, overlap=overlap, **UP).velocity
        assert found[1, 3, 4] == pytest.approx(value)
        found[1, 3, 4] = wanted[1, 3, 4]
        assert torch.equal(found, wanted)


def test_probes_outside_the_mesh_and_on_a_slope(tmp_path):
    values = VALUES.copy()
    values[:, 3] = -1e30 * 10
    path, _ = make.probes(tmp_path, values, marks=[3])
    found = tl.read_plane(path, **UP).velocity.flatten(0, 1).T
    assert found[:, 3].isnan().all()
    assert np.allclose(np.delete(found.numpy(), 3, 1), np.delete(VALUES[..., 1], 3, 1), atol=1e-6)
    path, _ = make.probes(tmp_path, points=POINTS + np.outer(POINTS[:, 0], [0, 0.01, 0]))
    with pytest.warns(tl.DataWarning, match=r"stand at y = .* of which a plane has one"):
        tl.read_plane(path, **UP)
    path, _ = make.probes(tmp_path, VALUES[:, :4], POINTS[:4])
    refused(path, "0.03 x 0 x 0 m along x, y, z.*state normal='y'")


def test_stamps_of_few_digits(tmp_path):
    """Seven digits of a late time tell steps of 1e-5 s still; a missing row is told all the same."""
    path, _ = make.probes(tmp_path, np.tile(VALUES, (5, 1, 1)))
    head, table = path.joinpath("0/U").read_text().split("Time\n")
    values = [line.split(None, 1)[1] for line in table.splitlines()]

    def stamped(times):
        rows = [f"{time:.7g} {value}\n" for time, value in zip(times, values, strict=False)]
        (path / "0/U").write_text(f"{head}Time\n{''.join(rows)}")
        return path

    late = 35 + 4e-5 * np.arange(45)
    assert tl.read_plane(stamped(late), **UP).sampling_rate == pytest.approx(2.5e4, rel=0.02)
    refused(stamped(np.delete(late, 20)), "not uniform|lacks", **UP)
    refused(stamped(np.full(9, 1.00001)), "have the same time, 1.00001 s.*timePrecision", **UP)


@pytest.mark.parametrize(
    "numbers",
    [
        [f"plane_{i * 1e-4:.6g}" for i in range(1, 25)],
        [f"plane_{i / 10:.1f}" for i in range(5, 15)],
        [f"plane_{i * 1e-5:.5e}" for i in range(5, 15)],
    ],
)
def test_frames_are_in_the_order_of_their_numbers(tmp_path, numbers):
    for i, name in enumerate(numbers):
        make.image(np.full((12, 3), float(i))).save(tmp_path / f"{name}.vti")
    stated = UP | SI | {"sampling_rate": 1 / STEP}
    for path in (tmp_path, tmp_path / f"{numbers[0]}.vti", f"{tmp_path}/*.vti"):
        assert tl.read_plane(path, **stated).velocity[0, 0].tolist() == [*range(len(numbers))]
    refused(tmp_path, "states no time.*sampling_rate", **UP, **SI)


WITHOUT = [i for i in range(20) if i not in (7, 8)]


@pytest.mark.parametrize(
    ("numbers", "times", "message"),
    [
        ([f"p_{i:03d}" for i in WITHOUT], None, "lacks 2 frames, the first 2 after sample 6"),
        ([f"p_{i / 10:g}" for i in WITHOUT], None, "lacks 2 frames, the first 2 after sample 6"),
        (["p_1", "p_01", "p_2"], None, "have the same time"),
        ([f"p_{i}" for i in range(18)], WITHOUT, "times lacks 2 frames.* after sample 6"),
        ([f"p_{i}" for i in range(3)], [0, 2, 1], "times is out of order: sample 2"),
    ],
)
def test_a_stated_rate_closes_no_gap(tmp_path, numbers, times, message):
    for i, name in enumerate(numbers):
        mesh = make.image(VALUES[0])
        if times is not None:
            mesh.field_data["Time"] = np.array([float(times[i])])
        mesh.save(tmp_path / f"{name}.vti")
    refused(tmp_path, message, **UP, **SI, sampling_rate=1 / STEP)


def test_faces_are_where_they_are(tmp_path):
    """A trapezoid's centroid and area by hand; a triangle; pixels and pixels turned; boxes have no area."""
    points = np.array([[0, 0, 0], [4, 0, 0], [2, 0, 2], [0, 0, 2], [6, 0, 3], [3, 0, 5.0]])
    centres, areas = centres_of(points, np.array([0, 1, 2, 3, 1, 4, 2]), np.array([4, 7]), "mesh")
    assert np.allclose(areas, [6, 5])
    assert np.allclose(centres, [[14 / 9, 0, 8 / 9], [4, 0, 5 / 3]])
    for kind, ring in ((11, False), (12, True)):
        x, y, z = np.meshgrid([0, 0.01, 0.02], [0, 1e-3], [0, 0.005], indexing="ij")
        corners, number = np.stack([x, y, z], -1).reshape(-1, 3), np.arange(12).reshape(3, 2, 2)
        cells = [[number[i + a, b, c] for c in (0, 1) for b in (0, 1) for a in (0, 1)] for i in (0, 1)]
        order = [0, 1, 3, 2, 4, 5, 7, 6] if ring else list(range(8))
        grid = pyvista.UnstructuredGrid(np.insert(np.array(cells)[:, order], 0, 8, 1).reshape(-1), [kind] * 2, corners)
        grid.cell_data["U"] = VALUES[0, :2]
        grid.save(tmp_path / "a.vtu")
        middle, area = read_frame(tmp_path / "a.vtu").places(True)
        assert area is None
        assert np.allclose(middle[:, 0], [0.005, 0.015])


def test_blocks_are_named(tmp_path):
    mesh = make.surface(VALUES[0])
    blocks = pyvista.MultiBlock({"a": mesh, "b": make.image(VALUES[0])})
    blocks.save(tmp_path / "b.vtm")
    with pytest.raises(ValueError, match=r"b.vtm has 2 blocks, a, b; name one \(--group\)"):
        read_frame(tmp_path / "b.vtm")
    assert len(read_frame(tmp_path / "b.vtm", "b").places(False)[0]) == 12


def test_frames_of_powerflow_are_means(tmp_path):
    """Their middle is the time; they attenuate a tone, by the mean of a sine, and that is told."""
    seconds = 0.5 * 2e-3 / 340
    path = make.store(tmp_path / "a.fnc", make.measurement(window=2))
    plane = tl.read_plane(path, **UP)
    assert plane.sampling_rate == pytest.approx(1 / (10 * seconds))
    assert plane.start == pytest.approx(5 * seconds)
    assert plane.provenance["frame_average"] == pytest.approx(2 * seconds)
    with pytest.warns(tl.DataWarning, match=r"attenuate a tone.* to 0\.9675 at 6000 Hz"):
        tl.read_plane(make.store(tmp_path / "a.fnc", make.measurement(window=8)), **UP)
    without = {name: each for name, each in make.measurement().items() if name != "voxel_scales"}
    refused(make.store(tmp_path / "a.fnc", without), "KeyError: 'voxel_scales'", **UP)


def test_surfels_say_of_which_face_they_are(tmp_path):
    variables = make.measurement(VALUES[:, :6], faces=(0, 1))
    path = make.store(tmp_path / "a.snc", variables)
    found = tl.read_plane(path, group="plane_1", **UP)
    assert np.allclose(found.velocity.T, VALUES[:, 1:6:2, 1], atol=1e-6)
    assert found.provenance["face"] == "plane_1"
    for group in ("plane_7", None):
        refused(path, "plane_0, plane_1.*name one as group", group=group, **UP)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v.pop("lx_scales"), "KeyError: 'lx_scales'"),
        (lambda v: v.update(lx_scales=(np.zeros(5), ("scales",))), "lx_scales is .*above 0"),
        (lambda v: v["end_time"][0].__setitem__(3, 50), "means over 2 to 16 time steps"),
        (lambda v: v["face"][0].__setitem__(2, 7), "2 face_names for each of 6 .*damaged"),
        (lambda v: v["first_vertex_refs"][0].__setitem__(2, 1), "does not increase"),
    ],
)
def test_faults_of_powerflow(tmp_path, change, message):
    variables = {name: (each.copy(), dims) for name, (each, dims) in make.measurement(VALUES[:, :6]).items()}
    change(variables)
    path = make.store(tmp_path / "a.fnc", variables)
    assert format_of(path).name == "PowerFLOW"
    refused(path, rf"a.fnc.*({message})", **UP)
