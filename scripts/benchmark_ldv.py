"""Time of a laser Doppler line: a station of 10 s on a grid of 51 kHz, part of ``benchmark.py``."""

from __future__ import annotations

import functools
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import torchliner as tl

STATION, BURSTS, GRID, TONE = 10.0, 250_000, 51e3, 1500.0  # s, a station, Hz, Hz
LINE = 120  # stations of the paper's line


def _bursts(seed: int) -> tl.BurstRecord:
    generator = np.random.default_rng(seed)
    times = np.sort(generator.uniform(0, STATION, BURSTS))
    slow = np.interp(times, np.linspace(0, STATION, 40_000), generator.standard_normal(40_000))
    velocity = 1.5 * slow + 1.0 * np.cos(2 * np.pi * TONE * times)
    return tl.BurstRecord(times, wall_normal=velocity, x=1e-3 * seed, y=1e-3, z=0.0,
                          frequency=TONE)  # fmt: skip


def _one_by_one(line: tl.ImpedanceLine, record: tl.BurstRecord, liner: Any) -> float:
    """Error of the batch against segments that are educed one after another in a loop."""
    signal = tl.onto_grid(record.arrival_time, record.wall_normal, GRID)
    length, worst = round(GRID), 0.0
    for i in range(int(line.segments[0])):
        begin = i * (length // 2)
        piece = signal.values[begin : begin + length]
        plane = tl.VelocityPlane(piece[None], sampling_rate=GRID, frequency=TONE)
        alone = tl.educe(plane, liner, averaging="admittance", interval=None).probes["admittance"].reflection[0, 0]
        worst = max(worst, abs(complex(line.reflection[0, i, 0] - alone)))
    return worst


def _timed(work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    spent, found = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        found = work()
        spent.append(time.perf_counter() - start)
    return min(spent), found


def stations() -> None:
    """A station in memory, from text and from HDF5; the loop over segments; memory of a line."""
    warnings.simplefilter("ignore")
    liner = tl.load_liner("onera")
    record = _bursts(1)
    choices: dict[str, Any] = {"grid_rate": GRID, "flagged": "use", "correction": "none"}
    educe = functools.partial(tl.educe_bursts, [record], liner, **choices)
    seconds, line = _timed(educe)
    count = int(line.segments[0])
    print(f"laser Doppler station: {BURSTS} bursts, {STATION:g} s, {GRID:g} Hz, {count} segments "
          "of 1 s; the paper: about 1 s 'per case'")  # fmt: skip

    def row(name: str, spent: float, note: str = "") -> None:
        print(f"  {name:44s} {spent:7.3f} s  {1e3 * spent / count:7.1f} ms a segment  "
              f"{note}", flush=True)  # fmt: skip

    row("averaged phase, nothing corrected", seconds)
    begin = time.perf_counter()
    worst = _one_by_one(line, record, liner)
    row("the same in a loop over segments", time.perf_counter() - begin, f"differs by {worst:.0e}")
    row("tone corrected", _timed(functools.partial(educe, correction="tone"))[0])
    row("self-consistent, tone corrected", _timed(
        functools.partial(educe, correction="tone", phase="self-consistent"))[0])  # fmt: skip
    row("band-limited reconstruction", _timed(
        functools.partial(educe, correction="tone", method="band-limited"), 1)[0])  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".h5", ".csv"):
            path = Path(folder) / f"station{suffix}"
            record.write(path)
            from_file = functools.partial(tl.educe_bursts, path, liner, **choices)
            row(f"from a {suffix} file of {path.stat().st_size / 1e6:.1f} MB",
                _timed(from_file, 1)[0])  # fmt: skip
    _memory(liner, choices)


def _memory(liner: Any, choices: dict[str, Any]) -> None:
    """Six stations may take no more than one."""
    with tempfile.TemporaryDirectory() as folder:
        for i in range(6):
            _bursts(i).write(Path(folder) / f"s{i}.h5")
        tl.educe_bursts(Path(folder) / "s0.h5", liner, **choices)
        before = _peak()
        line = tl.educe_bursts(folder, liner, **choices)
        print(f"  peak memory of 6 stations from files: {1e-6 * (_peak() - before):.0f} MB above "
              f"that of one; the result is {1e-3 * line.reflection.nbytes / 6:.1f} kB a station, "
              f"{1e-6 * LINE * line.reflection.nbytes / 6:.2f} MB for {LINE}")  # fmt: skip


def _peak() -> float:
    """Largest resident size so far, bytes."""
    import resource

    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
