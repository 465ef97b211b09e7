"""Warnings of a fit of the field."""

from __future__ import annotations

import math

from scipy.special import chdtri
from torch import Tensor

from torchliner.checks import FEEDS
from torchliner.pressure.field_model import like_rigid
from torchliner.pressure.impedance_search import STEPS, Solution
from torchliner.records import FieldFit, MicrophoneLine

FIRST_ORDER = 6.0  # standard errors of rho; nearer to a rigid wall Z is not linear over them
POOR = 0.01  # share of right models that are warned of
GAINS = 1 + 1e-6  # of an end; nearer to 1 it is rounding of the fit


def largest_misfit(freedom: int, cases: int = 1) -> float:
    """Chi squared that the largest of some right models exceeds once in 100 times."""
    return float(chdtri(freedom, POOR / cases))


def warnings_of(
    result: FieldFit, found: Solution, line: MicrophoneLine, wall: str, freedom: int, gains: Tensor
) -> tuple[str, ...]:
    """A note a frequency and fault of a fit, its solution, the line and wall of its microphones.

    Args:
        freedom: degrees of freedom of chi squared.
        gains: energy out and absorbed over that coming in where a wave feeds it, else 0, (B, F).
    """
    notes = []
    poor = largest_misfit(freedom, result.misfit[..., 0].numel()) / freedom
    shape = result.impedance.shape
    rigid, hard = (
        like_rigid(found.place, found.covariance, errors).reshape(shape) & result.converged
        for errors in (2.0, FIRST_ORDER)
    )
    # At the edge of less resistance.
    resistance = result.impedance.real - result.rise.real.abs() / 2
    for i, f in enumerate(line.frequency.tolist()):
        lost = int((~result.converged[..., i]).sum())
        if lost:
            notes.append(
                f"{line.name}: the fit at {f:g} Hz did not settle in {STEPS} steps in {lost} of "
                f"{result.converged[..., i].numel()} cases; the impedance is the best one met"
            )
        worst = float(result.misfit[..., i].max())
        if worst > poor:
            notes.append(
                f"{line.name}: at {f:g} Hz the residuals are {math.sqrt(worst):.3g} times the "
                f"stated errors of the microphones, more than {math.sqrt(poor):.3g}, which 1 right "
                "model in 100 exceeds: the duct model, the flow, the far end, the microphones' "
                f"wall ({wall}) or the errors are not those of the measurement, or this is not the "
                "deepest minimum (begin elsewhere, --start, start=); errors of Z do not cover that"
            )
        count, cases = int(rigid[..., i].sum()), rigid[..., i].numel()
        if count:
            notes.append(
                f"{line.name}: at {f:g} Hz the microphones do not tell the liner from a rigid wall "
                f"in {count} of {cases} cases; Z is the best one, its error has no bound"
            )
        count = int((hard & ~rigid)[..., i].sum())
        if count:
            notes.append(
                f"{line.name}: at {f:g} Hz a rigid wall is within {FIRST_ORDER:g} standard errors "
                f"in {count} of {cases} cases: those of 1/Z hold, those of Z are too small"
            )
        least = float(resistance[..., i].masked_fill(rigid[..., i], 0).min())
        if least < FEEDS:
            notes.append(f"{line.name}: the resistance at {f:g} Hz is {least:.3g}, below 0")
        most = float(result.end_reflection[..., i].abs().max())
        if most > GAINS:
            notes.append(f"{line.name}: at {f:g} Hz the far end would reflect {most:.3g} times what it gets")
        gain = float(gains[:, i].max())
        if gain > 0:
            notes.append(
                f"{line.name}: at {f:g} Hz the duct model, with the impedance found, gives back "
                f"and absorbs {gain:.3g} times the energy that comes in: a wave of its shear layer "
                "grows along the liner, and the impedance leans on the profile of the flow; "
                "compare other profiles, and do not rely on it beside a poor misfit"
            )
    return tuple(notes)
