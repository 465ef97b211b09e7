"""Times of what is read off the moments: error bars, the audit, a calibration."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import torchliner as tl
from common import case_files
from torchliner.liners.model import LinerModel

# Choices whose rows an audit has, as runs of their own.
ALONE: tuple[dict[str, Any], ...] = (
    {},
    {"mean": "removed"},
    {"drive": "rms"},
    {"drive": "running-rms"},
    {"phase": "self-consistent"},
)
FREE = {"vena_contracta": (0.3, 1.0), "offset_resistance": (-0.2, 0.2),
        "offset_reactance": (-0.5, 0.6), "porosity": (0.01, 0.5),
        "cavity_depth": (5e-3, 0.1)}  # fmt: skip


Clock = Callable[[], float]  # seconds, of the wall or of the processor


def timed(run: Callable[[], Any], clock: Clock) -> tuple[float, Any]:
    """Seconds of the second of two runs."""
    run()
    start = clock()
    found = run()
    return clock() - start, found


def error_bars(plane: tl.VelocityPlane, liner: LinerModel, clock: Clock) -> None:
    """``educe`` with and without intervals."""
    print("error bars: ns per velocity sample, and per probe")
    for name, level in (("educe without intervals", None), ("educe, 95 % intervals", 0.95)):
        seconds, _ = timed(functools.partial(tl.educe, plane, liner, interval=level), clock)
        each = 1e9 * seconds / plane.probes / plane.samples
        print(f"  {name:44s} {each:8.1f} ns  {1e6 * seconds / plane.probes:8.1f} us", flush=True)


def audit_rows(plane: tl.VelocityPlane, liner: LinerModel, clock: Clock) -> None:
    """The audit of one plane against an ``educe`` for each of some of its rows."""
    seconds, audited = timed(lambda: tl.audit(plane, liner), clock)
    start = clock()
    alone = [complex(tl.educe(plane, liner, interval=None, **choices).answer[0]) for choices in ALONE]
    each = (clock() - start) / len(ALONE)
    rows = [audited.base, *(row.impedance for row in audited.rows)]
    error = max(min(abs(value - row) for row in rows) for value in alone)
    print(f"audit: {len(audited.rows)} variants in {seconds:.2f} s, {audited.readings} readings; "
          f"one educe {each:.2f} s ({each * len(rows) / seconds:.1f} times the audit for all); "
          f"largest difference {error:.1e}")  # fmt: skip


def calibration(clock: Clock) -> None:
    """Five parameters of the slit on six shipped planes, and 60 frequencies: from moments."""
    files = [path for case in ("n115", "n130") for path in case_files(case)[-3:]]
    liner = tl.load_liner("lbm_slit")
    start = clock()
    kept: dict[str, Any] = {"cell_pitch": liner.cell_pitch, "averaging": "velocity"}
    reduced = [tl.moments(tl.read_plane(path), **kept) for path in files]
    reading = clock() - start
    fit = functools.partial(tl.calibrate, reduced, liner, "true", FREE, noise=0.002, draws=0)
    seconds, _ = timed(fit, clock)
    educe = functools.partial(reduced[-1].educe, liner, averaging="velocity", interval=None)
    sweep, _ = timed(functools.partial(educe, [400.0 + 90 * i for i in range(60)]), clock)
    one, _ = timed(educe, clock)
    print(f"calibration: {len(FREE)} parameters on {len(files)} planes in {1e3 * seconds:.0f} ms, "
          f"after {1e3 * reading:.0f} ms to read and reduce them; one map from moments "
          f"{1e3 * one:.0f} ms, at 60 frequencies {1e3 * sweep:.0f} ms")  # fmt: skip


def worth(plane: tl.VelocityPlane, liner: LinerModel, clock: Clock) -> None:
    """All three."""
    error_bars(plane, liner, clock)
    audit_rows(plane, liner, clock)
    calibration(clock)
