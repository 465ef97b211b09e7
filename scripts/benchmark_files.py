"""Whole files: rate from cold beside a raw read, peak memory, start-up. Linux."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

import torchliner as tl
from torchliner.engine import native
from torchliner.records.slabs import bounds_of, read_ahead

ACROSS, ALONG, RATE, FREQUENCY = 50, 548, 200e3, 1400.0
PITCH, IN_CELL = 9.9e-3, 25  # m, probes along a cell
ROUNDS = 5  # of reads of a file
# `torchliner educe`, its imports not timed. VmHWM is the peak of this process alone: the one that
# getrusage gives begins with that of the parent.
CHILD = """
import sys, time
import torchliner.velocity.educe, torchliner.report.map_table
from torchliner.cli.main import main
start, before = time.perf_counter(), time.process_time()
code = main(sys.argv[1:])
seconds = time.perf_counter() - start, time.process_time() - before
with open("/proc/self/status") as status:
    peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
print(code, *seconds, peak / 1024)
"""


@contextlib.contextmanager
def plane_file(folder: Path | None, gigabytes: float) -> Iterator[Path]:
    """A contiguous plane of the paper's 548 x 50 probes, as long as the size asks for."""
    import h5py

    samples = max(1024, int(gigabytes * 1e9 / 4 / ACROSS / ALONG))
    samples -= samples % 1000  # whole periods of 1400 Hz at 200 kHz
    scalars = {"frequency": (FREQUENCY, "Hz"), "incident_level": (145.0, "dB"),
               "height": (1e-3, "m")}  # fmt: skip
    axes = {
        "time": (np.arange(samples) / RATE, "s"),
        "z": ((np.arange(ACROSS) + 0.5) * PITCH / IN_CELL, "m"),
        "x": ((np.arange(ALONG) + 0.5) * PITCH / IN_CELL, "m"),
    }
    with tempfile.TemporaryDirectory(dir=folder) as own:
        path = Path(own) / "plane.h5"
        rows = torch.randn(512, ACROSS, ALONG, generator=torch.Generator().manual_seed(1))
        with h5py.File(path, "w") as file:
            shape = (samples, ACROSS, ALONG)
            data = file.create_dataset("wall_normal_velocity", shape, np.float32)
            for begin, end in bounds_of(samples, 512):
                data[begin:end] = 2 * rows[: end - begin].numpy()
            data.attrs["units"] = "m/s"
            for i, (name, (values, units)) in enumerate(axes.items()):
                file[name] = values
                file[name].attrs["units"] = units
                file[name].make_scale(name)
                data.dims[i].attach_scale(file[name])
            for name, (value, units) in scalars.items():
                file[name] = value
                file[name].attrs["units"] = units
            file.attrs["source_side"] = "normal"
        os.sync()
        yield path


def forget(path: Path) -> None:
    """Ask the system to drop the file from its page cache."""
    with path.open("rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def raw_read(path: Path) -> float:
    """Seconds of a plain read of all bytes."""
    buffer = bytearray(1 << 20)
    start = time.perf_counter()
    with path.open("rb", buffering=0) as file:
        while file.readinto(buffer):
            pass
    return time.perf_counter() - start


def slab_read(path: Path) -> float:
    """Seconds of the slabs alone, read ahead, nothing done with them."""
    stored = tl.read_plane(path, lazy=True).velocity
    start = time.perf_counter()
    for _ in read_ahead(stored, bounds_of(stored.shape[-1], 256), torch.device("cpu")):
        pass
    return time.perf_counter() - start


def cpu_too(work: Callable[[Path], float]) -> Callable[[Path], tuple[float, float]]:
    """Seconds, and CPU seconds beside them."""

    def run(path: Path) -> tuple[float, float]:
        before = time.process_time()
        return work(path), time.process_time() - before

    return run


def run_child(path: Path, *options: str) -> tuple[float, float, float]:
    """Seconds, CPU seconds and peak resident memory (MB) of ``torchliner educe``, a new process.

    Raises:
        RuntimeError: it failed.
    """
    words = ["educe", str(path), "--liner", "polito", "--quiet", *options]
    command = [sys.executable, "-W", "ignore", "-c", CHILD, *words]
    # Modules compiled once, as a user has them.
    own = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=own)
    code, seconds, busy, peak = done.stdout.splitlines()[-1].split()
    if code != "0":
        raise RuntimeError(f"{' '.join(words)} ended with {code}: {done.stderr[-500:]}")
    return float(seconds), float(busy), float(peak)


def cold_read(folder: Path | None) -> None:
    """A file that is in no cache, to its map.

    The same read may take one second or four, by the state of the system's free pages: so rows are
    repeated in turn, and the best of each is compared with the best raw read.
    """
    native.available()  # built before anything is timed
    with plane_file(folder, 2.0) as path:
        size = path.stat().st_size
        once, twice = ("--averaging", "admittance"), ("--averaging", "phase-locked")
        rows: dict[str, tuple[Callable[[Path], tuple[float, float]], str]] = {
            "raw read": (cpu_too(raw_read), ""),
            "slabs, read ahead": (cpu_too(slab_read), ""),
            "educe, one reading": (lambda p: run_child(p, *once)[:2], ", wanted 90"),
            "educe, the one rule": (lambda p: run_child(p, *twice)[:2], ", wanted 45"),
        }
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in rows}
        for _ in range(ROUNDS):
            for name, (work, _) in rows.items():
                forget(path)
                found[name].append(work(path))
        print(f"a file of {size / 1e9:.2f} GB, out of the page cache before each read, the best of "
              f"{ROUNDS}:")  # fmt: skip
        raw = min(found["raw read"])[0]
        for name, times in found.items():
            seconds, busy = min(times)
            print(f"  {name:24s} {seconds:6.2f} s (CPU {busy:5.2f} s, worst {max(times)[0]:5.2f} s)"
                  f"  {size / seconds / 1e9:5.2f} GB/s  {100 * raw / seconds:4.0f} % of raw"
                  f"{rows[name][1]}")  # fmt: skip


def peak_memory(folder: Path | None, sizes: Sequence[float]) -> None:
    """Peak resident memory of ``torchliner educe`` against the size of the plane, GB."""
    print("peak resident memory of `torchliner educe`, all of it, wanted below 600 MB:")
    for gigabytes in sizes:
        with plane_file(folder, gigabytes) as path:
            seconds, _, peak = run_child(path)
            print(f"  {path.stat().st_size / 1e9:6.2f} GB  {peak:5.0f} MB  {seconds:6.1f} s", flush=True)


def start_up() -> None:
    """Import and --help, best of five new processes."""
    for name, code in (
        ("import torchliner", ["-c", "import torchliner"]),
        ("import torchliner; torchliner.educe", ["-c", "import torchliner; torchliner.educe"]),
        ("torchliner --help", ["-m", "torchliner", "--help"]),
    ):
        seconds = []
        for _ in range(5):
            start = time.perf_counter()
            subprocess.run([sys.executable, *code], capture_output=True, check=True)
            seconds.append(time.perf_counter() - start)
        print(f"{name:40s} {min(seconds):6.2f} s", flush=True)
