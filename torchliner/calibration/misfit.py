r"""The educed reflection as a sum over node speeds: one plane, any liner, no pass over its data;
from it impedances of several planes, and their misfit, as functions of parameters of their liners.

The educed reflection is linear in the response R(f, |v|) of the liner. Interpolated over |v| from
the speeds v_k of the nodes, it is

    R_educed = sum_k W[k] R(f, v_k),

with weights W that follow from the moments of |v| alone: they are the same for every liner and every frequency.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, impedance_from_admittance
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Nodes, interpolation_error, response
from torchliner.forward_mode import slopes_of
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.notes import Note
from torchliner.velocity.answer import require_fitting
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.review import review_liner

WORK_NUMBERS = 1 << 22  # complex, held at once for many draws


@dataclass(frozen=True, eq=False)
class SpeedWeights:
    """Whole-liner impedance of one plane as a function of what its liner reflects.

    Args:
        known: moments of the plane.  averaging: of it.  frequency: Hz, (F,).
        weights: W, complex128, (C, K) for C columns.
        share: of each column in the mean, complex128, (C,).
        notes: warnings so far.
    """

    known: Moments
    averaging: str
    frequency: Tensor
    weights: Tensor
    share: Tensor
    notes: tuple[Note, ...] = ()

    @property
    def nodes(self) -> Nodes:
        """Speeds at which R is asked for."""
        assert self.known.nodes is not None
        return self.known.nodes

    @property
    def plane(self) -> VelocityPlane:
        """Its facts."""
        return self.known.plane

    def reflection(self, values: Tensor) -> Tensor:
        """R of every column, (..., F, C), from the model's at the nodes, (..., F, K)."""
        return values @ self.weights.T

    def impedance(self, values: Tensor) -> Tensor:
        """Z of the liner, (..., F), from the model's R at the nodes, (..., F, K)."""
        return impedance_from_admittance(admittance_from_reflection(self.reflection(values)) @ self.share)

    def model_error(self, liner: LinerModel) -> float:
        """Largest error in R of the interpolation over |v|, up to the largest of the data."""
        known, model = self.known, liner.in_flow(self.plane.mach)
        return interpolation_error(self.nodes, model, self.frequency, known.top_speed(model))[0]


def responses_of(liner: LinerModel, planes: Sequence[SpeedWeights]) -> list[Tensor]:
    """R at the frequencies and nodes of each plane, (F, K); the model is asked once. The planes share their nodes."""
    lines, place = torch.cat([plane.frequency for plane in planes]).unique(return_inverse=True)
    values = response(liner, lines, planes[0].nodes.speeds)
    return list(values[place].split([len(plane.frequency) for plane in planes]))


def require_plain_tones(chosen: Choices) -> None:
    """Refuse choices that a sum over node speeds does not know.

    Raises:
        ValueError: another phase rule, the rms of the record, or walls.
    """
    if chosen.phase != "averaged" or chosen.drive == "rms":
        raise ValueError(
            f"a fit takes phase 'averaged' and another drive than 'rms', not {chosen.phase!r} and {chosen.drive!r}; "
            "leave them out"
        )
    if chosen.wall_filter is not None:
        raise ValueError(
            f"wall_filter is {chosen.wall_filter:g}, and a fit takes all probes for liner: leave "
            "it out, and read a region without the walls"
        )


def _columns(known: Moments, averaging: str) -> Tensor:
    """Those that an averaging takes the mean over, bool."""
    if averaging == "velocity":
        return torch.ones(known.cells.count, dtype=torch.bool)
    return known.used if averaging == "admittance" else known.used & (known.cells.labels >= 0)


def speed_weights(
    plane: VelocityPlane | Moments, liner: LinerModel, frequency: Any, chosen: Choices, *, tables: bool = True
) -> SpeedWeights:
    """W of the columns that the averaging takes; a plane is read once, for its liner with any numbers.

    Args:
        plane: or its moments.  liner: whose cells are taken.  frequency: Hz; default the tone.
        tables: whether a liner that is a table over |v| has its own nodes; else those of any liner.
    """
    if isinstance(plane, Moments):
        known = plane
        asked = known.plane.asked(frequency)
        require_fitting(known, liner, asked, chosen)
    else:
        asked = plane.asked(frequency)
        own = tables and liner.speed_max is not None
        about: Any = {} if own else {"cell_pitch": liner.cell_pitch}
        known = moments(plane, liner if own else None, frequency, **about, **vars(chosen))
    averaging, nodes = chosen.averaging, known.nodes
    assert nodes is not None
    columns = _columns(known, averaging)
    sums = known.sums[averaging][:, 0].sum(0).cpu()[:, columns] / known.survey.lengths.sum().cpu()
    transform = nodes.coefficients(torch.eye(nodes.count, dtype=torch.float64))
    size = known.cells.weight if averaging == "velocity" else None
    size = torch.ones(sums.shape[1], dtype=torch.float64) if size is None else size
    notes = (*known.notes, *review_liner(known.plane, liner))
    weights, share = (transform @ sums).T.to(torch.complex128), (size / size.sum()).to(torch.complex128)
    return SpeedWeights(known, averaging, asked, weights, share, tuple(dict.fromkeys(notes)))


def driving_squares(known: Moments, averaging: str) -> Tensor:
    """Mean squares of the |v| that drives the model, of the columns of an averaging, m2/s2."""
    seen = survey_of_columns(known, averaging)
    square = seen.mean_square
    if known.settings["mean"] == "removed":
        square = square - seen.mean**2
    return square.cpu()[_columns(known, averaging)]


def driving_speed(weights: SpeedWeights) -> float:
    """rms over the record and the columns of the |v| that drives the model, m/s."""
    return float(driving_squares(weights.known, weights.averaging).mean().clamp(min=0).sqrt())


@dataclass(frozen=True, eq=False)
class FreeLiners:
    """Planes whose liners share free parameters.

    Args:
        planes: weights of node speeds, one a plane.
        liners: one a plane; the same object where they share one.
        names: of the free parameters, n of them.
    """

    planes: Sequence[SpeedWeights]
    liners: Sequence[LinerModel]
    names: tuple[str, ...]

    def moved(self, values: Any) -> list[LinerModel]:
        """The liners with these values, SI; the same object where they share one."""
        named = dict(zip(self.names, values, strict=True))
        made = {id(liner): liner.with_numbers(named) for liner in self.liners}
        return [made[id(liner)] for liner in self.liners]

    def responses(self, values: Any) -> list[Tensor]:
        """R of each plane's liner at its frequencies and nodes, (F, K)."""
        moved = [each.in_flow(p.plane.mach) for each, p in zip(self.moved(values), self.planes, strict=True)]
        shared: dict[Any, list[int]] = {}
        for i, (liner, plane) in enumerate(zip(moved, self.planes, strict=True)):
            shared.setdefault((id(liner), plane.nodes), []).append(i)
        found: dict[int, Tensor] = {}
        for members in shared.values():
            rows = responses_of(moved[members[0]], [self.planes[i] for i in members])
            found |= dict(zip(members, rows, strict=True))
        return [found[i] for i in range(len(moved))]

    def impedance(self, values: Tensor) -> Tensor:
        """Z of all planes and frequencies, (D,), differentiable in ``values`` (n,)."""
        rows = self.responses(values.unbind())
        return torch.cat([p.impedance(row) for p, row in zip(self.planes, rows, strict=True)])

    def impedances(self, values: Tensor) -> Tensor:
        """The same for many, (M, n) to (M, D), a block of them at a time."""
        work = sum(len(p.frequency) * sum(p.weights.shape) for p in self.planes)
        blocks = []
        for block in values.split(max(1, WORK_NUMBERS // work)):
            rows = zip(*(self.responses(each) for each in block.unbind()), strict=True)
            found = [p.impedance(torch.stack(r)) for p, r in zip(self.planes, rows, strict=True)]
            blocks.append(torch.cat(found, dim=-1))
        return torch.cat(blocks)

    def model_error(self, values: Any) -> float:
        """Largest error in R of the interpolation over |v|, with these values."""
        both = zip(self.planes, self.moved(values), strict=True)
        return max(plane.model_error(liner) for plane, liner in both)


@dataclass(frozen=True, eq=False)
class Misfit(FreeLiners):
    """Residuals over their uncertainties.

    Args:
        low, high: bounds, (n,).  wanted: reference impedances of all planes and frequencies, (D,).
        noise: standard uncertainty of R (real part) and X (imaginary part), (D,).
        prior: mean and standard deviation by parameter.
    """

    low: Tensor
    high: Tensor
    wanted: Tensor
    noise: Tensor
    prior: Mapping[str, tuple[float, float]]

    @property
    def data(self) -> int:
        """How many real numbers the fit is held to, priors apart."""
        return 2 * len(self.wanted)

    def misses(self, impedance: Tensor) -> list[Tensor]:
        """Residuals of the data, each (..., n), from Z (..., D)."""
        away = impedance - self.wanted
        return [away.real / self.noise.real, away.imag / self.noise.imag]

    def values(self, share: Tensor) -> Tensor:
        """SI, from the place in the box, 0 to 1, (..., n)."""
        return self.low + share * (self.high - self.low)

    def residuals(self, values: Tensor, impedance: Tensor) -> Tensor:
        """(..., data + priors) from values (..., n) and Z (..., D)."""
        parts = self.misses(impedance)
        for i, name in enumerate(self.names):
            if name in self.prior:
                mean, spread = self.prior[name]
                parts.append((values[..., i : i + 1] - mean) / spread)
        return torch.cat(parts, dim=-1)

    def slopes(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals (m,) and their derivatives in the place in the box, (m, n)."""
        at = [each.clone().requires_grad_() for each in share.detach()]
        values = self.values(torch.stack(at))
        rows = self.residuals(values, self.impedance(values))
        columns = [torch.zeros_like(rows) if c is None else c for c in slopes_of(rows, at)]
        return rows.detach(), torch.stack(columns, dim=1)


@dataclass(frozen=True, eq=False)
class LevelMisfit(Misfit):
    """Held to the level check alone: logarithm of implied over known pressure, no reference.

    ``noise`` is that of the level in nepers (real part) and of the phase in rad.

    Args:
        ratios: of each plane, from its Z (..., F); see ``torchliner.velocity.level_check``.
        has_phase: of each plane, whether the phase is known too.
    """

    ratios: Sequence[Callable[[Tensor], Tensor]]
    has_phase: Sequence[bool]

    @property
    def counts(self) -> list[int]:
        """Frequencies of each plane."""
        return [len(plane.frequency) for plane in self.planes]

    @property
    def data(self) -> int:
        """A level each, and a phase where it is known."""
        both = zip(self.counts, self.has_phase, strict=True)
        return sum(count * (2 if phase else 1) for count, phase in both)

    def logarithms(self, impedance: Tensor) -> list[Tensor]:
        """Of each plane, complex, (..., F), from Z (..., D)."""
        parts = impedance.split(self.counts, -1)
        return [ratio(z).log() for ratio, z in zip(self.ratios, parts, strict=True)]

    def misses(self, impedance: Tensor) -> list[Tensor]:
        """Residuals of levels, and of phases where known."""
        found = []
        both = zip(self.logarithms(impedance), self.noise.split(self.counts), strict=True)
        for (away, noise), phase in zip(both, self.has_phase, strict=True):
            found.append(away.real / noise.real)
            if phase:
                found.append(away.imag / noise.imag)
        return found
