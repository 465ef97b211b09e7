r"""Runs of a liner: Z of each plane as a function of what its liner reflects, and what that Z is held to.

The educed reflection is linear in the response R(f, |v|) of the liner. Interpolated over |v| from the speeds v_k of the
nodes it is :math:`R_c = \sum_k W_{ck} R(f, v_k)` for each column c (a probe, or a cell), with weights that follow from
the moments of |v| alone: they are the same for every liner and every frequency. So the data enter once, and a fit, its
exact Jacobian and thousands of draws cost no further reading.
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
from torchliner.velocity.known_pressure import Case, known_pressure
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
        notes, group: warnings so far; label of the run: planes of one run share one reference.
        wanted: reference impedance, (F,); nan where a level alone is known, empty where nothing is.
        noise: u(R) + j u(X), (F,); of a level u of level (nepers) and phase (rad).
        ratio, has_phase: implied over known pressure, from Z (F,), None with references; whether its phase is known.
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


def choices_of_fit(averaging: str, choices: dict[str, Any]) -> Choices:
    """All choices, float64 by default; refuses what a sum over node speeds does not know."""
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices, "averaging": averaging})
    for name, known in (
        ("phase", chosen.phase == "averaged"),
        ("drive", chosen.drive != "rms"),
        ("wall_filter", chosen.wall_filter is None),
    ):
        if not known:
            raise ValueError(
                f"{name} is {getattr(chosen, name)!r}, and a fit takes phase 'averaged', another drive than 'rms' and "
                "all probes for liner: leave it out, and read a region without walls"
            )
    return chosen


def planes_and_liners(planes: Any, liners: Any) -> tuple[list[Records], list[LinerModel]]:
    """Several planes and the liner of each; one liner is one object, which a fit asks once."""
    several = [planes] if isinstance(planes, Records) else list(planes)
    given = list(liners) if isinstance(liners, list | tuple) else [liners] * len(several)
    if not several or len(given) != len(several):
        raise ValueError(f"{len(several)} planes and {len(given)} liners; give one liner, or one a plane")
    made = {id(each): as_liner(each) for each in given}
    return several, [made[id(each)] for each in given]


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


def held(runs: Sequence[Run], references: Any, pressure: Any = None, noise: Any = None) -> list[Run]:
    """Runs with what they are held to.

    Args:
        runs: planes.
        references: values by plane, (F,) each; the name of an impedance that every plane holds; "in-situ" (by Dean's
            method from ``pressure``, else what the plane holds as "in situ"); or "level-check" (the level alone).
        pressure: records for these two, one a plane or None, in the order of the planes.
        noise: standard uncertainty of R and X, one number, u(R) + j u(X), or one by plane; of levels dB. None: 1.
    Raises:
        ValueError: something is missing or does not fit.
    """
    name = references if isinstance(references, str) else ""
    if references is None:
        raise ValueError("no reference is given; name one of the planes' or give values")
    if pressure is not None and name not in (IN_SITU, LEVEL_CHECK):
        raise ValueError(
            "pressures are for references 'in-situ' and 'level-check'; name one of these, or leave pressure out"
        )
    records = [None] * len(runs) if pressure is None else _each(pressure)
    values: list[Any] = list(runs) if name else _each(references)
    for what, given in (("pressures", records), ("references", values)):
        if len(given) != len(runs):
            raise ValueError(f"{len(given)} {what} for {len(runs)} planes; one each")
    spread = _noise(noise, runs, name)
    if name == LEVEL_CHECK:
        return [_held_to_level(*each) for each in zip(runs, records, spread, strict=True)]
    if name:
        values = [
            _in_situ(*each) if name == IN_SITU else _stated(each[0], name) for each in zip(runs, records, strict=True)
        ]
    found = []
    for run, value, noise_of_run in zip(runs, values, spread, strict=True):
        wanted = torch.as_tensor(value, dtype=torch.complex128).reshape(-1)
        if len(wanted) != len(run.frequency):
            count = f"{len(run.frequency)} frequencies and {len(wanted)} reference impedances"
            raise ValueError(f"{run.plane.name} has {count}; one each")
        if not bool(torch.isfinite(wanted.abs()).all()):
            raise ValueError(f"{run.plane.name}: a reference impedance is not finite")
        found.append(replace(run, wanted=wanted, noise=noise_of_run))
    return found


def _stated(run: Run, name: str) -> Tensor:
    """An impedance that a plane holds by name, at its tone, (1,)."""
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


def _in_situ(run: Run, record: Any) -> Tensor:
    """In situ Z from the record of the run, or that which the plane holds."""
    if record is None:
        return _stated(run, "in situ")
    require_same_run(run.plane, record)
    short = bool(run.known.settings["allow_short"])
    return in_situ(record, run.frequency, interval=None, allow_short=short).liner_impedance_pressure_first


def _held_to_level(run: Run, record: Any, spread: Tensor) -> Run:
    """Held to the level check: implied over known pressure."""
    known = run.known
    case = Case(run.plane, run.frequency, known.cells, known.cell_pitch, known.survey.blocks)
    pressures = known_pressure(case, record)
    if isinstance(pressures, str) or not bool(torch.isfinite(pressures.liner.abs()).all()):
        words = pressures if isinstance(pressures, str) else f"not at all frequencies: {pressures.words}"
        raise ValueError(f"{run.plane.name} cannot be fitted to its level: {words}")
    ratio, unknown = ratio_of_pressures(known, case, pressures), torch.full_like(spread, complex(math.nan, math.nan))
    return replace(run, wanted=unknown, noise=NEPER * spread, ratio=ratio, has_phase=pressures.has_phase)


def _noise(noise: Any, runs: Sequence[Run], name: str) -> list[Tensor]:
    """u(R) + j u(X) of every run, (F,) each, of levels in dB; 1 + 1j (of levels a neper) where it is unknown."""
    stated = _each((1 / NEPER if name == LEVEL_CHECK else 1.0) if noise is None else noise)
    if name == LEVEL_CHECK and any(isinstance(value, complex) for value in stated):
        raise ValueError(f"noise is {noise}, and with {name} it is of levels: state dB, one number, or one by plane")
    stated = stated * len(runs) if len(stated) == 1 else stated
    if len(stated) != len(runs):
        raise ValueError(f"noise has {len(stated)} values for {len(runs)} planes; one, or one each")
    both = [value if isinstance(value, complex) else complex(value, value) for value in stated]
    if not all(0 < part < math.inf for u in both for part in (u.real, u.imag)):
        raise ValueError(f"noise is {noise}; u(R) and u(X), by rho c, are finite and above 0 (None: unknown)")
    return [torch.full((len(run.frequency),), u, dtype=torch.complex128) for u, run in zip(both, runs, strict=True)]


def _each(given: Any) -> list[Any]:
    return list(given) if isinstance(given, Iterable) else [given]
