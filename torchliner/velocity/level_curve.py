"""Impedance over the level of the incident wave, as IR-TDIBC finds it, and how far it can be trusted."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_reflection
from torchliner.liners.model import LinerModel, reflection_of

SETTLED, UNSETTLED = 1e-3, 5e-2  # drift above which there is a warning, and an error
PLACES = 2001  # speeds at which the frequency domain is looked at, closer towards rest; two roots in one gap are lost
KERNEL_PART = 0.02  # of |Z + 1|: what a kernel may change without a warning


class FixedPoint(NamedTuple):
    """Z(f), complex128, (F,), at an rms |v|, m/s, that is just what the incident wave then drives."""

    speed: float
    impedance: Tensor


@dataclass(frozen=True)
class LevelCurve:
    """Impedance of a wall driven by incident waves of L levels, N realisations each.

    Args:
        level: of the incident wave, dB re 20 uPa rms, (L,).
        frequency: Hz, (F,).
        reflection: Y/X of each realisation, complex128, (L, N, F).
        rms_speed, peak_speed: of v in the record that is read, m/s, (L, N).
        residual: largest error of the implicit equation, of the largest |x|, (L, N).
        several: steps at which that equation has more than one solution, (L, N).
        drift: rms change of y against the record before, of its rms, (L, N); nan with kernel ``periodic``.
        reflected_energy: mean square of y over that of x, (L, N).
        fixed_points: of the frequency domain with one rms speed, by level; usually one.
        frozen: Z of the kernel less Z of the model, where |v| stands still at its rms, (L, F).
        choices: ``kernel``, ``kernel_band`` (Hz), ``kernel_error`` and ``kernel_gain``, largest |H - R| in the band and
            largest |H|; ``drive``, ``incident``, ``liner``, ``sampling_rate`` (Hz) and ``duration`` (s) of the record.
    """

    level: Tensor
    frequency: Tensor
    reflection: Tensor
    rms_speed: Tensor
    peak_speed: Tensor
    residual: Tensor
    several: Tensor
    drift: Tensor
    reflected_energy: Tensor
    fixed_points: tuple[tuple[FixedPoint, ...], ...]
    frozen: Tensor
    choices: dict[str, Any]

    @property
    def impedance(self) -> Tensor:
        """Z of the mean of R over realisations, complex128, (L, F)."""
        return impedance_from_reflection(self.reflection.mean(1))

    @property
    def spread(self) -> Tensor:
        """Standard deviation of one realisation's R + jX, as u(R) + j u(X), (L, F); nan of one."""
        each = torch.view_as_real(impedance_from_reflection(self.reflection))
        alone = torch.full_like(each[:, 0], math.nan)
        return torch.view_as_complex(alone if each.shape[1] == 1 else each.std(1))

    def warnings(self) -> Iterator[str]:
        """What is doubtful.

        Raises:
            ValueError: a level that has no steady state.
        """
        levels, chosen = self.level.tolist(), self.choices
        for level, drift in zip(levels, self.drift.amax(1).tolist(), strict=True):
            still = f"at {level:g} dB y still changes by {drift:.2g} of its rms from one record"
            if drift > UNSETTLED:
                raise ValueError(
                    f"{still} of {1e3 * chosen['duration']:.3g} ms to the next: no steady state; give a longer "
                    f"duration, or a kernel of lower gain than {chosen['kernel_gain']:.3g}"
                )
            if drift > SETTLED:
                yield f"{still} to the next; a longer duration settles it"
        share = self.frozen.abs() / (self.impedance - self.frozen + 1).abs()
        i, j = divmod(int(share.argmax()), share.shape[1])
        if share[i, j] > KERNEL_PART:
            yield (
                f"kernel {chosen['kernel']!r} is not the liner's response: with |v| frozen at the rms of {levels[i]:g} "
                f"dB it moves Z at {self.frequency[j]:g} Hz by {complex(self.frozen[i, j]):.3f}; see the kernel "
                "'periodic'"
            )
        for level, several in zip(levels, self.several.amax(1).tolist(), strict=True):
            if several:
                yield f"at {level:g} dB {several} steps have more than one |v|; the least was taken"


def fixed_points(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> list[float]:
    r"""All rms speeds (m/s) up to ``highest`` that the wave and the wall agree on.

    With p_i the mean square of the incident wave (as a velocity, m2/s2, (F,)) at its frequencies f_i (Hz, (F,)),
    :math:`s^2 = \sum_i p_i |1 - R(f_i, s)|^2`, which lies between 0 and :math:`4 \sum p_i` for passive walls.
    """
    from scipy.optimize import brentq  # takes a while to import

    def excess(speed: Tensor) -> Tensor:
        made = power[:, None] * (1 - reflection_of(liner, frequency[:, None], speed)).abs() ** 2
        return speed - made.sum(0).sqrt()

    top = min(highest, 2.5 * float(power.sum().sqrt()))
    places = top * torch.linspace(0, 1, PLACES, dtype=torch.float64) ** 2
    beyond = excess(places) > 0
    ends = [(float(places[i]), float(places[i + 1])) for i in (beyond[1:] != beyond[:-1]).nonzero().flatten()]
    return [brentq(lambda s: float(excess(torch.tensor([s], dtype=torch.float64))), *each, xtol=1e-14) for each in ends]
