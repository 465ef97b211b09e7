r"""Functions of |v| whose sums over a record say all of it: for every frequency, liner, derivative.

With :math:`R(f, |v|) = \sum_k c_k(f)\,\varphi_k(|v|)` a sum of R over a record is :math:`\sum_k c_k
m_k`, where the moments :math:`m_k = \sum_n w_n \varphi_k(|v_n|)` know neither frequency nor liner,
and :math:`c_k` comes from R at K speeds.

``Chebyshev`` serves all smooth R: :math:`\varphi_k = T_k(x)`, x = (|v| - c)/(|v| + c), so that no
largest speed has to be known beforehand. |v|^2.5 of eq. (2.4) at rest bounds the convergence:
K = 24 gives 1e-6 at one frequency, K = 64 some 1e-5 up to 6 kHz for most liners. ``Levels`` serves
tables, whose R has a kink at each of their speeds: cubics between levels that no kink parts.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.compiled.threads import one_thread
from torchliner.liners.model import LinerModel
from torchliner.liners.response import reflection_of

TOP_SPEED = 100.0  # m/s, up to which it holds
COUNTS = (16, 20, 24, 28, 32, 40, 48, 64, 96, 128)
# m/s, 0.09 to 6.4, exact in float32: a rounded c would shift all orders alike.
CENTRES = tuple(round(6.4 * 2 ** (0.4 * i)) / 64 for i in range(16))
ANY_LINER = (64, 1.5)  # K and c for liners that are not known yet
CHECKED = 500  # speeds at which R is compared
FIRST_CHECKED = 150  # in the search for a basis
MOST_ASKED = 31  # frequencies of which K and c are chosen; the error is stated over all
PARTS = (4, 8, 16, 32)  # of a table's step
STENCIL = 4
STEPS = 25  # uniform in the root of |v|, of a liner with a largest |v| and no kinks


@dataclass(frozen=True)
class Chebyshev:
    """T_k((|v| - c)/(|v| + c)), k < K.

    Args:
        count: K, 2 or more.
        centre: c, m/s.
    """

    count: int
    centre: float

    @functools.cached_property
    def _places(self) -> Tensor:
        order = torch.arange(self.count, dtype=torch.float64)
        return torch.cos(torch.pi * (order + 0.5) / self.count)

    @property
    def speeds(self) -> Tensor:
        """Those of the nodes, falling."""
        return self.centre * (1 + self._places) / (1 - self._places)

    @property
    def levels(self) -> int:
        """K."""
        return self.count

    @functools.cached_property
    def _transform(self) -> Tensor:
        """From values at the nodes to coefficients, (K, K)."""
        order = torch.arange(self.count, dtype=torch.float64)
        angle = torch.pi * torch.outer(order + 0.5, order) / self.count
        matrix = 2 / self.count * torch.cos(angle)
        matrix[:, 0] /= 2
        return matrix

    def coefficients(self, values: Tensor) -> Tensor:
        """By the discrete cosine transform."""
        return values @ self._transform.to(values)

    def weights(self, moments: Tensor) -> Tensor:
        """What values at ``speeds`` are weighed with, (..., K, P), from moments, (..., K, P): the
        adjoint of ``coefficients``, sum_k c_k m_k = sum_k w_k R(v_k)."""
        return self._transform.to(moments) @ moments

    def functions(self, speed: Tensor) -> Tensor:
        """T_k."""
        place = (speed.to(torch.float64) - self.centre) / (speed + self.centre)
        order = torch.arange(self.count, dtype=torch.float64)
        return torch.cos(order * place.clamp(-1, 1).acos()[:, None])

    def describe(self) -> dict[str, Any]:
        """K and c."""
        return {"kind": "chebyshev", "count": self.count, "centre": self.centre}


@dataclass(frozen=True)
class Levels:
    """Cardinal functions of piecewise cubics between the kinks of a table.

    Args:
        kinks: m/s, rising from 0, (M,) as a tuple; beyond the last |v| has no value.
        parts: equal steps from kink to kink, 3 or more.
    """

    kinks: tuple[float, ...]
    parts: int

    @property
    def count(self) -> int:
        """K."""
        return self.parts * (len(self.kinks) - 1) + 1

    @property
    def levels(self) -> int:
        """K."""
        return self.count

    @functools.cached_property
    def speeds(self) -> Tensor:
        """From kink to kink."""
        ends = torch.tensor(self.kinks, dtype=torch.float64)
        share = torch.arange(self.parts, dtype=torch.float64) / self.parts
        inner = ends[:-1, None] + ends.diff()[:, None] * share
        return torch.cat([inner.flatten(), ends[-1:]])

    def coefficients(self, values: Tensor) -> Tensor:
        """The values themselves."""
        return values

    def weights(self, moments: Tensor) -> Tensor:
        """The moments themselves."""
        return moments

    def locate(self, speed: Tensor) -> tuple[Tensor, Tensor]:
        """First level of each stencil (int64) and its weights, (4, ...), for |v| of any shape."""
        ends = torch.tensor(self.kinks, dtype=speed.dtype, device=speed.device)
        step = torch.bucketize(speed.contiguous(), ends, right=True)
        step = step.sub_(1).clamp_(0, len(ends) - 2)
        place = self.parts * (speed - ends[step]) / (ends[step + 1] - ends[step])
        first = (place.floor() - 1).clamp(0, self.parts + 1 - STENCIL).nan_to_num(0)
        t = place - first
        nodes = range(STENCIL)
        weights = []
        for i in nodes:
            weight = torch.ones_like(t)
            for other in nodes:
                if other != i:
                    weight = weight * (t - other) / (i - other)
            weights.append(weight)
        return self.parts * step + first.to(torch.int64), torch.stack(weights)

    def functions(self, speed: Tensor) -> Tensor:
        """At most four of each row are not 0."""
        index, weights = self.locate(speed.to(torch.float64))
        found = torch.zeros(len(speed), self.count, dtype=torch.float64)
        for i, weight in enumerate(weights):
            found.scatter_(1, index[:, None] + i, weight[:, None])
        return found

    def describe(self) -> dict[str, Any]:
        """Kinks and parts."""
        return {"kind": "levels", "kinks": list(self.kinks), "parts": self.parts}


Basis = Chebyshev | Levels  # K functions of |v|


def basis_of(described: dict[str, Any]) -> Basis:
    """From ``describe``."""
    if described["kind"] == "chebyshev":
        return Chebyshev(int(described["count"]), float(described["centre"]))
    return Levels(tuple(float(v) for v in described["kinks"]), int(described["parts"]))


Response = Callable[[Tensor, Tensor], Tensor]  # of frequency (F,) and |v| (V,): R, (F, V)


def response_of(liner: LinerModel) -> Response:
    """R of a liner's model, complex128, differentiable in its parameters."""

    def response(frequency: Tensor, speed: Tensor) -> Tensor:
        return reflection_of(liner, frequency[:, None], speed)

    return response


def interpolation_error(basis: Basis, response: Response, frequency: Tensor, top: float) -> tuple[float, float]:
    """Largest |dR| over 0 to ``top`` (m/s) and frequencies (Hz), and the |v| at which it stands."""
    speed = checked_speeds(top)
    with torch.no_grad():
        wanted = response(frequency, speed)
        found = basis.coefficients(response(frequency, basis.speeds))
        away = (found @ basis.functions(speed).T.to(found) - wanted).abs().amax(0)
    worst = int(away.argmax())
    return float(away[worst]), float(speed[worst])


@one_thread()
def choose_basis(liners: Sequence[LinerModel], frequency: Tensor, tolerance: float) -> Basis:
    """The smallest K, and the best c, with which R is known to ``tolerance``; no data are asked.

    Args:
        liners: that share the moments.
        frequency: Hz, (F,), wherever R will be read.
        tolerance: of R, at each |v| to ``TOP_SPEED``.
    Returns:
        ``Levels`` for tables over |v|, else ``Chebyshev``; where no K reaches the tolerance, the
        one that comes closest.
    """
    responses = [response_of(liner) for liner in liners]
    ends = [liner.speed_max for liner in liners if liner.speed_max is not None]
    top = min(ends, default=TOP_SPEED)
    with torch.no_grad():
        if ends:
            return _best_levels(responses, frequency, liners, top, tolerance)
        return _best_chebyshev(responses, frequency, tolerance)


def _best_levels(
    responses: Sequence[Response], frequency: Tensor, liners: Sequence[LinerModel], top: float,
    tolerance: float,
) -> Levels:  # fmt: skip
    kinks = {k for liner in liners for k in liner.speed_kinks if k < top}
    kinks = kinks or {top * (i / STEPS) ** 2 for i in range(STEPS)}
    rising = (*sorted(kinks | {0.0}), top)
    for parts in PARTS:
        found = Levels(rising, parts)
        errors = [interpolation_error(found, each, frequency, top)[0] for each in responses]
        if max(errors) <= tolerance:
            break
    return found


def _best_chebyshev(responses: Sequence[Response], frequency: Tensor, tolerance: float) -> Chebyshev:
    every = frequency
    if len(frequency) > MOST_ASKED:
        places = torch.linspace(0, len(frequency) - 1, MOST_ASKED).round().to(torch.int64)
        frequency = frequency.sort().values[places]

    def values_at(speed: Tensor) -> Tensor:
        """R of all liners and frequencies, (F, *speed.shape)."""
        flat = torch.cat([response(frequency, speed.flatten()) for response in responses])
        return flat.unflatten(1, speed.shape)

    wanted = values_at(checked_speeds(TOP_SPEED, FIRST_CHECKED))[:, None]
    best, least = Chebyshev(*ANY_LINER), float("inf")
    for count in COUNTS:
        made, functions = _candidates(count)
        values = values_at(torch.stack([basis.speeds for basis in made]))
        found = torch.einsum("fck,cvk->fcv", made[0].coefficients(values), functions.to(values))
        errors = (found - wanted).abs().amax((0, 2))
        if float(errors.min()) < least:
            best, least = made[int(errors.argmin())], float(errors.min())
        if least <= tolerance and all(
            interpolation_error(best, each, every, TOP_SPEED)[0] <= tolerance for each in responses
        ):
            break
    return best


@functools.lru_cache(maxsize=len(COUNTS))
def _candidates(count: int) -> tuple[list[Chebyshev], Tensor]:
    """Of all centres, and their functions at the speeds that are checked first, (C, V, K)."""
    made = [Chebyshev(count, centre) for centre in CENTRES]
    speed = checked_speeds(TOP_SPEED, FIRST_CHECKED)
    return made, torch.stack([basis.functions(speed) for basis in made])


def checked_speeds(top: float, count: int = CHECKED) -> Tensor:
    """Where an interpolation is compared, 0 to ``top``, m/s."""
    return top * torch.linspace(0, 1, count, dtype=torch.float64) ** 3
