"""A large file by shares: here, by one worker, by two; what keeping finished shares costs.

    python scripts/benchmark_cluster.py [--gigabytes 1] [--folder DIR]

The file is in the page cache (read once before): what is compared is work, not the disk. CPU
seconds stand beside, for machines that others share. Every row must give the same bits.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from pathlib import Path
from typing import Any

import torch

import torchliner as tl
from benchmark_files import PITCH, plane_file, raw_read
from torchliner.campaign.cluster import open_cluster
from torchliner.engine import native


def clocks(client: Any) -> tuple[float, float]:
    """CPU seconds of this process, and of the workers."""
    others = {} if client is None else client.run(time.process_time)
    return time.process_time(), sum(others.values())


def row(name: str, path: Path, client: Any = None, liner: Any = None, kept: Path | None = None) -> tl.Moments:
    """Print wall and CPU seconds of one reading."""
    plane, pitch = tl.read_plane(path, lazy=True), PITCH if liner is None else None
    start, before = time.perf_counter(), clocks(client)
    found = tl.moments(plane, liner, cell_pitch=pitch, client=client, kept=kept, averaging="admittance")
    wall = time.perf_counter() - start
    own, others = (after - earlier for after, earlier in zip(clocks(client), before, strict=True))
    size = path.stat().st_size
    rate, cost = size / wall / 1e9, 4e9 * (own + others) / size
    print(f"{name:28s} {wall:6.2f} s  CPU {own:6.2f} s, workers {others:6.2f} s  "
          f"{rate:5.2f} GB/s, {cost:5.2f} ns CPU a sample", flush=True)  # fmt: skip
    return found


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=1.0, help="default 1")
    parser.add_argument("--folder", type=Path, help="for the file; default a temporary one")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    native.available()
    torch.set_num_threads(1)
    with plane_file(options.folder, options.gigabytes) as path:
        plane = tl.read_plane(path, lazy=True)
        print(f"{path.stat().st_size / 1e9:.2f} GB, {plane.probes} probes, "
              f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")  # fmt: skip
        print(f"{'raw read, from the cache':28s} {raw_read(path):6.2f} s")
        here = row("here, one thread", path)
        row("here, shares kept", path, kept=path.parent / "parts")
        row("here, for one liner", path, liner=tl.load_liner("polito"))
        for workers in (1, 2):
            with open_cluster(f"local:{workers}") as client:
                client.run(native.available)
                there = row(f"workers: {workers}", path, client)
            if not all(torch.equal(sums, there.sums[name]) for name, sums in here.sums.items()):
                raise SystemExit("other bits")


if __name__ == "__main__":
    main()
