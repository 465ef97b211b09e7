"""How far each choice that the paper leaves open moves the answer, beside its statistical interval.

One ``prepare`` serves the phase rule, the kernel, the liner's readings, the window, both halves of
the record and half the sampling rate: they are read off its moments (``variants``). Another |v|
needs one more reading: mean removed, running rms; the drive ``rms`` needs none, its |v| is known
from the survey. Averaging lengths share one reading; a plane at another height is prepared anew.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch

from torchliner.audits.known_truths import nearest_truth
from torchliner.audits.rows import Audit, AuditRow
from torchliner.audits.variants import (
    CannotApply,
    Variants,
    further_lines,
    other_liners,
    with_drive,
)
from torchliner.checks import require_choice, require_positive, tell
from torchliner.liners.model import Liner, as_liner
from torchliner.names import DRIVES, MEANS, ORDERS, PHASE_RULES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import averaged_planes, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.reduction.basis import choose_basis
from torchliner.reduction.moments import Moments
from torchliner.reduction.plan import index_of
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.closure import closure_ratio
from torchliner.tdibc.educe import replay
from torchliner.tdibc.known_pressure import known_pressure
from torchliner.tdibc.prepare import ask, prepare
from torchliner.tdibc.prepared import Prepared
from torchliner.tdibc.replayed import Replayed
from torchliner.tdibc.review_kernels import frequencies_read

PHASES = 72  # of the incident wave, over one turn of 2 psi
LENGTHS = (0.25, 0.5, 1.0)  # of a cell
AUDITED = ("phase", "engine", "incident", "segment", "response")


def audit(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments], liner: Liner,
    frequency: float | None = None, *, order: str = ORDERS[2],
    progress: Callable[[int], None] | None = None, **choices: Any,
) -> Audit:  # fmt: skip
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others
            are its other heights. What ``Moments`` do not hold is left out, with the reason.
        liner: as for ``educe``.  frequency: Hz, one; default the plane's own tone.
        order: of averaging, one of ``names.ORDERS``.  progress: called with samples read.
        choices: of the base, see ``torchliner.tdibc.choices.Choices``; the phase rule is
            ``averaged`` and the engine ``spectral``.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, (VelocityPlane, Moments)) else list(planes)
    for plane in several:
        if not isinstance(plane, (VelocityPlane, Moments)):
            raise TypeError(f"planes holds {type(plane).__name__}; VelocityPlane is needed")
    if len(several) > 1:
        planes_by_height([_plane_of(each) for each in several])
    require_choice("order of averaging", order, ORDERS)
    for name in AUDITED:
        if choices.get(name) is not None:
            raise ValueError(
                f"{name} cannot be chosen for an audit: its base is the phase averaged by the "
                "engine 'spectral', and the other rules are among what it varies"
            )
    window = choices.get("running_window")  # of a variant, if not of the base
    if window is not None:
        require_positive("running_window", window)
    if choices.get("drive") != "running-rms":
        choices = {name: value for name, value in choices.items() if name != "running_window"}
    work = _Work(several, liner, frequency, Choices(**choices), order, window, progress)
    work.moments()
    for factor, vary in (
        ("phase rule", work.phases), ("drive, mean velocity", work.drives),
        ("averaging length", work.lengths), ("height", work.heights),
    ):  # fmt: skip
        try:
            vary()
        except CannotApply as reason:
            work.skipped[factor] = str(reason)
    tell(work.found.notes)
    return work.result()


class _Work:
    """The audit as it grows."""

    def __init__(
        self, planes: Sequence[VelocityPlane | Moments], liner: Liner, frequency: float | None,
        chosen: Choices, order: str, running_window: float | None,
        progress: Callable[[int], None] | None,
    ) -> None:  # fmt: skip
        self.model, self.running_window = as_liner(liner), running_window
        self.liners, self.skipped = other_liners(self.model)
        self.order, self.progress, self.others = order, progress, planes[1:]
        asked = ask(planes[0], self.model, frequency, chosen)
        if len(asked.frequency) != 1:
            raise ValueError(f"an audit has one frequency; {len(asked.frequency)} are given")
        self.basis = choose_basis(
            [self.model, *(liner for _, _, liner in self.liners)],
            frequencies_read(asked.record, asked.frequency, chosen),
            chosen.model_tolerance(_plane_of(planes[0]).velocity.dtype),
        )
        twice, known = 2 * float(asked.frequency[0]), asked.known
        has_phases = known is None or index_of(known.sums.plan.lines, twice) is not None
        (self.ready,) = prepare(
            planes[:1], self.model, asked.frequency, chosen, progress, every_rule=has_phases,
            basis=self.basis, further_lines=tuple(further_lines(asked.record, chosen)),
        )  # fmt: skip
        self.rows: list[AuditRow] = []
        self.readings = 0

    def moments(self) -> None:
        """Base and all variants that share its |v|: no reading."""
        ready = self.ready
        self.replayed = replay(ready)
        self.found = self.replayed.map("averaged")
        self.base = self._value(self.found)
        if not math.isfinite(abs(self.base)):
            raise ValueError(
                f"{ready.plane.name}: the base has no admittance, since every probe counts as "
                "wall; lower or leave out wall_filter"
            )
        variants, skipped = Variants(ready, self.liners).all()
        self.skipped |= skipped
        for factor, name, other in variants:
            self._add(factor, name, self._averaged(other))
        for order in self.found.orders:
            if order != self.order:
                self._add("averaging order", order, complex(self.found.of_liner(order)[0]))

    def _averaged(self, ready: Prepared) -> complex:
        """Without error bars."""
        return self._value(replay(dataclasses.replace(ready, blocks=None)).map("averaged"))

    def _value(self, found: ImpedanceMap) -> complex:
        return complex(found.of_liner(self.order)[0])

    def _add(self, factor: str, variant: str, impedance: complex, ready: Prepared | None = None) -> None:
        off = self._closure(impedance, ready or self.ready)
        self.rows.append(AuditRow(factor, variant, impedance, impedance - self.base, off))

    def _closure(self, impedance: complex, ready: Prepared) -> float | None:
        """dB, with the velocity of a plane; None where no pressure is known."""
        known = known_pressure(ready)
        if isinstance(known, str):
            return None
        z = torch.tensor([impedance], dtype=torch.complex128)
        return float(20 * torch.log10(closure_ratio(ready, known)(z).abs()))

    def phases(self) -> None:
        """The other phase rules; a stated phase wherever it may lie: no pass."""
        if self.replayed.sums.backward is None:
            raise CannotApply(
                "the moments were reduced without the rows of phase rules; reduce the plane again "
                "with phase='self-consistent'"
            )
        quiet = Replayed(dataclasses.replace(self.replayed.prepared, blocks=None), self.replayed.sums)
        for name in PHASE_RULES:
            if phase_rule(name).takes_phase:
                self._stated_phases(quiet, name)
            elif name != self.ready.chosen.phase and not phase_rule(name).several_tones:
                self._other_rule(quiet, name)

    def _other_rule(self, quiet: Replayed, name: str) -> None:
        own = quiet.map(name)
        if bool(own.phase_rule.any()):
            share = 100 * float(own.phase_rule.to(torch.float64).mean())
            self._add("phase rule", f"{name} ({share:.3g} % of probes)", self._value(own))
            return
        self.skipped[f"phase rule, {name}"] = (
            f"no probe is coherent with {float(self.ready.frequency[0]):g} Hz by "
            f"{self.ready.chosen.minimum_coherence:g}"
        )

    def _stated_phases(self, quiet: Replayed, name: str) -> None:
        steps = [math.pi * step / PHASES for step in range(PHASES)]
        found = {psi: self._value(quiet.map(name, psi)) for psi in steps}
        for part, letter in (("real", "R"), ("imag", "X")):
            for word, pick in (("smallest", min), ("largest", max)):
                psi = pick(found, key=lambda each: getattr(found[each], part))
                variant = f"{name}, psi = {psi:.2f} rad ({word} {letter})"
                self._add("phase rule", variant, found[psi])

    def drives(self) -> None:
        """Another |v|: a reading each, none for the rms of the whole record."""
        self._require_samples()
        chosen, ready = self.ready.chosen, self.ready
        others = [(drive, chosen.mean) for drive in DRIVES if drive != chosen.drive]
        others += [(chosen.drive, mean) for mean in MEANS if mean != chosen.mean]
        for drive, mean in others:
            quiet = dataclasses.replace(ready, blocks=None)
            other = with_drive(quiet, drive, mean, running_window=self.running_window, progress=self.progress)
            value = self._averaged(other)
            factor, name = ("mean velocity", mean) if drive == chosen.drive else ("drive", drive)
            self._add(factor, name, value)

    def lengths(self) -> None:
        """Velocity averaged over shares of a cell before it is replayed: one reading in all."""
        self._require_samples()
        ready, plane = self.ready, self.ready.plane
        pitch = ready.liner.cell_pitch
        if pitch is None:
            raise CannotApply("the liner states no cell_pitch")
        try:
            grid = grid_of(plane)
        except ValueError as reason:
            raise CannotApply(str(reason)) from None
        used = ready.used.reshape(grid.rows, grid.columns)
        shares = [s for s in LENGTHS if grid.spacing <= s * pitch <= grid.length * (1 + 1e-6)]
        if not shares:
            raise CannotApply(
                f"none of {', '.join(f'{s:g}' for s in LENGTHS)} cells lies between the spacing, "
                f"{1e3 * grid.spacing:.3g} mm, and the plane's length, {1e3 * grid.length:.3g} mm"
            )
        cut = [windows_of(grid, share * pitch, used, plane.samples) for share in shares]
        averaged = averaged_planes(plane, cut)
        self.readings += 1
        rules = dataclasses.replace(ready.chosen, interval=None, order=ORDERS[0], oncoming_rms=None)
        small = prepare(averaged, ready.liner, ready.frequency, rules, basis=self.basis)
        for share, each in zip(shares, small, strict=True):
            found = replay(each).map("averaged")
            self._add(
                "averaging length", f"velocity over {share:g} of a cell",
                complex(found.liner_impedance[0]),
            )  # fmt: skip

    def _require_samples(self) -> None:
        if self.ready.drive is None:
            raise CannotApply("the time samples are gone: the plane was reduced to moments")

    def heights(self) -> None:
        """The other planes."""
        if not self.others:
            raise CannotApply("one plane is given; name the other heights too")
        rules = dataclasses.replace(self.ready.chosen, interval=None)
        for other in self.others:
            plane = _plane_of(other)
            (ready,) = prepare([other], self.model, self.ready.frequency, rules, self.progress, basis=self.basis)
            name = plane.name if plane.height is None else f"y = {1e3 * plane.height:.3g} mm"
            self._add("height", name, self._averaged(ready), ready)
            self.readings += ready.readings

    def result(self) -> Audit:
        """Sorted."""
        self.readings += self.ready.readings
        size: dict[str, float] = {}
        for row in self.rows:
            size[row.factor] = max(size.get(row.factor, 0.0), abs(row.change))
        rows = sorted(self.rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))
        found, bounds = self.found, self.found.bounds_of_liner(self.order)
        low, high = bounds or (None, None)
        level = None if bounds is None else self.ready.chosen.interval
        return Audit(
            found.title or self.ready.plane.name, float(self.ready.frequency[0]),
            self.order, self.base, low, high, level, tuple(rows), self.skipped, self.readings,
            dict(found.choices), found.notes,
            self._closure(self.base, self.ready), found.closure_words, nearest_truth(found),
        )  # fmt: skip


def _plane_of(record: VelocityPlane | Moments) -> VelocityPlane:
    return record.plane if isinstance(record, Moments) else record
