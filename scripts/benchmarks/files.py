"""Whole files to their maps: rate from cold beside a raw read, memory, workers. Linux."""

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

import torchliner as tl
from benchmarks.harness import apart, row
from torchliner.engine import native
from torchliner.records.slabs import bounds_of, read_ahead

ACROSS, ALONG, RATE, TONE = 50, 548, 200e3, 1400.0
PITCH, IN_CELL = 9.9e-3, 25  # m, probes along a cell
ROUNDS = 5  # of reads of a file
X, Z = ((np.arange(count) + 0.5) * PITCH / IN_CELL for count in (ALONG, ACROSS))
ONE, TWO = ("--averaging", "admittance"), ("--averaging", "phase-locked")


@contextlib.contextmanager
def plane_file(folder: Path | None, gigabytes: float) -> Iterator[Path]:
    """A contiguous file of about this size, whole periods long."""
    samples = max(1000, round(gigabytes * 1e9 / 4 / ACROSS / ALONG / 1000) * 1000)
    with tempfile.TemporaryDirectory(dir=folder) as own:
        path = Path(own) / "plane.h5"
        rows = 2 * np.random.default_rng(1).standard_normal((500, ACROSS, ALONG), np.float32)
        with h5py.File(path, "w") as file:
            data = file.create_dataset("wall_normal_velocity", (samples, ACROSS, ALONG), "f4")
            data.attrs["units"] = "m/s"
            for begin, end in bounds_of(samples, 500):
                data[begin:end] = rows[: end - begin]
            axes = {"time": (np.arange(samples) / RATE, "s"), "z": (Z, "m"), "x": (X, "m")}
            facts = {"frequency": (TONE, "Hz"), "height": (1e-3, "m")}
            for name, (values, unit) in {**axes, **facts}.items():
                file[name] = values
                file[name].attrs["units"] = unit
            for axis, name in enumerate(axes):
                file[name].make_scale(name)
                data.dims[axis].attach_scale(file[name])
        os.sync()
        yield path


def raw_read(path: Path) -> float:
    """Seconds of a plain read of all bytes."""
    buffer, start = bytearray(1 << 20), time.perf_counter()
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


def educe_apart(path: Path, *words: str) -> tuple[float, float]:
    """``torchliner educe`` of a file, a process of its own: seconds, peak in MB."""
    return apart("benchmarks.files:command_of", "educe", str(path), "--liner", "polito", "--quiet", *words)


def cold(options: Any) -> None:
    """A file that is in no cache, to its map. The same read may take one second or four, by the state of the system's
    free pages: so rows are repeated in turn, and the best of each is compared with the best raw read."""
    native.available()  # built before anything is timed
    with plane_file(options.folder, 2.0) as path:
        works: dict[str, Callable[[], float]] = {
            "raw read": lambda: raw_read(path),
            "slabs, read ahead": lambda: slab_read(path),
            "educe, one reading": lambda: educe_apart(path, *ONE)[0],
            "educe, the default": lambda: educe_apart(path, *TWO)[0],
        }
        found: dict[str, list[float]] = {name: [] for name in works}
        for _ in range(ROUNDS):
            for name, work in works.items():
                with path.open("rb") as file:  # asks the system to drop it from its page cache
                    os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
                found[name].append(work())
        size, raw = path.stat().st_size, min(found["raw read"])
        for name, times in found.items():
            best = min(times)
            rate = f"{size / best / 1e9:.2f} GB/s, {100 * raw / best:.0f} % of raw, worst {max(times):.2f} s"
            row(f"cold, {size / 1e9:.2f} GB, {name}", best, rate)


def memory(options: Any) -> None:
    """Peak resident memory of ``torchliner educe`` against the size of the plane, wanted below 600 MB."""
    for gigabytes in (0.25, 1.0, 4.0, 16.0) if options.full else (0.25, 1.0):
        with plane_file(options.folder, gigabytes) as path:
            seconds, peak = educe_apart(path)
            row(f"educe, a file of {path.stat().st_size / 1e9:.2f} GB", seconds, f"peak {peak:.0f} MB")
