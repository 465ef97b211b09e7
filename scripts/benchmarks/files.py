"""Whole files to their maps: rate from cold beside a raw read, memory, other formats, workers, start-up. Linux."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from benchmarks.harness import Bench, apart, row
from torchliner.campaign.cluster import open_cluster
from torchliner.engine import native
from torchliner.records.slabs import bounds_of, read_ahead

ACROSS, ALONG, RATE, TONE = 50, 548, 200e3, 1400.0
PITCH, IN_CELL = 9.9e-3, 25  # m, probes along a cell
ROUNDS = 5  # of reads of a file
X, Z = ((np.arange(count) + 0.5) * PITCH / IN_CELL for count in (ALONG, ACROSS))
TEXT_SHARE = 16  # of the probes that text holds
ONE, TWO = ("--averaging", "admittance"), ("--averaging", "phase-locked")


def write_hdf5(path: Path, samples: int, chunks: tuple[int, ...] | None = None) -> None:
    """A plane of the paper's probes, piece by piece."""
    import h5py

    rows = 2 * np.random.default_rng(1).standard_normal((500, ACROSS, ALONG), np.float32)
    with h5py.File(path, "w") as file:
        data = file.create_dataset("wall_normal_velocity", (samples, ACROSS, ALONG), "f4", chunks=chunks)
        for begin, end in bounds_of(samples, 500):
            data[begin:end] = rows[: end - begin]
        data.attrs["units"] = "m/s"
        axes = {"time": (np.arange(samples) / RATE, "s"), "z": (Z, "m"), "x": (X, "m")}
        for axis, (name, (values, unit)) in enumerate(axes.items()):
            file[name] = values
            file[name].attrs["units"] = unit
            file[name].make_scale(name)
            data.dims[axis].attach_scale(file[name])
        for name, (value, unit) in {"frequency": (TONE, "Hz"), "height": (1e-3, "m")}.items():
            file[name] = value
            file[name].attrs["units"] = unit


@contextlib.contextmanager
def plane_file(folder: Path | None, gigabytes: float) -> Iterator[Path]:
    """A contiguous file of about this size, whole periods long."""
    samples = max(1000, round(gigabytes * 1e9 / 4 / ACROSS / ALONG / 1000) * 1000)
    with tempfile.TemporaryDirectory(dir=folder) as own:
        path = Path(own) / "plane.h5"
        write_hdf5(path, samples)
        os.sync()
        yield path


def forget(paths: Sequence[Path]) -> None:
    """Ask the system to drop files from its page cache."""
    for path in paths:
        with path.open("rb") as file:
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def raw_read(paths: Sequence[Path]) -> float:
    """Seconds of a plain read of all bytes."""
    buffer, start = bytearray(1 << 20), time.perf_counter()
    for path in paths:
        with path.open("rb", buffering=0) as file:
            while file.readinto(buffer):
                pass
    return time.perf_counter() - start


def slab_read(path: Path) -> float:
    """Seconds of the slabs alone, read ahead, nothing done with them."""
    stored, start = tl.read_plane(path, lazy=True).velocity, time.perf_counter()
    for _ in read_ahead(stored, bounds_of(stored.shape[-1], 256), torch.device("cpu")):
        pass
    return time.perf_counter() - start


def command_of(*words: str) -> Callable[[], int]:
    """``torchliner`` with these words, its imports done; for ``apart``."""
    import torchliner.report.of_map
    import torchliner.velocity.educe  # noqa: F401
    from torchliner.cli.main import main

    return lambda: main(list(words))


def educe_apart(path: Path, *options: str) -> dict[str, Any]:
    """``torchliner educe`` of a file, a process of its own."""
    return apart("benchmarks.files:command_of", "educe", str(path), "--liner", "polito", "--quiet", *options)


def cold(bench: Bench) -> None:
    """A file that is in no cache, to its map. The same read may take one second or four, by the state of the system's
    free pages: so rows are repeated in turn, and the best of each is compared with the best raw read."""
    native.available()  # built before anything is timed
    with plane_file(bench.folder, 2.0) as path:
        works: dict[str, Callable[[], float]] = {
            "raw read": lambda: raw_read([path]),
            "slabs, read ahead": lambda: slab_read(path),
            "educe, one reading": lambda: educe_apart(path, *ONE)["seconds"],
            "educe, the default": lambda: educe_apart(path, *TWO)["seconds"],
        }
        found: dict[str, list[float]] = {name: [] for name in works}
        for _ in range(ROUNDS):
            for name, work in works.items():
                forget([path])
                found[name].append(work())
        size, raw = path.stat().st_size, min(found["raw read"])
        for name, times in found.items():
            best = min(times)
            rate = f"{size / best / 1e9:.2f} GB/s, {100 * raw / best:.0f} % of raw, worst {max(times):.2f} s"
            row(f"cold, {size / 1e9:.2f} GB, {name}", best, rate)


def memory(bench: Bench) -> None:
    """Peak resident memory of ``torchliner educe`` against the size of the plane, wanted below 600 MB."""
    for gigabytes in (0.25, 1.0, 4.0, 16.0) if bench.full else (0.25, 1.0):
        with plane_file(bench.folder, gigabytes) as path:
            found = educe_apart(path)
            row(
                f"educe, a file of {path.stat().st_size / 1e9:.2f} GB", found["seconds"], f"peak {found['peak']:.0f} MB"
            )


def start(bench: Bench) -> None:
    """Import and --help, best of five new processes."""
    for name, code in (
        ("import torchliner", ["-c", "import torchliner"]),
        ("import torchliner; torchliner.educe", ["-c", "import torchliner; torchliner.educe"]),
        ("torchliner --help", ["-m", "torchliner", "--help"]),
    ):
        row(name, bench.best(lambda code=code: subprocess.run([sys.executable, *code], capture_output=True), 5)[0])  # type: ignore[misc]


def write_netcdf3(path: Path, v: Any) -> None:
    """As xarray writes it."""
    v.to_dataset(name="wall_normal_velocity").to_netcdf(path, engine="scipy")


def write_frames(path: Path, v: Any) -> None:
    """A .vtp a sample, as surfaces are sampled: points and vectors, raw."""
    import pyvista

    x, z = np.meshgrid(X, Z)
    surface = pyvista.PolyData(np.stack([x, np.full_like(x, 1e-3), z], -1).reshape(-1, 3).astype("f4"))
    for i, frame in enumerate(v.values):
        vectors = np.zeros((frame.size, 3), "f4")
        vectors[:, 1] = frame.ravel()
        surface.point_data["U"] = vectors
        surface.field_data["TimeValue"] = [i / RATE]
        surface.save(path.with_name(f"plane_{i:05d}.vtp"))


def write_text(path: Path, v: Any) -> None:
    """Histories of fewer probes."""
    x, z = (each.ravel()[::TEXT_SHARE] for each in np.meshgrid(X, Z))
    few = v.values.reshape(len(v), -1)[:, ::TEXT_SHARE]
    with path.open("w") as file:
        for name, values in (("x", x), ("y", np.full_like(x, 1e-3)), ("z", z)):
            file.write(f"# {name}, {', '.join(map(repr, values.tolist()))}\n")
        file.write(f"time [s], {', '.join(f'p{i} [m/s]' for i in range(len(x)))}\n")
        np.savetxt(file, np.column_stack([v.time, few]), "%.8g", ",")


FORMATS: dict[str, tuple[str, Callable[[Path, Any], None], dict[str, Any]]] = {
    "HDF5, contiguous": ("plane.h5", lambda path, v: write_hdf5(path, len(v)), {}),
    "HDF5, tiles of 16 samples": ("plane.h5", lambda path, v: write_hdf5(path, len(v), (16, ACROSS, ALONG)), {}),
    "netCDF-3": ("plane.nc", write_netcdf3, {}),
    "VTP, a file a sample": (
        "plane_00000.vtp",
        write_frames,
        {"normal": "y", "velocity_units": "m/s", "length_units": "m"},
    ),
    "text, 1/16 of the probes": ("histories.csv", write_text, {"normal": "y", "length_units": "m"}),
}


def formats(bench: Bench) -> None:
    """From the files of others to a map, each cold; every row must give the same R."""
    import xarray

    samples = 4000 if bench.full else 1000
    rows = 2 * np.random.default_rng(1).standard_normal((500, ACROSS, ALONG), np.float32)
    axes = {
        "time": ("time", np.arange(samples) / RATE, {"units": "s"}),
        "z": ("z", Z, {"units": "m"}),
        "x": ("x", X, {"units": "m"}),
    }
    v = xarray.DataArray(np.concatenate([rows] * (samples // 500)), axes, ("time", "z", "x"), attrs={"units": "m/s"})
    liner, first = tl.load_liner("polito"), None
    for name, (file, write, request) in FORMATS.items():
        with tempfile.TemporaryDirectory(dir=bench.folder) as own:
            path = Path(own) / file
            write(path, v)
            paths = sorted(Path(own).iterdir())
            os.sync()
            forget(paths)
            raw = raw_read(paths)
            forget(paths)
            begin = time.perf_counter()
            found = tl.educe(tl.read_plane(path, lazy=True, **request), liner, TONE, averaging="admittance")
            seconds, whole = time.perf_counter() - begin, found.probes["admittance"].reflection.reshape(-1)
            first = whole if first is None else first
            error = float((whole - (first if len(whole) == len(first) else first[::TEXT_SHARE])).abs().max())
            size = sum(each.stat().st_size for each in paths)
            row(name, seconds, f"{size / 1e9:.2f} GB, {100 * raw / seconds:.0f} % of raw", error=error)


def workers(bench: Bench) -> None:
    """A file in the page cache: here, by one worker, by two; what keeping finished shares costs; the same bits."""
    native.available()
    torch.set_num_threads(1)
    with plane_file(bench.folder, 4.0 if bench.full else 1.0) as path:
        row("raw read, from the cache", raw_read([path]))

        def moments(name: str, **options: Any) -> tl.Moments:
            about: dict[str, Any] = {} if "liner" in options else {"cell_pitch": PITCH}
            begin, cpu = time.perf_counter(), time.process_time()
            found = tl.moments(tl.read_plane(path, lazy=True), averaging="admittance", **about, **options)
            seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
            row(name, seconds, f"{cpu:.2f} s CPU in this process", samples=path.stat().st_size // 4)
            return found

        here = moments("here, one thread")
        moments("here, shares kept", kept=path.parent / "parts")
        moments("here, for one liner", liner=tl.load_liner("polito"))
        for count in (1, 2):
            with open_cluster(f"local:{count}") as client:
                client.run(native.available)
                there = moments(f"workers: {count}", client=client)
            if not all(torch.equal(sums, there.sums[name]) for name, sums in here.sums.items()):
                raise SystemExit("other bits")
