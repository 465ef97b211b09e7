"""Impedance out: a map with its averages and all choices that led to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from torchliner.checks import index_of_frequency, require_choice
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.names import AVERAGINGS, resolve
from torchliner.records.case import Found, probe_axes
from torchliner.records.declared import Variable, part, record, var
from torchliner.records.educed import Averaged, Educed, PointImpedances
from torchliner.records.level_check import LevelMatched
from torchliner.records.outlets import Drawn

FULL = ("probes", "frequency")


@record
class ImpedanceMap(Drawn, Averaged, Found):
    """Educed impedance of every probe, cell and the whole liner, with all choices that led to it.

    All impedances are normalised by rho c, exp(+j omega t), v into the liner. ``probes``, ``cells`` and ``liner`` hold
    an ``Educed`` for each averaging: ``found.liner["phase-locked"].impedance`` with ``.low`` and ``.high``. Axes:
    ``probes`` are those of the plane, F frequencies, C cells; ``columns`` are the x of a (z, x) plane.

    Args:
        probes: by averaging, (..., F); nan where excluded. Averaging ``velocity`` has no probes.
        cells: by averaging, (C, F).
        liner: by averaging, (F,).
        along_x: by averaging, the admittance averaged over z, (X, F), of (z, x) planes.
        averaging: which of them ``answer`` quotes.
        alongside: what other methods found for the same case, such as ``in_situ``.
    """

    frequency: Tensor = var("frequency", unit="Hz", text="frequency of the tone")
    probes: Mapping[str, Educed] = part("", *FULL, text="at each probe", by="names")
    cells: Mapping[str, Educed] = part("cell_", "averaging", "cell", "frequency", text="of each cell", by="averagings")
    liner: Mapping[str, Educed] = part("liner_", "averaging", "frequency", text="of the whole liner", by="averagings")
    averaging: str
    mean_velocity: Tensor = var("probes", unit="m/s", text="time mean of v, positive away from the liner")
    velocity_rms: Tensor = var("probes", unit="m/s", text="rms of v about its mean")
    velocity_amplitude: Tensor = var(*FULL, unit="m/s", kind="complex", text="peak amplitude of v into the liner")
    coherence: Tensor = var(*FULL, text="squared coherence of v with the tone over the blocks, nan where not measured")
    phase_rule: Tensor = var(*FULL, kind="flag", name="phase_rule_used", text="whether it was used; else averaged")
    cell_x: Tensor = var("cell", unit="m", text="streamwise coordinate of the centre of a cell")
    cell_z: Tensor = var("cell", unit="m", text="spanwise coordinate of the centre of a cell")
    along_x: Mapping[str, Educed] = part(
        "along_x_", "columns", "frequency", text="averaged over z", by="names", default_factory=dict
    )
    cell_weight: Tensor | None = var("cell", text="share of a cell's probes in use", default=None)
    wall: Tensor | None = var(*FULL, kind="flag", default=None, text="whether it counts as wall, of admittance 0")
    x: Tensor | None = var("columns", unit="m", text="streamwise coordinate", default=None)
    z: Tensor | None = var("rows", unit="m", text="spanwise coordinate", default=None)
    height: float | None = var(unit="m", text="distance of the plane from the liner", default=None)
    alongside: tuple[PointImpedances, ...] = part("alongside", by="groups", default=())
    _: KW_ONLY
    level_matched: LevelMatched | None = part("level_matched_", default=None)

    DERIVED: ClassVar = (
        Variable("averagings", dims=("averaging",), kind="text", name="averaging", text="averaging over the probes"),
        Variable("answer", dims=("frequency",), name="answer_{}", text="in the averaging chosen"),
        Variable("liner_spread", dims=("frequency",), name="liner_spread_{}", text="spread over positions"),
        Variable("inferred_incident_level", "dB", FULL, text="of the wave that gives the coherent v, re 20 uPa rms"),
    )
    SCHEMA: ClassVar = "torchliner map 1"
    PLACES: ClassVar = {"probes": ("probes",), "cells": ("cell",)}
    PLOT: ClassVar = "torchliner.report.curves:draw_result"

    def __post_init__(self) -> None:
        if not {self.averaging} <= {*self.liner} <= {*AVERAGINGS}:
            raise ValueError(
                f"averaging holds {[*self.liner]}, of which {self.averaging!r} was chosen; "
                f"{', '.join(AVERAGINGS)} are known"
            )

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of its file."""
        return {**probe_axes(tuple(self.mean_velocity.shape)), "places": ("cell",)}

    @property
    def tone(self) -> int | None:
        """Index of the tone of the data, of which ``reference`` is; where they state none, of the
        only frequency; None if it is not among them."""
        stated = self.choices.get("tone")
        if stated is None:
            return 0 if len(self.frequency) == 1 else None
        return index_of_frequency(self.frequency, stated)

    @property
    def impedance(self) -> Tensor:
        """Z of each probe as measured, (..., F): that of averaging ``admittance``."""
        return self.probes["admittance"].impedance

    @property
    def inferred_incident_level(self) -> Tensor:
        """Level of the wave that gives the measured v at f where v is coherent with the tone, of the amplitude
        rho c V/(1 - R), dB re 20 uPa rms, (..., F)."""
        wave = self.velocity_amplitude / (1 - self.probes["admittance"].reflection)
        return spl_from_pressure_amplitude(self.fluid.characteristic_impedance * wave)

    @property
    def liner_spread(self) -> Tensor:
        """Standard deviation of resistance and of reactance (imaginary part) over the probes as measured, (F,): how Z
        differs from place to place."""
        flat = self.impedance.reshape(-1, len(self.frequency))
        flat = flat[torch.isfinite(flat.real).all(1)]
        if len(flat) < 2:
            return torch.zeros(len(self.frequency), dtype=torch.complex128)
        return torch.complex(flat.real.std(0), flat.imag.std(0))

    def time_domain(
        self, poles: int = 8, *, band: tuple[float, float] | None = None, averaging: str | None = None
    ) -> Any:
        """The liner's R as poles and residues (``Multipole``), stable and passive, for solvers in the time domain.

        Args:
            poles: how many, fewer than frequencies of the map.
            band: lowest and highest frequency to fit, Hz; default all.
            averaging: default that of the answer.
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
