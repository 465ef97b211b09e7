r"""K speeds at which R is evaluated, and the K functions of |v| whose sums over a record replace the record.

With :math:`g(|v|) = \sum_k c_k \varphi_k(|v|)` the sum of any g over a record is :math:`\sum_k c_k m_k`. The sums
:math:`m_k = \sum_t w_t \varphi_k(|v_t|)` know neither frequency nor liner, and :math:`c_k` follows from g at K speeds.

``Chebyshev`` serves every smooth liner: :math:`\varphi_k = T_k(x)`, x = (|v| - c)/(|v| + c), so that no largest speed
has to be known beforehand. K = 24 gives an error in R of 1e-6 at one frequency, K = 64 below 1e-5 up to 6 kHz where 5 %
or more are open. ``Levels`` serves tables, whose R has a kink at each of their speeds: cubics between the kinks.
"""

import importlib
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel, reflection_of

TOP_SPEED = 100.0  # m/s, up to which the error of Chebyshev nodes is stated
COUNTS = (16, 20, 24, 28, 32, 40, 48, 64, 96, 128)
CENTRES = tuple(round(6.4 * 2 ** (0.4 * i)) / 64 for i in range(16))  # m/s, 0.09 to 6.4, exact in float32
CHECKED, FIRST_CHECKED = 500, 150  # speeds at which R is compared; in the search for nodes
MOST_ASKED = 31  # frequencies by which K and c are chosen; the error is stated over all
PARTS = (4, 8, 16, 32)  # of a table's step between two kinks
ROUNDED = 1e-6  # relative, of the largest |v| of a table
TILE = 1 << 17  # velocities whose temporaries stay in the cache of a CPU
FASTER = {"cpu": "torchliner.engine.native", "cuda": "torchliner.engine.triton_sums"}  # by kind of device


def torch_sums(weights: Tensor, columns: Tensor, count: int, centre: float) -> Tensor:
    r"""m_k = sum_t w_t T_k(x_t), x = (|v| - c)/(|v| + c), in torch alone: the definition, on any device.

    From w of G slabs of at most 256 rows, in the precision of the data, (G, R, L), and v, m/s, (G, L, N): float64,
    (G, R, K, N). A nan or inf in v makes the sums of its own column nan, but for order 0, the sum of w.
    """
    slabs, rows, length = weights.shape
    width = columns.shape[2]
    found = torch.empty(slabs, rows, count, width, dtype=torch.float64, device=columns.device)
    tile = max(1, TILE // (slabs * length)) if columns.device.type == "cpu" else width
    for left in range(0, width, tile):
        v = columns[:, :, left : left + tile]
        each = v.new_empty(count, slabs, rows, v.shape[2])
        speed = v.abs()
        twice = (speed - centre).mul_(2).div_(speed.add_(centre))
        # T_k = 2 x T_{k-1} - T_{k-2}: with the signs +, +, -, -, +, +, ... of T_k the last term is added instead, so
        # that each order is one operation; the signs are put right at the end.
        before, now = torch.ones_like(speed), twice / 2
        torch.bmm(weights, before, out=each[0])
        for k in range(1, count):
            if k > 1:
                torch.addcmul(before, twice, now, value=(-1) ** (k - 1), out=before)
                before, now = now, before
            torch.bmm(weights, now, out=each[k])
        found[..., left : left + tile] = each.permute(1, 2, 0, 3)
    return found * (1 - 2 * (torch.arange(count, device=found.device) // 2 % 2))[:, None]


def lagrange(place: Tensor, nodes: Sequence[int]) -> list[Any]:
    """Weight of the value at each node in the polynomial through all of them, at a place between."""
    return [math.prod((place - j) / (i - j) for j in nodes if j != i) for i in nodes]


@dataclass(frozen=True)
class Chebyshev:
    """The functions T_k((|v| - c)/(|v| + c)), k < K."""

    count: int  # K, 2 or more
    centre: float  # c, m/s
    kind: Literal["chebyshev"] = "chebyshev"

    @property
    def speeds(self) -> Tensor:
        """At which R is evaluated, m/s, falling, float64, (K,)."""
        cosine = torch.cos(torch.pi / self.count * (torch.arange(self.count, dtype=torch.float64) + 0.5))
        return self.centre * (1 + cosine) / (1 - cosine)

    def coefficients(self, values: Tensor) -> Tensor:
        """c_k from values at the speeds, (..., K), by a discrete cosine transform."""
        order = torch.arange(self.count, dtype=torch.float64)
        matrix = 2 / self.count * torch.cos(torch.pi / self.count * torch.outer(order + 0.5, order))
        matrix[:, 0] /= 2
        return values @ matrix.to(values)

    def sums(self, weights: Tensor, columns: Tensor) -> Tensor:
        """Measure of ``engine.sums``: ``torch_sums`` by the fastest code of the device. A faster module has ``sums``
        alike, and ``available()``; ``TORCHLINER_SUMS=torch`` in the environment keeps to torch alone."""
        home = None if os.environ.get("TORCHLINER_SUMS") == "torch" else FASTER.get(columns.device.type)
        faster: Any = None if home is None else importlib.import_module(home)
        sums = faster.sums if faster is not None and faster.available() else torch_sums
        return sums(weights, columns, self.count, self.centre)


@dataclass(frozen=True)
class Levels:
    """Cardinal functions of piecewise cubics between the kinks of a table; members as of ``Chebyshev``."""

    kinks: tuple[float, ...]  # m/s, rising from 0; sums with |v| beyond the last are nan
    parts: int  # equal steps from kink to kink, 3 or more
    kind: Literal["levels"] = "levels"

    @property
    def count(self) -> int:
        """K."""
        return self.parts * (len(self.kinks) - 1) + 1

    @property
    def speeds(self) -> Tensor:
        """m/s, rising from kink to kink, float64, (K,)."""
        ends = torch.tensor(self.kinks, dtype=torch.float64)
        share = torch.arange(self.parts, dtype=torch.float64) / self.parts
        return torch.cat([(ends[:-1, None] + ends.diff()[:, None] * share).flatten(), ends[-1:]])

    def coefficients(self, values: Tensor) -> Tensor:
        """The values themselves."""
        return values

    def sums(self, weights: Tensor, columns: Tensor) -> Tensor:
        """At most four functions of each |v| are not 0: cubics through four levels."""
        speed = columns.abs().double().contiguous()
        ends = torch.tensor(self.kinks, dtype=torch.float64, device=speed.device)
        step = torch.bucketize(speed, ends, right=True).sub_(1).clamp_(0, len(ends) - 2)
        place = self.parts * (speed - ends[step]) / (ends[step + 1] - ends[step])
        first = (place.floor() - 1).clamp(0, self.parts - 3).nan_to_num(0)
        t = torch.where(speed > ends[-1] * (1 + ROUNDED), torch.nan, place - first)
        index = self.parts * step + first.to(torch.int64)
        found = torch.zeros(len(weights), weights.shape[1], self.count, columns.shape[2], device=speed.device).double()
        for i, share in enumerate(lagrange(t, range(4))):
            for row in range(weights.shape[1]):
                found[:, row].scatter_add_(1, index + i, share * weights[:, row, :, None])
        return found


Nodes = Chebyshev | Levels
ANY_LINER = Chebyshev(64, 1.5)  # for liners that are not known yet


@torch.no_grad()
def interpolation_error(nodes: Nodes, liner: LinerModel, frequency: Tensor, top: float) -> tuple[float, float]:
    """Largest error in R from its values at the nodes, over 0 to ``top`` (m/s), and the |v| where it occurs."""
    speed = top * torch.linspace(0, 1, CHECKED, dtype=torch.float64) ** 3
    functions = nodes.sums(torch.ones(CHECKED, 1, 1, dtype=torch.float64), speed[:, None, None])[:, 0, :, 0]
    found = nodes.coefficients(reflection_of(liner, frequency[:, None], nodes.speeds)) @ functions.T.to(
        torch.complex128
    )
    away = (found - reflection_of(liner, frequency[:, None], speed)).abs().amax(0)
    worst = int(away.argmax())
    return float(away[worst]), float(speed[worst])


@torch.no_grad()
def choose_nodes(liners: Sequence[LinerModel], frequency: Tensor, tolerance: float) -> Nodes:
    """The fewest nodes from which R of all liners is known to ``tolerance`` at each |v| up to ``TOP_SPEED``, at
    frequencies in Hz, (F,), the most where none are enough: ``Levels`` for tables over |v|, else ``Chebyshev`` with the
    best centre."""
    top = TOP_SPEED
    candidates: Iterable[Nodes] = _centred(liners, frequency)
    if ends := [liner.speed_max for liner in liners if liner.speed_max is not None]:
        top = min(ends)
        kinks = {kink for liner in liners for kink in liner.speed_kinks if kink < top}
        kinks = kinks or {top * (i / 25) ** 2 for i in range(25)}  # of a liner that states none
        candidates = (Levels((*sorted(kinks | {0.0}), top), parts) for parts in PARTS)
    best: Nodes = ANY_LINER
    for best in candidates:
        if all(interpolation_error(best, liner, frequency, top)[0] <= tolerance for liner in liners):
            break
    return best


def _centred(liners: Sequence[LinerModel], frequency: Tensor) -> Iterator[Chebyshev]:
    """More and more nodes, each number with that of ``CENTRES`` from which R is known best."""
    asked = frequency[:, None]
    if len(asked) > MOST_ASKED:
        asked = asked.sort(0).values[torch.linspace(0, len(asked) - 1, MOST_ASKED).round().to(torch.int64)]
    speed = TOP_SPEED * torch.linspace(0, 1, FIRST_CHECKED, dtype=torch.float64) ** 3
    centres = torch.tensor(CENTRES, dtype=torch.float64)[:, None]
    wanted = torch.cat([reflection_of(liner, asked, speed) for liner in liners])[:, None]
    angle = ((speed - centres) / (speed + centres)).acos()[:, :, None]
    for count in COUNTS:  # all centres at once, (C, K)
        unit = Chebyshev(count, 1.0)
        speeds = centres * unit.speeds
        values = torch.cat([reflection_of(liner, asked, speeds.flatten()) for liner in liners])
        functions = torch.cos(angle * torch.arange(count)).to(values)  # T_k, (C, V, K)
        found = torch.einsum("fck,cvk->fcv", unit.coefficients(values.unflatten(1, speeds.shape)), functions)
        yield Chebyshev(count, CENTRES[int((found - wanted).abs().amax((0, 2)).argmin())])
