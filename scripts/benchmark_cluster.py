"""A large file by slices: here, by one worker, by two; what resuming costs; what 10 TB would take.

    python scripts/benchmark_cluster.py [--gigabytes 1] [--folder DIR]

The file is in the page cache (read once before): what is compared is work, not the disk. CPU
seconds stand beside, for machines that others share. Every row must give the same bits.
"""

from __future__ import annotations

import argparse
import math
import os
import time
import warnings
from pathlib import Path
from typing import Any

import torch

import torchliner as tl
from benchmark_files import PITCH, plane_file, raw_read
from torchliner.campaign.cluster import open_cluster
from torchliner.campaign.kept_parts import EVERY, SHARE, KeptParts
from torchliner.compiled import library
from torchliner.reduction.moments import Moments
from torchliner.tdibc.parts import first_part
from torchliner.tdibc.requested import Request
from torchliner.tdibc.slices import moments_in_slices, spans_of

ORDER = "probes first"  # one reading


def clocks(client: Any) -> tuple[float, float]:
    """CPU seconds of this process, and of the workers."""
    others = {} if client is None else client.run(time.process_time)
    return time.process_time(), sum(others.values())


def row(name: str, path: Path, client: Any, request: Request) -> Moments:
    """Print wall and CPU seconds of one reduction."""
    plane = tl.read_plane(path, lazy=True)
    start, before = time.perf_counter(), clocks(client)
    found = moments_in_slices(plane, request, client=client)
    wall = time.perf_counter() - start
    own, others = (after - earlier for after, earlier in zip(clocks(client), before, strict=True))
    size = path.stat().st_size
    rate, cost = size / wall / 1e9, 4e9 * (own + others) / size
    print(f"{name:28s} {wall:6.2f} s  CPU {own:6.2f} s, workers {others:6.2f} s  "
          f"{rate:5.2f} GB/s, {cost:5.2f} ns CPU a sample", flush=True)  # fmt: skip
    return found


def same(one: Moments, other: Moments) -> bool:
    """Whether all totals have the same bits."""
    pairs = zip(one.sums.groups, other.sums.groups, strict=True)
    return all(torch.equal(a.totals, b.totals) for a, b in pairs)


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=1.0, help="default 1")
    parser.add_argument("--folder", type=Path, help="for the file; default a temporary one")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    library.available()
    torch.set_num_threads(1)
    request = Request(cell_pitch=PITCH, choices={"order": ORDER})
    with plane_file(options.folder, options.gigabytes) as path:
        plane = tl.read_plane(path, lazy=True)
        spans = spans_of(plane, (0,))
        print(f"{path.stat().st_size / 1e9:.2f} GB, {plane.probes} probes, {len(spans)} slices, "
              f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")  # fmt: skip
        print(f"{'raw read, from the cache':28s} {raw_read(path):6.2f} s")
        here = row("here, one thread", path, None, request)
        kept = KeptParts(path.parent / "parts")
        kept.last = -math.inf  # as if a minute had gone by
        kept.save(1, _part(plane, request))
        size = (kept.folder / "reading1.part").stat().st_size
        print(f"  a state to resume from: {kept.took:.2f} s, {size / 1e6:.0f} MB, "
              f"every {max(EVERY, kept.took / SHARE):.0f} s at most")  # fmt: skip
        row("here, for one liner", path, None, Request(tl.load_liner("polito"), 1400.0,
                                                       choices={"order": ORDER}))  # fmt: skip
        for workers in (1, 2):
            with open_cluster(f"local:{workers}") as client:
                client.run(_warm)
                there = row(f"workers: {workers}", path, client, request)
            if not same(here, there):
                raise SystemExit("other bits")


def _part(plane: tl.VelocityPlane, request: Request) -> Any:
    """All of a record but its last block."""
    return first_part(plane, (0, plane.samples - 1), request)


def _warm() -> bool:
    import torchliner.tdibc.slices  # noqa: F401

    return library.available()


if __name__ == "__main__":
    main()
