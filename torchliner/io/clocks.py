"""Clocks from time stamps: uniform, and what a stated rate makes of them."""

from __future__ import annotations

import numpy as np

from torchliner.checks import require_positive
from torchliner.file_checks import Unwritten

UNIFORMITY = 0.01  # largest error of a time stamp, in sampling intervals
SAME_RATE = 0.01  # relative: a rate that is stated, and that of the times


def clock_of(time: np.ndarray, name: str, stated: float | None, exact: float = 0.0) -> tuple[float, float]:
    """Sampling rate, Hz, and time of the first of uniform stamps, s; of those without a unit the user states the rate,
    Hz, since they count evenly whatever they count. Arguments as for ``uniform_rate``."""
    found, first = uniform_rate(time, name, exact), float(time[0])
    if stated is None:
        return found, first
    require_positive(f"{name}: sampling_rate (Hz)", stated)
    return stated, first * found / stated


def require_same_rate(found: float, stated: float | None, name: str, unit: str) -> None:
    """A rate that the user states of times that have a unit must be theirs, to 1 %."""
    if stated is not None and abs(found - stated) > SAME_RATE * stated:
        raise ValueError(
            f"{name}: its times are at {found:.6g} Hz, sampling_rate states {stated:.6g} Hz; leave "
            f"it out, or correct the unit of the times, {unit}"
        )


def uniform_rate(time: np.ndarray, name: str, exact: float = 0.0) -> float:
    """Sampling rate of time stamps, Hz.

    Args:
        time: s.
        name: of the times, for messages.
        exact: s, by which stamps are rounded.
    Raises:
        ValueError: they are not finite, out of order, or not uniform; frames are missing.
    """
    if not np.isfinite(time).all():
        raise ValueError(f"{name} holds {int((~np.isfinite(time)).sum())} values not finite")
    if len(time) < 2:
        raise Unwritten(f"{name}: there is {len(time)} of them; at least two are needed")
    time = time.astype(np.float64)
    step = (time[-1] - time[0]) / (len(time) - 1)
    error = np.abs(time - (time[0] + step * np.arange(len(time)))).max()
    if step > 0 and error <= UNIFORMITY * step + min(exact, step / 4):
        return float(1 / step)
    steps = np.diff(time)
    back, usual = int(np.argmin(steps)), float(np.median(steps))
    if steps[back] == 0:
        raise ValueError(
            f"{name}: samples {back} and {back + 1} have the same time, {time[back]:.9g} s: times are written with too "
            "few digits; write more (OpenFOAM: timePrecision in controlDict)"
        )
    if steps[back] < 0:
        raise ValueError(
            f"{name} is out of order: sample {back + 1} is at {time[back + 1]:.9g} s, the one before it at "
            f"{time[back]:.9g} s; sort the frames, or give the runs as files of their own, which are joined"
        )
    lost = np.rint(steps / usual).astype(int) - 1
    if lost.any() and np.abs(steps - (lost + 1) * usual).max() < 0.1 * usual:
        gap = int((lost > 0).argmax())
        raise ValueError(
            f"{name} lacks {int(lost.sum())} frames, the first {lost[gap]} after sample {gap} ({time[gap]:.9g} s); "
            "restore them, or keep one stretch between the gaps"
        )
    raise ValueError(
        f"{name} is not uniform: stamps are off by up to {error / step:.3g} sampling intervals "
        f"(limit {UNIFORMITY:g}), most after sample {int(np.abs(steps - step).argmax())}; resample the data to uniform "
        "times first"
    )
