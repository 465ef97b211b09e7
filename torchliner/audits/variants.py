"""What an audit changes, as lines of one pass: each variant is a model, a record or a kernel.

The sums of ``spectral`` are linear in the response and in the weights of the emission times, so
that all that changes neither |v| nor its levels' range shares one reading of the data.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from torchliner.checks import FEWEST_PERIODS
from torchliner.liners.readings import porosity_readings, velocity_readings
from torchliner.liners.sdof import SDoFLiner
from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, build_kernels
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.lines import AnyLine, BackwardLine, Line, PartLine, plan_lines
from torchliner.signals.windows import make_window
from torchliner.tdibc.level_range import kernel_band
from torchliner.tdibc.prepared import Prepared
from torchliner.tdibc.review import FEWEST_SAMPLES_PER_PERIOD

WINDOWS = ("hann", "boxcar", "blackman")
EDGES = ("finite", "silent", "wrap")
VENA_CONTRACTA = (0.75, 0.8, 0.85)
PAPER_LEVELS = (200, "uniform", "linear")


@dataclass(frozen=True)
class Variant:
    """One change and what it takes.

    Args:
        factor: what is changed.
        name: to what.
        ready: the plane, with the record and the liner of the variant.
        line: for the pass.
    """

    factor: str
    name: str
    ready: Prepared
    line: AnyLine


class CannotApply(ValueError):
    """A factor that cannot be varied here; the text says why."""


class VariantMaker:
    """All variants of a prepared plane at its one frequency; kernels are built once each."""

    def __init__(self, ready: Prepared) -> None:
        self.ready, self.frequency = ready, float(ready.frequency[0])
        self.kernels: dict[Any, KernelTable] = {}
        self.factors: dict[str, Callable[[], Iterator[Variant]]] = {
            "window": self._windows,
            "edge": self._edges,
            "kernel": self._kernels,
            "levels": self._levels,
            "vena contracta": self._vena_contracta,
            "velocity reading": lambda: self._readings("velocity reading", velocity_readings),
            "porosity reading": lambda: self._readings("porosity reading", porosity_readings),
            "half the record": self._halves,
            "sampling rate": self._half_rate,
        }

    def base(self) -> list[Variant]:
        """The choices as they are: the reply to e^{j omega t}, and that to e^{-j omega t}."""
        forward = self._variant("base", "as chosen", self.ready)
        both = self._variant("base", "backward", self.ready, backward=True)
        assert isinstance(both.line, Line)
        return [forward, dataclasses.replace(both, line=BackwardLine(both.line))]

    def all(self) -> tuple[list[Variant], dict[str, str]]:
        """Variants, and why a factor has none."""
        found: list[Variant] = []
        skipped = {}
        for factor, make in self.factors.items():
            try:
                for variant in make():
                    found.append(variant)
            except ValueError as reason:  # a liner's table may be too narrow
                skipped[factor] = str(reason)
        return found, skipped

    def _variant(
        self, factor: str, name: str, ready: Prepared, *, kind: str | None = None,
        grid: VelocityGrid | None = None, of_kernel: bool | None = None,
        part: tuple[int, int] | None = None, backward: bool = False,
    ) -> Variant:  # fmt: skip
        """``part``: first sample and step where the record is one of a part."""
        chosen, record = ready.chosen, ready.record
        of_kernel = chosen.uses_kernel_response if of_kernel is None else of_kernel
        grid = grid or ready.grid
        kernels = None
        if of_kernel or record.needs_table(self.frequency):
            kernels = self._kernel(ready, grid, kind or chosen.kernel)
        (line,) = plan_lines(
            ready.liner, [self.frequency], record, grid, kernels, of_kernel=of_kernel,
            backward=backward,
        )  # fmt: skip
        return Variant(factor, name, ready, line if part is None else PartLine(line, *part))

    def _kernel(self, ready: Prepared, grid: VelocityGrid, kind: str) -> KernelTable:
        rate = ready.record.sampling_rate
        key = (id(ready.liner), grid, rate, kind)
        if key not in self.kernels:
            band = kernel_band(ready.liner, ready.frequency, ready.chosen)
            self.kernels[key] = build_kernels(ready.liner, grid, rate, kind=kind, band=band)
        return self.kernels[key]

    def _with_record(self, **changes: Any) -> Prepared:
        record = dataclasses.replace(self.ready.record, **changes)
        return dataclasses.replace(self.ready, record=record)

    def _windows(self) -> Iterator[Variant]:
        record = self.ready.record
        for name in WINDOWS:
            if name != record.window.name:
                window = make_window(name, len(record.window.weights))
                yield self._variant("window", name, self._with_record(window=window))

    def _edges(self) -> Iterator[Variant]:
        record = self.ready.record
        periods = self.frequency * (record.samples - record.start) / record.sampling_rate
        for rule in EDGES:
            whole = abs(periods - round(periods)) < 1e-6 and record.start == 0
            if rule != record.edge and (rule != "wrap" or whole):
                yield self._variant("edge", rule, self._with_record(edge=rule))

    def _kernels(self) -> Iterator[Variant]:
        mine = self.ready.chosen.kernel if self.ready.chosen.uses_kernel_response else "model"
        for kind in ("two-sided", "causal"):
            if kind != mine:
                name = f"{kind}{', the paper to the letter' if kind == 'causal' else ''}"
                yield self._variant("kernel", name, self.ready, kind=kind, of_kernel=True)

    def _levels(self) -> Iterator[Variant]:
        levels, spacing, interpolation = PAPER_LEVELS
        grid = VelocityGrid(self.ready.grid.maximum, levels, spacing, interpolation)
        if grid == self.ready.grid:
            raise CannotApply("they are those of the paper already")
        name = f"{levels} {spacing}, {interpolation} (the paper), by kernel"
        yield self._variant("levels", name, self.ready, grid=grid, of_kernel=True)

    def _sdof(self) -> SDoFLiner:
        if not isinstance(self.ready.liner, SDoFLiner):
            kind = type(self.ready.liner).__name__
            raise CannotApply(f"{kind} has no such parameter; only SDoF liners have")
        return self.ready.liner

    def _vena_contracta(self) -> Iterator[Variant]:
        liner = self._sdof()
        for value in VENA_CONTRACTA:
            if value != liner.vena_contracta:
                other = dataclasses.replace(self.ready, liner=liner.replace(vena_contracta=value))
                yield self._variant("vena contracta", f"{value:g}", other)

    def _readings(
        self, factor: str, of: Callable[[SDoFLiner], dict[str, SDoFLiner]]
    ) -> Iterator[Variant]:
        for name, liner in of(self._sdof()).items():
            yield self._variant(factor, name, dataclasses.replace(self.ready, liner=liner))

    def _halves(self) -> Iterator[Variant]:
        record = self.ready.record
        length = (record.samples - record.start) // 2
        periods = length * self.frequency / record.sampling_rate
        if periods < FEWEST_PERIODS and not self.ready.chosen.allow_short:
            raise CannotApply(
                f"half the record holds {periods:.3g} periods, fewer than {FEWEST_PERIODS:g}"
            )
        window = make_window(record.window.name, length)
        for name, begin in (("first", record.start), ("second", record.samples - length)):
            half = Record(length, 0, window, _open(record.edge), record.sampling_rate)
            ready = dataclasses.replace(self.ready, record=half)
            yield self._variant("half the record", name, ready, part=(begin, 1))

    def _half_rate(self) -> Iterator[Variant]:
        record = self.ready.record
        rate = record.sampling_rate / 2
        if rate < FEWEST_SAMPLES_PER_PERIOD * self.frequency:
            raise CannotApply(
                f"{rate:g} Hz would leave {rate / self.frequency:.3g} samples per period, fewer "
                f"than {FEWEST_SAMPLES_PER_PERIOD:g}"
            )
        count = (record.samples - record.start + 1) // 2
        window = make_window(record.window.name, count)
        half = Record(count, 0, window, _open(record.edge), rate)
        ready = dataclasses.replace(self.ready, record=half)
        yield self._variant(
            "sampling rate", f"every second sample, {rate:.6g} Hz", ready, part=(record.start, 2)
        )


def _open(edge: str) -> str:
    """A part of a periodic record is not periodic."""
    return "finite" if edge == "wrap" else edge
