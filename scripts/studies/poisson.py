r"""What a reconstruction from Poisson arrivals leaves of a tone in the mean: closed forms.

For a Poisson process of rate :math:`\lambda` the distances B, F from any instant to the arrivals before and after are
independent and exponential. With :math:`x = \omega/\lambda`:

- hold: :math:`\langle G\rangle = \langle e^{-j\omega B}\rangle = 1/(1+jx)`.
- linear: given D = B + F, of density :math:`\lambda^2 D e^{-\lambda D}`, B is uniform on (0, D) and the mean of
  :math:`[F e^{-j\omega B} + B e^{j\omega F}]/D` over it is :math:`2(1-\cos\omega D)/(\omega D)^2`; over D, by
  Frullani's integral, :math:`\langle G\rangle = \ln(1+x^2)/x^2`.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, require_positive

CLOSED_FORMS = ("linear", "hold")


def poisson_attenuation(frequency: Any, rate: Any, method: str = "linear") -> Tensor:
    """Mean factor G of a tone for Poisson arrivals on a fine grid, complex128.

    Args:
        frequency: Hz.  rate: mean rate of the arrivals, Hz; broadcasts against the frequency.
        method: ``linear`` or ``hold``; the band-limited fit has no closed form.
    Source: derived at the head of this file; linear interpolation at 1500 Hz gives 0.84, 0.94, 0.98 for 15, 25, 50 kHz.
    """
    require_choice("method with a closed form", method, CLOSED_FORMS)
    high, low = (torch.as_tensor(each, dtype=torch.float64) for each in (frequency, rate))
    require_positive("frequency (Hz)", high.min())
    require_positive("mean rate (Hz)", low.min())
    turns = 2 * math.pi * high / low
    if method == "hold":
        return 1 / (1 + 1j * turns)
    return (torch.log1p(turns**2) / turns**2).to(torch.complex128)
