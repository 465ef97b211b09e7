"""How far each choice that the paper leaves open moves the answer, beside its statistical interval.

One set of moments serves the phase rule, the kernel, the liner's readings, both halves of the record and half the
sampling rate (``variants``). All other |v|, drives, means and averaging lengths, share one more reading. A plane at
another height is read for itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch

from torchliner.audits.known_truths import nearest_truth
from torchliner.audits.rows import Audit, AuditRow
from torchliner.audits.variants import CannotApply, of_liner, other_liners, variants
from torchliner.checks import require_choice, require_positive, tell
from torchliner.conversions import impedance_from_admittance
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes
from torchliner.engine.phase import PHASE_RULES
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.names import AVERAGINGS, DRIVES, MEANS
from torchliner.pressure.known_pressure import Case, known_pressure
from torchliner.records import VelocityPlane
from torchliner.records.boxes import grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.source import Further, Source, average_of
from torchliner.velocity.answer import answer, require_fitting
from torchliner.velocity.choices import Choices
from torchliner.velocity.level_check import cell_velocity, implied_pressure

PHASES = 72  # of the incident wave, over one turn of 2 psi
LENGTHS = (0.25, 0.5, 1.0)  # of a cell
AUDITED = ("phase",)


def audit(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    averaging: str = "phase-locked",
    progress: Callable[[int], object] | None = None,
    **choices: Any,
) -> Audit:
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others are its other heights.
            What ``Moments`` do not hold is left out, with the reason.
        liner: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        averaging: one of ``names.AVERAGINGS``.
        progress: called with numbers of samples read.
        choices: of the base, see ``torchliner.velocity.choices.Choices``; its phase rule is ``averaged``.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, VelocityPlane | Moments) else list(planes)
    for plane in several:
        if not isinstance(plane, VelocityPlane | Moments):
            raise TypeError(f"planes holds {type(plane).__name__}; VelocityPlane is needed")
    if len(several) > 1:
        planes_by_height([_plane_of(each) for each in several])
    require_choice("averaging", averaging, AVERAGINGS)
    for name in AUDITED:
        if choices.get(name) is not None:
            raise ValueError(
                f"{name} cannot be chosen for an audit: its base is the phase averaged, and the other rules are among "
                "what it varies"
            )
    window = choices.get("running_window")  # of a variant, if not of the base
    if window is not None:
        require_positive("running_window", window)
    if choices.get("drive") != "running-rms":
        choices = {name: value for name, value in choices.items() if name != "running_window"}
    work = _Work(several, liner, frequency, Choices(**choices), averaging, window, progress)
    work.moments()
    for factor, vary in (("phase rule", work.phases), ("drive, mean velocity", work.further), ("height", work.heights)):
        try:
            vary()
        except CannotApply as reason:
            work.skipped[factor] = str(reason)
    tell([note.text for note in work.found.notes])
    return work.result()


class _Work:
    """The audit as it grows."""

    def __init__(
        self,
        planes: Sequence[VelocityPlane | Moments],
        liner: Liner,
        frequency: float | None,
        chosen: Choices,
        averaging: str,
        running_window: float | None,
        progress: Callable[[int], object] | None,
    ) -> None:
        self.model, self.averaging, self.running_window = as_liner(liner), averaging, running_window
        self.plane, self.others, self.progress = _plane_of(planes[0]), planes[1:], progress
        self.frequency = self.plane.asked(frequency)
        if len(self.frequency) != 1:
            raise ValueError(f"an audit has one frequency; {len(self.frequency)} are given")
        self.liners, self.skipped = other_liners(self.model)
        self.chosen = chosen
        if isinstance(planes[0], Moments):
            made = planes[0].settings["averaging"]
            self.chosen = dataclasses.replace(self.chosen, averaging=made)
            require_choice(f"averaging of moments reduced with {made!r}:", averaging, self.chosen.averagings)
        self.quiet = dataclasses.replace(self.chosen, interval=None)
        self.rows: list[AuditRow] = []
        self.readings = 0
        self.known, self.source = self._moments_of(planes[0])

    def _moments_of(self, record: VelocityPlane | Moments) -> tuple[Moments, Source | None]:
        if isinstance(record, Moments):
            require_fitting(record, self.model, self.frequency, self.chosen)
            return record, None
        tolerance = self.chosen.tolerance(record.velocity.dtype)
        nodes = choose_nodes([self.model, *(liner for _, _, liner in self.liners)], self.frequency, tolerance)
        turns = [2 * float(self.frequency[0]), record.sampling_rate / 2] if record is self.plane else []
        source = Source(
            record, self.model, self.frequency, nodes, self.chosen, more_turns=turns, progress=self.progress
        )
        self.readings += source.readings
        return source.known, source

    def moments(self) -> None:
        """Base and all variants of its |v|."""
        with torch.no_grad():
            self.found = answer(self.known, self.model, self.frequency, self.chosen)
        self.base = complex(self.found.liner[self.averaging].impedance[0])
        if not math.isfinite(abs(self.base)):
            raise ValueError(
                f"{self.plane.name}: the base has no admittance, since every probe counts as wall; lower or leave out "
                "wall_filter"
            )
        found, skipped = variants(self.known, self.model, self.liners, float(self.frequency[0]))
        self.skipped |= skipped
        for factor, name, known, liner in found:
            self._add(factor, name, self._value(known, self.quiet, liner))
        for averaging in self.found.averagings:
            if averaging != self.averaging:
                self._add("averaging", averaging, complex(self.found.liner[averaging].impedance[0]))
        for which, chosen in self._drives().items():
            if chosen.drive == "rms":
                self._add(*which, self._value(self.known, chosen))

    def _value(
        self, known: Moments, chosen: Choices, liner: LinerModel | None = None, psi: float | None = None
    ) -> complex:
        """Z of the whole liner."""
        found = average_of(known, liner or self.model, self.frequency, chosen, self.averaging, psi)
        return complex(found.liner.impedance[0])

    def _add(self, factor: str, variant: str, impedance: complex, known: Moments | None = None) -> None:
        off = self._level_check(impedance, known or self.known)
        self.rows.append(AuditRow(factor, variant, impedance, impedance - self.base, off))

    def _level_check(self, impedance: complex, known: Moments) -> float | None:
        """dB, with the velocity of a plane; None where no pressure is known."""
        case = Case(known.plane, self.frequency, known.cells, known.cell_pitch, known.survey.blocks)
        pressure = known_pressure(case)
        if isinstance(pressure, str):
            return None
        z = torch.tensor([[impedance]], dtype=torch.complex128)
        implied = implied_pressure(case, pressure, z, cell_velocity(known, case, pressure)[0, :1])
        return float(20 * torch.log10((implied / pressure.liner).abs()))

    def phases(self) -> None:
        """The other phase rules; a stated phase wherever it may lie."""
        twice = 2 * float(self.frequency[0])
        if self.chosen.drive != "rms" and not bool((self.known.turns == twice).any()):
            raise CannotApply(
                "the moments were reduced without the rows of phase rules; reduce the plane again with "
                "phase='self-consistent'"
            )
        known = of_liner(self.known, self.model, self.frequency)
        for name in PHASE_RULES:
            chosen = dataclasses.replace(self.quiet, phase=name)
            if name == "given":
                self._stated_phases(known, chosen)
            elif name != self.chosen.phase:
                self._other_rule(known, chosen)

    def _other_rule(self, known: Moments, chosen: Choices) -> None:
        held = self.known.survey.coherence(self.frequency)[self.known.counted] >= chosen.minimum_coherence
        if bool(held.any()):
            share = 100 * float(held.double().mean())
            self._add("phase rule", f"{chosen.phase} ({share:.3g} % of probes)", self._value(known, chosen))
            return
        self.skipped[f"phase rule, {chosen.phase}"] = (
            f"no probe is coherent with {float(self.frequency[0]):g} Hz by {chosen.minimum_coherence:g}"
        )

    def _stated_phases(self, known: Moments, chosen: Choices) -> None:
        steps = [math.pi * step / PHASES for step in range(PHASES)]
        found = {psi: self._value(known, chosen, psi=psi) for psi in steps}
        for part, letter in (("real", "R"), ("imag", "X")):
            for word, pick in (("smallest", min), ("largest", max)):
                psi = pick(found, key=lambda each: getattr(found[each], part))
                variant = f"{chosen.phase}, psi = {psi:.2f} rad ({word} {letter})"
                self._add("phase rule", variant, found[psi])

    def further(self) -> None:
        """Another |v|, and v over shares of a cell: one reading for all."""
        if self.source is None:
            reason = "the time samples are gone: the plane was reduced to moments"
            self.skipped["averaging length"] = reason
            raise CannotApply(reason)
        drives = {name: Further(chosen) for name, chosen in self._drives().items() if chosen.drive != "rms"}
        wanted = drives | self._lengths()
        before = self.source.readings
        for (name, each), known in zip(wanted.items(), self.source.others([*wanted.values()]), strict=True):
            if each.windows is None:
                self._add(*name, self._value(known, each.chosen))
            else:
                windows = average_of(known, self.model, self.frequency, each.chosen, "velocity").cells
                admittance = windows.admittance[torch.isfinite(windows.reflection.real)]
                self._add(*name, complex(impedance_from_admittance(admittance.mean())))
        self.readings += self.source.readings - before

    def _drives(self) -> dict[tuple[str, str], Choices]:
        """Other drives and means; ``rms`` is known from the survey."""
        found = {}
        for other in DRIVES:
            if other != self.chosen.drive:
                window = self.running_window if other == "running-rms" else None
                found["drive", other] = dataclasses.replace(self.quiet, drive=other, running_window=window)
        for other in MEANS:
            if other != self.chosen.mean:
                found["mean velocity", other] = dataclasses.replace(self.quiet, mean=other)
        return found

    def _lengths(self) -> dict[tuple[str, str], Further]:
        try:
            pitch = self.model.cell_pitch
            if pitch is None:
                raise CannotApply("the liner states no cell_pitch")
            grid = grid_of(self.plane)
            shares = [s for s in LENGTHS if grid.spacing <= s * pitch <= grid.length * (1 + 1e-6)]
            if not shares:
                raise CannotApply(
                    f"none of {', '.join(f'{s:g}' for s in LENGTHS)} cells lies between the spacing, "
                    f"{1e3 * grid.spacing:.3g} mm, and the plane's length, {1e3 * grid.length:.3g} mm"
                )
        except ValueError as reason:
            self.skipped["averaging length"] = str(reason)
            return {}
        used = self.known.used.reshape(grid.rows, grid.columns)
        chosen = dataclasses.replace(self.quiet, averaging="velocity", background_rms=None)
        return {
            ("averaging length", f"velocity over {share:g} of a cell"): Further(
                chosen, windows_of(grid, share * pitch, used)
            )
            for share in shares
        }

    def heights(self) -> None:
        """The other planes."""
        if not self.others:
            raise CannotApply("one plane is given; name the other heights too")
        for other in self.others:
            plane = _plane_of(other)
            known, _ = self._moments_of(other)
            name = plane.name if plane.height is None else f"y = {1e3 * plane.height:.3g} mm"
            self._add("height", name, self._value(known, self.quiet), known)

    def result(self) -> Audit:
        """Sorted."""
        size: dict[str, float] = {}
        for row in self.rows:
            size[row.factor] = max(size.get(row.factor, 0.0), abs(row.change))
        rows = sorted(self.rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))
        found = self.found
        low, high = found.bounds_of_liner(self.averaging) or (None, None)
        return Audit(
            title=found.title or self.plane.name,
            frequency=float(self.frequency[0]),
            averaging=self.averaging,
            base=self.base,
            low=low,
            high=high,
            level=found.level,
            rows=tuple(rows),
            skipped=self.skipped,
            readings=self.readings,
            choices=dict(found.choices),
            notes=tuple(note.text for note in found.notes),
            level_check=self._level_check(self.base, self.known),
            level_check_words=found.level_check_words,
            nearest_truth=nearest_truth(found),
        )


def _plane_of(record: VelocityPlane | Moments) -> VelocityPlane:
    return record.plane if isinstance(record, Moments) else record
