r"""Runs of a liner: Z of each plane as a function of what its liner reflects, and what that Z is held to.

The educed reflection is linear in the response R(f, |v|) of the liner. Interpolated over |v| from the speeds v_k of the
nodes it is :math:`R_c = \sum_k W_{ck} R(f, v_k)` for each column c (a probe, or a cell), with weights that follow from
the moments of |v| alone: they are the same for every liner and every frequency. So the data enter once, and a fit, its
exact Jacobian and thousands of draws cost no further reading.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import admittance_from_reflection, impedance_from_admittance, reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Nodes
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.notes import Note
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.answer import require_fitting
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.known_pressure import Case, known_pressure
from torchliner.velocity.level_check import ratio_of_pressures
from torchliner.velocity.review import review_liner, review_record

NEPER = math.log(10) / 20  # of a decibel
NOTHING = torch.zeros(0, dtype=torch.complex128)


@dataclass(frozen=True, eq=False)
class Run:
    """One plane, and what its impedance is held to.

    Args:
        known: moments of the plane.
        averaging: of the impedance.
        frequency: Hz, (F,).
        liner: of the plane, whose parameters are varied.
        weights: W, complex128, (C, K) for C columns.
        share: of each column in the mean admittance, complex128, (C,).
        notes: warnings so far.
        group: label of the run: planes of one run share one reference.
        wanted: reference impedance, (F,); nan where a level alone is known, empty where nothing is.
        noise: u(R) + j u(X), (F,); of a level u of level (nepers) and phase (rad).
        ratio: implied over known pressure, from Z (F,); None with references.
        has_phase: whether the phase of that is known.
    """

    known: Moments
    averaging: str
    frequency: Tensor
    liner: LinerModel
    weights: Tensor
    share: Tensor
    notes: tuple[Note, ...]
    group: str = ""
    wanted: Tensor = NOTHING
    noise: Tensor = NOTHING
    ratio: Callable[[Tensor], Tensor] | None = None
    has_phase: bool = True

    @property
    def plane(self) -> VelocityPlane:
        """Its facts."""
        return self.known.plane

    @property
    def nodes(self) -> Nodes:
        """Speeds at which R is asked for."""
        assert self.known.nodes is not None
        return self.known.nodes

    @property
    def squares(self) -> Tensor:
        """Mean squares of the |v| that drives the model, of the columns, m2/s2, (C,)."""
        seen = survey_of_columns(self.known, self.averaging)
        removed = seen.mean**2 if self.known.settings["mean"] == "removed" else 0
        return (seen.mean_square - removed).cpu()[_columns(self.known, self.averaging)]

    @property
    def speed(self) -> float:
        """rms over the record and the columns of the |v| that drives the model, m/s."""
        return float(self.squares.mean().clamp(min=0).sqrt())

    @property
    def data(self) -> int:
        """How many real numbers it is held to."""
        return len(self.frequency) * (1 + self.has_phase)

    def impedance(self, values: Tensor) -> Tensor:
        """Z of the plane, (..., F), from the liner's Z at the speeds of the nodes, (..., F, K)."""
        reflection = reflection_from_impedance(values) @ self.weights.T
        return impedance_from_admittance(admittance_from_reflection(reflection) @ self.share)

    def errors(self, impedance: Tensor) -> Tensor:
        """What is left, complex, (..., F): Z less the reference, or the logarithm of the ratio of pressures, without a
        phase where none is known."""
        if self.ratio is None:
            return impedance - self.wanted
        left = self.ratio(impedance).log()
        return left if self.has_phase else left.real.to(left.dtype)

    def off(self, impedance: Tensor) -> Tensor:
        """Error by which models are compared, (F,): of the reflection coefficient, or relative of the pressure."""
        if self.ratio is not None:
            return self.errors(impedance).abs()
        return (reflection_from_impedance(self.wanted) - reflection_from_impedance(impedance)).abs()

    def residuals(self, impedance: Tensor) -> Tensor:
        """``errors`` over their noise, real, (..., data)."""
        errors = self.errors(impedance)
        parts = [errors.real / self.noise.real, errors.imag / self.noise.imag]
        return torch.cat(parts[: 1 + self.has_phase], dim=-1)

    def at(self, index: int) -> Run:
        """One of its frequencies."""
        one, ratio = slice(index, index + 1), self.ratio
        part = None if ratio is None else lambda z: ratio(z.expand(*z.shape[:-1], len(self.frequency)))[..., one]
        return replace(self, frequency=self.frequency[one], wanted=self.wanted[one], noise=self.noise[one], ratio=part)


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


def read_run(plane: Records, liner: LinerModel, frequency: Any, chosen: Choices, *, any_curve: bool = False) -> Run:
    """A plane, or its moments, read once for its liner with any numbers, or with ``any_curve`` for any liner; else
    tables over |v| have their own speeds."""
    asked, own = plane_of(plane).asked(frequency), liner.speed_max is not None and not any_curve
    if isinstance(plane, Moments):
        known, bare = plane, LinerModel()
        bare.cell_pitch = liner.cell_pitch
        require_fitting(known, bare if any_curve else liner, asked, chosen)
    else:
        about: Any = {} if own else {"cell_pitch": liner.cell_pitch}
        known = moments(plane, liner if own else None, frequency, **about, **vars(chosen))
    averaging, nodes = chosen.averaging, known.nodes
    assert nodes is not None
    columns = _columns(known, averaging)
    sums = known.sums[averaging][:, 0].sum(0).cpu()[:, columns] / known.survey.lengths.sum().cpu()
    transform = nodes.coefficients(torch.eye(nodes.count, dtype=torch.float64))
    size = known.cells.weight if averaging == "velocity" else None
    size = torch.ones(sums.shape[1], dtype=torch.float64) if size is None else size
    notes = [*known.notes, *review_record(known.plane, asked), *review_liner(known.plane, liner)]
    weights, share = (transform @ sums).T.to(torch.complex128), (size / size.sum()).to(torch.complex128)
    return Run(known, averaging, asked, liner, weights, share, tuple(dict.fromkeys(notes)))


def _columns(known: Moments, averaging: str) -> Tensor:
    """Those that an averaging takes the mean over, bool."""
    if averaging == "velocity":
        return torch.ones(known.cells.count, dtype=torch.bool)
    return known.used if averaging == "admittance" else known.used & (known.cells.labels >= 0)


def held_to_references(runs: Sequence[Run], references: Any, noise: Any) -> list[Run]:
    """Runs held to impedances.

    Args:
        runs: planes.
        references: values by plane, (F,) each, or a name that every plane holds.
        noise: standard uncertainty, one number, u(R) + j u(X), or one by plane; None: 1.
    Raises:
        ValueError: values that are missing or do not fit.
    """
    if references is None:
        raise ValueError("no reference is given; name one of the planes' or give values")
    values = [held_reference(run, references) for run in runs] if isinstance(references, str) else _each(references)
    if len(values) != len(runs):
        raise ValueError(f"{len(values)} references for {len(runs)} planes; one each")
    found = []
    for run, value, spread in zip(runs, values, _noise(noise, runs), strict=True):
        name, count = run.plane.name, len(run.frequency)
        wanted = torch.as_tensor(value, dtype=torch.complex128).reshape(-1)
        if len(wanted) != count:
            raise ValueError(f"{name} has {count} frequencies and {len(wanted)} reference impedances; one each")
        if not bool(torch.isfinite(wanted.abs()).all()):
            raise ValueError(f"{name}: a reference impedance is not finite")
        found.append(replace(run, wanted=wanted, noise=spread))
    return found


def held_reference(run: Run, name: str) -> Tensor:
    """An impedance that a plane holds by name, at its tone, (1,).

    Raises:
        ValueError: it holds none of that name, or another frequency is asked for.
    """
    plane, asked = run.plane, run.frequency.tolist()
    if name not in plane.reference:
        there = ", ".join(plane.reference) or "none"
        raise ValueError(f"{plane.name} holds no reference {name!r} (it holds: {there}); give the values")
    tone = plane.frequency
    if tone is not None and (len(asked) > 1 or abs(asked[0] / tone - 1) > SAME_FREQUENCY):
        raise ValueError(
            f"{plane.name} holds its reference {name!r} at {tone:g} Hz, and {', '.join(f'{f:g}' for f in asked)} Hz is "
            "asked for; leave frequency out, or give the values there"
        )
    return torch.tensor([complex(plane.reference[name])], dtype=torch.complex128)


def held_to_levels(runs: Sequence[Run], pressure: Any, noise: Any) -> list[Run]:
    """Runs held to the level check: implied over known pressure.

    Args:
        runs: planes.
        pressure: records, one each or None.
        noise: dB, one or one by plane; None: 1 neper.
    Raises:
        ValueError: pressures do not fit the planes, or nothing is known of a plane.
    """
    decibels = [1 / NEPER] if noise is None else _each(noise)
    if any(isinstance(value, complex) for value in decibels):
        raise ValueError(
            f"noise is {noise}, and with level_check it is of levels: state dB, one number, or one by plane"
        )
    given = list(pressure) if isinstance(pressure, list | tuple) else [pressure] * len(runs)
    if len(given) != len(runs):
        raise ValueError(f"{len(given)} pressures for {len(runs)} planes; one each, or None")
    found = []
    for run, record, spread in zip(runs, given, _noise([value * NEPER for value in decibels], runs), strict=True):
        known = run.known
        case = Case(run.plane, run.frequency, known.cells, known.cell_pitch, known.survey.blocks)
        pressures = known_pressure(case, record)
        if isinstance(pressures, str) or not bool(torch.isfinite(pressures.liner.abs()).all()):
            words = pressures if isinstance(pressures, str) else f"not at all frequencies: {pressures.words}"
            raise ValueError(f"{run.plane.name} cannot be fitted to its level: {words}")
        ratio = ratio_of_pressures(known, case, pressures)
        unknown = torch.full_like(spread, complex(torch.nan, torch.nan))
        found.append(replace(run, wanted=unknown, noise=spread, ratio=ratio, has_phase=pressures.has_phase))
    return found


def _noise(noise: Any, runs: Sequence[Run]) -> list[Tensor]:
    """u(R) + j u(X) of every run, (F,) each; 1 + 1j where it is unknown."""
    stated = _each(1.0 if noise is None else noise)
    stated = stated * len(runs) if len(stated) == 1 else stated
    if len(stated) != len(runs):
        raise ValueError(f"noise has {len(stated)} values for {len(runs)} planes; one, or one each")
    found = []
    for value, run in zip(stated, runs, strict=True):
        each = value if isinstance(value, complex) else complex(value, value)
        if not (0 < each.real < math.inf and 0 < each.imag < math.inf):
            raise ValueError(
                f"noise is {value}; u(R) and u(X), normalised by rho c, are finite and above 0 (None if unknown)"
            )
        found.append(torch.full((len(run.frequency),), each, dtype=torch.complex128))
    return found


def _each(given: Any) -> list[Any]:
    return [given] if isinstance(given, int | float | complex) else list(given)
