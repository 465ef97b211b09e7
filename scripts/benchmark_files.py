"""Whole files: rate from cold, peak memory, start-up."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

import torchliner as tl
from torchliner.records.slabs import bounds_of, read_ahead

PROBES, RATE, FREQUENCY = 27400, 200e3, 1400.0
# The child prints its own peak, so that neither this process nor the file's pages count.
CHILD = """
import resource, sys, time, warnings
warnings.simplefilter("ignore")
import torch, torchliner as tl
plane = tl.read_plane(sys.argv[1], lazy=True)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
start = time.perf_counter()
tl.educe(plane, tl.load_liner("polito"), engine=sys.argv[2], memory=sys.argv[3] or None,
         edge=sys.argv[4], window=sys.argv[5], compile=sys.argv[6])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(before / 1024, peak / 1024, time.perf_counter() - start)
"""


@contextlib.contextmanager
def plane_file(folder: Path, gigabytes: float) -> Iterator[Path]:
    """A plane of the paper's 548 x 50 probes, as long as the size asks for."""
    import h5py

    samples = max(64, int(gigabytes * 1e9 / 4 / PROBES))
    samples -= samples % 1000 if samples > 2000 else 0  # whole periods of 1400 Hz at 200 kHz
    handle, name = tempfile.mkstemp(dir=folder, suffix=".h5")
    os.close(handle)
    path = Path(name)
    try:
        with h5py.File(path, "w") as file:
            rows = torch.randn(512, PROBES, generator=torch.Generator().manual_seed(1)).numpy() * 2
            data = file.create_dataset("wall_normal_velocity", (samples, PROBES), np.float32)
            for begin, end in bounds_of(samples, 512):
                data[begin:end] = rows[: end - begin]
            data.attrs["units"] = "m/s"
            file["time"] = np.arange(samples) / RATE
            file["time"].attrs["units"] = "s"
            file["time"].make_scale("time")
            data.dims[0].attach_scale(file["time"])
            file["frequency"] = FREQUENCY
            file["frequency"].attrs["units"] = "Hz"
        os.sync()
        yield path
    finally:
        path.unlink(missing_ok=True)


def forget(path: Path) -> None:
    """Ask the system to drop the file from its page cache."""
    with path.open("rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def raw_read(path: Path) -> float:
    """Seconds of a plain read of all bytes."""
    buffer = bytearray(1 << 25)
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


def run_child(
    path: Path, engine: str, memory: str, edge: str, window: str, compiled: str
) -> list[float]:
    """Resident memory before, its peak (MB) and seconds of an eduction in a new process."""
    command = [sys.executable, "-c", CHILD, str(path), engine, memory, edge, window, compiled]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [float(number) for number in shown.split()]


def cold_read(folder: Path) -> None:
    """A file that is in no cache, to its map."""
    with plane_file(folder, 2.0) as path:
        size = path.stat().st_size
        print(f"a file of {size / 1e9:.2f} GB, out of the page cache (survey and replay read it "
              "once each):")  # fmt: skip
        rows = [("raw read", raw_read), ("slabs, read ahead", slab_read)]
        for name, work in rows:
            forget(path)
            seconds = work(path)
            print(f"  {name:44s} {seconds:6.2f} s  {size / seconds / 1e9:5.2f} GB/s", flush=True)
        for engine, edge, window, compiled in (
            ("spectral", "wrap", "boxcar", "always"),
            ("spectral", "finite", "hann", "never"),
        ):
            forget(path)
            _, _, seconds = run_child(path, engine, "", edge, window, compiled)
            name = f"educe, {edge}, {window}, compile {compiled}"
            print(f"  {name:44s} {seconds:6.2f} s  {size / seconds / 1e9:5.2f} GB/s", flush=True)


def peak_memory(folder: Path, sizes: list[float]) -> None:
    """Peak resident memory of ``educe`` against the size of the plane."""
    print("peak resident memory above that of the imported program (MB), limit in brackets:")
    for gigabytes in sizes:
        with plane_file(folder, gigabytes) as path:
            # unfold takes minutes a gigabyte: its memory is measured on the smallest plane.
            for engine, memory in (("spectral", ""), ("spectral", "100MB"), ("unfold", "1GB")):
                if engine == "unfold" and gigabytes > 1:
                    continue
                before, peak, seconds = run_child(path, engine, memory, "finite", "hann", "never")
                size = path.stat().st_size / 1e9
                print(
                    f"  {size:6.2f} GB  {engine:9s} [{memory or 'default'}] {peak - before:7.0f}  "
                    f"(of {peak:.0f})  {seconds:7.1f} s",
                    flush=True,
                )


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
