"""What is doubtful about an identification, in words with numbers."""

from __future__ import annotations

from typing import Any

import torch

from torchliner.calibration.calibrate import LARGEST_MODEL_ERROR
from torchliner.engine.nodes import interpolation_error
from torchliner.identification.curve_model import CurveFit, FittedCurves
from torchliner.identification.found import Identification, beyond
from torchliner.liners.model import LinerModel

FAR = 2.0  # times the noise, from which a misfit is one of the model
WIDE = 3.0  # standard deviations, beyond which a prediction is not covered


def warnings_of(found: Identification) -> list[str]:
    """Of the best model, and of those that were not chosen because they are not passive."""
    best, fitted = found.best, found.best.fitted
    notes = list(fitted.notes)
    for row in best.rows:
        notes += [f"without it, {text}" for text in
                  beyond(row.label, row.outside, found.seen_speeds)]  # fmt: skip
    if fitted.misfit > FAR:
        notes.append(
            f"{best.label}: the misfit is {fitted.misfit:.3g} times the noise: no such law gives "
            "all references, and uncertainties are widened by that factor"
        )
    far = [row.label for row in best.rows if row.misses is not None
           and max(abs(row.misses.real), abs(row.misses.imag)) > WIDE]  # fmt: skip
    if far:
        notes.append(
            f"{', '.join(dict.fromkeys(far))}: predicted by the other runs, off by more than "
            f"{WIDE:g} standard deviations; the uncertainty of the fit does not cover what its law "
            "misses"
        )
    notes += [f"{each.label} is not passive: R falls to {each.lowest:.3g}; it was not chosen"
              for each in found.candidates if each.lowest < 0]  # fmt: skip
    if isinstance(fitted, FittedCurves):
        error = max(_model_error(found, fit) for fit in fitted.fits)
        if error > LARGEST_MODEL_ERROR:
            notes.append(
                f"R of the curve is known to {error:.2g} only (limit {LARGEST_MODEL_ERROR:g}) "
                "between the speeds at which the moments read it; compare with educe of the table"
            )
    return notes


def _model_error(found: Identification, fit: CurveFit) -> float:
    """Largest error in R of the interpolation over |v|, at any |v| of the runs."""
    lines = torch.tensor([fit.frequency], dtype=torch.float64)

    nodes = {run.weights.nodes for run in found.runs}
    return max(interpolation_error(each, _Curve(fit), lines, found.knots.top)[0] for each in nodes)


class _Curve(LinerModel):
    """A fitted curve as a liner, at its own frequency."""

    def __init__(self, fit: CurveFit) -> None:
        self.fit = fit

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Any:
        """Z of the curve, whatever the frequency."""
        return self.fit.curve(speed).expand(frequency.shape[0], -1)
