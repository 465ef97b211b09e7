"""Warnings of a fit of the field."""

from __future__ import annotations

import math

from torch import Tensor

from torchliner.checks import FEEDS
from torchliner.pressure.field_model import like_rigid
from torchliner.pressure.impedance_search import STEPS, Solution
from torchliner.pressure.microphone_errors import POOR, largest_misfit
from torchliner.pressure.wave_notes import Notes, least, noted
from torchliner.records import FieldFit

FIRST_ORDER = 6.0  # standard errors of rho; nearer to a rigid wall Z is not linear over them
GAINS = 1 + 1e-6  # of an end; nearer to 1 it is rounding of the fit


def field_notes(result: FieldFit, found: Solution, gains: Tensor) -> Notes:
    """A warning a fault.

    Args:
        result: the fit.
        found: its solution.
        gains: energy out and absorbed over that coming in where a wave feeds it, else 0, (B, F).
    """
    shape, misfit, freedom = result.impedance.shape, result.misfit, result.freedom
    assert freedom is not None
    limit = largest_misfit(freedom, POOR / misfit[..., 0].numel())
    poor, gains = misfit > limit, gains.reshape(shape)
    rigid, hard = (
        like_rigid(found.place, found.covariance, errors).reshape(shape) & result.converged
        for errors in (2.0, FIRST_ORDER)
    )
    resistance = result.impedance.real - result.rise.real.abs() / 2  # at the edge of less
    active = (resistance < FEEDS) & ~rigid
    end = result.end_reflection.abs()
    level, phase = (-least(-used, poor) for used in result.used_errors)
    rows = (
        (~result.converged, "unsettled", f"the fit did not settle in {STEPS} steps; Z is the best one met"),
        (
            poor,
            "model-misfit",
            f"the residuals are {math.sqrt(-least(-misfit, poor)):.3g} times the stated errors of "
            f"the microphones (limit {math.sqrt(limit):.3g}): duct, flow, far end or the microphones' wall "
            f"({result.choices['wall']}) are not those of the measurement, this is not the deepest minimum (begin "
            f"elsewhere, --start, start=), or the errors are {level:.2g} dB and {phase:.2g} degrees, which error bars "
            "take",
        ),
        (rigid, "rigid-wall", "the microphones do not tell the liner from a rigid wall: the error of Z has no bound"),
        (
            hard & ~rigid,
            "near-rigid-wall",
            f"a rigid wall is within {FIRST_ORDER:g} standard errors: those of 1/Z hold, those of Z are too small",
        ),
        (active, "active-wall", f"the resistance is {least(resistance, active):.3g}, below 0"),
        (end > GAINS, "active-end", f"the far end would reflect {-least(-end, end > GAINS):.3g} times what it gets"),
        (
            gains > 0,
            "growing-wave",
            f"the duct with this impedance gives back and absorbs {float(gains.max()):.3g} "
            "times the energy that comes in: a wave of its shear layer grows along the liner, and Z leans on the "
            "profile of the flow; compare other profiles",
        ),
    )
    return tuple(note for which, code, text in rows for note in noted(result, which, code, text))
