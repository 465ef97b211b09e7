r"""Runs of a liner: Z of each plane as a function of what its liner reflects, and what that Z is held to.

The educed reflection is linear in the response of the liner: :math:`R_c = \sum_k W_{ck} R(f, v_k)` for each column c (a
probe, or a cell), v_k the speeds of the nodes. The weights W follow from the moments of |v|, whatever the liner and the
frequency: a fit, its exact Jacobian and thousands of draws cost no further reading.
"""

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import admittance_from_reflection, impedance_from_admittance, reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Nodes
from torchliner.liners.model import LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.studies.laws import Knots, Law, impedances_at
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.answer import require_fitting
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.level_check import known_pressure, ratio_of_pressures
from torchliner.velocity.review import review_case

NEPER = math.log(10) / 20  # of a decibel
LEVEL_CHECK = "level-check"
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST, FINE = 4.0, 60  # times the rms no |v| that matters is larger; steps in sqrt |v| by which the last knot is found


@dataclass(frozen=True, eq=False)
class Run:
    """One plane, and what its impedance is held to.

    Args:
        known, averaging, frequency: moments of the plane, and of what in them at which lines, Hz, (F,).
        liner: of the plane, whose parameters are varied.
        group: label of the run: planes of one run share one reference.
        wanted, noise: reference impedance, (F,), and its u(R) + j u(X), of a level u (nepers).
        ratio: implied over known pressure, from Z (F,), where that is held to.
    """

    known: Moments
    averaging: str
    frequency: Tensor
    liner: LinerModel
    group: str = ""
    wanted: Tensor | None = None
    noise: Tensor | None = None
    ratio: Callable[[Tensor], Tensor] | None = None

    @property
    def plane(self) -> VelocityPlane:
        """Its facts."""
        return self.known.plane

    @property
    def notes(self) -> list[str]:
        """Warnings of the plane and the liner."""
        own = review_case(self.plane, self.liner, self.frequency)
        return list(dict.fromkeys(note.text for note in (*self.known.notes, *own)))

    @functools.cached_property
    def in_flow(self) -> LinerModel:
        """The liner in the flow of the plane."""
        return self.liner.in_flow(self.plane.mach)

    @property
    def nodes(self) -> Nodes:
        """Speeds at which R is asked for."""
        assert self.known.nodes is not None
        return self.known.nodes

    @functools.cached_property
    def columns(self) -> Tensor:
        """Which columns the averaging takes the mean over: cells, or probes, bool."""
        if self.averaging == "velocity":
            return torch.ones(self.known.cells.count, dtype=torch.bool)
        return self.known.used if self.averaging == "admittance" else self.known.used & (self.known.cells.labels >= 0)

    @functools.cached_property
    def weights(self) -> Tensor:
        """W, complex128, (C, K), for C columns."""
        seen, nodes = self.known.survey, self.nodes
        sums = self.known.sums[self.averaging][:, 0].sum(0).cpu()[:, self.columns] / seen.lengths.sum().cpu()
        return (nodes.coefficients(torch.eye(nodes.count, dtype=torch.float64)) @ sums).T.to(torch.complex128)

    @functools.cached_property
    def share(self) -> Tensor:
        """Of each column in the mean admittance, complex128, (C,)."""
        size = self.known.cells.weight if self.averaging == "velocity" else None
        size = torch.ones(int(self.columns.sum()), dtype=torch.float64) if size is None else size
        return (size / size.sum()).to(torch.complex128)

    @property
    def squares(self) -> Tensor:
        """Mean squares of the |v| that drives the model, of the columns, m2/s2, (C,)."""
        seen = survey_of_columns(self.known, self.averaging)
        removed = seen.mean**2 if self.known.settings["mean"] == "removed" else 0
        return (seen.mean_square - removed).cpu()[self.columns]

    @property
    def speed(self) -> float:
        """rms of the |v| that drives the model, m/s."""
        return float(self.squares.mean().clamp(min=0).sqrt())

    @property
    def data(self) -> int:
        """How many real numbers it is held to."""
        return len(self.frequency) * (2 if self.ratio is None else 1)

    def impedance(self, values: Tensor) -> Tensor:
        """Z of the plane, (..., F), from the liner's Z at the speeds of the nodes, (..., F, K)."""
        reflection = reflection_from_impedance(values) @ self.weights.T
        return impedance_from_admittance(admittance_from_reflection(reflection) @ self.share)

    def level(self, impedance: Tensor) -> Tensor:
        """By which the implied pressure is above the known one, nepers, (..., F)."""
        assert self.ratio is not None
        return self.ratio(impedance).abs().log()

    def off(self, impedance: Tensor) -> Tensor:
        """Error by which models are compared, (F,): of the reflection coefficient, or relative of the pressure."""
        if self.wanted is None:
            return self.level(impedance).abs()
        return (reflection_from_impedance(self.wanted) - reflection_from_impedance(impedance)).abs()

    def residuals(self, impedance: Tensor) -> Tensor:
        """What is left over its noise, real, (..., data)."""
        assert self.noise is not None
        if self.wanted is None:
            return self.level(impedance) / self.noise.real
        errors = impedance - self.wanted
        return torch.cat([errors.real / self.noise.real, errors.imag / self.noise.imag], dim=-1)


def choices_of_fit(**choices: Any) -> Choices:
    """All choices, float64 by default; refuses what a sum over node speeds does not know."""
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    fits = {"phase": chosen.phase == "averaged", "drive": chosen.drive != "rms", "wall_filter": not chosen.wall_filter}
    for name in (name for name, known in fits.items() if not known):
        raise ValueError(
            f"{name} is {getattr(chosen, name)!r}, and a fit takes phase 'averaged', another drive than 'rms' and all "
            "probes: leave it out"
        )
    return chosen


def one_each(what: str, given: Any, several: Sequence[Any]) -> list[Any]:
    """As many values as planes; a single one, or a name, is that of all."""
    single = isinstance(given, str) or not isinstance(given, Iterable)
    found = [given] * len(several) if single else list(given)
    if len(found) != len(several) or not several:
        raise ValueError(f"{len(found)} {what} for {len(several)} planes; one each")
    return found


def read_runs(planes: Any, liners: Any, frequency: Any, chosen: Choices, *, any_curve: bool = False) -> list[Run]:
    """Planes, or their moments, each read once for its liner with any numbers, or with ``any_curve`` for any liner.

    One liner of several planes stays one object, which a fit asks once.
    """
    several = [planes] if isinstance(planes, Records) else list(planes)
    given = one_each("liners", liners, several) if isinstance(liners, list | tuple) else [liners] * len(several)
    made, runs = {id(each): as_liner(each) for each in given}, list[Run]()
    for plane, liner in zip(several, (made[id(each)] for each in given), strict=True):
        asked, own = plane_of(plane).asked(frequency), liner.speed_max is not None and not any_curve
        if isinstance(plane, Moments):
            known, bare = plane, LinerModel()
            bare.cell_pitch = liner.cell_pitch
            require_fitting(known, bare if any_curve else liner, asked, chosen)
        else:  # tables over |v| have their own speeds
            about: Any = {} if own else {"cell_pitch": liner.cell_pitch}
            known = moments(plane, liner if own else None, frequency, **about, **vars(chosen))
        runs.append(Run(known, chosen.averaging, asked, liner))
    return runs


def held(runs: Sequence[Run], references: Any, noise: Any = None) -> list[Run]:
    """Runs with what they are held to; arguments and errors as of ``calibrate``, noise 1 where it is unknown."""
    if noise is None:
        noise = 1 / NEPER if isinstance(references, str) and references == LEVEL_CHECK else 1.0
    given = references if isinstance(references, Iterable) else [references]
    values, noises = one_each("references", given, runs), one_each("noises", noise, runs)
    return [_held(*each) for each in zip(runs, values, noises, strict=True)]


def _held(run: Run, reference: Any, noise: Any) -> Run:
    """One run with its reference, a value or a name."""
    plane, u = run.plane, complex(noise) if isinstance(noise, complex) else complex(noise, noise)
    if not (0 < u.real < math.inf and 0 < u.imag < math.inf):
        raise ValueError(f"noise is {noise}; u(R) and u(X), or one number of dB, are finite and above 0")
    spread = torch.full((len(run.frequency),), u, dtype=torch.complex128)
    if isinstance(reference, str) and reference == LEVEL_CHECK:
        pressures = known_pressure(run.known, run.frequency)
        if isinstance(pressures, str):
            raise ValueError(f"{plane.name} cannot be fitted to its level: {pressures}")
        return replace(run, noise=NEPER * spread, ratio=ratio_of_pressures(run.known, pressures))
    if isinstance(reference, str):
        if reference not in plane.reference:
            there = ", ".join(plane.reference) or "none"
            raise ValueError(f"{plane.name} holds no reference {reference!r} (it holds: {there}); give the values")
        tone, asked = plane.frequency, run.frequency.tolist()
        if tone is not None and (len(asked) > 1 or abs(asked[0] / tone - 1) > SAME_FREQUENCY):
            raise ValueError(
                f"{plane.name} holds its reference {reference!r} at {tone:g} Hz alone, and "
                f"{', '.join(f'{f:g}' for f in asked)} Hz is asked for; leave frequency out, or give the values there"
            )
        reference = complex(plane.reference[reference])
    wanted = torch.as_tensor(reference, dtype=torch.complex128).reshape(-1)
    if len(wanted) != len(run.frequency) or not bool(torch.isfinite(wanted.abs()).all()):
        raise ValueError(
            f"{plane.name} has {len(run.frequency)} frequencies and references {wanted.tolist()}; one each is needed, "
            "finite"
        )
    return replace(run, wanted=wanted, noise=spread)


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z at the frequencies and node speeds of each run, (F, K), differentiable; each liner is asked once."""
    every = torch.cat([run.frequency for run in runs]).unique()
    asked = {(id(run.liner), run.plane.mach, run.nodes): run for run in runs}
    made = {key: law.curve(values, run.in_flow, every, run.nodes.speeds) for key, run in asked.items()}
    places = [torch.searchsorted(every, run.frequency) for run in runs]
    return [made[id(run.liner), run.plane.mach, run.nodes][i] for run, i in zip(runs, places, strict=True)]


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run, (F,), differentiable in the values."""
    return [run.impedance(z) for run, z in zip(runs, curves_at_nodes(law, values, runs), strict=True)]


def with_slopes(made: Callable[[Tensor], Tensor], values: Tensor) -> tuple[Tensor, Tensor]:
    """What is made of values (n,), (...), and its derivatives in them, (..., n)."""
    at = values.detach().requires_grad_()
    found = made(at)
    if not found.requires_grad:
        return found, found.new_zeros(*found.shape, len(values))
    parts = torch.view_as_real(found) if found.is_complex() else found
    unit = torch.eye(parts.numel(), dtype=torch.float64).reshape(-1, *parts.shape)
    (rows,) = torch.autograd.grad(parts, at, unit, is_grads_batched=True)
    by = rows.reshape(*parts.shape, -1)
    by = torch.complex(by.select(-2, 0), by.select(-2, 1)) if found.is_complex() else by
    return found.detach(), by


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""

    def made(at: Tensor) -> Tensor:
        return torch.cat([run.residuals(z) for run, z in zip(runs, impedances(law, at, runs), strict=True)])

    left, by = with_slopes(made, values)
    return torch.cat([left, law.prior @ values]), torch.cat([by, law.prior])


def weights_of(run: Run, values: Tensor, knots: Knots) -> Tensor:
    """Share of each spline of a curve in Z of a plane, (F, n), which sum to 1; ``values``: Z at the nodes, (F, K)."""
    at = values.detach().requires_grad_()
    (slopes,) = torch.autograd.grad(run.impedance(at).real.sum(), at)
    found = (slopes @ knots.splines(run.nodes.speeds).to(slopes)).abs()
    return found / found.sum(-1, keepdim=True)


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    fine, last = Knots(CREST * max(float(run.squares.max()) for run in runs) ** 0.5, FINE), 0
    for run in runs:
        weights = weights_of(run, impedances_at(run.in_flow, run.frequency, run.nodes.speeds), fine)
        last = max(last, int((weights.cumsum(-1) < WITHIN).sum(-1).max()))
    return Knots(float(fine.speeds[last]))
