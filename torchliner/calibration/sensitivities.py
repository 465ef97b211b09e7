r"""Derivatives of the educed impedance in every parameter of a liner, from one reading of the data.

The educed reflection is linear in the response R(f, |v|) of the liner, which is read at a few
speeds alone. So dR/dp there, by forward differentiation of the liner's formula, and the moments of
|v| that R is read with give its derivative; averages and phase rules follow by forward
differentiation too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor
from torch.autograd import forward_ad

from torchliner.calibration.budget import OF_PLACES, Budget, OfParameters, budget_of
from torchliner.checks import require_choice, tell
from torchliner.forward_mode import dual_level, tangent_of
from torchliner.liners.model import Liner, LinerModel, as_liner, named_numbers
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.impedance_map import ENDS
from torchliner.reduction.basis import interpolation_error, response_of
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared, Progress
from torchliner.tdibc.replayed import Replayed

FIELDS = {  # of the sensitivities, by that of the map which they differentiate
    "probes": "impedance",
    "cells": "cell_impedance",
    "cells_velocity_first": "cell_impedance_velocity_first",
    "liner": "liner_impedance",
    "liner_velocity_first": "liner_impedance_velocity_first",
    "cells_coherent_first": "cell_impedance_coherent_first",  # these where the map holds them
    "liner_coherent_first": "liner_impedance_coherent_first",
}


@dataclass(frozen=True, eq=False)
class Sensitivities(OfParameters):
    """dZ/dp of everything that ``educe`` gives, normalised by rho c per SI unit of p.

    Args:
        numbers: parameters by name, n of them, at which the derivatives hold.
        probes: complex, (n, ..., F) on the probe axes of the plane; nan where excluded.
        cells, cells_velocity_first, cells_coherent_first: (n, C, F), by order of averaging; the
            last is None where it was left out.
        liner, liner_velocity_first, liner_coherent_first: whole liner, (n, F), by order.
        level_error: largest error of dR/dp from its interpolation over |v|, at any |v| of the data
            and relative to the largest |dR/dp|, (n,); that of the mean over a record is far less.
        found: the map itself.
    """

    probes: Tensor
    cells: Tensor
    cells_velocity_first: Tensor
    liner: Tensor
    liner_velocity_first: Tensor
    level_error: Tensor
    found: ImpedanceMap
    cells_coherent_first: Tensor | None = None
    liner_coherent_first: Tensor | None = None

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each parameter, "1" if it has none."""
        return tuple(number.unit for number in self.numbers.values())

    def of_liner(self, order: str) -> Tensor:
        """Whole liner, (n, F), in one of ``ORDERS``."""
        require_choice("order of averaging", order, self.found.orders)
        return cast(Tensor, getattr(self, f"liner{ENDS[order]}"))

    def scaled(self, steps: Any) -> Sensitivities:
        """Change of Z, to first order, for a step of each parameter.

        Args:
            steps: SI, (n,).
        """
        amounts = torch.as_tensor(steps, dtype=torch.float64)
        moved = {
            name: part * amounts.reshape(-1, *(1,) * (part.ndim - 1))
            for name in FIELDS
            if (part := getattr(self, name)) is not None
        }
        return dataclasses.replace(self, **moved)

    def per_percent(self) -> Sensitivities:
        """Change of Z for 1 % of each parameter's value."""
        return self.scaled(0.01 * self.values)

    def propagate(
        self,
        tolerances: Mapping[str, Any],
        *,
        limits: str,
        correlation: Mapping[tuple[str, str], float] | None = None,
    ) -> Budget:
        """First-order standard uncertainty of R and X from stated tolerances.

        Args:
            tolerances: half-width by parameter, with its unit: ``{"orifice_diameter": "0.02 mm",
                "porosity": "2 %"}``; a plain number only for what has no unit.
            limits: what a half-width means: ``rectangular``, limits within which every value is
                equally likely (standard uncertainty half-width/sqrt 3), or ``standard``, the
                standard uncertainty itself.
            correlation: coefficients of pairs of parameters, -1 to 1; others are independent.
        Returns:
            The budget, contributions and covariance of R and X.
        Raises:
            ValueError: a parameter that was not differentiated, a tolerance without a unit, an
                unknown reading, correlations that no set of quantities can have.
        Source: JCGM 100:2008 (GUM), 4.3.7 and eq. (13).
        """
        slopes = {
            **{order: self.of_liner(order) for order in self.found.orders},
            **{name: getattr(self, name) for name in OF_PLACES},
        }
        return budget_of(self.numbers, slopes, tolerances, limits, correlation)


def sensitivities(
    plane: VelocityPlane,
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
        plane: wall-normal velocity, (..., T) m/s.
        liner: one that states ``numbers``, as SDoF liners do.
        frequency: Hz, one or several; default the plane's tone.
        parameters: names of ``liner.numbers()``; default all. ``temperature`` and
            ``pressure`` change c, rho and eta of the liner's gas as those of dry air; the plane's
            own gas, which scales inferred waves alone, stays.
        reference_phase: rad, for ``phase="given"``.
        progress: called with numbers of samples done, 2 T in all.
        choices: as for ``educe``; float64 unless ``dtype`` says otherwise.
    Raises:
        TypeError: a liner without numbers.
        ValueError: an engine that is not ``spectral``, an unknown parameter, or data that cannot
            give an answer (see ``educe``).
    Warns:
        DataWarning: as ``educe``.
    Source: Roncen et al. (2026), section 3, differentiated.
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    model = as_liner(liner)
    numbers = named_numbers(model, parameters)
    if not numbers:
        raise ValueError("no parameter is named; leave parameters out for all of them")
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    if chosen.engine != "spectral":
        raise ValueError(
            f"sensitivities are read off engine 'spectral', not {chosen.engine!r}; leave engine "
            "and incident out"
        )
    ready = prepare([plane], model, frequency, chosen, progress)[0]
    nominal = replay(ready).map(chosen.phase, reference_phase)
    rows: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
    errors = []
    for name, number in numbers.items():
        with dual_level():
            value = torch.tensor(number.value, dtype=torch.float64)
            moved = model.with_numbers({name: forward_ad.make_dual(value, torch.ones_like(value))})
            errors.append(_slope_error(ready, moved, name))
            # Without blocks: intervals have no derivative.
            again = Replayed(dataclasses.replace(ready, blocks=None), ready.read_with(moved))
            found = again.map(chosen.phase, reference_phase)
            for each, field in FIELDS.items():
                if (part := getattr(found, field)) is not None:
                    rows[each].append(tangent_of(part))
    stacked = {name: torch.stack(each) for name, each in rows.items() if each}
    tell(nominal.notes)
    return Sensitivities(numbers, **stacked, level_error=torch.tensor(errors), found=nominal)


def _slope_error(ready: Prepared, moved: LinerModel, name: str) -> float:
    """Largest relative error of dR/dp from its interpolation over |v|.

    Raises:
        ValueError: no derivative passes the liner's formula.
    """
    assert ready.reader is not None
    response = response_of(moved)

    def slope(frequency: Tensor, speed: Tensor) -> Tensor:
        found = response(frequency, speed)
        if forward_ad.unpack_dual(found).tangent is None:
            raise ValueError(
                f"{type(moved).__name__}.impedance passes no derivative in {name}; compute it "
                "with torch from the number as with_numbers stores it, without float()"
            )
        return tangent_of(found)

    lines = ready.reader.read.flatten()
    return interpolation_error(ready.reader.basis, slope, lines, ready.top_speed, relative=True)[0]
