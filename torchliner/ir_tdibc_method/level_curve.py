"""What is found: impedance over level, and how far it can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.conversions import impedance_from_reflection

SETTLED, UNSETTLED = 1e-3, 5e-2  # drift that is warned of, and refused
KERNEL_PART = 0.02  # of |Z + 1|: what a kernel may change before it is warned of


@dataclass(frozen=True)
class FixedPoint:
    """Z(f) at an rms speed on which the incident wave and the wall agree.

    Args:
        speed: rms |v|, m/s.  impedance: complex128, (F,).
    """

    speed: float
    impedance: Tensor


@dataclass(frozen=True)
class LevelCurve:
    """Impedance of a wall driven by incident waves of L levels, N realisations each.

    Args:
        level: of the incident wave, dB re 20 uPa rms, (L,).
        frequency: Hz, (F,).
        reflection: Y/X of each realisation, complex128, (L, N, F).
        rms_speed, peak_speed: of v in the steady part, m/s, (L, N).
        residual: largest error of the implicit equation over the steps, of the largest |x|, (L, N).
        several: steps at which that equation has more than one solution, (L, N).
        drift: rms change of y against the record before, of its rms, (L, N); nan for recordings.
        reflected_energy: mean square of y over that of x, (L, N).
        fixed_points: of the frequency domain with one rms speed, by level; usually one.
        frozen: what the kernel changes in Z where |v| stands still at its rms: kernel's Z minus the
            model's, (L, F); 0 without kernel.
        kernel, kernel_error, kernel_gain: name, largest |H - R| in the band, largest |H|.
        kernel_band: Hz.  slope: largest |x| times max |dh0/ds|: below 1 each step has one solution.
        drive, incident, liner: names.  sampling_rate: Hz.
        samples: of the record that is read; as many steps settle before it.
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
    kernel: str
    kernel_error: float
    kernel_gain: float
    kernel_band: tuple[float, float]
    slope: float
    drive: str
    incident: str
    liner: str
    sampling_rate: float
    samples: int

    @property
    def impedance(self) -> Tensor:
        """Z of the mean of R over realisations, complex128, (L, F)."""
        return impedance_from_reflection(self.reflection.mean(1))

    @property
    def spread(self) -> Tensor:
        """Standard deviation of one realisation's R + jX, as u(R) + j u(X), (L, F); nan of one."""
        each = impedance_from_reflection(self.reflection)
        if each.shape[1] == 1:  # whose scatter nobody knows
            return torch.full_like(each[:, 0], complex(math.nan, math.nan))
        return torch.complex(each.real.std(1), each.imag.std(1))

    @property
    def seconds(self) -> float:
        """Length of the record that is read."""
        return self.samples / self.sampling_rate


def judge(curve: LevelCurve) -> None:
    """Refuse what has no steady state; warn of what is doubtful.

    Raises:
        ValueError: the drift of a level.
    """
    for level, drift in zip(curve.level.tolist(), curve.drift.amax(1).tolist(), strict=True):
        if drift > UNSETTLED:
            raise ValueError(
                f"at {level:g} dB y still changes by {drift:.2g} of its rms from one record of "
                f"{1e3 * curve.seconds:.3g} ms to the next: no steady state; give a longer "
                f"duration, or a kernel of lower gain than {curve.kernel_gain:.3g}"
            )
        if drift > SETTLED:
            tell(f"at {level:g} dB y still changes by {drift:.2g} of its rms from one record to "
                 "the next; a longer duration settles it", 2)  # fmt: skip
    z = curve.impedance - curve.frozen
    share = (curve.frozen.abs() / (z + 1).abs()).amax(1)
    worst = int(share.argmax())
    if share[worst] > KERNEL_PART:
        f = int((curve.frozen[worst].abs() / (z[worst] + 1).abs()).argmax())
        tell(f"kernel {curve.kernel!r} is not the liner's response: with |v| frozen at the rms of "
             f"{curve.level[worst]:g} dB it moves Z at {curve.frequency[f]:g} Hz by "
             f"{complex(curve.frozen[worst, f]):.3f}; see the kernel 'periodic'", 2)  # fmt: skip
    for level, several in zip(curve.level.tolist(), curve.several.amax(1).tolist(), strict=True):
        if several:
            tell(f"at {level:g} dB {several} steps have more than one |v|; the least was taken", 2)
