"""Covariance of R and X for errors of the microphones as large as what the waves leave.

Errors are taken as independent and normal, of one size in Pa (or in dB, where a fit weights so); N
microphones less the complex unknowns of the waves are the degrees of freedom. The slope of Z with
each microphone's real and imaginary part is a difference of two eductions, of all microphones as
one batch.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torchliner.records import WallEduction

STEP = 1e-4  # of the errors' unit; the slope errs by its square


def residual_covariance(
    result: WallEduction, educe: Callable[[Tensor], WallEduction], pressure: Tensor,
    freedom: int, unit: Tensor,
) -> Tensor | None:  # fmt: skip
    """(F, 2, 2) of (R, X); None without a degree of freedom, or for lines with leading axes.

    Args:
        result: of the pressures.  educe: from pressures (D, N, F).  pressure: (N, F).
        freedom: N less the complex unknowns.
        unit: size of pressure, (N, F), in whose shares errors are equal.
    """
    if freedom < 1 or pressure.ndim > 2:
        return None
    count = len(pressure)
    steps = torch.eye(count, dtype=torch.complex128, device=pressure.device) * STEP
    steps = torch.cat([steps, 1j * steps])[..., None] * unit  # (2 N, N, F)
    both = educe(torch.cat([pressure + steps, pressure - steps])).impedance.reshape(
        2, 2 * count, -1
    )
    slope = torch.view_as_real((both[0] - both[1]) / (2 * STEP))  # (2 N, F, 2)
    # Half of the complex variance belongs to each part.
    variance = result.residual.square() * count / (2 * freedom)
    return variance[:, None, None] * torch.einsum("dfi,dfj->fij", slope, slope)
