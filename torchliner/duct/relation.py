r"""The dispersion relation of a lined duct in uniform flow as an entire function of alpha.

With :math:`d = k - \alpha M`, :math:`\gamma^2 = d^2 - \alpha^2` and s = d/k (Ingard-Myers) or 1
(continuous velocity) the relation of ``duct/dispersion.py``, multiplied out, is

.. math:: F = a\,\gamma\sin\gamma H - j b\,s\,d\cos\gamma H = 0, \qquad a : b = Z : 1.

It is even in gamma, so it knows no branches of the root, has no poles, and covers Z = 0 (a = 0) and
the rigid wall (b = 0) like any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import real_tensor, require_choice
from torchliner.names import CONDITIONS

DIRECTIONS = ("downstream", "upstream")


@dataclass(frozen=True)
class Duct:
    """What the relation needs besides alpha and Z, as real tensors of one shape.

    Args:
        wavenumber: k = omega/c, 1/m.  height: H, m.  mach: M.  displaced: Ingard-Myers, else continuous velocity.
    """

    wavenumber: Tensor
    height: Tensor
    mach: Tensor
    displaced: bool

    def at(self, index: Tensor) -> Duct:
        """Some items of the batch."""
        return Duct(self.wavenumber[index], self.height[index], self.mach[index], self.displaced)

    def flattened(self) -> Duct:
        """All items in one row."""
        k, height, mach = (p.reshape(-1) for p in (self.wavenumber, self.height, self.mach))
        return Duct(k, height, mach, self.displaced)


class Relation(NamedTuple):
    """gamma sin gamma H and j s d cos gamma H, each with its derivative in alpha."""

    rigid: tuple[Tensor, Tensor]
    soft: tuple[Tensor, Tensor]


def duct_of(
    first: Tensor, frequency: Any, height: Any, mach: Any, sound_speed: Any, condition: str
) -> tuple[Duct, Tensor]:
    """The duct and the first argument in float64, broadcast against each other, checked."""
    require_choice("condition", condition, CONDITIONS)
    stated = {"frequency (Hz)": frequency, "height (m)": height, "sound_speed (m/s)": sound_speed}
    reals = {name: real_tensor(value).to(first.device) for name, value in stated.items()}
    for name, value in reals.items():
        bad = ~((value.detach() > 0) & torch.isfinite(value.detach()))
        if bool(bad.any()):
            worst = float(value.detach()[bad].reshape(-1)[0])
            raise ValueError(f"{name} is {worst:g}; it must be finite and above 0")
    flow = real_tensor(mach).to(first.device)
    fast = ~(flow.detach().abs() < 1)
    if bool(fast.any()):
        worst = float(flow.detach()[fast].reshape(-1)[0])
        raise ValueError(f"mach is {worst:g}; its size must be below 1 (a Mach number, not m/s)")
    k = 2 * torch.pi * reals["frequency (Hz)"] / reals["sound_speed (m/s)"]
    wave, k, tall, flow = torch.broadcast_tensors(first.to(torch.complex128), k, reals["height (m)"], flow)
    return Duct(k, tall, flow, condition == CONDITIONS[0]), wave


def relation(alpha: Tensor, duct: Duct) -> Relation:
    r"""Both entire parts and their derivatives in alpha.

    With w = gamma^2 and x = gamma H: (gamma sin x)_w = H (sinc x + cos x)/2, (cos x)_w = -H^2 sinc x/2;
    w' = -2 (M d + alpha).
    """
    h, m = duct.height, duct.mach
    d = duct.wavenumber - alpha * m
    w, w_slope = d * d - alpha * alpha, -2 * (m * d + alpha)
    zero = w == 0
    x = torch.sqrt(torch.where(zero, 1, w)) * h
    cos, sinc = torch.where(zero, 1, torch.cos(x)), torch.where(zero, 1, torch.sin(x) / x)
    rigid = (w * h * sinc, h * (sinc + cos) / 2 * w_slope)
    f, f_slope = (d * d / duct.wavenumber, -2 * m * d / duct.wavenumber) if duct.displaced else (d, -m + 0 * d)
    return Relation(rigid, (1j * f * cos, 1j * (f_slope * cos - f * h * h * sinc / 2 * w_slope)))
