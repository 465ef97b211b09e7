r"""Derivatives of the educed impedance in every parameter of a liner, from one replay.

The educed reflection is linear in the response R(f, |v|) of the liner, and so are the kernels and
the tables of the ends of the record. Hence its derivative is the replay of dR/dp in the place of R:
for each parameter a few more lines (``replay.lines``) in the same pass over the data, whose tables
over the levels are filled by forward differentiation of the liner alone. Averages and phase rules
then follow by forward differentiation of the sums.
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
from torchliner.conversions import reflection_from_impedance
from torchliner.forward_mode import dual_level
from torchliner.liners.model import Liner, Number, as_liner, named_numbers
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.impedance_map import ENDS
from torchliner.reduction.probe_velocity import with_smaller_slabs
from torchliner.replay.edges import EdgeTable, Reach
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import impedance_of, reflection_at_levels
from torchliner.replay.levels import interpolate
from torchliner.replay.lines import Line, plan_lines
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.spectral import spectral_sums
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.engines import with_liner
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
        level_error: largest error of dR/dp from the interpolation between velocity levels, relative
            to the largest |dR/dp|, (n,).
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
    """dZ/dp of the liner, its cells and every probe, for all parameters in one replay.

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
    backward = phase_rule(chosen.phase).needs_backward
    lines = plan_lines(
        model, ready.frequency.tolist(), ready.record, ready.grid, ready.kernels,
        of_kernel=chosen.uses_kernel_response, backward=backward,
    )  # fmt: skip
    errors = []
    for name, number in numbers.items():
        more, error = _tangent_lines(ready, name, number.value, backward)
        lines += more
        errors.append(error)
    sums, notes = with_smaller_slabs(
        ready.drive.velocity,
        lambda: spectral_sums(
            ready.drive, lines, ready.grid, compile_loops=chosen.compile, progress=progress
        ),
    )
    ready = dataclasses.replace(ready, notes=(*ready.notes, *notes))
    result = _assemble(ready, numbers, sums, torch.tensor(errors), reference_phase)
    tell(result.found.notes)
    return result


def _tangent(dual: Tensor) -> Tensor:
    found = forward_ad.unpack_dual(dual).tangent
    return torch.zeros_like(dual) if found is None else found


def _tangent_lines(
    ready: Prepared, name: str, at_value: float, backward: bool
) -> tuple[list[Line], float]:
    """Lines of dR/dp, and the largest relative error of its interpolation between levels."""
    record, grid, liner = ready.record, ready.grid, ready.liner
    middle = ((grid.speeds[1:] + grid.speeds[:-1]) / 2)[:, None]
    lines, errors = [], []
    with dual_level():
        value = torch.tensor(at_value, dtype=torch.float64)
        moved = liner.with_numbers({name: forward_ad.make_dual(value, torch.ones_like(value))})
        kernels = with_liner(ready, moved).kernels
        if kernels is not None:
            # Taps, response and edge tables are linear in R: its tangent in, theirs out.
            kernels = dataclasses.replace(kernels, taps=_tangent(kernels.taps))
        for frequency in ready.frequency.tolist():
            at = torch.tensor(record.line_frequencies(frequency)[0], dtype=torch.float64)
            table = _tangent(reflection_at_levels(moved, at, grid))
            between_levels = reflection_from_impedance(impedance_of(moved, at, middle))
            if forward_ad.unpack_dual(between_levels).tangent is None:
                raise ValueError(
                    f"{type(liner).__name__}.impedance passes no derivative in {name}; compute it "
                    "with torch from the number as with_numbers stores it, without float()"
                )
            exact = _tangent(between_levels)
            between = interpolate(table, *grid.locate(middle[:, 0]))
            errors.append(float((between - exact).abs().max() / exact.abs().max().clamp(1e-300)))
            edges = None
            if ready.chosen.uses_kernel_response:
                assert kernels is not None
                table = kernels.response(at)
            if record.needs_table(frequency):
                assert kernels is not None
                edges = EdgeTable(kernels, Reach(record, kernels.taps.shape[1]), frequency)
            lines.append(Line(frequency, record, None, table, edges, backward))
    return lines, max(errors)


def _assemble(
    ready: Prepared,
    numbers: Mapping[str, Number],
    sums: LineSums,
    level_error: Tensor,
    reference_phase: Any,
) -> Sensitivities:
    """Averages and phase rule, differentiated along each parameter's tangent of the sums."""
    phase, count = ready.chosen.phase, len(ready.frequency)
    forward = sums.forward.split(count, dim=1)
    backward = None if sums.backward is None else sums.backward.split(count, dim=1)
    rows: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
    for i in range(1, len(numbers) + 1):
        with dual_level():
            moved = LineSums(
                forward_ad.make_dual(forward[0], forward[i]),
                None if backward is None else forward_ad.make_dual(backward[0], backward[i]),
            )
            found = Replayed(ready, moved).map(phase, reference_phase)
            for name, field in FIELDS.items():
                if (value := getattr(found, field)) is not None:
                    rows[name].append(_tangent(value))
    at_values = LineSums(forward[0], None if backward is None else backward[0])
    nominal = Replayed(ready, at_values).map(phase, reference_phase)
    stacked = {name: torch.stack(each) for name, each in rows.items() if each}
    return Sensitivities(numbers, **stacked, level_error=level_error, found=nominal)
