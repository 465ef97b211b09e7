r"""Statistical intervals of the in situ and microphone methods, from blocks of time.

They say how far Z may be off because the record is finite; not what the formula, the cavity's numbers or the
microphones' own errors do.

A windowed amplitude is linear in the signal, :math:`A = \sum_t g_t y_t`. What is left of y when tone, conjugate and
mean are taken off adds :math:`c_s = \sum_{t \in s} g_t r_t` in block s of whole periods, so A is the mean, with the
window's weight W_s of each block, of :math:`A + c_s/W_s`: without block s it is :math:`A - c_s/(1 - W_s)`. Z of these
amplitudes is what the jackknife of ``engine.intervals`` takes. Over several segments the blocks are the segments, and
H1 is made of the sums over those that remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import impedance_from_admittance
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, FROM_REFLECTION, ITSELF, Conversion, jackknife, replicates
from torchliner.pressure.plane_waves import split_waves
from torchliner.records import Interval, PointUncertainty, PressureRecord
from torchliner.records.cells import Cells
from torchliner.signals.transfer import segment_amplitudes
from torchliner.signals.windows import make_window

FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
LEVEL = 0.95
FEWEST_RUNS = 8  # below, an interval says little
SMALLEST_WIDTH = 1e-9  # a steady tone leaves rounding


def require_level(level: float | None) -> None:
    """Refuse what is no share of all cases; None is for no intervals."""
    if level is not None and not 0 < level < 1:
        raise ValueError(f"interval is {level:g}; it is a level between 0 and 1 (95 % is 0.95)")


@dataclass(frozen=True)
class _TimeBlocks:
    """Blocks of a record at one frequency.

    Args:
        amplitudes: of each signal given, (S, ..., 1).  weights: W, of sum 1, (S,).
        single: whether they are blocks of one segment, not segments.
    """

    amplitudes: tuple[Tensor, ...]
    weights: Tensor
    single: bool

    def h1(self, driver: Tensor, response: Tensor) -> Tensor:
        """H1 = response/driver of all blocks, without each and without each quarter, (1 + S + 4, ...).

        Args:
            driver, response: of the blocks, (S, ..., 1), linear in ``amplitudes``.
        """
        if self.single:  # H1 of one segment is the ratio of its amplitudes
            return self._remaining(response) / self._remaining(driver)
        return self._remaining(driver.conj() * response) / self._remaining(driver.abs().square())

    def _remaining(self, values: Tensor) -> Tensor:
        """Weighted means of (S, ...) over the blocks that remain."""
        return replicates(self.weights.reshape(-1, *[1] * (values.ndim - 1)) * values, self.weights)

    def interval(self, values: Tensor, level: float, conversion: Conversion = FROM_REFLECTION) -> Interval:
        """Of Z from a quantity of the remaining blocks, (1 + S + 4, ...)."""
        return jackknife(values, self.weights, level, conversion)


def _blocks_of(
    signals: Sequence[Tensor], frequency: Tensor, sampling_rate: float, *, window: Any,
    segment: float | None, start: float,
) -> _TimeBlocks | None:  # fmt: skip
    """Amplitudes of signals of one time base in blocks of time; None for fewer than four.

    Args:
        signals: real, (..., T) each.  frequency: Hz, (1,).  sampling_rate: Hz.
        window, segment, start: as for ``segment_amplitudes``, whose amplitudes these explain.
    """
    first = round(start * sampling_rate)
    samples = signals[0].shape[-1]
    if segment is not None and round(segment * sampling_rate) != samples - first:
        cut = {"window": window, "segment": segment, "start": start}
        parts = tuple(segment_amplitudes(s, frequency, sampling_rate, **cut) for s in signals)
        equal = torch.full((len(parts[0]),), 1 / len(parts[0]), dtype=torch.float64)
        # A single segment that leaves part of the record out has no others to be compared with.
        return _TimeBlocks(parts, equal, False) if len(equal) >= FEWEST_BLOCKS else None
    if (samples - first) * float(frequency) < sampling_rate:
        return None
    borders = list(Blocks.of(samples - first, sampling_rate, float(frequency)).borders)
    count = len(borders) - 1
    if count < FEWEST_BLOCKS:
        return None
    weight = make_window(window, samples - first).weights
    turn = 2j * torch.pi * frequency / sampling_rate * torch.arange(first, samples)
    basis = torch.stack([turn.exp(), (-turn).exp(), torch.ones_like(turn)])
    across = basis.conj() * weight
    dual = torch.linalg.solve(across @ basis.mT, across)
    share = torch.stack([weight[a:b].sum() for a, b in pairwise(borders)]) / weight.sum()
    kept = torch.stack([dual[0, a:b] @ basis[:, a:b].T for a, b in pairwise(borders)])  # (S, 3)
    found = []
    for signal in signals:
        ends = [*borders, samples - first] if borders[-1] < samples - first else borders
        sums = torch.stack([
            signal[..., first + a : first + b].to("cpu", torch.complex128) @ dual[:, a:b].T
            for a, b in pairwise(ends)
        ])  # fmt: skip
        fitted = sums.sum(0)  # tone, conjugate, mean
        left = sums[:count, ..., 0] - torch.einsum("sk,...k->s...", kept, fitted)
        size = share.reshape(-1, *[1] * (left.ndim - 1)).clamp(min=1e-12)
        own = left / size
        own = own - (size * own).sum(0) / share.sum()  # what the samples behind the last period add
        found.append((fitted[..., 0] + own)[..., None])
    return _TimeBlocks(tuple(found), share / share.sum(), True)


def dean_uncertainty(
    record: PressureRecord, frequency: Tensor, drive: Tensor, cells: Cells,
    rows: Tensor, options: dict[str, Any], level: float | None,
) -> PointUncertainty | None:  # fmt: skip
    """Intervals of cells and surface in both orders; None for fewer than four blocks.

    Args:
        record, frequency, options: as ``in_situ`` has them.  drive: rho c v_in/p_b, (F,).
        cells, rows: of the probes, and the row of the backplate that belongs to each.
        level: of the intervals; None for none.
    """
    if level is None:
        return None
    assert record.facesheet is not None and record.backplate is not None  # noqa: PT018
    back = record.backplate.reshape(-1, record.samples)
    face = record.facesheet.reshape(-1, record.samples)
    used = rows >= 0
    inside = ((cells.labels >= 0) & used)[:, None]
    parts: dict[str, list[Interval]] = {}
    count = 0
    for f, hertz in enumerate(frequency):
        blocks = _blocks_of((face, back), hertz[None], record.sampling_rate, **options)
        if blocks is None:
            return None
        count = min(count or len(blocks.weights), len(blocks.weights))
        pressure, bottom = blocks.amplitudes
        through = (bottom * drive[f])[:, rows.clamp(min=0)]
        admittance = 1 / blocks.h1(through, pressure)
        admittance = cells.average(torch.where(inside, admittance, 0), used)
        through, pressure = cells.average(through, used), cells.average(pressure, used)
        values = {
            "cells": (admittance, FROM_ADMITTANCE),
            "liner": (admittance.mean(1), FROM_ADMITTANCE),
            "cells_pressure_first": (blocks.h1(through, pressure), ITSELF),
            "liner_pressure_first": (blocks.h1(through.mean(1), pressure.mean(1)), ITSELF),
        }
        for name, (value, conversion) in values.items():
            parts.setdefault(name, []).append(blocks.interval(value, level, conversion))
    return PointUncertainty(
        **{name: Interval.joined(each, -1) for name, each in parts.items()},
        settings={"level": level, "resampled": "time", "blocks": count},
    )  # fmt: skip


def wave_interval(
    record: PressureRecord, signals: Sequence[Tensor], frequency: Tensor, places: Tensor,
    options: dict[str, Any], level: float | None,
) -> Interval | None:  # fmt: skip
    """Of Z at y = 0 from plane waves, (F,); None for fewer than four blocks.

    Args:
        record, frequency, options: as ``decompose_waves`` has them.
        signals: pressures of the microphones, and rho c v_in there if velocities are used.
        places: y, m.  level: of the interval; None for none.
    """
    if level is None:
        return None
    parts = []
    for hertz in frequency:
        blocks = _blocks_of(signals, hertz[None], record.sampling_rate, **options)
        if blocks is None:
            return None
        waves, _, _ = split_waves(
            blocks.amplitudes[0], places, hertz[None], record.fluid.sound_speed,
            record.microphone_mach, *blocks.amplitudes[1:],
        )  # fmt: skip
        parts.append(blocks.interval(blocks.h1(waves[:, 0], waves[:, 1]), level))
    return Interval.joined(parts)


def few_blocks_note(name: str, found: Interval | None, level: float | None) -> list[str]:
    """Where an interval is missing or rough."""
    if level is None:
        return []
    if found is None:
        return [f"{name}: no statistical interval, since the record holds fewer than four blocks "
                "(periods of the tone, or segments)"]  # fmt: skip
    runs, width = float(found.runs.min()), float(found.widths.max())
    if runs >= FEWEST_RUNS or not width > SMALLEST_WIDTH:
        return []
    return [
        f"{name}: the error bars rest on {runs:.2g} independent blocks of time, fewer than "
        f"{FEWEST_RUNS}; they are rough"
    ]
