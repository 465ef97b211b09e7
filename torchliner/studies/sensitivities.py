r"""Derivatives of the educed impedance in every parameter of a liner, from one reading of the data.

The educed reflection is linear in the response R(f, |v|) of the liner, which is read at a few speeds alone: dZ/dp is
what autograd makes of Z as a function of these few values.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, Number, as_liner, impedance_of, named_numbers
from torchliner.names import LIMITS
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.runs import Run, choices_of_fit, with_slopes
from torchliner.studies.variants import Study, plane_of, rows_of
from torchliner.units import parse_tolerance
from torchliner.velocity.educe import moments
from torchliner.velocity.reading import Progress

STEP = 1e-3  # of a value, by which a slope of zero is checked


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """dZ/dp of the whole liner, normalised by rho c per SI unit of p.

    Args:
        numbers: parameters by name, n of them, at which the derivatives hold.
        liner: complex, by averaging, (n, F).
        found: the map itself.
    """

    numbers: Mapping[str, Number]
    liner: Mapping[str, Tensor]
    found: ImpedanceMap

    def per_percent(self) -> Sensitivities:
        """Change of Z, to first order, for 1 % of each parameter's value."""
        step = torch.tensor([[0.01 * number.value] for number in self.numbers.values()], dtype=torch.float64)
        return dataclasses.replace(self, liner={name: step * slopes for name, slopes in self.liner.items()})

    def propagate(self, tolerances: Mapping[str, Any], *, limits: str = "rectangular") -> Study:
        """First-order standard uncertainty of R and X from stated tolerances of independent parameters.

        Args:
            tolerances: half-width by parameter, with its unit: ``{"orifice_diameter": "0.02 mm", "porosity": "2 %"}``.
            limits: what a half-width means: ``rectangular``, limits within which every value is equally likely
                (standard uncertainty half-width/sqrt 3), or ``standard``, the standard uncertainty itself.
        Returns:
            covariance (of R and X of the liner, by averaging, (F, 2, 2)) and combined (u(R) + j u(X), (F,)). ``rows``,
            the largest first: averaging, frequency (Hz), parameter, value, unit, half_width, standard (u(p)), impedance
            (signed change of the liner's Z for one u(p)).
        Raises:
            ValueError: an unknown parameter or reading; a tolerance without a unit or wider than its parameter can be.
        Source: JCGM 100:2008 (GUM), 4.3.7 and eq. (10).
        """
        factor = LIMITS[require_choice("reading of the limits", limits, LIMITS)]
        about, rows, covariance = list[Any](), list[Any](), dict[str, Tensor]()
        for name, tolerance in tolerances.items():
            number = self.numbers[require_choice("parameter of a tolerance", name, self.numbers)]
            width = parse_tolerance(tolerance, name, number.quantity, number.value)
            if number.low >= 0 and width > abs(number.value) > 0:
                raise ValueError(
                    f"tolerance of {name} is {tolerance!r}, a half-width of {width:g}, more than its value, "
                    f"{number.value:.6g}; write '2 %' where per cent are meant"
                )
            about.append((number.value, number.unit, width, factor * width))
        value, unit, half_width, standard = zip(*about, strict=True)
        kept = [list(self.numbers).index(name) for name in tolerances]
        for averaging, slopes in self.liner.items():
            change = slopes[kept] * torch.tensor(standard, dtype=torch.float64)[:, None]
            covariance[averaging] = covariance_of(change, torch.eye(len(kept), dtype=torch.float64))
            found = rows_of(
                averaging=averaging,
                frequency=(lines := self.found.frequency)[:, None],
                parameter=[*tolerances],
                value=value,
                unit=unit,
                half_width=half_width,
                standard=standard,
                impedance=change.T,
            )
            rows += sorted(found, key=lambda row: (lines.tolist().index(row.frequency), -abs(row.impedance)))
        combined = {name: standard_of(each) for name, each in covariance.items()}
        return Study(rows=rows, covariance=covariance, combined=combined)


def sensitivities(
    plane: VelocityPlane | Moments,
    liner: Liner,
    frequency: Any = None,
    parameters: Sequence[str] | None = None,
    *,
    progress: Progress | None = None,
    **choices: Any,
) -> Sensitivities:
    """dZ/dp of the liner for all parameters from one reading, phase ``averaged``.

    Args:
        plane, frequency, progress, choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
        liner: one that states ``numbers``, as SDoF liners do.
        parameters: names of ``liner.numbers()``; default all. ``temperature`` and ``pressure`` change c, rho and eta of
            the liner's gas as those of dry air.
    Raises:
        TypeError: a liner without numbers.
        ValueError: an unknown parameter, one through which no derivative passes, a choice that a fit does not know.
    Source: Roncen et al. (2026), section 3, differentiated.
    """
    model = as_liner(liner).in_flow(plane_of(plane).mach)
    numbers, chosen, known = named_numbers(model, parameters), choices_of_fit(**choices), plane
    if isinstance(known, VelocityPlane):
        known = moments(known, model, frequency, progress=progress, **vars(chosen))
    found: ImpedanceMap = known.educe(model, frequency, **vars(chosen))
    runs = {name: Run(known, name, found.frequency, model) for name in found.averagings}

    def made(at: Tensor) -> Tensor:
        moved = model.with_numbers(dict(zip(numbers, at.unbind(), strict=True)))
        curves = (impedance_of(moved, found.frequency[:, None], run.speeds) for run in runs.values())
        return torch.stack([run.impedance(z) for run, z in zip(runs.values(), curves, strict=True)])

    values = torch.tensor([number.value for number in numbers.values()], dtype=torch.float64)
    z, by = with_slopes(made, values)
    for i, name in enumerate(numbers):
        moved = values - STEP * values * (torch.arange(len(values)) == i)
        if not bool(by[..., i].any()) and bool((made(moved) != z).any()):
            raise ValueError(
                f"{type(model).__name__}.impedance passes no derivative in {name}; compute it with torch from the "
                "number as with_numbers stores it, without float()"
            )
    return Sensitivities(numbers, dict(zip(runs, by.movedim(-1, 1), strict=True)), found)


def standard_of(covariance: Tensor) -> Tensor:
    """u(R) + j u(X) from (..., 2, 2)."""
    return torch.view_as_complex(covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt().contiguous())


def covariance_of(changes: Tensor, between: Tensor) -> Tensor:
    """Covariance of R and X, (..., 2, 2), from changes of Z, complex, (n, ...), and the covariance between these."""
    parts = torch.view_as_real(changes.resolve_conj())
    return torch.einsum("i...a,ij,j...b->...ab", parts, between, parts)
