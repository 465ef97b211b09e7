r"""Where the sound's energy goes: plane-like mode in and out of the duct, and into the liner.

A plane wave of amplitude a carries (1 +- M)^2 |a|^2 H/(2 rho c) with and against the flow; the wall
takes half the integral of Re(p w*), p = (1 + R) eta its pressure and w = (1 - R) eta the velocity of
its face, in p's units (``boundaries.py``). Without flow what goes in comes out or is taken. With flow
the mean flow may give or take energy: the difference of the balance, which may be negative. A passive
wall that lets out more than comes in says that a wave grew.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.duct.boundaries import Wall
from torchliner.duct.sweep import SweptDuct

GAIN, FED = 1.01, 2.0  # energy out, and out or absorbed, over that in: limits of a warning
PASSIVE = -1e-6  # of the energy in: what a wall takes; below, it gives


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Shares of the energy that comes in, (..., F).

    Args:
        out: plane-like modes out of both ends, with (1 +- M)^2, M the bulk Mach number.
        absorbed: by the liner, from p and w on its face.
    """

    out: Tensor
    absorbed: Tensor

    @property
    def missing(self) -> Tensor:
        """1 - out - absorbed: to the mean flow, if negative from it; errors of the mesh; mode 1."""
        return 1 - self.out - self.absorbed

    def rows(self) -> list[dict[str, float]]:
        """One a frequency, of a field without leading axes."""
        parts = {"energy out": self.out, "energy absorbed": self.absorbed, "energy missing": self.missing}
        return [{name: float(part[f]) for name, part in parts.items()} for f in range(len(self.out))]


def energy_balance(swept: SweptDuct, waves: Tensor, eta: Tensor, wall: Wall | None) -> EnergyBalance:
    """Of X (..., F, D) and eta (..., F, W) of ``boundaries.py`` and the wall that they were solved with."""
    mesh = swept.mesh
    mach = mesh.case.profile.bulk_mach
    along, against = (1 + mach) ** 2, (1 - mach) ** 2
    size = waves[..., [0, 1, -2, -1]].abs().square()
    coming = along * size[..., 0] + against * size[..., 2]
    out = against * size[..., 1] + along * size[..., 3]
    absorbed = torch.zeros_like(out)
    if wall is not None:
        back = wall.reflected(eta)
        widths = torch.as_tensor(mesh.lined_widths).to(swept.basis.weights)
        weights = torch.outer(widths, swept.basis.weights).flatten() / mesh.case.height
        absorbed = (((eta + back) * (eta - back).conj()).real * weights).sum(-1)
    return EnergyBalance(out / coming, absorbed / coming)


def warn_of_gain(balance: EnergyBalance, frequency: Tensor) -> None:
    """Say where more energy goes out than comes in though the wall takes some.

    Warns:
        DataWarning: with the frequency and the ratio.
    """
    out, absorbed = balance.out.detach(), balance.absorbed.detach()
    grown = ((out > GAIN) | (out + absorbed > FED)) & (absorbed > PASSIVE)
    if bool(grown.any()):
        item = int(torch.where(grown, out + absorbed, 0 * out).argmax())
        tell(
            f"at {float(frequency[item % len(frequency)]):g} Hz ({int(grown.sum())} of {grown.numel()} cases) "
            f"{float(out.flatten()[item]):.3g} times the energy that comes in goes out and "
            f"{float(absorbed.flatten()[item]):.3g} times is absorbed, though the wall is passive: a wave of the shear "
            "layer grows along the liner, or the mesh does not resolve it; do not rely on this field",
            depth=3,
        )
