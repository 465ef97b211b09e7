"""From the files of others to a map: each format cold, beside a raw read of the same bytes.

    python scripts/benchmark_formats.py [--megabytes 500] [--folder DIR]

Every row educes the same velocity, in one reading, and must give the same R; text holds fewer
probes. ``convert`` stands beside ``cp``. For clusters see ``benchmark_cluster.py``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from scipy.io import netcdf_file

import torchliner as tl
from benchmark_files import ACROSS, ALONG, FREQUENCY, IN_CELL, PITCH, RATE, forget, raw_read
from torchliner.io.plane_writer import write_plane

TEXT_SHARE = 16  # of the probes that text holds
X, Z = ((np.arange(n) + 0.5) * PITCH / IN_CELL for n in (ALONG, ACROSS))


def velocity_of(samples: int) -> np.ndarray:
    """(T, z, x), m/s, from 500 different samples."""
    some = np.random.default_rng(1).normal(0, 2, (500, ACROSS, ALONG)).astype("f4")
    return np.concatenate([some] * -(-samples // 500))[:samples]


def write_hdf5(folder: Path, v: np.ndarray, chunks: tuple[int, ...] | None = None) -> list[Path]:
    path = folder / ("chunked.h5" if chunks else "contiguous.h5")
    with h5py.File(path, "w") as file:
        data = file.create_dataset("wall_normal_velocity", data=v, chunks=chunks)
        for axis, (name, values, unit) in enumerate(
            (("time", np.arange(len(v)) / RATE, "s"), ("z", Z, "m"), ("x", X, "m"))
        ):
            file[name] = values
            file[name].attrs["units"] = unit
            file[name].make_scale(name)
            data.dims[axis].attach_scale(file[name])
        data.attrs["units"] = "m/s"
    return [path]


def write_chunked(folder: Path, v: np.ndarray) -> list[Path]:
    return write_hdf5(folder, v, (16, ACROSS, ALONG))


def write_netcdf3(folder: Path, v: np.ndarray) -> list[Path]:
    path = folder / "plane.nc"
    with netcdf_file(path, "w", version=2) as file:
        axes = {"time": np.arange(len(v)) / RATE, "z": Z, "x": X}
        for name, values in axes.items():
            file.createDimension(name, len(values))
            file.createVariable(name, "f8", (name,))[:] = values
            setattr(file.variables[name], "units", "s" if name == "time" else "m")  # noqa: B010
        file.createVariable("wall_normal_velocity", "f4", tuple(axes))[:] = v
        setattr(file.variables["wall_normal_velocity"], "units", "m/s")  # noqa: B010
    return [path]


def write_vtp(folder: Path, v: np.ndarray) -> list[Path]:
    """Points and vectors of each sample, appended raw, as surfaces are sampled."""
    x, z = (np.broadcast_to(each, (ACROSS, ALONG)) for each in (X, Z[:, None]))
    points = np.stack([x, np.full_like(x, 1e-3), z], -1).astype("f4").tobytes()
    found = []
    for i, frame in enumerate(v):
        vectors = np.zeros((*frame.shape, 3), "f4")
        vectors[..., 1] = frame
        parts = [points, vectors.tobytes()]
        path = folder / f"plane_{i:05d}.vtp"
        array = '<DataArray type="Float32" Name="{}" NumberOfComponents="3" format="appended" '
        path.write_bytes(
            b'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" '
            b'byte_order="LittleEndian" header_type="UInt64"><PolyData><FieldData>'
            b'<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">'
            + f"{i / RATE!r}</DataArray></FieldData><Piece NumberOfPoints=\"{frame.size}\">"
              f"<PointData>{array.format('U')}offset=\"{8 + len(points)}\"/></PointData>"
              f"<Points>{array.format('Points')}offset=\"0\"/></Points></Piece></PolyData>"
              '<AppendedData encoding="raw">_'.encode()
            + b"".join(len(part).to_bytes(8, "little") + part for part in parts)
            + b"</AppendedData></VTKFile>"
        )  # fmt: skip
        found.append(path)
    return found


def write_csv(folder: Path, v: np.ndarray) -> list[Path]:
    path, few = folder / "histories.csv", v.reshape(len(v), -1)[:, ::TEXT_SHARE]
    x, z = (np.broadcast_to(each, (ACROSS, ALONG)).reshape(-1)[::TEXT_SHARE]
            for each in (X, Z[:, None]))  # fmt: skip
    with path.open("w") as file:
        for name, values in (("x", x), ("y", np.full_like(x, 1e-3)), ("z", z)):
            file.write(f"# {name}, {', '.join(map(repr, values.tolist()))}\n")
        file.write(f"time [s], {', '.join(f'p{i} [m/s]' for i in range(len(x)))}\n")
        np.savetxt(file, np.column_stack([np.arange(len(v)) / RATE, few]), "%.8g", ",")
    return [path]


ROWS: Sequence[tuple[str, Callable[[Path, np.ndarray], list[Path]], dict[str, Any]]] = (
    ("HDF5, contiguous", write_hdf5, {}),
    ("HDF5, tiles of 16 samples", write_chunked, {}),
    ("netCDF-3", write_netcdf3, {}),
    ("VTP, a file a sample", write_vtp,
     {"normal": "y", "velocity_units": "m/s", "length_units": "m"}),
    ("text, 1/16 of the probes", write_csv,
     {"normal": "y", "length_units": "m"}),
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=float, default=500.0, help="of velocity")
    parser.add_argument("--folder", type=Path, help="for the files; default a temporary one")
    options = parser.parse_args()
    warnings.simplefilter("ignore", tl.DataWarning)
    v = velocity_of(int(options.megabytes * 1e6 / 4 / ACROSS / ALONG) // 1000 * 1000 or 1000)
    liner, first = tl.load_liner("polito"), None
    print(f"{len(v)} samples of {ACROSS} x {ALONG} probes; {torch.get_num_threads()} threads")
    for name, write, request in ROWS:
        with tempfile.TemporaryDirectory(dir=options.folder) as own:
            paths = write(Path(own), v)
            size = sum(path.stat().st_size for path in paths)
            os.sync()
            raw, _ = cold(paths, raw_of)
            all_of_it, found = cold(paths, partial(educed, request=request, liner=liner))
            whole = found.reflection.reshape(-1)
            first = whole if first is None else first
            error = float((whole - (first if len(whole) == len(first) else first[::TEXT_SHARE]))
                          .abs().max())  # fmt: skip
            print(f"{name:28s} {size / 1e9:5.2f} GB  {all_of_it:6.2f} s  "
                  f"{size / all_of_it / 1e9:5.2f} GB/s  {100 * raw / all_of_it:4.0f} % of raw  "
                  f"R differs by {error:.1e}", flush=True)  # fmt: skip
            if write is write_hdf5:
                copies(paths[0])


def cold(paths: Sequence[Path], work: Callable[[Sequence[Path]], Any]) -> tuple[float, Any]:
    """Seconds of some work on files that are in no cache, and what it gives."""
    for path in paths:
        forget(path)
    start = time.perf_counter()
    found = work(paths)
    return time.perf_counter() - start, found


def raw_of(paths: Sequence[Path]) -> None:
    for path in paths:
        raw_read(path)


def educed(paths: Sequence[Path], request: dict[str, Any], liner: Any) -> tl.ImpedanceMap:
    plane = tl.read_plane(paths[0], lazy=True, **request)
    return tl.educe(plane, liner, FREQUENCY, averaging="admittance")


def copies(path: Path) -> None:
    """The same file by ``convert`` and by ``cp``, from cold."""
    for name, work in (
        ("cp", lambda to: subprocess.run(["cp", path, to], check=True)),
        ("convert", lambda to: write_plane(tl.read_plane(path, lazy=True), to)),
    ):
        forget(path)
        target = path.with_name(f"{name}.h5")
        start = time.perf_counter()
        work(target)
        seconds = time.perf_counter() - start
        print(f"  {name:26s} {path.stat().st_size / seconds / 1e9:12.2f} GB/s", flush=True)
        target.unlink()
        os.sync()


if __name__ == "__main__":
    main()
