"""A liner from runs without flow: linear offset, contraction coefficient, and which law of lost mass they support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from torchliner.engine.moments import Moments
from torchliner.liners.model import LinerModel, as_liner
from torchliner.liners.sdof import EndLossSDoFLiner, SDoFLiner
from torchliner.studies.calibrate import calibrate
from torchliner.studies.fit import Fit
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.educe import moments

AVERAGING = "phase-locked"
FREE = {"vena_contracta": (0.2, 1.0)}
NOISE = 0.005 + 0.05j  # of R and X: two ways of measuring one run differ by 0.002 to 0.015 in X, the model by more
LEFT_OUT = 1e3  # u(X) with which a reactance does not count
QUIET = 0.02  # Mach number that counts as no flow


def calibrate_without_flow(
    planes: Sequence[Records],
    liner: Any,
    references: Any = "true",
    *,
    noise: complex | None = None,
    draws: int = 2000,
    seed: int = 0,
    **choices: Any,
) -> tuple[Fit, Mapping[str, float]]:
    """Fit a liner to runs without flow at one or several levels, with the law of lost mass that predicts them best.

    Free are the contraction coefficient and, with two levels or more, both parts of the linear offset. The law is that
    of the liner, or ``EndLossSDoFLiner`` with its usual coefficients if it predicts reactances better that
    it was not fitted to: each but that of the lowest level is left out in turn (of a single run its own).

    Args:
        planes: or their moments, each with its reference, without flow.
        liner: geometry, and the linear offset where there is one level alone.
        references: as of ``calibrate``.
        noise: standard uncertainty, u(R) + j u(X); default 0.005 + 0.05j, mostly of the model.
        draws, seed, choices: as of ``calibrate``; averaging ``phase-locked`` by default.
    Returns:
        The fit, and by law the rms error of the reactances that were left out.
    Raises:
        ValueError: a plane with flow; as ``calibrate``.
        TypeError: the liner is no ``SDoFLiner``.
    """
    model, several = as_liner(liner), [planes] if isinstance(planes, Records) else list(planes)
    if not isinstance(model, SDoFLiner):
        raise TypeError(f"liner is {type(model).__name__}; an SDoFLiner is calibrated without flow, others with --free")
    for plane in map(plane_of, several):
        if (plane.mach or 0.0) > QUIET:
            raise ValueError(f"{plane.name} states Mach number {plane.mach:g}; give runs without flow, or --free")
    chosen = {"averaging": AVERAGING, **choices}
    read = {"cell_pitch": model.cell_pitch, **chosen}
    known = [each if isinstance(each, Moments) else moments(each, **read) for each in several]
    levels = [plane_of(each).incident_level or 0.0 for each in known]
    free = dict(FREE)
    if len(set(levels)) > 1:
        offset = complex(torch.as_tensor(model.impedance_offset))
        free |= {"offset_resistance": (offset.real - 0.5, offset.real + 0.5)}
        free |= {"offset_reactance": (offset.imag - 0.5, offset.imag + 0.5)}
    usual = complex(NOISE if noise is None else noise)
    laws: dict[str, LinerModel] = {"as given": model}
    if not isinstance(model, EndLossSDoFLiner):
        laws["end loss"] = EndLossSDoFLiner.of(model)
    scores = {}
    left_out = sorted(set(levels))[1:] or levels[:1]
    for name, law in laws.items():
        errors = []
        for level in left_out:
            spread = [complex(usual.real, LEFT_OUT) if each == level else usual for each in levels]
            fit = calibrate(known, law, references, free, noise=spread, draws=0, **chosen)
            rows = zip(fit.rows, levels, strict=True)
            errors += [(row.impedance - row.true).imag for row, each in rows if each == level]
        scores[name] = float(torch.tensor(errors).square().mean().sqrt())
    best = min(scores, key=lambda name: scores[name])
    return calibrate(known, laws[best], references, free, noise=usual, draws=draws, seed=seed, **chosen), scores
