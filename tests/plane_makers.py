"""The canonical plane of the contract of formats, and one function for each way to write it into files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyvista
import vtk
import xarray
from scipy.io import netcdf_file, savemat
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase

import torchliner as tl

STEP = 1e-5
X, Z = np.array([0.0, 0.01, 0.02, 0.03]), np.array([-0.005, 0.0, 0.005])
# Points z outside x, in the plane y = 1 mm, and their velocity (T, N, 3), which text tells exactly.
POINTS = np.stack([np.tile(X, 3), np.full(12, 1e-3), np.repeat(Z, 4)], 1)
VALUES = np.round(np.random.default_rng(3).normal(size=(9, 12, 3)), 4).astype("f4")
QUADS = np.array([[i, i + 1, i + 5, i + 4] for row in (0, 4) for i in range(row, row + 3)])
SI = {"velocity_units": "m/s", "length_units": "m"}
UP, NAMED = {"normal": "y"}, {"variable": "v"}
Made = tuple[Path, dict[str, Any]]


def text(path: Path, *lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


# Variables: (time, z, x)


def dataset(values=VALUES, order=("time", "z", "x"), **attributes) -> xarray.Dataset:
    """As exporters of CF netCDF write it."""
    normal = np.asarray(values)[..., 1].reshape(-1, 3, 4)
    times = STEP * np.arange(len(normal))
    coords = {"time": ("time", times, {"units": "s"})}
    coords |= {name: (name, each, {"units": "m"}) for name, each in (("z", Z), ("x", X))}
    data = xarray.DataArray(normal, dims=("time", "z", "x"), attrs={"units": "m s**-1"} | attributes)
    return xarray.Dataset({"v": data.transpose(*order)}, coords)


def own(folder: Path, values=VALUES) -> Made:
    normal = np.moveaxis(values[..., 1].reshape(-1, 3, 4), 0, -1).copy()
    tl.VelocityPlane(normal, sampling_rate=1 / STEP, x=X, z=Z).write(folder / "a.h5")
    return folder / "a.h5", {}


def netcdf4(folder: Path, values=VALUES, **more) -> Made:
    dataset(values, **more).to_netcdf(folder / "a.data", engine="h5netcdf")
    return folder / "a.data", NAMED


def netcdf3(folder: Path, values=VALUES, **more) -> Made:
    dataset(values, **more).to_netcdf(folder / "a.data", engine="scipy")
    return folder / "a.data", NAMED


def zarr(folder: Path, values=VALUES, **more) -> Made:
    dataset(values, **more).to_zarr(folder / "a.data", consolidated=False)
    return folder / "a.data", NAMED


def hdf5(folder: Path, values=VALUES, order=("time", "z", "x")) -> Made:
    """One axis of three has a name."""
    data = dataset(values, order)
    with h5py.File(folder / "a.data", "w") as file:
        for each in data.variables:
            file[each] = data[each].values
            file[each].attrs["units"] = data[each].attrs["units"]
        file["time"].make_scale("time")
        file["v"].dims[order.index("time")].attach_scale(file["time"])
    return folder / "a.data", NAMED | {"axes": order}


def npy(folder: Path, values=VALUES, order=("time", "z", "x")) -> Made:
    np.save(folder / "a.npy", dataset(values, order).v.values)
    return folder / "a.npy", SI | {"axes": ",".join(order), "sampling_rate": 1 / STEP, "x": X, "z": Z}


def matlab5(folder: Path, values=VALUES, order=("time", "z", "x"), **how) -> Made:
    arrays = {"v": dataset(values, order).v.values, "X_unique": X[None], "Z_unique": Z[None], "note": "text", "f": 7.0}
    savemat(folder / "a.mat", arrays, **how)
    return folder / "a.mat", NAMED | SI | {"axes": ",".join(order), "sampling_rate": 1 / STEP}


def packed_matlab5(folder: Path, values=VALUES, **more) -> Made:
    return matlab5(folder, values, do_compression=True, **more)


def matlab73(folder: Path, values=VALUES, order=("time", "z", "x")) -> Made:
    """HDF5 with reversed axes behind a page of text."""
    with h5py.File(folder / "a.mat", "w", userblock_size=512) as file:
        for name, each in (("v", dataset(values, order).v.values), ("X_unique", X[None]), ("Z_unique", Z[None])):
            file[name] = each.T
    with (folder / "a.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    return folder / "a.mat", NAMED | SI | {"axes": ",".join(order), "sampling_rate": 1 / STEP}


# Text


def vectors(values) -> list[str]:
    """(u v w) of each row, as OpenFOAM writes them."""
    return [f"({' '.join(f'{n:.10g}' for n in row)})" for row in values]


def probes(folder: Path, values=VALUES, points=POINTS, first=0, marks=(), time="0") -> Made:
    """OpenFOAM's, of one run."""
    lines = [
        f"# Probe {i} ({' '.join(f'{n:.6g}' for n in p)}){'  # Not Found' * (i in marks)}" for i, p in enumerate(points)
    ]
    rows = [f"{(first + i) * STEP:>13.8g}   {'   '.join(vectors(row))}" for i, row in enumerate(values)]
    text(folder / f"probes/{time}/U", *lines, "#       Probe  0  1", "#        Time", *rows)
    return folder / "probes", UP


def rows(values=VALUES, separator=" ", unit=1.0) -> list[str]:
    return [
        separator.join([f"{i * STEP * unit:.9g}", *(f"{v:.6g}" for v in row)])
        for i, row in enumerate(np.asarray(values)[..., 1])
    ]


def names(separator=" ", time="time [s]", unit=" [m/s]") -> str:
    return separator.join([time, *(f"p{i}{unit}" for i in range(12))])


def coordinates(points=POINTS, scale=1.0) -> list[str]:
    return [f"# {axis}, {', '.join(f'{n * scale:.6g}' for n in points[:, i])}" for i, axis in enumerate("xyz")]


def histories(folder: Path, values=VALUES, points=POINTS) -> Made:
    path = text(folder / "v.csv", *coordinates(points), f"# {names()}", *rows(values))
    return path, UP | {"length_units": "m"}


def listed_histories(folder: Path, values=VALUES, points=POINTS) -> Made:
    """Points in a list of their own, axes in another order, mm."""
    lines = [f"{1e3 * x:.6g}, {1e3 * z:.6g}, {1e3 * y:.6g}" for x, y, z in points]
    listed = text(folder / "points.txt", "length_unit\t=\tmm", "x, z, y", *lines)
    path = text(folder / "YVelocity.csv", names(";", "time [ms]"), *rows(values, ";", 1e3))
    return path, UP | {"points": listed}


# Surfaces, a frame after another


def surface(values, points=POINTS, name="U"):
    """A frame as pyvista has it, of twelve points or of six faces."""
    mesh = pyvista.PolyData(points, np.insert(QUADS, 0, 4, 1).reshape(-1))
    (mesh.point_data if len(values) == 12 else mesh.cell_data)[name] = values
    return mesh


def image(values, name="U"):
    mesh = pyvista.ImageData(dimensions=(4, 1, 3), spacing=(0.01, 1, 0.005), origin=(0, 1e-3, Z[0]))
    (mesh.point_data if len(values) == 12 else mesh.cell_data)[name] = values
    return mesh


def timed(mesh, i, start=0):
    mesh.field_data["TimeValue"] = np.array([start + STEP * i])
    return mesh


def numbered(folder: Path, ending: str, make: Callable[..., Any], values, times=True, **how) -> Made:
    """A file a frame."""
    for i, frame in enumerate(values):
        mesh = timed(make(frame), i) if times else make(frame)
        save(mesh, folder / f"plane_{i:02d}{ending}", **how)
    return folder / f"plane_04{ending}", UP | SI


def save(mesh, path: Path, mode="raw", packer=None) -> None:
    """A VTK file of one of the ways that its writers know."""
    if path.suffix in (".vtk", ".vtm"):
        mesh.save(path, binary=mode != "ascii")
        return
    kind = {".vtp": "PolyData", ".vtu": "UnstructuredGrid", ".vti": "ImageData", ".vts": "StructuredGrid"}
    writer = getattr(vtk, f"vtkXML{kind.get(path.suffix, 'RectilinearGrid')}Writer")()
    writer.SetFileName(str(path))
    writer.SetInputData(mesh)
    writer.SetDataMode({"ascii": 0, "binary": 1, "raw": 2, "base64": 2}[mode])
    writer.SetEncodeAppendedData(mode == "base64")
    getattr(writer, f"SetCompressorTypeTo{packer or 'None'}")()
    if packer:
        writer.SetBlockSize(192)  # several blocks
    assert writer.Write()


def of_frames(ending: str, make=surface, **how) -> Callable[..., Made]:
    def maker(folder: Path, values=VALUES, points=POINTS) -> Made:
        built = make if make is not surface else lambda frame: surface(frame, points)
        return numbered(folder, ending, built, values, **how)

    return maker


def of_collection(ending: str, inner: str = ".vtp") -> Callable[..., Made]:
    """A collection that states the times, of files that state none."""

    def maker(folder: Path, values=VALUES, points=POINTS) -> Made:
        for i, frame in enumerate(values):
            mesh = surface(frame, points)
            save(pyvista.MultiBlock([mesh]) if inner == ".vtm" else mesh, folder / f"{'qp'[i % 2]}{i}{inner}")
        listed = [(f"{'qp'[i % 2]}{i}{inner}", float(f"{i * STEP:.8g}")) for i in range(len(values))]
        tags = "".join(f'<DataSet timestep="{time!r}" part="0" file="{name}"/>' for name, time in listed)
        files = [{"name": name, "time": time} for name, time in listed]
        content = {
            ".pvd": f'<?xml version="1.0"?>\n<VTKFile type="Collection"><Collection>{tags}</Collection></VTKFile>',
            ".series": json.dumps({"file-series-version": "1.0", "files": files}),
        }
        return text(folder / f"all{ending}", content[Path(ending).suffix or ending]), UP | SI

    return maker


class Frames(VTKPythonAlgorithmBase):
    """Frames as a filter of VTK offers them to a writer."""

    def __init__(self, frames):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType=frames[0].GetClassName())
        self.frames = frames

    def RequestInformation(self, request, inputs, outputs):
        about, keys = outputs.GetInformationObject(0), vtk.vtkStreamingDemandDrivenPipeline
        times = STEP * np.arange(len(self.frames))
        for time in times:
            about.Append(keys.TIME_STEPS(), time)
        about.Set(keys.TIME_RANGE(), [0, times[-1]], 2)
        if self.frames[0].GetClassName() == "vtkImageData":
            about.Set(keys.WHOLE_EXTENT(), self.frames[0].GetExtent(), 6)
        return 1

    def RequestData(self, request, inputs, outputs):
        about, keys = outputs.GetInformationObject(0), vtk.vtkStreamingDemandDrivenPipeline
        time = about.Get(keys.UPDATE_TIME_STEP()) if about.Has(keys.UPDATE_TIME_STEP()) else 0.0
        frame = vtk.vtkDataObject.GetData(about)
        frame.ShallowCopy(self.frames[round(time / STEP)])
        frame.GetInformation().Set(vtk.vtkDataObject.DATA_TIME_STEP(), time)
        return 1


def of_vtkhdf(kind: str) -> Callable[..., Made]:
    """As VTK itself writes it."""

    def maker(folder: Path, values=VALUES, points=POINTS) -> Made:
        frames = [image(frame) if kind == "image" else surface(frame, points) for frame in values]
        frames = [frame.cast_to_unstructured_grid() for frame in frames] if kind == "grid" else frames
        source, writer = Frames(frames), vtk.vtkHDFWriter()
        writer.SetInputConnection(source.GetOutputPort())
        writer.SetWriteAllTimeSteps(True)
        writer.SetFileName(str(folder / "a.vtkhdf"))
        writer.Write()
        return folder / "a.vtkhdf", UP | SI

    return maker


def of_foam(kind: str) -> Callable[..., Made]:
    """A folder for each time."""

    def maker(folder: Path, values=VALUES, points=POINTS) -> Made:
        for i, frame in enumerate(values):
            here = folder / f"2024/planes/{i * STEP:.6g}"
            if kind == "vtp":
                here.mkdir(parents=True)
                save(surface(frame, points), here / "top.vtp")
                continue
            places = points if len(frame) == 12 else points[QUADS].mean(1)
            table = [" ".join(f"{n:.8g}" for n in row) for row in np.hstack([places, frame])]
            head = f"# U  {'POINT' if len(frame) == 12 else 'FACE'}_DATA {len(frame)}"
            text(here / "U_top.raw", head, "#  x  y  z  U_x U_y U_z", *table)
        return folder / "2024/planes", UP

    return maker


# PowerFLOW

CELL, SPEED, TICK = 2e-3, 340.0, 0.5  # lx_scales[0], [3] and [-1]
OFFSET = np.array([3.0, -2.0, 1.0])
NAMES = ("static_pressure", "x_velocity", "y_velocity", "z_velocity", "density")


def texts(words) -> np.ndarray:
    return np.frombuffer("\0".join((*words, "")).encode(), "S1")


def measurement(values=VALUES, points=POINTS, window=2, faces=(0,)) -> dict[str, tuple[np.ndarray, tuple[str, ...]]]:
    """Variables and their dimensions: cells of .fnc, or the six surfels of .snc."""
    lattice, count = points / CELL - OFFSET, values.shape[1]
    stored = np.full((len(values), 5, count), 0.3, np.float32)
    stored[:, 1:4] = np.moveaxis(values, -1, 1) / SPEED
    csys = np.zeros((1, 4, 4))
    csys[0, :3, 3] = OFFSET
    frames = 10 * np.arange(len(values))
    found = {
        "lx_scales": (np.array([CELL, 1.2, 1.0, SPEED, TICK]), ("scales",)),
        "measurements": (stored, ("nsets", "n_variables", "npoints")),
        "variable_short_names": (texts(NAMES), ("letters",)),
        "start_time": (frames + 5 - window // 2, ("nsets",)),
        "end_time": (frames + 5 + window - window // 2, ("nsets",)),
        "csys": (csys, ("ncsys", "four", "columns")),
    }
    if count == 12:
        scales = np.full(12, 1)
        corner = lattice - 0.5 * 2.0 ** (1 + scales)[:, None]
        return found | {"coords": (corner, ("npoints", "ndims")), "voxel_scales": (scales, ("npoints",))}
    return found | {
        "vertex_coords": (lattice, ("nvertices", "ndims")),
        "first_vertex_refs": (4 * np.arange(6), ("npoints",)),
        "vertex_refs": (QUADS.reshape(-1), ("nvertex_refs",)),
        "surfel_area": (np.full(6, 5e-5 / CELL**2), ("npoints",)),
        "surfel_normal": (np.tile([0.0, 1.0, 0.0], (6, 1)), ("npoints", "ndims")),
        "face_names": (texts(["plane_0", "plane_1"]), ("nfaces_letters",)),
        "face": (np.resize(faces, 6), ("npoints",)),
    }


def store(path: Path, variables, classic=True) -> Path:
    """netCDF-3, or HDF5."""
    if not classic:
        with h5py.File(path, "w") as file:
            for name, (values, _) in variables.items():
                file[name] = values
        return path
    with netcdf_file(path, "w") as file:
        for name, (values, dims) in variables.items():
            for dim, size in zip(dims, values.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            kind = "c" if values.dtype.kind == "S" else values.dtype.char.replace("l", "i")
            file.createVariable(name, kind, dims)[:] = values
    return path


def of_powerflow(classic: bool) -> Callable[..., Made]:
    def maker(folder: Path, values=VALUES, points=POINTS) -> Made:
        path = folder / ("a.fnc" if values.shape[1] == 12 else "a.snc")
        return store(path, measurement(values, points), classic), UP

    return maker


VARIABLES = {
    "own": own,
    "netcdf4": netcdf4,
    "netcdf3": netcdf3,
    "zarr": zarr,
    "hdf5": hdf5,
    "npy": npy,
    "matlab5": matlab5,
    "packed matlab5": packed_matlab5,
    "matlab73": matlab73,
}
SURFACES = {
    "vtp": of_frames(".vtp"),
    "vtp ascii": of_frames(".vtp", mode="ascii"),
    "vtp binary": of_frames(".vtp", mode="binary"),
    "vtp zlib": of_frames(".vtp", mode="base64", packer="ZLib"),
    "vtp lz4": of_frames(".vtp", packer="LZ4"),
    "vtp lzma": of_frames(".vtp", packer="LZMA"),
    "vtk": of_frames(".vtk"),
    "vtk ascii": of_frames(".vtk", mode="ascii"),
    "vtu": of_frames(".vtu", lambda frame: surface(frame).cast_to_unstructured_grid()),
    "vti": of_frames(".vti", image),
    "vts": of_frames(".vts", lambda frame: image(frame).cast_to_structured_grid()),
    "vtr": of_frames(".vtr", lambda frame: image(frame).cast_to_rectilinear_grid()),
    "pvd": of_collection(".pvd"),
    "series": of_collection(".vtp.series"),
    "vtm series": of_collection(".vtm.series", ".vtm"),
    "vtkhdf": of_vtkhdf("surface"),
    "vtkhdf grid": of_vtkhdf("grid"),
    "vtkhdf image": of_vtkhdf("image"),
    "foam vtp": of_foam("vtp"),
    "foam raw": of_foam("raw"),
    "powerflow netcdf3": of_powerflow(True),
    "powerflow hdf5": of_powerflow(False),
}
TEXTS = {"probes": probes, "histories": histories, "listed histories": listed_histories}
MAKERS: dict[str, Callable[..., Made]] = VARIABLES | SURFACES | TEXTS
FIXED = ("vtu", "vti", "vts", "vtr", "vtkhdf image")  # whose points cannot be given in another order
