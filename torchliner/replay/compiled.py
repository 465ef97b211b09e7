"""The weighted sum of R over time as one fused loop, compiled when a job is large enough.

Compilation takes seconds, so small jobs never see it. Where there is no compiler, or it fails, one
warning is given and the same numbers come from the eager path.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable

import torch
from torch import Tensor

from torchliner.liners.nonlinear import SpeedLaw, powers
from torchliner.replay.reflect import reflection_parts

PAYS_FROM = 1.5e9  # velocity samples x lines: some ten seconds of eager work
# Without these inductor writes full-size temporaries and the fused loop is four times slower.
OPTIONS: dict[str, str | int | bool | Callable[..., object]] = {
    "realize_reads_threshold": 64,
    "realize_opcount_threshold": 400,
    "realize_acc_reads_threshold": 200,
    "max_fusion_size": 400,
}

Fused = Callable[[Tensor, Tensor, Tensor], Tensor]


def fused_line_sums(speed: Tensor, coefficients: Tensor, weights: Tensor) -> Tensor:
    """Sum over time and lines of weight times R.

    Args:
        speed: |v|, m/s, (t, P).
        coefficients: of ``SpeedLaw``, (lines, 6), in the precision of ``speed``.
        weights: real and imaginary part per line and direction, (t, lines, 2 directions).
    Returns:
        Real and imaginary part per direction, float64, (2 directions, P).
    """
    square, power = powers(speed)
    totals: list[Tensor | None] = [None] * weights.shape[2]
    for i in range(coefficients.shape[0]):
        law = SpeedLaw(*coefficients[i].unbind())
        real, imaginary = reflection_parts(*law.parts_from_powers(speed, square, power))
        for j in range(0, weights.shape[2], 2):
            a, b = weights[:, i, j, None], weights[:, i, j + 1, None]
            for k, part in ((j, a * real - b * imaginary), (j + 1, a * imaginary + b * real)):
                before = totals[k]
                totals[k] = part if before is None else before + part
    return torch.stack([part.sum(0, dtype=torch.float64) for part in totals if part is not None])


@functools.lru_cache(maxsize=8)
def compile_line_sums(
    device: torch.device, dtype: torch.dtype, shape: tuple[int, int], lines: int, parts: int
) -> Fused | None:
    """``fused_line_sums`` compiled for one slab shape (t, P) and tried on zeros.

    One shape only: inductor falls back to eager after eight. None, with a warning, if it fails.
    """
    compiled: Fused = torch.compile(fused_line_sums, dynamic=False, options=OPTIONS)
    speed = torch.zeros(shape, dtype=dtype, device=device)
    coefficients = torch.ones(lines, 6, dtype=dtype, device=device)
    weights = torch.ones(shape[0], lines, parts, dtype=dtype, device=device)
    try:
        compiled(speed, coefficients, weights)
    except Exception as error:
        reason = str(error).strip().splitlines()[0][:120] if str(error).strip() else repr(error)
        warnings.warn(
            f"torch.compile is not to be had ({type(error).__name__}: {reason}); the eager path "
            "gives the same numbers, some ten times slower on large planes",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    return compiled
