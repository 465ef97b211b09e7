"""Impedance out: a map with its averages and all choices that led to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, require_choice
from torchliner.conversions import (
    absorption_from_reflection,
    admittance_from_reflection,
    impedance_from_reflection,
    mean_impedance,
    spl_from_pressure_amplitude,
)
from torchliner.fluid import Fluid
from torchliner.names import ORDERS
from torchliner.records.closure import Closure, words_of
from torchliner.records.holes import Holes
from torchliner.records.outlets import DrawnAtFrequency, Result
from torchliner.records.point_impedances import PointImpedances
from torchliner.records.summaries import (
    Facts,
    Summarised,
    frequency_words,
    heading_of,
    impedance_facts,
    shape_words,
)
from torchliner.records.uncertainty import Uncertainty

ENDS = dict(zip(ORDERS, ("", "_velocity_first", "_coherent_first"), strict=True))  # of names


@dataclass(frozen=True, eq=False, repr=False)
class ImpedanceMap(DrawnAtFrequency, Result, Summarised):
    """Educed impedance of every probe, with its averages and all choices that led to it.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner.

    Args:
        frequency: Hz, (F,).
        reflection: R, complex128, (..., F) on the probe axes of the plane; nan where excluded.
        mean_velocity, velocity_rms: m/s, (...): time mean, and rms of the rest, of v as stored
            (positive away from the liner).
        velocity_amplitude: complex peak amplitude of v into the liner at f, m/s, (..., F).
        coherence: squared coherence of v with a steady tone at f, (..., F).
        phase_rule: per probe and frequency, the rule that was used: False where
            ``self-consistent`` fell back to ``averaged``.
        cell_x, cell_z: centres of whole cells, m, (C,).
        cell_reflection: from the admittance averaged over each cell's probes, (C, F).
        cell_reflection_velocity_first: from the velocity averaged over the cell, then replayed.
        reflection_coherent_first, cell_reflection_coherent_first: R of each probe, (..., F), under
            its own incoherent velocity and the coherent one of its cell, and from the admittance
            averaged over each cell's probes, (C, F); None where another order was asked for.
        liner_reflection_coherent_first: the same over the probes of all cells, (F,).
        x, z, height, fluid, reference, holes, ...: as in the plane.
        wall: probes that counted as wall, admittance 0, in the averages over probes, bool,
            (..., F); None without a wall filter.
        choices: every option and what followed from it (kernel error, levels, versions).
        notes: warnings, with numbers.
        uncertainty: statistical intervals, because the record is finite; None without any.
        alongside: what other methods found for the same case, such as ``in_situ``.
        cell_weight: share of its probes that each cell has, in averages over cells, (C,); None: all
            the same. Cells without any probe left are no cells of the map.
        closure: whether Z and the coherent velocity give the pressure that is known; None where
            that is not checked, see ``closure_words``.
    """

    frequency: Tensor
    reflection: Tensor
    mean_velocity: Tensor
    velocity_rms: Tensor
    velocity_amplitude: Tensor
    coherence: Tensor
    phase_rule: Tensor
    cell_x: Tensor
    cell_z: Tensor
    cell_reflection: Tensor
    cell_reflection_velocity_first: Tensor
    x: Tensor | None = None
    z: Tensor | None = None
    height: float | None = None
    fluid: Fluid = field(default_factory=Fluid)
    reference: Mapping[str, complex] = field(default_factory=dict)
    mach: float | None = None
    incident_level: float | None = None
    source_side: str = "unknown"
    goodrich: Tensor | None = None
    title: str = ""
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    uncertainty: Uncertainty | None = None
    wall: Tensor | None = None
    alongside: tuple[PointImpedances, ...] = ()
    cell_weight: Tensor | None = None
    reflection_coherent_first: Tensor | None = None
    cell_reflection_coherent_first: Tensor | None = None
    liner_reflection_coherent_first: Tensor | None = None
    closure: Closure | None = None
    holes: Holes | None = None

    @property
    def tone(self) -> int | None:
        """Index of the tone of the data, of which ``reference`` is; where they state none, of the
        only frequency; None if it is not among them."""
        stated = self.choices.get("tone")
        if stated is None:
            return 0 if len(self.frequency) == 1 else None
        return index_of_frequency(self.frequency, stated)

    def reference_at(self, index: int) -> dict[str, complex]:
        """Independent impedances at one frequency, by name: none but at the tone."""
        return dict(self.reference) if index == self.tone else {}

    @property
    def impedance(self) -> Tensor:
        """Z, (..., F)."""
        return impedance_from_reflection(self.reflection)

    @property
    def resistance(self) -> Tensor:
        """Re Z, (..., F)."""
        return self.impedance.real

    @property
    def reactance(self) -> Tensor:
        """Im Z, (..., F)."""
        return self.impedance.imag

    @property
    def admittance(self) -> Tensor:
        """1/Z, (..., F)."""
        return admittance_from_reflection(self.reflection)

    @property
    def averaged_admittance(self) -> Tensor:
        """The admittance that averages over probes take, (..., F): 0 where a probe is wall."""
        if self.wall is None:
            return self.admittance
        return torch.where(self.wall, 0, self.admittance)

    @property
    def absorption(self) -> Tensor:
        """1 - |R|^2, (..., F)."""
        return absorption_from_reflection(self.reflection)

    @property
    def incident_pressure(self) -> Tensor:
        """Complex peak amplitude, Pa, (..., F), of the wave that gives the measured v at f.

        X = V/(1 - R): it means something only where v is coherent with the tone.
        """
        scale = self.fluid.characteristic_impedance
        return scale * self.velocity_amplitude / (1 - self.reflection)

    @property
    def inferred_incident_level(self) -> Tensor:
        """Level of ``incident_pressure``, dB re 20 uPa rms, (..., F)."""
        return spl_from_pressure_amplitude(self.incident_pressure)

    @property
    def liner_impedance(self) -> Tensor:
        """1 / mean of the admittance over all probes, 0 at those that count as wall, (F,)."""
        flat = self.averaged_admittance.reshape(-1, len(self.frequency))
        return mean_impedance(flat[torch.isfinite(flat.real).all(1)])

    @property
    def liner_spread(self) -> Tensor:
        """Standard deviation of resistance and of reactance (imaginary part) over the probes, (F,).

        How Z differs from place to place; it does not shrink with the length of the record.
        """
        flat = self.impedance.reshape(-1, len(self.frequency))
        flat = flat[torch.isfinite(flat.real).all(1)]
        if len(flat) < 2:
            return torch.zeros(len(self.frequency), dtype=torch.complex128)
        return torch.complex(flat.real.std(0), flat.imag.std(0))

    @property
    def liner_impedance_velocity_first(self) -> Tensor:
        """1 / mean over cells, each by its share of probes, of Y from their velocity, (F,)."""
        admittance = admittance_from_reflection(self.cell_reflection_velocity_first)
        return mean_impedance(admittance, weights=self.cell_weight)

    @property
    def liner_impedance_coherent_first(self) -> Tensor | None:
        """1 / mean of the admittance over the probes of all cells, coherent first, (F,)."""
        return _impedance_if_known(self.liner_reflection_coherent_first)

    @property
    def orders(self) -> tuple[str, ...]:
        """Those of ``names.ORDERS`` that the map holds."""
        return ORDERS if self.cell_reflection_coherent_first is not None else ORDERS[:2]

    @property
    def order(self) -> str:
        """That of ``answer``: as chosen; ``probes first`` in files of older versions."""
        return str(self.choices.get("order", ORDERS[0]))

    @property
    def answer(self) -> Tensor:
        """Z of the whole liner in the order that was chosen, (F,): the value to quote."""
        return self.of_liner(self.order)

    def of_liner(self, order: str) -> Tensor:
        """Whole liner, (F,), in one of ``orders``."""
        return self._in_order(self, f"liner_impedance{ENDS[order]}", order)

    def of_cells(self, order: str) -> Tensor:
        """Each cell, (C, F), in one of ``orders``."""
        return self._in_order(self, f"cell_impedance{ENDS[order]}", order)

    @property
    def closure_words(self) -> str:
        """What the whole plane is compared with, or why it is not."""
        return words_of(self.closure, self.choices)

    def bounds_of_liner(self, order: str, index: int = 0) -> tuple[complex, complex] | None:
        """Of its statistical interval at one frequency; None without any."""
        if self.uncertainty is None or order not in self.orders:
            return None
        found = self._in_order(self.uncertainty, f"liner{ENDS[order]}", order)
        return complex(found.low[index]), complex(found.high[index])

    def _in_order(self, holder: Any, name: str, order: str) -> Any:
        require_choice("order of averaging", order, self.orders)
        return getattr(holder, name)

    @property
    def cell_impedance(self) -> Tensor:
        """Of each cell, admittance averaged over its probes, (C, F)."""
        return impedance_from_reflection(self.cell_reflection)

    @property
    def cell_impedance_velocity_first(self) -> Tensor:
        """Of each cell, velocity averaged over its probes, then replayed, (C, F)."""
        return impedance_from_reflection(self.cell_reflection_velocity_first)

    @property
    def cell_impedance_coherent_first(self) -> Tensor | None:
        """Of each cell, admittance averaged over its probes, coherent first, (C, F)."""
        return _impedance_if_known(self.cell_reflection_coherent_first)

    @property
    def impedance_coherent_first(self) -> Tensor | None:
        """Of each probe under the coherent velocity of its cell, (..., F)."""
        return _impedance_if_known(self.reflection_coherent_first)

    def _heading(self) -> str:
        probes = shape_words(tuple(self.mean_velocity.shape), "probe")
        cells = shape_words((len(self.cell_x),), "cell")
        words = (probes, cells, frequency_words(self.frequency), f"liner {self.order}")
        return heading_of(self, *words)

    def _facts(self) -> Facts:
        found = self.uncertainty
        if found is None or self.order not in self.orders:
            return impedance_facts(self.frequency, self.answer)
        interval = getattr(found, f"liner{ENDS[self.order]}")
        return impedance_facts(self.frequency, self.answer, interval, found.settings["level"])

    def with_alongside(self, *others: PointImpedances) -> ImpedanceMap:
        """The same map with the results of other methods beside it, for files and figures."""
        return replace(self, alongside=(*self.alongside, *others))


def _impedance_if_known(reflection: Tensor | None) -> Tensor | None:
    return None if reflection is None else impedance_from_reflection(reflection)
