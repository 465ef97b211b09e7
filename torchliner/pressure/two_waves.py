r"""Impedance from microphones at any places: least squares for two waves between the ends of a lined section.

.. math:: p(s) = A e^{-j\alpha_+ s} + B e^{-j\alpha_- (s - S)}, \quad 0 \le s \le S.

Amplitudes are solved for at every step; the unknown is the wall's reflection rho, which both wavenumbers follow: with
(r, s) the two parts of the relation at a wavenumber, (1 + rho) r = (1 - rho) s gives
:math:`d\alpha/d\rho = -(r + s)/((1 + \rho) r' - (1 - \rho) s')`. The start is the best of a grid of impedances.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import reflection_from_impedance
from torchliner.duct.dispersion import Duct, carry_wavenumber, duct_of, relation, wavenumber_from_impedance
from torchliner.names import DIRECTIONS
from torchliner.pressure.least_squares import System, best_of, least_squares, project, solve_linear
from torchliner.pressure.microphone_errors import MicrophoneErrors
from torchliner.pressure.waves import Waves, educe_waves, seen_from_source
from torchliner.records import MicrophoneLine, WallEduction

RESISTANCES = (0.1, 0.3, 0.8, 2.0, 5.0)
REACTANCES = (-4.0, -1.5, -0.5, 0.0, 0.5, 1.5, 4.0)
STARTS = 3
FEWEST = 4  # microphones: more equations than the three unknowns


def two_wave_fit(
    line: MicrophoneLine, *, condition: str = "ingard-myers", margin: float = 0.0, **errors: Any
) -> WallEduction:
    """Impedance by least squares over a wave with the source and one against it, the two of ``modes``, of one wall.

    Args:
        line: microphones at any places; those over the liner are used, all if it names no liner.
        condition, margin, errors: as for ``kumaresan_tufts``.
    Raises, Warns: as ``kumaresan_tufts``; fewer than four microphones; fits that did not settle.
    """
    seen = seen_from_source(line.over_liner(margin))
    count = seen.line.microphones
    if count < FEWEST:
        raise ValueError(f"{line.name}: {count} microphones are used; two waves of one wall need at least {FEWEST}")
    about: dict[str, Any] = {"frequency": line.frequency[:, None], "height": line.duct_height, "mach": seen.mach}
    about |= {"sound_speed": line.fluid.sound_speed, "condition": condition}
    walls = torch.tensor([complex(r, x) for r in RESISTANCES for x in REACTANCES], dtype=torch.complex128)
    first: list[Tensor] = []  # where the first search ended; others begin there

    def waves_of(pressure: Tensor) -> Waves:
        values = pressure.movedim(-2, -1).to(torch.complex128)  # (..., F, N)
        lead, s = values.shape[:-1], seen.distance.to(values.device)
        duct, _ = duct_of(values[..., :1].expand(*lead, 2), **about)
        pairs = WavePairs(values.reshape(-1, count), torch.stack([s, s - s[-1]], -1), duct.at(...))
        if first:
            found = least_squares(pairs.system, first[0].expand(*lead, 3).reshape(-1, 3), pairs.move)
        else:
            both = [wavenumber_from_impedance(walls, direction=each, **about) for each in DIRECTIONS]
            grid = torch.stack([reflection_from_impedance(walls).expand_as(both[0]), *both], -1).to(values.device)
            grid = grid.expand(*lead, -1, 3).reshape(len(pairs.pressure), -1, 3)
            columns = torch.exp(-1j * grid[..., None, 1:] * pairs.places)
            left = solve_linear(columns, pairs.pressure[:, None])[-1].norm(dim=-1)
            best = grid.gather(1, left.argsort(-1)[:, :STARTS, None].expand(-1, -1, 3))
            found = best_of(least_squares(pairs.system, each, pairs.move) for each in best.unbind(1))
            first.append(found.place.reshape(*lead, 3))
        # The reflected wave is referred to the far end in the fit, to the origin in the record.
        wave = found.place[:, 1:]
        amplitude = found.amplitude * torch.exp(1j * wave * s[-1] * torch.tensor([0, 1]).to(s))
        modes, amplitudes = (each.reshape(*lead, 2).movedim(-1, -2) for each in (wave, amplitude))
        residual = found.cost.sqrt().reshape(lead) / values.norm(dim=-1)
        return Waves(modes[..., 0, :], modes, amplitudes, residual, settled=found.converged.reshape(lead))

    choices, assumed = {"method": "two-wave fit", "margin": margin}, MicrophoneErrors(**errors)
    return educe_waves(
        seen, waves_of, method="two waves", unknowns=3, condition=condition, errors=assumed, choices=choices
    )


@dataclass(frozen=True, eq=False)
class WavePairs:
    """Lines of microphones, each fitted by two waves of one wall: its reflection rho, alpha+ and alpha-, (P, 3)."""

    pressure: Tensor  # complex, (P, N)
    places: Tensor  # s and s - S, m, (N, 2)
    duct: Duct  # of each line twice, (2 P,), the flow along s

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals and their change with rho, which both waves follow."""
        rho, wave = place[:, :1], place[:, 1:]
        columns = torch.exp(-1j * wave[:, None] * self.places)
        (r, r1), (s, s1) = (
            tuple(part.reshape(wave.shape) for part in pair) for pair in relation(wave.reshape(-1), self._of(index))
        )
        turn = -(r + s) / ((1 + rho) * r1 - (1 - rho) * s1)
        return project(columns, (-1j * self.places * columns * turn[:, None])[:, None], self.pressure[index])

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Walls after a step, and whether both waves could follow."""
        walls = [rho.expand(-1, 2).reshape(-1) for rho in (place[:, :1], place[:, :1] + step)]
        begin, end = ((1 + rho, 1 - rho) for rho in walls)
        waves, there = carry_wavenumber(self._of(index), place[:, 1:].reshape(-1), begin, end, first_step=1.0)
        there = (there & torch.isfinite(waves)).reshape(-1, 2).all(-1)
        return torch.cat([place[:, :1] + step, waves.reshape(-1, 2)], -1), there

    def _of(self, index: Tensor) -> Duct:
        """The duct at both waves of some lines."""
        return self.duct.at(torch.stack([2 * index, 2 * index + 1], -1))
