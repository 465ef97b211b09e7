"""VTKHDF: surfaces, grids and steps in time."""

from __future__ import annotations

import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista
import vtk
from hypothesis import given
from hypothesis import strategies as st
from plane_files import (
    FUZZED,
    POINTS,
    QUADS,
    STEP,
    VALUES,
    X,
    Z,
    answer_or_error,
    cuts,
    mutate,
    mutations,
    opened,
    recognised,
)
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase

from torchliner.io.plane_format import PlaneRequest
from torchliner.io.vtkhdf import FORMAT

STATED = PlaneRequest(normal="y", velocity_units="m/s", length_units="m")
WANTED = {"points": VALUES[..., 1].T.reshape(3, 4, 9), "faces": VALUES[:, :6, 1].T.reshape(2, 3, 9)}


def store(path, kind="PolyData", values="points", shift=0):
    """A file by the description of the format; ``shift`` rows before the first frame."""
    with h5py.File(path, "w") as file:
        group = file.create_group("VTKHDF")
        group.attrs["Version"] = (2, 0)
        group.attrs["Type"] = np.bytes_(kind)
        steps = group.create_group("Steps")
        steps.attrs["NSteps"] = 9
        steps["Values"] = np.arange(9) * STEP
        section = "PointData" if values == "points" else "CellData"
        data = VALUES if values == "points" else VALUES[:, :6]
        if kind == "ImageData":
            group.attrs.update(
                WholeExtent=(0, 3, 0, 0, 0, 2), Origin=(0, 1e-3, Z[0]), Spacing=(0.01, 1.0, 0.005),
                Direction=np.eye(3).reshape(-1),
            )  # fmt: skip
            group[f"{section}/U"] = data.reshape(9, 3, 1, 4, 3).astype("f4")
            return path
        rows = data.shape[1]
        group[f"{section}/U"] = np.vstack([np.zeros((shift, 3)), data.reshape(-1, 3)]).astype("f4")
        steps[f"{section}Offsets/U"] = shift + rows * np.arange(9)
        steps["PartOffsets"] = np.zeros(9, int)
        steps["NumberOfParts"] = np.ones(9, int)
        steps["PointOffsets"] = np.zeros(9, int)
        steps["CellOffsets"] = np.zeros((9, 4 if kind == "PolyData" else 1), int)
        steps["ConnectivityIdOffsets"] = steps["CellOffsets"][()]
        group["NumberOfPoints"], group["Points"] = [12], POINTS
        for name in ("Vertices", "Lines", "Polygons", "Strips") if kind == "PolyData" else (".",):
            filled = name in ("Polygons", ".")
            cells = group.require_group(name)
            cells["NumberOfCells"] = [6 * filled]
            cells["Connectivity"] = QUADS.reshape(-1) if filled else np.empty(0, int)
            cells["NumberOfConnectivityIds"] = [24 * filled]
            cells["Offsets"] = 4 * np.arange(6 * filled + 1)
        if kind == "UnstructuredGrid":
            group["Types"] = np.full(6, 9, "u1")
    return path


@pytest.mark.parametrize("values", ["points", "faces"])
@pytest.mark.parametrize("kind", ["PolyData", "UnstructuredGrid"])
def test_surfaces(tmp_path, kind, values):
    """Values, places, areas and times; frames wherever Steps says that they begin."""
    path = store(tmp_path / "a.vtkhdf", kind, values, shift=5)
    assert recognised(FORMAT, path)
    plane = FORMAT.open(path, STATED)
    assert np.allclose(plane.load().velocity, WANTED[values], atol=1e-6)
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    if values == "faces":
        assert np.allclose(plane.area, 5e-5)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(3, 5), plane.load().velocity.flatten(0, 1).T[3:5])
    with h5py.File(path, "r+") as file:  # frames that stand in another order
        section = {"points": "PointData", "faces": "CellData"}[values]
        offsets = file[f"VTKHDF/Steps/{section}Offsets/U"]
        offsets[...] = offsets[()][::-1]
    assert np.allclose(opened(FORMAT, path, STATED), WANTED[values][..., ::-1], atol=1e-6)


def test_grid(tmp_path):
    plane = FORMAT.open(store(tmp_path / "a.vtkhdf", "ImageData"), STATED)
    assert np.allclose(plane.load().velocity, WANTED["points"], atol=1e-6)
    assert np.allclose(plane.x, X)
    assert np.allclose(plane.z, Z)


def test_vtk_itself_reads_what_these_tests_write(tmp_path):
    """The files are VTKHDF, not what we take for it."""
    for kind, values in (("PolyData", "points"), ("UnstructuredGrid", "faces")):
        reader = vtk.vtkHDFReader()
        reader.SetFileName(str(store(tmp_path / "a.vtkhdf", kind, values)))
        reader.Update()
        data = reader.GetOutputDataObject(0)
        assert data.GetNumberOfPoints() == 12
        assert data.GetNumberOfCells() == 6
        assert reader.GetNumberOfSteps() == 9


class Frames(VTKPythonAlgorithmBase):
    """Frames as a filter of VTK offers them to a writer."""

    def __init__(self, make):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType=make(0).GetClassName())
        self.make = make

    def RequestInformation(self, request, inputs, outputs):
        about, keys = outputs.GetInformationObject(0), vtk.vtkStreamingDemandDrivenPipeline
        for time in STEP * np.arange(9):
            about.Append(keys.TIME_STEPS(), time)
        about.Set(keys.TIME_RANGE(), [0, 8 * STEP], 2)
        if self.make(0).GetClassName() == "vtkImageData":
            about.Set(keys.WHOLE_EXTENT(), self.make(0).GetExtent(), 6)
        return 1

    def RequestData(self, request, inputs, outputs):
        about, keys = outputs.GetInformationObject(0), vtk.vtkStreamingDemandDrivenPipeline
        wanted = about.Has(keys.UPDATE_TIME_STEP())
        time = about.Get(keys.UPDATE_TIME_STEP()) if wanted else 0.0
        frame = vtk.vtkDataObject.GetData(about)
        frame.ShallowCopy(self.make(round(time / STEP)))
        frame.GetInformation().Set(vtk.vtkDataObject.DATA_TIME_STEP(), time)
        return 1


@pytest.mark.parametrize("values", ["points", "faces"])
@pytest.mark.parametrize("kind", ["PolyData", "UnstructuredGrid", "ImageData"])
def test_what_vtk_itself_writes(tmp_path, kind, values):
    """Offsets have one more than there are frames, and flat images lack an axis."""

    def frame(number):
        mesh = pyvista.ImageData(dimensions=(4, 1, 3), spacing=(0.01, 1, 0.005), origin=(0, 1e-3, Z[0]))
        if kind != "ImageData":
            mesh = pyvista.PolyData(POINTS, np.insert(QUADS, 0, 4, 1).reshape(-1))
        if kind == "UnstructuredGrid":
            mesh = mesh.cast_to_unstructured_grid()
        arrays = mesh.point_data if values == "points" else mesh.cell_data
        # The points of the image stand row by row, as those of the surfaces do.
        arrays["U"] = VALUES[number] if values == "points" else VALUES[number, :6]
        return mesh

    source, path = Frames(frame), tmp_path / "a.vtkhdf"
    writer = vtk.vtkHDFWriter()
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetWriteAllTimeSteps(True)
    writer.SetFileName(str(path))
    writer.Write()
    plane = FORMAT.open(path, STATED)
    assert np.allclose(plane.load().velocity, WANTED[values], atol=1e-6)
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    assert np.allclose(plane.x, X if values == "points" else X[:-1] + 0.005)
    if values == "faces":
        assert np.allclose(plane.area, 5e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda g: g.attrs.__setitem__("Type", np.bytes_("AMR")), "is of type 'AMR'"),
        (lambda g: g.__delitem__("Steps"), "no Steps: it is one frame"),
        (lambda g: g["Steps/Values"].__setitem__(4, 7e-5), "out of order|not uniform"),
        (lambda g: g["Steps/PointDataOffsets/U"].__setitem__(8, 100), "reach beyond: the file is"),
        (lambda g: g["Steps/NumberOfParts"].__setitem__(3, 2), "frames of 2 parts"),
        (lambda g: g.__delitem__("Points"), "Points is missing"),
        (lambda g: g.move("PointData/U", "PointData/p"), "holds p; name the velocity"),
    ],
)  # fmt: skip
def test_faults(tmp_path, change, message):
    path = store(tmp_path / "a.vtkhdf")
    with h5py.File(path, "r+") as file:
        change(file["VTKHDF"])
    with pytest.raises(ValueError, match=rf"{path}.*({message})"):
        FORMAT.open(path, STATED)


def test_frames_of_other_points(tmp_path):
    path = store(tmp_path / "a.vtkhdf")
    with h5py.File(path, "r+") as file:
        del file["VTKHDF/NumberOfPoints"]
        file["VTKHDF/NumberOfPoints"] = [12, 11]
        file["VTKHDF/Steps/PartOffsets"][4:] = 1
    with pytest.raises(ValueError, match=r"frame 4 has 11 points, the first 12"):
        FORMAT.open(path, STATED)


@pytest.mark.parametrize("given", [True, False])
def test_faces_behind_other_cells(tmp_path, given):
    """Values on cells are those of vertices, lines, faces and strips, in this order."""
    path = store(tmp_path / "a.vtkhdf", values="faces")
    with h5py.File(path, "r+") as file:
        group = file["VTKHDF"]
        for name, count in (("Vertices", 2), ("Lines", 1)):
            group[f"{name}/NumberOfCells"][0] = count
        values = np.full((9, 9, 3), 7.0)
        values[:, 3:] = VALUES[:, :6]
        for name in ("CellData/U", "Steps/CellDataOffsets/U"):
            del group[name]
        group["CellData/U"] = values.reshape(-1, 3)
        if given:
            group["Steps/CellDataOffsets/U"] = 9 * np.arange(9)
    assert np.allclose(opened(FORMAT, path, STATED), WANTED["faces"], atol=1e-6)
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Strips/NumberOfCells"][0] = 1
    with pytest.raises(ValueError, match=r"has 1 triangle strips.*triangulate"):
        FORMAT.open(path, STATED)


def test_pixels(tmp_path):
    """Corners of VTK's pixels stand row by row."""
    path = store(tmp_path / "a.vtkhdf", "UnstructuredGrid", "faces")
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Types"][:] = 8
        file["VTKHDF/Connectivity"][:] = QUADS[:, [0, 1, 3, 2]].reshape(-1)
    assert np.allclose(FORMAT.open(path, STATED).area, 5e-5)


@pytest.mark.parametrize(("times", "message"), [
    ([0, 1, 2, 3, 6, 7, 8, 9, 10], "lacks 2 frames.* after sample 3"),
    ([0, 1, 2, 2, 3, 4, 5, 6, 7], ": samples 2 and 3 have the same time"),
    ([0, 2, 1, 3, 4, 5, 6, 7, 8], "is out of order: sample 2"),
    ([8, 7, 6, 5, 4, 3, 2, 1, 0], "is out of order"),
])  # fmt: skip
def test_a_stated_rate_excuses_no_times(tmp_path, times, message):
    """Whatever steps count, they count it evenly: the first tells the start."""
    path = store(tmp_path / "a.vtkhdf")
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Steps/Values"][:] = 5 + 0.01 * np.arange(9)  # ms
    stated = replace(STATED, sampling_rate=1e5)
    assert FORMAT.open(path, stated).start == pytest.approx(5e-3)
    with h5py.File(path, "r+") as file:
        file["VTKHDF/Steps/Values"][:] = times
    with pytest.raises(ValueError, match=rf"Steps/Values ?{message}"):
        FORMAT.open(path, stated)


@pytest.mark.slow
@FUZZED
@given(marks=mutations, cut=cuts, kind=st.sampled_from(["PolyData", "ImageData"]))
def test_mutated_bytes(tmp_path_factory, marks, cut, kind):
    path = store(tmp_path_factory.mktemp("vtkhdf") / "a.vtkhdf", kind)
    clean = opened(FORMAT, path, STATED)
    mutate(path, marks, cut)
    if recognised(FORMAT, path):
        answer_or_error(FORMAT, path, STATED, "a.vtkhdf", clean)
