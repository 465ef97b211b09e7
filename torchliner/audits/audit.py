"""How far each choice that the paper leaves open moves the answer, beside its statistical interval.

One survey and one replay of the data serve the phase rule, the kernel, the levels, the liner's
readings, the window, the edge, both halves of the record and half the sampling rate: they are lines
of one pass (``variants``). Another |v| needs a pass of its own: mean removed, running rms; the
drive ``rms`` needs none, its |v| is known from the survey. Averaging lengths share one reading; a
plane at another height costs a survey and a replay.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.audits.known_truths import nearest_truth
from torchliner.audits.rows import Audit, AuditRow
from torchliner.audits.variants import CannotApply, VariantMaker
from torchliner.checks import tell
from torchliner.liners.model import Liner
from torchliner.names import DRIVES, MEANS, ORDERS, PHASE_RULES
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.boxes import averaged_planes, grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.probe_velocity import with_smaller_slabs
from torchliner.replay.incident import LineSums
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.spectral import spectral_sums
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.closure import closure_ratio
from torchliner.tdibc.educe import replay
from torchliner.tdibc.engines import block_lines_of
from torchliner.tdibc.known_pressure import known_pressure
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared
from torchliner.tdibc.replayed import Replayed

PHASES = 72  # of the incident wave, over one turn of 2 psi
LENGTHS = (0.25, 0.5, 1.0)  # of a cell
AUDITED = ("phase", "engine", "incident", "segment", "response")


def audit(
    planes: VelocityPlane | Sequence[VelocityPlane],
    liner: Liner,
    frequency: float | None = None,
    *,
    order: str = ORDERS[2],
    progress: Callable[[int], None] | None = None,
    **choices: Any,
) -> Audit:
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others
            are its other heights.
        liner: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        order: of averaging, one of ``names.ORDERS``.
        progress: called with samples read.
        choices: of the base, see ``torchliner.tdibc.choices.Choices``; the phase rule is
            ``averaged`` and the engine ``spectral``.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, VelocityPlane) else list(planes)
    for plane in several:
        if not isinstance(plane, VelocityPlane):
            raise TypeError(f"planes holds {type(plane).__name__}; VelocityPlane is needed")
    if len(several) > 1:
        planes_by_height(several)
    chosen = _base_choices(choices, order)
    work = _Work(several, liner, frequency, chosen, order, progress)
    work.lines()
    work.phases()
    work.drives()
    for factor, vary in (("averaging length", work.lengths), ("height", work.heights)):
        try:
            vary()
        except CannotApply as reason:
            work.skipped[factor] = str(reason)
    tell(work.found.notes)
    return work.result()


def _base_choices(choices: dict[str, Any], order: str) -> Choices:
    if order not in ORDERS:
        raise ValueError(f"order is {order!r}; one of {', '.join(ORDERS)}")
    for name in AUDITED:
        if choices.get(name) is not None:
            raise ValueError(
                f"{name} cannot be chosen for an audit: its base is the phase averaged by the "
                "engine 'spectral', and the other rules are among what it varies"
            )
    return Choices(**choices)


class _Work:
    """The audit as it grows."""

    def __init__(
        self,
        planes: Sequence[VelocityPlane],
        liner: Liner,
        frequency: float | None,
        chosen: Choices,
        order: str,
        progress: Callable[[int], None] | None,
    ) -> None:
        # Surveys of all planes: with them the levels span all heights.
        everything = prepare(planes, liner, frequency, chosen, progress)
        self.ready, self.others = everything[0], everything[1:]
        if len(self.ready.frequency) != 1:
            raise ValueError(f"an audit has one frequency; {len(self.ready.frequency)} are given")
        self.order, self.progress = order, progress
        self.rows: list[AuditRow] = []
        self.skipped: dict[str, str] = {}
        self.readings = len(planes)

    def lines(self) -> None:
        """Base and all variants that share its |v|: one pass."""
        maker = VariantMaker(self.ready)
        variants, skipped = maker.all()
        self.skipped |= skipped
        base = maker.base()
        ready = self.ready
        of_blocks = block_lines_of(ready, backward=False)
        everything = [*base, *variants]
        sums, notes = with_smaller_slabs(
            ready.drive.velocity,
            lambda: spectral_sums(
                ready.drive, [each.line for each in everything], ready.grid,
                block_lines=of_blocks, compile_loops=ready.chosen.compile, progress=self.progress,
            ),
        )  # fmt: skip
        self.readings += ready.chosen.drive != "rms"
        self.replayed = Replayed(
            dataclasses.replace(ready, notes=(*ready.notes, *notes)),
            LineSums(_column(sums, 0), _column(sums, 1), sums.blocks),
        )
        self.found = self.replayed.map("averaged")
        self.base = self._value(self.found)
        if not math.isfinite(abs(self.base)):
            raise ValueError(
                f"{ready.plane.name}: the base has no admittance, since every probe counts as "
                "wall; lower or leave out wall_filter"
            )
        for i, variant in enumerate(variants, len(base)):
            quiet = dataclasses.replace(variant.ready, blocks=None)
            found = Replayed(quiet, LineSums(_column(sums, i), None)).map("averaged")
            self._add(variant.factor, variant.name, self._value(found))
        for other in self.found.orders:
            if other != self.order:
                self._add("averaging order", other, complex(self.found.of_liner(other)[0]))

    def _of_pass(self, ready: Prepared) -> complex:
        """Another pass over data, without error bars."""
        quiet = dataclasses.replace(ready, blocks=None)
        return self._value(replay(quiet, progress=self.progress).map("averaged"))

    def _value(self, found: ImpedanceMap) -> complex:
        return complex(found.of_liner(self.order)[0])

    def _add(
        self, factor: str, variant: str, impedance: complex, ready: Prepared | None = None
    ) -> None:
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
        quiet = Replayed(
            dataclasses.replace(self.replayed.prepared, blocks=None), self.replayed.sums
        )
        for name in PHASE_RULES:
            if phase_rule(name).takes_phase:
                self._stated_phases(quiet, name)
            elif name != self.ready.chosen.phase:
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
        """Other readings of |v|: a pass each, none for the rms of the whole record."""
        chosen, ready = self.ready.chosen, self.ready
        others = [(drive, chosen.mean) for drive in DRIVES if drive != chosen.drive]
        others += [(chosen.drive, mean) for mean in MEANS if mean != chosen.mean]
        for drive, mean in others:
            source = DriveSpeed(
                ready.drive.velocity, drive, mean, ready.survey, ready.drive.running_samples,
                ready.drive.periodic,
            )  # fmt: skip
            rules = dataclasses.replace(chosen, drive=drive, mean=mean)
            value = self._of_pass(dataclasses.replace(ready, drive=source, chosen=rules))
            self.readings += drive != "rms"
            factor, name = ("mean velocity", mean) if drive == chosen.drive else ("drive", drive)
            self._add(factor, name, value)

    def lengths(self) -> None:
        """Velocity averaged over shares of a cell before it is replayed: one reading in all."""
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
        rules = dataclasses.replace(ready.chosen, interval=None, order=ORDERS[0])
        for share, each in zip(shares, averaged, strict=True):
            # One by one: their levels, like the base's, come from their own velocities.
            (small,) = prepare([each], ready.liner, ready.frequency, rules)
            found = replay(small).map("averaged")
            self._add(
                "averaging length", f"velocity over {share:g} of a cell",
                complex(found.liner_impedance[0]),
            )  # fmt: skip

    def heights(self) -> None:
        """The other planes."""
        if not self.others:
            raise CannotApply("one plane is given; name the other heights too")
        for other in self.others:
            value = self._of_pass(other)
            self.readings += 1
            height = other.plane.height
            name = other.plane.name if height is None else f"y = {1e3 * height:.3g} mm"
            self._add("height", name, value, other)

    def result(self) -> Audit:
        """Sorted."""
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


def _column(sums: LineSums, index: int) -> Tensor:
    return sums.forward[:, index : index + 1]
