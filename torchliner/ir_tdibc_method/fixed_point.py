r"""The frequency domain's answer: one speed for the whole record, its rms.

With p_i the mean square of the incident wave (as a velocity) at its frequencies f_i,

    s^2 = sum_i p_i |1 - R(f_i, s)|^2,    Z(f) = Z(f, s).

The right side lies between 0 and :math:`4 \sum p_i` for passive walls, so all roots do too.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.liners.response import reflection_of

PLACES = 2001  # where the equation is looked at, closer towards rest; two roots in one gap are lost
HALVINGS = 60
MOST_LINES = 256  # of a noise; neighbours are taken together


def fixed_points(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> list[float]:
    """All rms speeds (m/s) that the wave and the wall agree on, up to ``highest``.

    Args:
        liner: R(f, s).  frequency: Hz, (F,).  power: mean square, m2/s2, (F,).
        highest: of the speeds looked at, m/s.
    """
    wall = frequency[:, None]

    def short(speed: Tensor) -> Tensor:
        made = (power[:, None] * (1 - reflection_of(liner, wall, speed)).abs() ** 2).sum(0)
        return speed - made.sqrt()

    top = min(highest, 2.5 * float(power.sum().sqrt()))
    places = top * torch.linspace(0, 1, PLACES, dtype=torch.float64) ** 2
    left = short(places)
    crossed = ((left[1:] > 0) != (left[:-1] > 0)).nonzero().flatten()
    low, high = places[crossed], places[crossed + 1]
    rising = left[crossed + 1] > 0
    for _ in range(HALVINGS if len(crossed) else 0):
        middle = (low + high) / 2
        above = (short(middle) > 0) == rising
        low, high = torch.where(above, low, middle), torch.where(above, middle, high)
    return ((low + high) / 2).tolist()


def spectrum_of(sent: Tensor, sampling_rate: float) -> tuple[Tensor, Tensor]:
    """Frequencies and mean squares of the lines of a real record (n,) that carry it.

    Each stands for a group of neighbours where there are many.
    """
    n = len(sent)
    power = 2 * (torch.fft.rfft(sent) / n).abs().square()
    power[0] = 0  # a mean moves no wave
    keep = power > 1e-10 * power.max()
    frequency = torch.fft.rfftfreq(n, 1 / sampling_rate, dtype=torch.float64)[keep]
    power = power[keep]
    together = torch.arange(len(power)) * min(MOST_LINES, len(power)) // len(power)
    sums = torch.zeros(int(together[-1]) + 1, dtype=torch.float64)
    sums = sums.index_add(0, together, power)
    means = torch.zeros_like(sums).index_add(0, together, power * frequency) / sums
    return means, sums
