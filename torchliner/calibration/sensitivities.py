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
from torchliner.forward_mode import dual_level, slopes_of
from torchliner.liners.model import Liner, Number, as_liner, named_numbers
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.impedance_map import ENDS
from torchliner.reduction.basis import Response, checked_speeds, response_of
from torchliner.reduction.moments import Moments
from torchliner.replay.incident import LineSums
from torchliner.tdibc.assemble import assemble
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared, Progress
from torchliner.tdibc.replayed import Replayed, find_walls

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
        self, tolerances: Mapping[str, Any], *, limits: str,
        correlation: Mapping[tuple[str, str], float] | None = None,
    ) -> Budget:  # fmt: skip
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
    plane: VelocityPlane | Moments, liner: Liner, frequency: Any = None,
    parameters: Sequence[str] | None = None, *, reference_phase: Any = None,
    progress: Progress | None = None, **choices: Any,
) -> Sensitivities:  # fmt: skip
    """dZ/dp of the liner, its cells and every probe, for all parameters from one reading.

    Args:
        plane: wall-normal velocity, (..., T) m/s, or its moments.
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
    if not isinstance(plane, (VelocityPlane, Moments)):
        raise TypeError(f"plane is {type(plane).__name__}; one VelocityPlane is needed")
    model = as_liner(liner)
    numbers = named_numbers(model, parameters)
    if not numbers:
        raise ValueError("no parameter is named; leave parameters out for all of them")
    chosen = Choices(**{"dtype": "float64", "interval": None, **choices})
    if chosen.engine != "spectral":
        raise ValueError(
            f"sensitivities are read off engine 'spectral', not {chosen.engine!r}; leave engine and incident out"
        )
    ready = prepare([plane], model, frequency, chosen, progress)[0]
    replayed = replay(ready)
    nominal = replayed.map(chosen.phase, reference_phase)
    slopes, errors = _model_slopes(ready, numbers)
    rule, wall = replayed.rule(chosen.phase, reference_phase), find_walls(ready)[0]
    rows: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
    for slope in slopes:
        # Sums are linear in R, averages and phase rules are not.
        moved = ready.read_with(lambda *_, slope=slope: slope)
        with dual_level():
            along = Replayed(ready, LineSums(
                forward_ad.make_dual(replayed.sums.forward, moved.forward),
                *(None if after is None else forward_ad.make_dual(before, after)
                  for before, after in ((replayed.sums.backward, moved.backward), (None, None),
                                        (replayed.sums.turned, moved.turned))),
            ))  # fmt: skip
            reflection = rule.reflection(along.means)
            peak = 2 * ready.velocity_amplitude
            found = assemble(ready, chosen.phase, reflection, rule.held, peak, [], wall=wall)
            for name, field in FIELDS.items():
                if (part := getattr(found, field)) is not None:
                    tangent = forward_ad.unpack_dual(part).tangent
                    rows[name].append(torch.zeros_like(part) if tangent is None else tangent)
    stacked = {name: torch.stack(each) for name, each in rows.items() if each}
    tell(nominal.notes)
    return Sensitivities(numbers, **stacked, level_error=errors, found=nominal)


def _model_slopes(ready: Prepared, numbers: Mapping[str, Number]) -> tuple[Tensor, Tensor]:
    """dR/dp at the reader's lines and speeds, (n, lines, K), and its relative error between, (n,).

    Raises:
        ValueError: no derivative passes the liner's formula.
    """
    assert ready.reader is not None
    values = [torch.tensor(n.value, dtype=torch.float64).requires_grad_() for n in numbers.values()]
    moved = ready.liner.with_numbers(dict(zip(numbers, values, strict=True)))
    lines, basis = ready.reader.read.flatten(), ready.reader.basis
    speed = checked_speeds(ready.top_speed)

    def slopes(response: Response, speeds: Tensor) -> Tensor:
        found = slopes_of(response(lines, speeds), values)
        for name, each in zip(numbers, found, strict=True):
            if each is None:
                raise ValueError(
                    f"{type(moved).__name__}.impedance passes no derivative in {name}; compute it "
                    "with torch from the number as with_numbers stores it, without float()"
                )
        return torch.stack([each for each in found if each is not None])

    at_nodes, wanted = slopes(response_of(moved), torch.cat([basis.speeds, speed])).tensor_split([basis.count], dim=-1)
    between = basis.coefficients(at_nodes) @ basis.functions(speed).T.to(wanted)
    away, scale = (each.abs().amax((1, 2)) for each in (between - wanted, wanted))
    if ready.kernels is not None:
        at_nodes = slopes(ready.response(moved), basis.speeds)
    return at_nodes, away / scale.clamp(1e-300)
