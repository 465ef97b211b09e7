r"""Impedance from microphones at any places: least squares for two waves between the ends of a lined section.

.. math:: p(s) = A e^{-j\alpha_+ s} + B e^{-j\alpha_- (s - S)}, \quad 0 \le s \le S.

Amplitudes are solved for at every step; the unknown is alpha+, whose wall alpha- follows: with (r, s) the two parts of
the relation at alpha+, (R, S) those at alpha-, S r = R s gives
:math:`d\alpha_-/d\alpha_+ = -(s'R - r'S)/(sR' - rS')`. The start is the best of a grid of impedances.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.duct.dispersion import Duct, carry_wavenumber, duct_of, relation, wavenumber_from_impedance
from torchliner.names import DIRECTIONS
from torchliner.pressure.least_squares import Problem, System, best_of, least_squares, project, solve_linear
from torchliner.pressure.microphone_errors import MicrophoneErrors
from torchliner.pressure.waves import Waves, educe_waves, seen_from_source
from torchliner.records import MicrophoneLine, WallEduction

RESISTANCES = (0.1, 0.3, 0.8, 2.0, 5.0)
REACTANCES = (-4.0, -1.5, -0.5, 0.0, 0.5, 1.5, 4.0)
STARTS = 3
FEWEST = 4  # microphones: more equations than the three unknowns


def two_wave_fit(
    line: MicrophoneLine,
    *,
    source_side: str | None = None,
    condition: str = "ingard-myers",
    margin: float = 0.0,
    **errors: Any,
) -> WallEduction:
    """Impedance by least squares over a wave with the source and one against it, the two of ``modes``, of one wall.

    Args:
        line: microphones at any places; those over the liner are used, all if it names no liner.
        source_side, condition, margin, errors: as for ``kumaresan_tufts``.
    Raises, Warns: as ``kumaresan_tufts``; fewer than four microphones; fits that did not settle.
    """
    seen = seen_from_source(line.over_liner(margin), source_side)
    count = seen.line.microphones
    if count < FEWEST:
        raise ValueError(f"{line.name}: {count} microphones are used; two waves of one wall need at least {FEWEST}")
    about = {"height": line.duct_height, "mach": seen.mach, "sound_speed": line.fluid.sound_speed}
    first: list[Tensor] = []  # where the first search ended; others begin there

    def waves_of(pressure: Tensor) -> Waves:
        values = pressure.movedim(-2, -1).to(torch.complex128)  # (..., F, N)
        lead, frequency, s = values.shape[:-1], line.frequency.to(values.device), seen.distance.to(values.device)
        duct, _ = duct_of(values[..., 0], frequency, line.duct_height, seen.mach, about["sound_speed"], condition)
        flat = values.reshape(-1, count)
        pairs = WavePairs(flat, torch.stack([s, s - s[-1]], -1), duct.at(...))
        if first:
            found = least_squares(pairs, first[0].expand(*lead, 2).reshape(-1, 2))
        else:
            walls = torch.tensor([complex(r, x) for r in RESISTANCES for x in REACTANCES], dtype=torch.complex128)
            both = [
                wavenumber_from_impedance(walls, line.frequency[:, None], **about, condition=condition, direction=each)
                for each in DIRECTIONS
            ]
            grid = torch.stack(both, -1).to(values.device).expand(*lead, -1, 2).reshape(len(flat), -1, 2)
            best = pairs.residuals(grid).argsort(-1)[:, :STARTS, None]
            found = best_of(
                least_squares(pairs, grid.gather(1, each.expand(-1, 1, 2))[:, 0]) for each in best.split(1, 1)
            )
            first.append(found.place.reshape(*lead, 2))
        # The reflected wave is referred to the far end in the fit, to the origin in the record.
        amplitude = found.amplitude * torch.exp(1j * found.place * s[-1] * torch.tensor([0, 1]).to(s))
        modes, amplitudes = (each.reshape(*lead, 2).movedim(-1, -2) for each in (found.place, amplitude))
        residual = (found.cost / pairs.whole).sqrt().reshape(lead)
        return Waves(modes[..., 0, :], modes, amplitudes, residual, settled=found.converged.reshape(lead))

    return educe_waves(
        seen,
        waves_of,
        method="two waves",
        unknowns=3,
        condition=condition,
        errors=MicrophoneErrors(**errors),
        choices={"method": "two-wave fit", "margin": margin},
    )


@dataclass(frozen=True, eq=False)
class WavePairs(Problem):
    """Lines of microphones, each to be fitted by two waves of one wall, from alpha+ and alpha-, (P, 2)."""

    pressure: Tensor  # complex, (P, N)
    places: Tensor  # s and s - S, m, (N, 2)
    duct: Duct  # of each line, (P,), the flow along s

    tolerance = 1e-10  # of k + |alpha|

    @property
    def whole(self) -> Tensor:
        """Sum of squares of the pressures, (P,)."""
        return self.pressure.abs().square().sum(-1)

    def residuals(self, wave: Tensor) -> Tensor:
        """What pairs (P, G, 2) leave, (P, G)."""
        columns = torch.exp(-1j * wave[..., None, :] * self.places)
        return solve_linear(columns, self.pressure[:, None])[-1].norm(dim=-1)

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals and their change with alpha+, which alpha- follows."""
        columns = torch.exp(-1j * place[:, None, :] * self.places)
        (r, r1), (s, s1) = relation(place[:, 0], duct := self.duct.at(index))
        (far_r, far_r1), (far_s, far_s1) = relation(place[:, 1], duct)
        turn = -(s1 * far_r - r1 * far_s) / (s * far_r1 - r * far_s1)  # d alpha-/d alpha+ at one wall
        both = torch.stack([torch.ones_like(turn), turn], -1)[:, None]
        return project(columns, (-1j * self.places * columns * both)[:, None], self.pressure[index])

    def size(self, place: Tensor, step: Tensor, index: Tensor) -> Tensor:
        """Of k + |alpha|."""
        return step.abs().amax(-1) / (self.duct.wavenumber[index] + place.abs().amax(-1))

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Both wavenumbers after a step, and whether alpha- could follow."""
        duct, ahead = self.duct.at(index), place[:, 0] + step[:, 0]
        begin, end = _wall_of(place[:, 0], duct), _wall_of(ahead, duct)
        # Both pairs are known up to a factor; the straight way between them is to be the short one.
        inner = begin[0].conj() * end[0] + begin[1].conj() * end[1]
        turn = torch.where(inner.abs() > 0, inner.conj() / inner.abs().clamp(min=1e-300), 1 + 0j)
        behind, there = carry_wavenumber(duct, place[:, 1], begin, (end[0] * turn, end[1] * turn), first_step=1.0)
        return torch.stack([ahead, behind], -1), there & torch.isfinite(behind)


def _wall_of(wavenumber: Tensor, duct: Duct) -> tuple[Tensor, Tensor]:
    """The wall (a, b), a : b = Z : 1 and |a|^2 + |b|^2 = 1, at which alpha is a root."""
    rigid, soft = relation(wavenumber, duct)
    size = (rigid[0].abs().square() + soft[0].abs().square()).sqrt().clamp(min=1e-300)
    return soft[0] / size, rigid[0] / size
