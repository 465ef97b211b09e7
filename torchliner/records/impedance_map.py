"""Impedance out: a map with its averages and all choices that led to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, require_choice
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.fluid import Fluid
from torchliner.names import resolve
from torchliner.records.averaged import Educed
from torchliner.records.holes import Holes
from torchliner.records.level_check import LevelCheck, words_of
from torchliner.records.notes import Note
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


@dataclass(frozen=True, eq=False, repr=False)
class ImpedanceMap(DrawnAtFrequency, Result, Summarised):
    """Educed impedance of every probe, cell and the whole liner, with all choices that led to it.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner. ``probes``, ``cells`` and ``liner`` hold
    an ``Educed`` for each averaging: ``found.liner["phase-locked"].impedance`` with ``.low`` and ``.high``.

    Args:
        frequency: Hz, (F,).
        probes: by averaging, on the probe axes of the plane, (..., F); nan where excluded. Averaging ``velocity`` has
            no probes.
        cells: by averaging, (C, F).
        liner: by averaging, (F,).
        along_x: by averaging, the admittance averaged over z, (X, F), of (z, x) planes.
        averaging: which of them ``answer`` quotes.
        mean_velocity, velocity_rms: m/s, (...): time mean, and rms of the rest, of v as stored (positive away from
            the liner).
        velocity_amplitude: complex peak amplitude of v into the liner at f, m/s, (..., F).
        coherence: squared coherence of v with a steady tone at f over the blocks of the record, (..., F). As
            ``velocity_amplitude`` nan where it was not measured: beside the tone, where many frequencies are asked for.
        phase_rule: per probe and frequency, whether the phase rule was used: False where ``self-consistent`` fell back
            to ``averaged``.
        cell_x, cell_z: centres of whole cells, m, (C,).
        cell_weight: share of its probes that each cell has, in averages over cells, (C,); None: all the same.
        wall: probes that counted as wall, admittance 0, in averages over probes, bool, (..., F); None without filter.
        x, z, height, fluid, reference, holes, ...: as in the plane.
        choices: every option and what followed from it.
        notes: warnings.
        level_check: whether Z and the phase-locked velocity give the pressure that is known; None where that is not
            checked, see ``level_check_words``.
        alongside: what other methods found for the same case, such as ``in_situ``.
    """

    frequency: Tensor
    probes: Mapping[str, Educed]
    cells: Mapping[str, Educed]
    liner: Mapping[str, Educed]
    averaging: str
    mean_velocity: Tensor
    velocity_rms: Tensor
    velocity_amplitude: Tensor
    coherence: Tensor
    phase_rule: Tensor
    cell_x: Tensor
    cell_z: Tensor
    along_x: Mapping[str, Educed] = field(default_factory=dict)
    cell_weight: Tensor | None = None
    wall: Tensor | None = None
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
    notes: tuple[Note, ...] = ()
    level_check: LevelCheck | None = None
    alongside: tuple[PointImpedances, ...] = ()
    holes: Holes | None = None

    @property
    def averagings(self) -> tuple[str, ...]:
        """Those that the map holds."""
        return tuple(self.liner)

    @property
    def answer(self) -> Tensor:
        """Z of the whole liner in the averaging that was chosen, (F,): the value to quote."""
        return self.liner[self.averaging].impedance

    @property
    def level(self) -> float | None:
        """Of the statistical intervals, 0 to 1; None without any."""
        return self.choices.get("interval") if self.liner[self.averaging].interval is not None else None

    def bounds_of_liner(self, averaging: str, index: int = 0) -> tuple[complex, complex] | None:
        """Of the statistical interval at one frequency; None without any."""
        require_choice("averaging", averaging, self.averagings)
        interval = self.liner[averaging].interval
        return None if interval is None else interval.bounds(index)

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
        """Z of each probe as measured, (..., F): that of averaging ``admittance``."""
        return self.probes["admittance"].impedance

    @property
    def resistance(self) -> Tensor:
        """Re Z of each probe as measured, (..., F)."""
        return self.impedance.real

    @property
    def reactance(self) -> Tensor:
        """Im Z of each probe as measured, (..., F)."""
        return self.impedance.imag

    @property
    def incident_pressure(self) -> Tensor:
        """Complex peak amplitude, Pa, (..., F), of the wave that gives the measured v at f.

        X = V/(1 - R): it means something only where v is coherent with the tone.
        """
        scale = self.fluid.characteristic_impedance
        return scale * self.velocity_amplitude / (1 - self.probes["admittance"].reflection)

    @property
    def inferred_incident_level(self) -> Tensor:
        """Level of ``incident_pressure``, dB re 20 uPa rms, (..., F)."""
        return spl_from_pressure_amplitude(self.incident_pressure)

    @property
    def liner_spread(self) -> Tensor:
        """Standard deviation of resistance and of reactance (imaginary part) over the probes as measured, (F,).

        How Z differs from place to place; it does not shrink with the length of the record.
        """
        flat = self.impedance.reshape(-1, len(self.frequency))
        flat = flat[torch.isfinite(flat.real).all(1)]
        if len(flat) < 2:
            return torch.zeros(len(self.frequency), dtype=torch.complex128)
        return torch.complex(flat.real.std(0), flat.imag.std(0))

    @property
    def level_check_words(self) -> str:
        """What the whole plane is compared with, or why it is not."""
        return words_of(self.level_check, self.choices)

    def time_domain(
        self, poles: int = 8, *, band: tuple[float, float] | None = None, averaging: str | None = None
    ) -> Any:
        """The liner's R as poles and residues, stable and passive, for solvers in the time domain.

        Args:
            poles: how many, fewer than frequencies of the map.
            band: lowest and highest frequency to fit, Hz; default all.
            averaging: default that of the answer.
        Returns:
            ``Multipole``.
        Raises:
            ValueError: as ``fit_multipole``.
        """
        name = self.averaging if averaging is None else require_choice("averaging", averaging, self.averagings)
        low, high = (0.0, float("inf")) if band is None else band
        wanted = (self.frequency >= low) & (self.frequency <= high)
        source = {"source": self.title or self.choices.get("source", ""), "averaging": name}
        z = self.liner[name].impedance[wanted]
        return resolve("torchliner.liners.multipole:fit_multipole")(self.frequency[wanted], z, poles, **source)

    def with_alongside(self, *others: PointImpedances) -> ImpedanceMap:
        """The same map with the results of other methods beside it, for files and figures."""
        return replace(self, alongside=(*self.alongside, *others))

    def _heading(self) -> str:
        probes = shape_words(tuple(self.mean_velocity.shape), "probe")
        cells = shape_words((len(self.cell_x),), "cell")
        words = (probes, cells, frequency_words(self.frequency), f"liner {self.averaging}")
        return heading_of(self, *words)

    def _facts(self) -> Facts:
        return impedance_facts(self.frequency, self.answer, self.liner[self.averaging].interval, self.level)
