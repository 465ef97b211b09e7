"""Level-matched Z: the incoherent velocity is scaled until the level check is 0.

How much of the incoherent velocity acts on the liner is not known where jets pass the plane (docs/background.md). Where
the level is known it follows: Z, with the phase-locked velocity as measured, must give the known pressure. Each block
is left out in turn and the share found again to first order, so that the interval holds the scatter of Z and of the
velocity together; a level that is off by its stated uncertainty moves Z along the same path.
"""

import math

import torch
from scipy.optimize import brentq
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.engine.drives import phase_locked
from torchliner.engine.intervals import FEWEST_BLOCKS, ITSELF, jackknife
from torchliner.engine.moments import Moments
from torchliner.liners.model import LinerModel
from torchliner.records.level_check import LevelMatched
from torchliner.records.notes import Note
from torchliner.velocity.averages import average
from torchliner.velocity.level_check import known_pressure, ratio_of_pressures
from torchliner.velocity.reading import Reading

RANGE = (0.1, 4.0)  # of the share: beyond, it is not the share of the turbulence that is wrong
LEAST = 0.5  # dB by a factor e in the incoherent velocity: below, the level does not tell the share
CLOSE = 1e-9  # dB: such a level check is 0
STEP = 0.02  # in the logarithm of the share, for slopes
PER_NEPER = 20 / math.log(10)


def match_level(
    reading: Reading, known: Moments, liner: LinerModel, pressure: object = None, reference_phase: object = None
) -> tuple[LevelMatched | None, list[Note]]:
    """Z at each frequency at which a pressure is known, and why there is none.

    ``reading`` is of a plane that still has its samples: each share that is tried reads them again; ``known`` is what
    it gave, ``liner``, ``pressure`` and ``reference_phase`` as of ``educe``.
    """
    chosen, frequency, name = reading.chosen, reading.frequency, known.plane.name
    if known.locked is None:
        raise ValueError("level_matched scales what phase-locked averaging leaves; choose averaging='phase-locked'")
    pressures = known_pressure(known, frequency, pressure)
    if isinstance(pressures, str):
        return None, [Note("level-matched", f"{name}: no level-matched answer: {pressures}")]
    scale = torch.ones_like(known.survey.mean) if known.locked.scale is None else known.locked.scale
    seen, ratio = dict[float, tuple[Tensor, Tensor]](), ratio_of_pressures(known, pressures, every=True)
    lengths, notes = known.survey.lengths.cpu(), []

    def at(place: float) -> tuple[Tensor, Tensor]:
        """Z of the liner and level check, nepers, of all blocks and without each, (B, F), by the share's logarithm."""
        if place not in seen:
            drive = phase_locked(known.survey, known.membership, math.exp(place) * scale)
            moments = known if place == 0 else reading.with_drive(known, drive)
            found = average(moments, liner, frequency, chosen, "phase-locked", reference_phase)
            z = impedance_from_reflection(found.replicates[:, 0].detach()).cpu()
            seen[place] = z, ratio(z).log()
        return seen[place]

    def matched(i: int) -> list[complex] | str:
        """The fields of the record at one frequency, or why there are none."""

        def gap(place: float) -> float:
            """dB."""
            return PER_NEPER * float(at(place)[1][0, i].real)

        place, end = 0.0, math.log(RANGE[int(gap(0.0) < 0)])
        beyond = abs(gap(0.0)) > CLOSE and gap(0.0) * gap(end) > 0
        if abs(gap(0.0)) > CLOSE and not beyond:
            place = float(brentq(gap, min(end, 0.0), max(end, 0.0), xtol=1e-5))
        rate = (gap(place + STEP) - gap(place)) / STEP  # dB by a factor e
        if rate < LEAST:
            return f"the level check changes by {rate:.2g} dB by a factor e in the incoherent rms (limit {LEAST:g})"
        if beyond:
            still = f"still {gap(end):+.2f} dB with {math.exp(end):g} times the incoherent velocity"
            return f"the level check is {still}: model, level or phase-locked velocity are wrong"
        share, away = math.exp(place), chosen.level_uncertainty / rate
        (z, ratio), (beside, _) = ([each[:, i] for each in at(where)] for where in (place, place + STEP))
        by, bounds = complex((beside[0] - z[0]) / STEP), [complex(math.nan, math.nan)] * 4
        if chosen.interval is not None and len(lengths) >= FEWEST_BLOCKS:
            moved = -(ratio - ratio[:1]).real * PER_NEPER / rate  # the logarithm of each replicate's own share
            values = torch.stack([z + by * moved, moved.to(z)], 1)
            interval = jackknife(values, lengths / lengths.sum(), chosen.interval, ITSELF)
            for k, (value, more) in enumerate(((complex(z[0]), by * away), (0j, complex(away)))):
                bounds[2 * k : 2 * k + 2] = (farther(value, each, more) for each in interval.bounds(k))
        low, high = (share * math.exp(each.real) for each in bounds[2:])
        return [complex(z[0]), *bounds[:2], share, low, high, rate]

    every = torch.full((7, len(frequency)), complex(math.nan, math.nan), dtype=torch.complex128)
    for i, f in enumerate(frequency.tolist()):
        if bool(torch.isfinite(pressures.pressure[0, i].abs())):
            found = matched(i)
            if isinstance(found, str):
                notes.append(Note("level-matched", f"{name}: no level-matched answer at {f:g} Hz: {found}"))
            else:
                every[:, i] = torch.tensor(found, dtype=torch.complex128)
    z, low, high, *rest = every
    return LevelMatched(z, low, high, *(each.real for each in rest), chosen.level_uncertainty), notes


def farther(value: complex, bound: complex, more: complex) -> complex:
    """A bound moved out by another error, R and X apart: the root of the sum of squares."""
    pairs = zip((value.real, value.imag), (bound.real, bound.imag), (more.real, more.imag), strict=True)
    return complex(*(own + math.copysign(math.hypot(end - own, away), end - own) for own, end, away in pairs))
