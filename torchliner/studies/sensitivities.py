r"""Derivatives of the educed impedance in every parameter of a liner, from one reading of the data.

The educed reflection is linear in the response R(f, |v|) of the liner, which is read at a few speeds alone: dZ/dp is
what autograd makes of Z as a function of these few values.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, require_positive
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner, impedance_of, named_numbers
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.runs import Run, choices_of_fit, with_slopes
from torchliner.studies.variants import Study, plane_of, rows_of
from torchliner.velocity.educe import moments
from torchliner.velocity.reading import Progress


def sensitivities(
    plane: VelocityPlane | Moments,
    liner: Liner,
    frequency: Any = None,
    parameters: Sequence[str] | None = None,
    *,
    tolerances: Mapping[str, float] | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """dZ/dp of the whole liner in its parameters, from one reading, phase ``averaged``, and what tolerances make of it.

    Args:
        plane, frequency, progress, choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
        liner: one that states ``numbers``, as SDoF liners do.
        parameters: names of ``liner.numbers()``; default those of the tolerances, else all. ``temperature`` and
            ``pressure`` change c, rho and eta of the liner's gas as those of dry air.
        tolerances: half-widths, SI, by parameter: limits within which every value is equally likely, independent of the
            other parameters (standard uncertainty half-width/sqrt 3).
    Returns:
        numbers (parameters by name, n of them), slopes (dZ/dp per SI unit, complex, by averaging, (n, F)), found (the
        map itself); with tolerances covariance (of R and X, by averaging, (F, 2, 2)) and combined (u(R) + j u(X),
        (F,)). ``rows``, the largest first: averaging, frequency (Hz), parameter, value, unit, slope, step (of Z for 1 %
        of the value), half_width, standard (u(p)), change (of Z for one u(p)).
    Raises:
        TypeError: a liner without numbers.
        ValueError: an unknown parameter, a choice that a fit does not know, a tolerance wider than its parameter.
    Source: Roncen et al. (2026), section 3, differentiated; JCGM 100:2008 (GUM), 4.3.7 and eq. (10).
    """
    stated, model = dict(tolerances or {}), as_liner(liner).in_flow(plane_of(plane).mach)
    numbers, chosen, known = named_numbers(model, parameters or [*stated] or None), choices_of_fit(**choices), plane
    widths = dict.fromkeys(numbers, 0.0)
    for name, width in stated.items():
        number = numbers[require_choice("parameter of a tolerance", name, numbers)]
        require_positive(f"tolerance of {name}", width)
        if number.low >= 0 and width > abs(number.value) > 0:
            raise ValueError(f"tolerance of {name} is {width:g}, above its value, {number.value:.6g}; state it in SI")
        widths[name] = width
    if isinstance(known, VelocityPlane):
        known = moments(known, model, frequency, progress=progress, **vars(chosen))
    found: ImpedanceMap = known.educe(model, frequency, **vars(chosen))
    runs = {name: Run(known, name, found.frequency, model) for name in found.averagings}

    def made(at: Tensor) -> Tensor:
        moved = model.with_numbers(dict(zip(numbers, at.unbind(), strict=True)))
        curves = (impedance_of(moved, found.frequency[:, None], run.speeds) for run in runs.values())
        return torch.stack([run.impedance(z) for run, z in zip(runs.values(), curves, strict=True)])

    values = torch.tensor([number.value for number in numbers.values()], dtype=torch.float64)
    _, by = with_slopes(made, values)
    slopes, covariance, rows = dict(zip(runs, by.movedim(-1, 1), strict=True)), dict[str, Tensor](), list[Any]()
    standard = 3**-0.5 * torch.tensor([*widths.values()], dtype=torch.float64)[:, None]
    for averaging, slope in slopes.items():
        own = rows_of(
            averaging=averaging,
            frequency=found.frequency,
            parameter=[[name] for name in numbers],
            value=values[:, None],
            unit=[[number.unit] for number in numbers.values()],
            slope=slope,
            step=0.01 * values[:, None] * slope,
            half_width=[[width] for width in widths.values()],
            standard=standard,
            change=standard * slope,
        )
        size = "change" if stated else "step"
        rows += sorted(own, key=lambda row: (row.frequency, -abs(row[size])))
        covariance[averaging] = covariance_of(standard * slope, torch.eye(len(values), dtype=torch.float64))
    combined = {name: standard_of(each) for name, each in covariance.items()}
    budget = {"covariance": covariance, "combined": combined} if stated else {}
    return Study(numbers=numbers, slopes=slopes, found=found, rows=rows, **budget)


def standard_of(covariance: Tensor) -> Tensor:
    """u(R) + j u(X) from (..., 2, 2)."""
    return torch.view_as_complex(covariance.diagonal(dim1=-2, dim2=-1).clamp(min=0).sqrt().contiguous())


def covariance_of(changes: Tensor, between: Tensor) -> Tensor:
    """Covariance of R and X, (..., 2, 2), from changes of Z, complex, (n, ...), and the covariance between these."""
    parts = torch.view_as_real(changes.resolve_conj())
    return torch.einsum("i...a,ij,j...b->...ab", parts, between, parts)
