r"""Runs of a liner: Z of each plane as a function of what its liner reflects, and what that Z is held to.

The educed reflection is linear in the response of the liner: :math:`R_c = \sum_k W_{ck} R(f, v_k)` for each column c (a
probe, or a cell), v_k the speeds of the nodes. The weights W follow from the moments of |v|, whatever the liner and the
frequency: a fit, its exact Jacobian and thousands of draws cost no further reading.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import admittance_from_reflection, impedance_from_admittance, reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.liners.model import LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.studies.laws import Knots, Law, impedances_at
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.averages import survey_of_columns
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import fitting, moments
from torchliner.velocity.review import review_case

SHARE = 0.02  # of |Z|: noise of references for which none is stated
WITHIN = 0.995  # of a plane's weight lies below the last knot
CREST, FINE = 4.0, 60  # times the rms no |v| that matters is larger; steps in sqrt |v| by which the last knot is found


@dataclass(frozen=True, eq=False)
class Run:
    """One plane, and what its impedance is held to.

    Args:
        known, averaging, frequency: moments of the plane, and of what in them at which lines, Hz, (F,).
        liner: of the plane, whose parameters are varied.
        wanted, noise: reference impedance, (F,), and its u(R) + j u(X).
    """

    known: Moments
    averaging: str
    frequency: Tensor
    liner: LinerModel
    wanted: Any = None
    noise: Any = 1 + 1j

    @property
    def plane(self) -> VelocityPlane:
        """Its facts."""
        return self.known.plane

    @property
    def case(self) -> str:
        """Of its provenance, else the name of the plane: planes of one case are one run, with one reference."""
        return str(self.plane.provenance.get("case") or self.plane.name)

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
    def speeds(self) -> Tensor:
        """At which R is asked for, (K,)."""
        assert self.known.nodes is not None
        return self.known.nodes.speeds

    @functools.cached_property
    def columns(self) -> Tensor:
        """Which columns the averaging takes the mean over: cells, or probes, bool."""
        if self.averaging == "velocity":
            return torch.ones(self.known.cells.count, dtype=torch.bool)
        return self.known.used & ((self.known.cells.labels >= 0) | (self.averaging == "admittance"))

    @functools.cached_property
    def weights(self) -> tuple[Tensor, Tensor]:
        """W, (C, K), and the share of each of C columns in the mean admittance, (C,), complex128."""
        nodes, lengths = self.known.nodes, self.known.survey.lengths
        assert nodes is not None
        sums = self.known.sums[self.averaging][:, 0].sum(0).cpu()[:, self.columns] / lengths.sum().cpu()
        found = (nodes.coefficients(torch.eye(nodes.count, dtype=torch.float64)) @ sums).T
        size = self.known.cells.weight if self.averaging == "velocity" else None
        size = torch.ones(len(found), dtype=torch.float64) if size is None else size
        return found.to(torch.complex128), (size / size.sum()).to(torch.complex128)

    @property
    def fastest(self) -> float:
        """Largest rms of the |v| that drives the model, m/s."""
        seen = survey_of_columns(self.known, self.averaging)
        removed = seen.mean**2 if self.known.settings["mean"] == "removed" else 0
        return float((seen.mean_square - removed).cpu()[self.columns].max()) ** 0.5

    def impedance(self, values: Tensor) -> Tensor:
        """Z of the plane, (..., F), from the liner's Z at the speeds of the nodes, (..., F, K)."""
        weights, share = self.weights
        return impedance_from_admittance(
            admittance_from_reflection(reflection_from_impedance(values) @ weights.T) @ share
        )

    def residuals(self, impedance: Tensor) -> Tensor:
        """What is left over the noise, real, (2 F,)."""
        errors = impedance - self.wanted
        return torch.cat([errors.real / self.noise.real, errors.imag / self.noise.imag])

    def splines(self, values: Tensor, knots: Knots) -> Tensor:
        """Share of each spline of a curve in Z of the plane, (F, n), which sum to 1; ``values``: Z at the nodes, (F,
        K)."""
        at = values.detach().requires_grad_()
        (slopes,) = torch.autograd.grad(self.impedance(at).real.sum(), at)
        found = (slopes @ knots.splines(self.speeds).to(slopes)).abs()
        return found / found.sum(-1, keepdim=True)


def choices_of_fit(**choices: Any) -> Choices:
    """All choices, float64 by default; refuses what a sum over node speeds does not know."""
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    if chosen.phase != "averaged" or chosen.drive == "rms" or chosen.wall_filter:
        raise ValueError("a fit takes phase 'averaged', another drive than 'rms' and no wall_filter")
    return chosen


def read_runs(planes: Any, liners: Any, frequency: Any, chosen: Choices) -> list[Run]:
    """Planes, or their moments, each read once for any liner; one liner of several planes stays one object."""
    several = [planes] if isinstance(planes, Records) else list(planes)
    if not isinstance(liners, list | tuple):
        liners = [as_liner(liners)] * len(several)
    if len(liners) != len(several) or not several:
        raise ValueError(f"{len(liners)} liners for {len(several)} planes; one each")
    runs, any_liner = [], LinerModel()
    for plane, liner in zip(several, map(as_liner, liners), strict=True):
        asked, any_liner.cell_pitch = plane_of(plane).asked(frequency), liner.cell_pitch
        if isinstance(plane, Moments):
            fitting(known := plane, any_liner, asked, chosen)
        else:
            known = moments(plane, None, frequency, cell_pitch=liner.cell_pitch, **vars(chosen))
        runs.append(Run(known, chosen.averaging, asked, liner))
    return runs


def held(runs: Sequence[Run], references: Any, noise: Any = None) -> list[Run]:
    """Runs with what they are held to; arguments and errors as of ``calibrate``."""
    u = noise if noise is None or isinstance(noise, complex) else complex(noise, noise)
    if u is not None and not (0 < u.real < math.inf and 0 < u.imag < math.inf):
        raise ValueError(f"noise is {noise}; u(R) and u(X) are finite and above 0")
    values = [references] * len(runs) if isinstance(references, str | complex) else list(references)
    if len(values) != len(runs):
        raise ValueError(f"{len(values)} references for {len(runs)} planes; one each")
    found = []
    for run, value in zip(runs, values, strict=True):
        plane, tone, asked = run.plane, run.plane.frequency, run.frequency.tolist()
        if isinstance(value, str):
            if value not in plane.reference:
                there = ", ".join(plane.reference) or "none"
                raise ValueError(f"{plane.name} holds no reference {value!r} (it holds: {there}); give the values")
            if tone is not None and (len(asked) > 1 or abs(asked[0] / tone - 1) > SAME_FREQUENCY):
                raise ValueError(f"{plane.name} holds reference {value!r} at {tone:g} Hz alone; leave frequency out")
            value = complex(plane.reference[value])
        wanted = torch.as_tensor(value, dtype=torch.complex128).reshape(-1)
        if len(wanted) != len(asked) or not bool(torch.isfinite(wanted.abs()).all()):
            raise ValueError(f"{plane.name} has {len(asked)} frequencies and references {value}; one each, finite")
        found.append(replace(run, wanted=wanted, noise=SHARE * (1 + 1j) * wanted.abs() if u is None else u))
    return found


def curves_at_nodes(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z at the frequencies and node speeds of each run, (F, K), differentiable; each liner is asked once."""
    keys = [(id(run.liner), run.plane.mach, run.known.nodes, *run.frequency.tolist()) for run in runs]
    first = dict(zip(keys, runs, strict=True))
    made = {key: law.curve(values, run.in_flow, run.frequency, run.speeds) for key, run in first.items()}
    return [made[key] for key in keys]


def impedances(law: Law, values: Tensor, runs: Sequence[Run]) -> list[Tensor]:
    """Z of each run, (F,), differentiable in the values."""
    return [run.impedance(z) for run, z in zip(runs, curves_at_nodes(law, values, runs), strict=True)]


def with_slopes(made: Callable[[Tensor], Tensor], values: Tensor) -> tuple[Tensor, Tensor]:
    """What is made of values (n,), (...), and its derivatives in them, complex, (..., n)."""

    def parts(at: Tensor) -> Tensor:
        return torch.view_as_real(made(at).to(torch.complex128))

    by = torch.autograd.functional.jacobian(parts, values, vectorize=True)
    return made(values).detach(), torch.complex(by.select(-2, 0), by.select(-2, 1))


def residuals_of(law: Law, values: Tensor, runs: Sequence[Run]) -> tuple[Tensor, Tensor]:
    """Residuals of the data and then of the prior, (m,), and their derivatives in the values, (m, n)."""

    def made(at: Tensor) -> Tensor:
        return torch.cat([run.residuals(z) for run, z in zip(runs, impedances(law, at, runs), strict=True)])

    left, by = with_slopes(made, values)
    return torch.cat([left, law.prior @ values]), torch.cat([by.real, law.prior])


def knots_for(runs: Sequence[Run]) -> Knots:
    """Up to the |v| below which nearly all of every plane's weight lies."""
    fine, last = Knots(CREST * max(run.fastest for run in runs), FINE), 0
    for run in runs:
        weights = run.splines(impedances_at(run.in_flow, run.frequency, run.speeds), fine)
        last = max(last, int((weights.cumsum(-1) < WITHIN).sum(-1).max()))
    return Knots(float(fine.speeds[last]))
