"""What an audit changes without another reading: the liner, its response, or the weights of time.

The moments of |v| know neither liner nor response, so any liner may be read off them. A window is a
few more rows of the same pass, every second sample is a row of alternating sign, and half of the
record is the sum over half of its blocks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch

from torchliner.checks import FEWEST_PERIODS
from torchliner.liners.cell import CellLiner
from torchliner.liners.model import LinerModel
from torchliner.liners.readings import Readings, porosity_readings, velocity_readings
from torchliner.liners.sdof import SDoFLiner
from torchliner.reduction.basis import Response, response_of
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.line_means import LineReader, lines_needed, window_lines
from torchliner.reduction.plan import PassPlan, index_of
from torchliner.reduction.readings import moments_of
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.replay.edges import Record
from torchliner.replay.kernels import build_kernels
from torchliner.signals.windows import Window, make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.level_range import kernel_band
from torchliner.tdibc.prepared import Prepared, Progress, kernel_response
from torchliner.tdibc.reading import reader_lines
from torchliner.tdibc.review import FEWEST_SAMPLES_PER_PERIOD
from torchliner.tdibc.review_kernels import frequencies_read

WINDOWS = ("boxcar", "hann", "blackman")
VENA_CONTRACTA = (0.75, 0.8, 0.85)
EVERYWHERE = [(0.0, 1.0 + 0.0j)]  # lines of the weight 1
# What is changed, to what, and the plane with the moments, record, liner and reader of the variant.
Variant = tuple[str, str, Prepared]


class CannotApply(ValueError):
    """A factor that cannot be varied here; the text says why."""


def other_liners(liner: LinerModel) -> tuple[list[tuple[str, str, CellLiner]], dict[str, str]]:
    """Factor, name and liner of each variant of a liner, and why a factor has none."""
    found, skipped = [], {}
    factors: tuple[tuple[str, Any, type[CellLiner], str], ...] = (
        ("vena contracta", _vena_contracta, SDoFLiner, "SDoF liners"),
        ("velocity reading", velocity_readings, CellLiner, "SDoF and layered liners"),
        ("porosity reading", porosity_readings, SDoFLiner, "SDoF liners"),
    )
    for factor, of, needed, words in factors:
        try:
            if not isinstance(liner, needed):
                kind = type(liner).__name__
                raise CannotApply(f"{kind} has no such parameter; only {words} have")
            found += [(factor, name, other) for name, other in of(liner).items()]
        except ValueError as reason:
            skipped[factor] = str(reason)
    return found, skipped


def _vena_contracta(liner: SDoFLiner) -> Readings:
    others = [value for value in VENA_CONTRACTA if value != liner.vena_contracta]
    return {f"{value:g}": liner.replace(vena_contracta=value) for value in others}


def further_lines(record: Record, chosen: Choices) -> Iterator[float]:
    """Waves, Hz, that other windows and every second sample take beside those of the base."""
    for window in _other_windows(record):
        if window.lines:
            yield from (line for line, _ in window_lines(window, 0, record.sampling_rate))
    base = (line for line, _ in reader_lines(record, chosen))
    yield from (record.sampling_rate / 2 - abs(line) for line in base)


def _other_windows(record: Record) -> list[Window]:
    names = [name for name in WINDOWS if name != record.window.name]
    return [make_window(name, len(record.window.weights)) for name in names]


class Variants:
    """All of a prepared plane at its one frequency.

    Args:
        ready: with ``further_lines``.
        liners: of ``other_liners``, which the basis of ``ready`` serves too.
    """

    def __init__(self, ready: Prepared, liners: list[tuple[str, str, CellLiner]]) -> None:
        assert ready.reader is not None
        self.ready, self.reader, self.liners = ready, ready.reader, liners
        self.frequency, self.rate = float(ready.frequency[0]), ready.record.sampling_rate
        self.kind = ready.chosen.kernel if ready.chosen.uses_kernel_response else None

    def all(self) -> tuple[list[Variant], dict[str, str]]:
        """Variants, and why a factor has none."""
        found: list[Variant] = []
        skipped = {}
        factors: dict[str, Callable[[], Iterator[Variant]]] = {
            "window": self._windows,
            "kernel": self._kernels,
            "liner": self._liners,
            "half the record": self._halves,
            "sampling rate": self._half_rate,
        }
        for factor, make in factors.items():
            try:
                for variant in make():
                    found.append(variant)
            except ValueError as reason:  # a liner's table may be too narrow
                skipped[factor] = str(reason)
        return found, skipped

    def _read(self, lines: list[tuple[float, complex]], response: Response) -> LineReader:
        plan, basis = self.reader.plan, self.reader.basis
        frequency = self.ready.frequency
        return LineReader(plan, basis, lines, frequency, response, frequency[:, None][:, :0])

    def _windows(self) -> Iterator[Variant]:
        record = self.ready.record
        for window in _other_windows(record):
            lines = window_lines(window, record.start, self.rate)
            self._require_rows([abs(line) for line, _ in lines if line], "other windows")
            reader = self._read(lines, self.reader.response)
            other = dataclasses.replace(record, window=window)
            ready = dataclasses.replace(self.ready, record=other, reader=reader)
            yield ("window", window.name, ready)

    def _require_rows(self, lines: Sequence[float], of: str) -> None:
        if any(index_of(self.reader.plan.lines, line) is None for line in lines):
            raise CannotApply(
                f"the moments were reduced without the rows of {of}, which an audit of the plane itself sums"
            )

    def _of_kernel(self, liner: LinerModel, kind: str) -> Response:
        ready = self.ready
        read = frequencies_read(ready.record, ready.frequency, ready.chosen)
        band = kernel_band(liner, read, ready.chosen)
        basis = self.reader.basis
        return kernel_response(build_kernels(liner, basis, self.rate, kind=kind, band=band))

    def _kernels(self) -> Iterator[Variant]:
        for kind, words in (("two-sided", ""), ("causal", ", the paper to the letter")):
            if kind != self.kind:
                reader = self._read(self.reader.window, self._of_kernel(self.ready.liner, kind))
                ready = dataclasses.replace(self.ready, reader=reader)
                yield ("kernel", kind + words, ready)

    def _liners(self) -> Iterator[Variant]:
        for factor, name, liner in self.liners:
            response = self._of_kernel(liner, self.kind) if self.kind else response_of(liner)
            reader = self._read(self.reader.window, response)
            ready = dataclasses.replace(self.ready, liner=liner, reader=reader)
            yield (factor, name, ready)

    def _with_moments(self, groups: list[GroupMoments], record: Record, lines: list[tuple[float, complex]]) -> Prepared:
        sums = dataclasses.replace(self.ready.sums, groups=tuple(groups))
        reader = self._read(lines, self.reader.response)
        return dataclasses.replace(self.ready, sums=sums, record=record, reader=reader)

    def _halves(self) -> Iterator[Variant]:
        ready, blocks = self.ready, self.reader.plan.blocks
        half = blocks.count // 2
        periods = half * blocks.periods
        if periods < FEWEST_PERIODS and not ready.chosen.allow_short:
            raise CannotApply(f"half the record holds {periods} whole periods, fewer than {FEWEST_PERIODS:g}")
        kept = [group.of_blocks for group in ready.sums.groups if group.of_blocks is not None]
        if not kept or half == 0:
            raise CannotApply("no moments of blocks are kept: |v| is constant, or interval None")
        for name, first in (("first", 0), ("second", blocks.count - half)):
            parts = [blocks_of[first : first + half] for blocks_of in kept]
            own = [GroupMoments(part.sum(0, dtype=torch.float64), None) for part in parts]
            begin, end = blocks.borders[first], blocks.borders[first + half]
            window = make_window("boxcar", end - begin)
            record = dataclasses.replace(ready.record, start=begin, window=window)
            words = f"{name}, mean over {periods} whole periods"
            yield ("half the record", words, self._with_moments(own, record, EVERYWHERE))

    def _half_rate(self) -> Iterator[Variant]:
        rate, record = self.rate / 2, self.ready.record
        if rate < FEWEST_SAMPLES_PER_PERIOD * self.frequency:
            raise CannotApply(
                f"{rate:g} Hz would leave {rate / self.frequency:.3g} samples per period, fewer "
                f"than {FEWEST_SAMPLES_PER_PERIOD:g}"
            )
        needed = [rate - abs(line) for line, _ in self.reader.window]
        self._require_rows(needed, "alternating sign")
        window = record.window
        kept = torch.zeros_like(window.weights)
        kept[::2] = window.weights[::2]
        half = dataclasses.replace(record, window=dataclasses.replace(window, weights=kept))
        groups = [every_second(group, self.reader.plan, record.start) for group in self.ready.sums.groups]
        ready = self._with_moments(groups, half, self.reader.window)
        yield ("sampling rate", f"every second sample, {rate:.6g} Hz", ready)


def every_second(group: GroupMoments, plan: PassPlan, start: int) -> GroupMoments:
    r"""Moments of the samples start, start + 2, ... alone.

    Their weight is :math:`(1 + (-1)^{n - start})/2`, and :math:`(-1)^n e^{j\theta n}` is the
    conjugate of the wave at :math:`\pi - \theta`. Rows without such a partner are left as nan.
    """
    sign, count = (-1.0) ** start, len(plan.lines)
    found = torch.full_like(group.totals, torch.nan)
    for line in (0.0, *plan.lines):
        row, other = index_of(plan.lines, line), index_of(plan.lines, plan.sampling_rate / 2 - line)
        if other is None:
            continue
        cosine = 0 if row is None else 1 + row
        found[cosine] = (group.totals[cosine] + sign * group.totals[1 + other]) / 2
        if row is not None:
            sine = 1 + count + row
            found[sine] = (group.totals[sine] - sign * group.totals[1 + count + other]) / 2
    return GroupMoments(found, None)


def with_drive(
    ready: Prepared, drive: str, mean: str, *, every_rule: bool = False,
    running_window: float | None = None, progress: Progress | None = None,
) -> Prepared:  # fmt: skip
    """The plane under another |v|: one more reading of it, none for the rms of the record.

    Args:
        ready: prepared plane.  drive, mean: see ``Choices``.
        every_rule: keep what any phase rule can be read off, else ``averaged`` alone.
        running_window: s; default that of ``ready``.
        progress: called with numbers of samples done.
    """
    assert ready.drive is not None and ready.reader is not None  # noqa: PT018
    before, window = ready.drive, ready.reader.window
    seconds, running = running_window or ready.chosen.running_window, before.running_samples
    if seconds is not None:
        running = max(1, round(seconds * ready.plane.sampling_rate))
    source = DriveSpeed(
        before.velocity, drive, mean, ready.sums.survey, running, ready.periodic
    )  # fmt: skip
    turns = (2 * ready.frequency)[:, None][:, : int(every_rule)]
    lines = lines_needed(window, turns)
    plan = dataclasses.replace(ready.sums.plan, lines=lines)
    groups, notes = moments_of(source, plan, ready.reader.basis, (), ready.blocks is not None, progress)
    reader = LineReader(plan, ready.reader.basis, window, ready.frequency, ready.reader.response, turns)
    return dataclasses.replace(
        ready, drive=source, reader=reader, notes=(*ready.notes, *notes),
        chosen=dataclasses.replace(
            ready.chosen, drive=drive, mean=mean,
            running_window=seconds if drive == "running-rms" else None,
        ),
        sums=dataclasses.replace(ready.sums, plan=plan, groups=groups),
    )  # fmt: skip
