r"""Derivatives of the educed impedance in every parameter of a liner, from one reading of the data.

The educed reflection is linear in the response R(f, |v|) of the liner, which is read at a few speeds alone. So dR/dp
there, by differentiation of the liner's formula, and the moments of |v| that R is read with give its derivative;
averages and phase rules follow by forward differentiation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.checks import require_choice
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import checked_speeds, response
from torchliner.forward_mode import dual_level, slopes_of
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.liners.parameters import Number
from torchliner.names import LIMITS
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Records, plane_of
from torchliner.units import parse_tolerance
from torchliner.velocity.answer import averages_of
from torchliner.velocity.averages import average
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.reading import Progress


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """dZ/dp of everything that ``educe`` gives, normalised by rho c per SI unit of p.

    Args:
        numbers: parameters by name, n of them, at which the derivatives hold.
        probes: of each probe as measured, complex, (n, ..., F) on the probe axes of the plane; nan where excluded.
        cells: by averaging, (n, C, F).
        liner: whole liner, by averaging, (n, F).
        level_error: largest error of dR/dp from its interpolation over |v|, at any |v| of the data
            and relative to the largest |dR/dp|, (n,); that of the mean over a record is far less.
        found: the map itself.
    """

    numbers: Mapping[str, Number]
    probes: Tensor
    cells: Mapping[str, Tensor]
    liner: Mapping[str, Tensor]
    level_error: Tensor
    found: ImpedanceMap

    @property
    def values(self) -> Tensor:
        """At which the derivatives hold, SI, float64, (n,)."""
        return torch.tensor([number.value for number in self.numbers.values()], dtype=torch.float64)

    def per_percent(self) -> Sensitivities:
        """Change of Z, to first order, for 1 % of each parameter's value."""
        step = 0.01 * self.values
        cells, liner = ({name: _times(step, z) for name, z in each.items()} for each in (self.cells, self.liner))
        return dataclasses.replace(self, probes=_times(step, self.probes), cells=cells, liner=liner)

    def propagate(
        self, tolerances: Mapping[str, Any], *, limits: str, correlation: Mapping[tuple[str, str], float] | None = None
    ) -> Study:
        """First-order standard uncertainty of R and X from stated tolerances.

        Args:
            tolerances: half-width by parameter, with its unit: ``{"orifice_diameter": "0.02 mm",
                "porosity": "2 %"}``; a plain number only for what has no unit.
            limits: what a half-width means: ``rectangular``, limits within which every value is
                equally likely (standard uncertainty half-width/sqrt 3), or ``standard``, the
                standard uncertainty itself.
            correlation: coefficients of pairs of parameters, -1 to 1; others are independent.
        Returns:
            half_widths, standard (u(p)), SI, (n,); by averaging contributions (signed change of the liner's Z for one
            standard uncertainty of each parameter, complex, (n, F)), covariance (of R and X of the liner, (F, 2, 2))
            and combined (u(R) + j u(X), (F,)); places (the same of the probes and of the cells, (..., F), by "probes"
            and by averaging). ``rows``, the largest first: averaging, frequency (Hz), parameter, value, unit,
            half_width, standard, impedance (its contribution).
        Raises:
            ValueError: a parameter that was not differentiated, a tolerance without a unit or wider than what the
                parameter can be, an unknown reading, correlations that no set of quantities can have.
        Source: JCGM 100:2008 (GUM), 4.3.7 and eq. (13).
        """
        factor = LIMITS[require_choice("reading of the limits", limits, LIMITS)]
        if not tolerances:
            raise ValueError("no tolerance is stated; name at least one, e.g. orifice_diameter")
        for name in tolerances:
            require_choice("parameter of a tolerance", name, self.numbers)
        stated = {name: number for name, number in self.numbers.items() if name in tolerances}
        kept = [i for i, name in enumerate(self.numbers) if name in tolerances]
        widths = [_half_width(name, tolerances[name], number) for name, number in stated.items()]
        half_widths = torch.tensor(widths, dtype=torch.float64)
        standard, matrix = factor * half_widths, _correlation_matrix([*stated], correlation or {})
        contributions = {name: _times(standard, slopes[kept]) for name, slopes in self.liner.items()}
        places = {"probes": self.probes, **self.cells}
        covariance = {name: covariance_of(change, matrix) for name, change in contributions.items()}
        rows = []
        for averaging, change in contributions.items():
            for i, f in enumerate(self.found.frequency.tolist()):
                for j in change[:, i].abs().argsort(descending=True, stable=True).tolist():
                    name, number = [*stated.items()][j]
                    about = {"value": number.value, "unit": number.unit, "half_width": widths[j]}
                    about |= {"standard": float(standard[j]), "impedance": complex(change[j, i])}
                    rows.append(Row(averaging=averaging, frequency=f, parameter=name, **about))
        return Study(
            rows=rows,
            half_widths=half_widths,
            standard=standard,
            contributions=contributions,
            covariance=covariance,
            combined={name: standard_of(each) for name, each in covariance.items()},
            places={n: standard_of(covariance_of(_times(standard, z[kept]), matrix)) for n, z in places.items()},
        )


def sensitivities(
    plane: VelocityPlane | Moments,
    liner: Liner,
    frequency: Any = None,
    parameters: Sequence[str] | None = None,
    *,
    reference_phase: Any = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Sensitivities:
    """dZ/dp of the liner, its cells and every probe, for all parameters from one reading.

    Args:
        plane: wall-normal velocity, (..., T) m/s, or its moments.
        liner: one that states ``numbers``, as SDoF liners do.
        frequency: Hz, one or several; default the plane's tone.
        parameters: names of ``liner.numbers()``; default all. ``temperature`` and
            ``pressure`` change c, rho and eta of the liner's gas as those of dry air; the plane's
            own gas, which scales inferred waves alone, stays.
        reference_phase: rad, for ``phase="given"``.
        progress: called with numbers of samples read.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: drive ``rms``, an unknown parameter, or data that cannot give an answer (see ``educe``).
    Warns:
        DataWarning: as ``educe``.
    Source: Roncen et al. (2026), section 3, differentiated.
    """
    if not isinstance(plane, Records):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    model = as_liner(liner).in_flow(plane_of(plane).mach)
    numbers = named_numbers(model, parameters)
    if not numbers:
        raise ValueError("no parameter is named; leave parameters out for all of them")
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    if chosen.drive == "rms":
        raise ValueError("drive 'rms' leaves no moments of |v|, which sensitivities are read off; choose another drive")
    known = plane
    if isinstance(plane, VelocityPlane):
        known = moments(plane, model, frequency, progress=progress, **vars(chosen))
    assert isinstance(known, Moments)
    assert known.nodes is not None
    nominal: ImpedanceMap = known.educe(model, frequency, reference_phase=reference_phase, **vars(chosen))
    slopes, errors = _model_slopes(known, model, nominal.frequency, numbers)
    asked, _ = averages_of(known, model, nominal.frequency, chosen, reference_phase)
    probes: list[Tensor] = []
    cells, whole = ({name: list[Tensor]() for name in chosen.averagings} for _ in range(2))
    for slope in slopes:
        # Sums are linear in R, averages and phase rules are not.
        with dual_level():
            moved = forward_ad.make_dual(asked.coefficients, known.nodes.coefficients(slope).to(asked.coefficients))
            along = dataclasses.replace(asked, coefficients=moved)
            for name in chosen.averagings:
                found = average(known, along, name)
                cells[name].append(_tangent(found.cells.impedance))
                whole[name].append(_tangent(found.liner.impedance))
                if name == "admittance" and found.probes is not None:
                    probes.append(_tangent(found.probes.impedance).unflatten(0, known.plane.probe_shape))
    of_cells, of_liner = ({name: torch.stack(each).cpu() for name, each in part.items()} for part in (cells, whole))
    return Sensitivities(numbers, torch.stack(probes).cpu(), of_cells, of_liner, errors, nominal)


def _tangent(value: Tensor) -> Tensor:
    found = forward_ad.unpack_dual(value).tangent
    return torch.zeros_like(value) if found is None else found


def _model_slopes(
    known: Moments, liner: LinerModel, frequency: Tensor, numbers: Mapping[str, Number]
) -> tuple[Tensor, Tensor]:
    """dR/dp at the nodes, (n, F, K), and its relative error between them, (n,).

    Raises:
        ValueError: no derivative passes the liner's formula.
    """
    nodes = known.nodes
    assert nodes is not None
    values = [torch.tensor(n.value, dtype=torch.float64).requires_grad_() for n in numbers.values()]
    moved = liner.with_numbers(dict(zip(numbers, values, strict=True)))
    speed = checked_speeds(known.top_speed(liner))
    found = slopes_of(response(moved, frequency, torch.cat([nodes.speeds, speed])), values)
    for name, each in zip(numbers, found, strict=True):
        if each is None:
            raise ValueError(
                f"{type(moved).__name__}.impedance passes no derivative in {name}; compute it "
                "with torch from the number as with_numbers stores it, without float()"
            )
    stacked = torch.stack([each for each in found if each is not None])
    at_nodes, wanted = stacked.tensor_split([nodes.count], dim=-1)
    between = nodes.coefficients(at_nodes) @ nodes.functions(speed).T.to(wanted)
    away, scale = (each.abs().amax((1, 2)) for each in (between - wanted, wanted))
    return at_nodes, away / scale.clamp(1e-300)


def standard_of(covariance: Tensor) -> Tensor:
    """u(R) + j u(X) from (..., 2, 2)."""
    return torch.view_as_complex(covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt().contiguous())


def correlation_of(covariance: Tensor) -> float:
    """Of R and X, -1 to 1, from (2, 2); 0 where one of them has no uncertainty."""
    product = float((covariance[0, 0] * covariance[1, 1]).sqrt())
    return float(covariance[0, 1]) / product if product else 0.0


def covariance_of(changes: Tensor, between: Tensor) -> Tensor:
    """Covariance of R and X, (..., 2, 2), from changes of Z, complex, (n, ...), and the covariance between these."""
    parts = torch.view_as_real(changes.resolve_conj())
    return torch.einsum("i...a,ij,j...b->...ab", parts, between, parts)


def _times(factors: Tensor, slopes: Tensor) -> Tensor:
    return slopes * factors.reshape(-1, *(1,) * (slopes.ndim - 1))


def _half_width(name: str, tolerance: Any, number: Number) -> float:
    width = parse_tolerance(tolerance, name, number.quantity, number.value)
    if number.low >= 0 and width > abs(number.value) > 0:
        raise ValueError(
            f"tolerance of {name} is {tolerance!r}, a half-width of {width:g}, more than its value, "
            f"{number.value:.6g}, which is never below {number.low:g}; write '2 %' where per cent are meant"
        )
    return width


def _correlation_matrix(names: Sequence[str], pairs: Mapping[tuple[str, str], float]) -> Tensor:
    matrix = torch.eye(len(names), dtype=torch.float64)
    for (first, second), coefficient in pairs.items():
        for name in (first, second):
            require_choice("parameter of a correlation", name, names)
        if first == second or not -1 <= coefficient <= 1:
            raise ValueError(
                f"correlation of {first} and {second} is {coefficient:g}; it is -1 to 1, between two different "
                "parameters"
            )
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = coefficient
    lowest = float(torch.linalg.eigvalsh(matrix)[0])
    if lowest < -1e-12:
        raise ValueError(
            f"these correlations contradict each other: their matrix has the eigenvalue {lowest:.3g}, and none may be "
            "negative"
        )
    return matrix
