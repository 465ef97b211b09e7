"""Planes predicted by a calibrated liner, beside what is known of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torchliner.calibration.budget import correlation_of
from torchliner.calibration.calibrate import Calibration
from torchliner.engine.moments import Moments


@dataclass(frozen=True)
class PredictionRow:
    """One predicted impedance beside what is known of it, all normalised.

    Args:
        label: of the plane.  frequency: Hz.  height: m, or None.
        before, after: with the liner as it was, and calibrated.
        standard: u(R) + j u(X) of ``after``, from the parameters' spread.  correlation: of R and X.
        true: reference, or None.
        misses: by how many standard deviations R and X lie off it, signed; None without one.
        notes: warnings, as of a |v| beyond what was fitted.
    """

    label: str
    frequency: float
    height: float | None
    before: complex
    after: complex
    standard: complex
    correlation: float
    true: complex | None
    misses: complex | None
    notes: tuple[str, ...] = ()


def prediction_rows(
    found: Calibration, plane: Any, before: Any, *, label: str | None = None,
    reference: str = "true", noise: complex = 0j,
) -> list[PredictionRow]:  # fmt: skip
    """Rows of one plane, by its velocity or its moments.

    Args:
        before: liner as it was, whose other numbers the prediction keeps.
        label: of the plane; default its case.
        reference: name of the impedance beside which it is put, if the plane has it.
        noise: standard uncertainty of that, u(R) + j u(X), part of the misses.
    """
    prediction = found.predict(plane, before)
    plane = plane.plane if isinstance(plane, Moments) else plane
    true = plane.reference.get(reference)
    case = label or str(plane.provenance.get("case", plane.title))
    return [
        PredictionRow(
            case, frequency, plane.height, complex(prediction.before[i]),
            complex(prediction.impedance[i]), complex(prediction.standard[i]),
            correlation_of(prediction.covariance[i]), true,
            None if true is None else prediction.misses(complex(true), noise, i), prediction.notes,
        )
        for i, frequency in enumerate(prediction.frequency.tolist())
    ]  # fmt: skip
