"""Clocks from time stamps: uniform, and what a stated rate makes of them."""

import numpy as np

from torchliner.checks import require_positive, tell
from torchliner.file_checks import Unwritten
from torchliner.io.variables import Field
from torchliner.units import require_plausible, si_factor

UNIFORMITY = 0.01  # largest error of a time stamp, in sampling intervals
SAME_RATE = 0.01  # relative: a rate that is stated, and that of the times


def uniform_rate(time: np.ndarray, name: str, exact: float = 0.0) -> float:
    """Sampling rate, Hz, of time stamps, s, that are rounded by ``exact``, s; ``name`` is for messages. A ValueError
    where they are not finite, out of order, or not uniform, or frames are missing."""
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
            f"{name}: samples {back} and {back + 1} have the same time, {time[back]:.9g} s: write times with more "
            "digits (OpenFOAM: timePrecision in controlDict)"
        )
    if steps[back] < 0:
        raise ValueError(
            f"{name} is out of order: sample {back + 1} is at {time[back + 1]:.9g} s, after {time[back]:.9g} s; sort "
            "the frames, or give the runs as files of their own, which are joined"
        )
    lost = np.rint(steps / usual).astype(int) - 1
    if lost.any() and np.abs(steps - (lost + 1) * usual).max() < 0.1 * usual:
        gap = int((lost > 0).argmax())
        raise ValueError(
            f"{name} lacks {int(lost.sum())} frames, the first {lost[gap]} after sample {gap} ({time[gap]:.9g} s); "
            "restore them, or keep one stretch between the gaps"
        )
    raise ValueError(
        f"{name} is not uniform: stamps are off by up to {error / step:.3g} sampling intervals (limit {UNIFORMITY:g}), "
        f"most after sample {int(np.abs(steps - step).argmax())}; resample to uniform times first"
    )


def clock_of(
    time: np.ndarray, name: str, stated: float | None, exact: float = 0.0, unit: str = ""
) -> tuple[float, float]:
    """Sampling rate, Hz, and time of the first of uniform stamps, s; arguments as for ``uniform_rate``.

    A rate that the user has ``stated``, Hz, is that of times without a ``unit``, which count evenly, whatever they
    count. Of times with a unit it must be the rate, to 1 %.
    """
    found, first = uniform_rate(time, name, exact), float(time[0])
    if stated is None:
        return found, first
    require_positive(f"{name}: sampling_rate (Hz)", stated)
    if not unit:
        return stated, first * found / stated
    if abs(found - stated) > SAME_RATE * stated:
        raise ValueError(
            f"{name}: its times are at {found:.6g} Hz, sampling_rate states {stated:.6g} Hz; leave "
            f"it out, or correct the unit of the times, {unit}"
        )
    return found, first


def read_times(field: Field, stated: float | None = None) -> tuple[float, int, float]:
    """Sampling rate, Hz, number of samples, and time of the first, s, since the epoch if there is one; the rate may be
    ``stated`` where the times have no units, or as they have it. A ValueError as of ``clock_of``; a DataWarning where
    the times are rounded so that they tell the rate badly."""
    name, shape = field.label, field.shape
    if len(shape) != 1 or shape[0] < 2:
        raise Unwritten(f"{name} has shape {shape}; a list of at least two times is needed")
    unit, _, epoch = (field.text("units") or "").partition(" since ")
    counted = stated is not None and not unit  # whatever they count, evenly
    counts, kind = field.values(), field.array.dtype
    factor = 1.0 if counted else si_factor("time", unit or field.text("units"), name)
    if not epoch and not counted:
        require_plausible(factor * counts, "time", name)
    # Dates are far from their epoch; what counts is how far they are from each other.
    time = factor * (counts - (counts[0] if epoch or counted else 0)).astype(np.float64)
    # Stamps are as exact as their type; the largest is a unit in the last place off, at most.
    exact = factor * float(np.spacing(np.abs(counts).max().astype(kind))) if kind.kind == "f" else 0.0
    found, length, first = uniform_rate(time, name, exact), time[-1] - time[0], factor * float(counts[0])
    rate, _ = clock_of(time, name, stated, exact, unit)
    if counted:
        return rate, len(time), first * found / rate
    if stated is not None and abs(stated / rate - 1) * length <= 2 * exact:
        rate = stated  # the stamps cannot tell the two apart
    if stated is None and exact * rate > UNIFORMITY:
        tell(
            f"{name} are {kind}, exact to {exact:.1g} s, {exact * rate:.2g} of a step: the rate, {rate:.9g} Hz, is "
            f"known to {exact / length:.1g} of itself; write them in float64, or state sampling_rate=..."
        )
    return rate, len(time), first
