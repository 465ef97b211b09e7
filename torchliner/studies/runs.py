r"""Runs of a liner: Z of each plane as a function of what its liner reflects, and what that Z is held to.

The educed reflection is linear in the response of the liner: :math:`R_c = \sum_k W_{ck} R(f, v_k)` for each column c (a
probe, or a cell), v_k the speeds of the nodes. The weights W follow from the moments of |v|, whatever the liner and the
frequency: a fit, its exact Jacobian and thousands of draws cost no further reading.
"""

from __future__ import annotations

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
from torchliner.pressure.dean import in_situ
from torchliner.records import VelocityPlane
from torchliner.records.notes import Note
from torchliner.records.same_case import require_same_run
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.answer import require_fitting
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.known_pressure import known_pressure
from torchliner.velocity.level_check import ratio_of_pressures
from torchliner.velocity.review import review_liner, review_record

NEPER = math.log(10) / 20  # of a decibel
NOTHING = torch.zeros(0, dtype=torch.complex128)
LEVEL_CHECK, IN_SITU = "level-check", "in-situ"


@dataclass(frozen=True, eq=False)
class Run:
    """One plane, and what its impedance is held to.

    Args:
        known, averaging, frequency: moments of the plane, and of what in them at which lines, Hz, (F,).
        liner: of the plane, whose parameters are varied.
        weights, share: W, complex128, (C, K) for C columns; of each in the mean admittance, (C,).
        group: label of the run: planes of one run share one reference.
        wanted: reference impedance, (F,); empty where a level, or nothing, is known.
        noise: u(R) + j u(X), (F,); of a level u of level (nepers) and phase (rad).
        ratio, has_phase: implied over known pressure, from Z (F,), None with references; whether its phase is known.
    """

    known: Moments
    averaging: str
    frequency: Tensor
    liner: LinerModel
    weights: Tensor
    share: Tensor
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
    def notes(self) -> list[Note]:
        """Warnings of the plane and the liner."""
        own = review_record(self.plane, self.frequency), review_liner(self.plane, self.liner)
        return list(dict.fromkeys([*self.known.notes, *own[0], *own[1]]))

    @functools.cached_property
    def in_flow(self) -> LinerModel:
        """The liner in the flow of the plane."""
        return self.liner.in_flow(self.plane.mach)

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
        """rms of the |v| that drives the model, m/s."""
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


def choices_of_fit(**choices: Any) -> Choices:
    """All choices, float64 by default; refuses what a sum over node speeds does not know."""
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    for name, fits in (
        ("phase", chosen.phase == "averaged"),
        ("drive", chosen.drive != "rms"),
        ("wall_filter", chosen.wall_filter is None),
    ):
        if not fits:
            raise ValueError(
                f"{name} is {getattr(chosen, name)!r}, and a fit takes phase 'averaged', another drive than 'rms' and "
                "all probes: leave it out"
            )
    return chosen


def planes_and_liners(planes: Any, liners: Any) -> tuple[list[Records], list[LinerModel]]:
    """Several planes and the liner of each; one liner is one object, which a fit asks once."""
    several = [planes] if isinstance(planes, Records) else list(planes)
    given = list(liners) if isinstance(liners, list | tuple) else [liners] * len(several)
    made = {id(each): as_liner(each) for each in given}
    return several, [made[id(each)] for each in one_each("liners", given, several)]


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
    return run_of(known, chosen.averaging, liner, asked)


def run_of(known: Moments, averaging: str, liner: LinerModel, frequency: Tensor) -> Run:
    """Of moments that hold an averaging; ``frequency`` in Hz, (F,)."""
    nodes = known.nodes
    assert nodes is not None
    sums = known.sums[averaging][:, 0].sum(0).cpu()[:, _columns(known, averaging)] / known.survey.lengths.sum().cpu()
    size = known.cells.weight if averaging == "velocity" else None
    size = torch.ones(sums.shape[1], dtype=torch.float64) if size is None else size
    weights = (nodes.coefficients(torch.eye(nodes.count, dtype=torch.float64)) @ sums).T
    wide = (weights.to(torch.complex128), (size / size.sum()).to(torch.complex128))
    return Run(known, averaging, frequency, liner, *wide)


def _columns(known: Moments, averaging: str) -> Tensor:
    """Those that an averaging takes the mean over, bool."""
    if averaging == "velocity":
        return torch.ones(known.cells.count, dtype=torch.bool)
    return known.used if averaging == "admittance" else known.used & (known.cells.labels >= 0)


def held(runs: Sequence[Run], references: Any, pressure: Any = None, noise: Any = None) -> list[Run]:
    """Runs with what they are held to; arguments and errors as of ``calibrate``, noise 1 where it is unknown."""
    name = references if isinstance(references, str) else ""
    if pressure is not None and name not in (IN_SITU, LEVEL_CHECK):
        raise ValueError("pressures are for references 'in-situ' and 'level-check'; name one of these")
    records = one_each("pressures", [None] * len(runs) if pressure is None else pressure, runs)
    values = one_each("references", [name] * len(runs) if name else references, runs)
    unknown = 1 / NEPER if name == LEVEL_CHECK else 1.0
    noises = one_each("noises", [unknown] * len(runs) if noise is None else noise, runs, shared=True)
    return [_held(*each) for each in zip(runs, values, records, noises, strict=True)]


def one_each(what: str, given: Any, runs: Sequence[Any], *, shared: bool = False) -> list[Any]:
    """As many values as runs; with ``shared`` one may be of all."""
    found = list(given) if isinstance(given, Iterable) else [given]
    found = found * len(runs) if shared and len(found) == 1 else found
    if len(found) != len(runs) or not runs:
        raise ValueError(f"{len(found)} {what} for {len(runs)} planes; one each")
    return found


def _held(run: Run, reference: Any, record: Any, noise: Any) -> Run:
    """One run with its reference, a value or a name."""
    u, level = complex(noise), isinstance(reference, str) and reference == LEVEL_CHECK
    u = u if isinstance(noise, complex) else complex(u.real, u.real)
    if not (0 < u.real < math.inf and 0 < u.imag < math.inf) or (level and u.real != u.imag):
        raise ValueError(
            f"noise is {noise}; u(R) and u(X), by rho c, or one number of dB with 'level-check', are finite and above "
            "0 (None: unknown)"
        )
    spread = torch.full((len(run.frequency),), u, dtype=torch.complex128)
    if level:
        pressures = known_pressure(run.known, run.frequency, record)
        if isinstance(pressures, str) or not bool(torch.isfinite(pressures.liner.abs()).all()):
            words = pressures if isinstance(pressures, str) else f"not at all frequencies: {pressures.words}"
            raise ValueError(f"{run.plane.name} cannot be fitted to its level: {words}")
        ratio = ratio_of_pressures(pressures)
        return replace(run, noise=NEPER * spread, ratio=ratio, has_phase=pressures.has_phase)
    if isinstance(reference, str):
        reference = _named(run, reference, record)
    wanted = torch.as_tensor(reference, dtype=torch.complex128).reshape(-1)
    if len(wanted) != len(run.frequency) or not bool(torch.isfinite(wanted.abs()).all()):
        raise ValueError(
            f"{run.plane.name} has {len(run.frequency)} frequencies and references {wanted.tolist()}; one each is "
            "needed, finite"
        )
    return replace(run, wanted=wanted, noise=spread)


def _named(run: Run, name: str, record: Any) -> Any:
    """In situ Z from the record of the run, else an impedance that the plane holds by name, at its tone."""
    plane, asked = run.plane, run.frequency.tolist()
    if name == IN_SITU and record is not None:
        require_same_run(plane, record)
        short = bool(run.known.settings["allow_short"])
        return in_situ(record, run.frequency, interval=None, allow_short=short).liner_impedance_pressure_first
    name = "in situ" if name == IN_SITU else name
    if name not in plane.reference:
        there = ", ".join(plane.reference) or "none"
        raise ValueError(f"{plane.name} holds no reference {name!r} (it holds: {there}); give the values")
    tone = plane.frequency
    if tone is not None and (len(asked) > 1 or abs(asked[0] / tone - 1) > SAME_FREQUENCY):
        raise ValueError(
            f"{plane.name} holds its reference {name!r} at {tone:g} Hz, and {', '.join(f'{f:g}' for f in asked)} Hz is "
            "asked for; leave frequency out, or give the values there"
        )
    return complex(plane.reference[name])
