r"""How |v| is distributed, from its moments: no sample is needed.

The moments of a record, :math:`m_k = \langle T_k(x)\rangle` with x = (|v| - c)/(|v| + c), are the
coefficients of the density of :math:`\theta = \arccos x`, :math:`p = (m_0 + 2 \sum_k g_k m_k \cos
k\theta)/\pi`. With Jackson's factors g_k it is nowhere negative and smooth over about
:math:`\pi/K` in theta; its integral is a sum of sines. The factors are those of the kernel
polynomial method, Weisse et al. (2006), Rev. Mod. Phys. 78, 275, as public codes that name it have
them; a test holds the result against the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Chebyshev

FINE = 4000  # speeds at which quantiles are looked for


@dataclass(frozen=True)
class Speeds:
    """Distribution of |v| over all probes and samples.

    Args:
        moments: mean of T_k over record and probes, (K,).  centre: c, m/s.
        top: largest |v| of the record, m/s.  mean_square: of v, m2/s2.
    """

    moments: Tensor
    centre: float
    top: float
    mean_square: float

    def below(self, speed: Tensor) -> Tensor:
        """Share of the samples with |v| up to ``speed`` (m/s, at least 0)."""
        count = len(self.moments)
        order = torch.arange(count, dtype=torch.float64)
        step = math.pi / (count + 1)
        jackson = ((count - order + 1) * (step * order).cos() + (step * order).sin() / math.tan(step)) / (count + 1)
        theta = ((speed - self.centre) / (speed + self.centre)).clamp(-1, 1).acos()
        waves = (theta[:, None] * order[1:]).sin() / order[1:]
        share = (math.pi - theta) * self.moments[0] - 2 * waves @ (jackson * self.moments)[1:]
        return (share / math.pi / self.moments[0]).clamp(0, 1)

    def quantile(self, share: float) -> float:
        """|v| below which a share of the samples lies, m/s."""
        speed = torch.linspace(0, 1, FINE, dtype=torch.float64).square() * self.top
        place = int((self.below(speed) < share).sum())
        return float(speed[min(place, FINE - 1)])

    def density(self, bins: int) -> tuple[Tensor, Tensor]:
        """Edges of equal bins (bins + 1,), m/s, and the mean density in each, s/m."""
        edges = torch.linspace(0, self.quantile(0.995) * 1.05, bins + 1, dtype=torch.float64)
        return edges, self.below(edges).diff() / edges.diff()

    def resolution(self, speed: float) -> float:
        """Over which |v| the density is smooth, m/s."""
        turn = math.pi / (len(self.moments) + 1)
        return turn * math.sqrt(speed / self.centre) * (speed + self.centre)


def speeds_of(known: Moments) -> Speeds | None:
    """Of the probes; None where the moments are of a table's levels, which are no polynomials."""
    nodes, sums = known.nodes, known.sums.get("admittance")
    if not isinstance(nodes, Chebyshev) or sums is None:
        return None
    own = sums[:, 0].sum(0).cpu()[:, known.used].mean(1)  # of T_k, (K,)
    seen = known.survey
    top, square = seen.peak.nan_to_num(0).max(), seen.mean_square.nanmean()
    return Speeds(own / seen.lengths.sum().cpu(), nodes.centre, float(top), float(square))
