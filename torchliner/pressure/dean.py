r"""The in situ method: impedance from the pressures on the facesheet and at the cavity bottom.

``cavity_mouth.py`` derives the velocity v_in into the whole surface from the pressure p_b at the bottom of the
cavities, so that with p_f on the facesheet

.. math:: Z = \frac{p_f}{\rho c\,v_{in}} = -j\,\frac{p_f}{p_b}\,\frac{1}{\varphi_c\sin kH}
            \quad (\text{lossless}).

Nothing is assumed of the facesheet or of the flow above it.

Two orders of averaging. v_in is one number per cell, p_f is not: it drops towards the hole and is lowest in its mouth.
The admittance averaged over points is v_in <1/p_f>, the plane wave that the surface sends back knows v_in/<p_f>: the
first is the paper's, the second is the projection on the plane mode (the mean over the surface of p and of v), exact
for normal incidence. The ratio of the two Z is <p_f><1/p_f>: 1 plus, to leading order, <d^2>/<p_f>^2 with d = p_f -
<p_f> complex, which is below 1 where the pressure over a hole is in quadrature with the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.conversions import impedance_from_admittance
from torchliner.engine.intervals import ITSELF, Conversion
from torchliner.names import LOSSES
from torchliner.pressure.cavity_mouth import mouth_velocity_ratio
from torchliner.pressure.time_blocks import (
    LEVEL,
    TimeBlocks,
    few_blocks_notes,
    frequencies_of,
    require_level,
    time_intervals,
)
from torchliner.records import PointImpedances, PointUncertainty, PressureRecord
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of
from torchliner.records.pressure_record import require_record
from torchliner.tones import segment_amplitudes, transfer_from_amplitudes

Estimator = Callable[[Tensor, Tensor], Tensor]
FROM_ADMITTANCE = Conversion(impedance_from_admittance, lambda y: -1 / y**2, 0)
NO_TONE = 1e-9  # of a signal's largest value: no tone
COHERENCE_PERIODS = 2.0  # of a segment, where the estimate itself has only one
FEWEST_SAMPLES = 8  # of such a segment
LOW_COHERENCE = 0.5


def in_situ(
    record: PressureRecord,
    frequency: Any = None,
    *,
    losses: str = "none",
    window: Any = "hann",
    segment: float | None = None,
    start: float = 0.0,
    allow_short: bool = False,
    interval: float | None = LEVEL,
) -> PointImpedances:
    r"""Impedance at every facesheet point, per cell and over the whole surface, after Dean.

    Args:
        record: facesheet and backplate pressure, cavity depth and porosity.
        frequency: Hz, one or several; default the record's own tone.
        losses: of the wave in the cavity, ``none`` or ``viscothermal`` (needs the cavity's hydraulic radius).
        window: any window of scipy.
        segment: s of a segment of the H1 estimate, overlapping by half; default one segment, the whole record: tones
            are then exact.
        start: s at the beginning that are left out.
        allow_short: accept fewer than four periods.
        interval: level of the statistical intervals, 0 to 1; None for no intervals.
    Returns:
        Impedances in both orders of averaging (see the module), with the coherence of the two pressures. It comes from
        the segments, or from segments of two periods if there is only one. The intervals come from blocks of whole
        periods, or from the segments.
    Raises:
        ValueError: a pressure is missing or has no tone; the record is too short; a frequency is at or above Nyquist,
            or sin(kH) is zero there, by which Dean's formula divides.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``.
    Source: Dean, J. Sound Vib. 34 (1974) 97, with the cavity porosity and, as an option, the losses of eq. (2.2d) of
        Roncen et al. (2026); H1 with the backplate as input, since the turbulence on the facesheet is then the output's
        noise and leaves no bias.
    """
    require_record(record)
    require_choice("losses", losses, LOSSES)
    if record.facesheet is None or record.cavity_depth is None:
        missing = "cavity_depth" if record.facesheet is not None else "facesheet pressure"
        raise ValueError(f"{record.name}: {missing} is missing; the in situ method needs it")
    require_level(interval)
    wanted = frequencies_of(record, frequency, start, allow_short)
    drive, notes = mouth_velocity_ratio(record, wanted, losses)
    cells, rows = _cells_of(record)
    used = rows >= 0
    options: dict[str, Any] = {"window": window, "segment": segment, "start": start}

    def averages(h1: Estimator, face: Tensor, back: Tensor, drive: Tensor) -> dict[str, tuple[Tensor, Conversion]]:
        return _in_both_orders(h1, face, (back * drive)[:, rows.clamp(min=0)], cells, used)

    def of_blocks(blocks: TimeBlocks, f: int) -> dict[str, tuple[Tensor, Conversion]]:
        return averages(blocks.h1, blocks.amplitudes[0], blocks.amplitudes[1], drive[f])

    face, back = _amplitudes(record, wanted, options)
    found = {
        name: conversion.impedance(value)
        for name, (value, conversion) in averages(_of_segments, face, back, drive).items()
    }
    points = _of_segments((back * drive)[:, rows.clamp(min=0)], face)
    signals = [getattr(record, label).reshape(-1, record.samples) for label in ("facesheet", "backplate")]
    known = time_intervals(signals, wanted, record.sampling_rate, options, interval, of_blocks)
    uncertainty = None
    if known is not None:
        settings = {"level": interval, "resampled": "time", "blocks": known[1]}
        uncertainty = PointUncertainty(**known[0], settings=settings)
    coherence, segments = _coherence(record, wanted, (face, back), cells, rows, options)
    notes += _coherence_notes(record, coherence, segments) + _mode_notes(record, wanted)
    notes += few_blocks_notes(f"{record.name}: in situ", None if uncertainty is None else uncertainty.liner, interval)
    tell([str(note) for note in notes])
    unknown = torch.full((record.probes,), torch.nan, dtype=torch.float64)
    x, z = (unknown if values is None else values for values in record.probe_coordinates())
    choices = {
        "method": "in situ",
        "losses": losses,
        **options,
        "source": record.name,
        "cavity_depth": record.cavity_depth,
        "cavity_porosity": record.cavity_porosity,
        "coherence_segments": segments,
        **origin_of([("in situ", record.name)]),
    }
    return PointImpedances(
        name="in situ (Dean)",
        frequency=wanted,
        cell_x=cells.x,
        cell_z=cells.z,
        cell_impedance=found["cells"],
        cell_impedance_pressure_first=found["cells_pressure_first"],
        liner_impedance=found["liner"],
        liner_impedance_pressure_first=found["liner_pressure_first"],
        coherence=coherence,
        point_x=x,
        point_z=z,
        point_impedance=torch.where(used[:, None], points, torch.nan),
        choices=choices,
        notes=tuple(notes),
        uncertainty=uncertainty,
    )


def _of_segments(driver: Tensor, response: Tensor) -> Tensor:
    """H1 of segments, (S, ..., F) to (..., F)."""
    return transfer_from_amplitudes(driver, response).response


def _in_both_orders(
    h1: Estimator, pressure: Tensor, velocity: Tensor, cells: Cells, used: Tensor
) -> dict[str, tuple[Tensor, Conversion]]:
    """What is averaged over cells and the surface in both orders, and how Z follows from it.

    Args:
        h1: of driver and response, (S, ..., F) each; it may give further axes in front.
        pressure: on the facesheet, (S, P, F).
        velocity: rho c v_in behind each point, likewise.
        cells, used: of the points.
    """
    inside = ((cells.labels >= 0) & used)[:, None]
    admittance = cells.average(torch.where(inside, 1 / h1(velocity, pressure), 0), used)
    pressure, velocity = cells.average(pressure, used), cells.average(velocity, used)
    # Over whole cells in both orders, so that their ratio is <p_f><1/p_f>.
    return {
        "cells": (admittance, FROM_ADMITTANCE),
        "liner": (admittance.mean(-2), FROM_ADMITTANCE),
        "cells_pressure_first": (h1(velocity, pressure), ITSELF),
        "liner_pressure_first": (h1(velocity.mean(-2), pressure.mean(-2)), ITSELF),
    }


def _cells_of(record: PressureRecord) -> tuple[Cells, Tensor]:
    """The cells, and which row of the backplate belongs to each probe, (P,), -1 for none."""
    if record.probe_cell is None:
        cells = sort_into_cells(record, record.cell_pitch)
    else:
        labels = record.probe_cell
        unplaced = torch.full((int(labels.max()) + 1,), torch.nan, dtype=torch.float64)
        alone = Cells(labels, unplaced, unplaced)
        centres = [
            unplaced if values is None else alone.average(values, labels >= 0, 0)
            for values in record.probe_coordinates()
        ]
        cells = Cells(labels, *centres)
    rows = math.prod(record.backplate.shape[:-1])
    # A probe that the record puts in no cell has no backplate either.
    stray = torch.zeros_like(cells.labels) if record.probe_cell is None else cells.labels
    if rows == 1:
        return cells, torch.where(stray < 0, -1, 0)
    if rows == cells.count:
        first = [int((cells.labels == cell).nonzero()[0]) for cell in range(cells.count)]
        if record.probe_cell is None and first != sorted(first):
            tell(
                f"{record.name}: the rows of the backplate are taken as the cells in rising z, then x, in which order "
                "the facesheet probes do not come; state probe_cell if the backplate is in the probes' order"
            )
        return cells, cells.labels
    if rows == record.probes:
        return cells, torch.where(stray < 0, -1, torch.arange(rows))
    raise ValueError(
        f"{record.name}: backplate has {rows} rows, but there are {cells.count} cells and {record.probes} facesheet "
        "probes; give one for all, one per cell or one per probe, and the cells by cell_pitch or probe_cell"
    )


def _amplitudes(record: PressureRecord, frequency: Tensor, options: dict[str, Any]) -> tuple[Tensor, Tensor]:
    """Tones on the facesheet (S, P, F) and at the backplate (S, C, F)."""
    found = []
    for label in ("facesheet", "backplate"):
        signal = getattr(record, label).reshape(-1, record.samples)
        lines = segment_amplitudes(signal, frequency, record.sampling_rate, **options)
        largest = signal.abs().amax(-1).cpu().to(torch.float64)
        quiet = lines.abs().amax(0) <= NO_TONE * largest[:, None]
        if bool(quiet.any()):
            row, column = quiet.nonzero()[0].tolist()
            what = "is zero" if float(largest[row]) == 0 else "has no tone"
            raise ValueError(
                f"{record.name}: {label} pressure {what} at {float(frequency[column]):g} Hz in "
                f"{int(quiet.any(-1).sum())} of {len(signal)} signals, the first is {row}; leave it out"
            )
        found.append(lines)
    return found[0], found[1]


def _coherence(
    record: PressureRecord,
    frequency: Tensor,
    lines: tuple[Tensor, Tensor],
    cells: Cells,
    rows: Tensor,
    options: dict[str, Any],
) -> tuple[Tensor, int]:
    """Of the two pressures, mean over a cell's points, (C, F), and the number of segments.

    The amplitudes (S, P, F), (S, C, F) of a single segment say nothing of it; shorter segments do.
    """
    used = rows >= 0

    def over_cells(face: Tensor, back: Tensor) -> Tensor:
        found = transfer_from_amplitudes(back[:, rows.clamp(min=0)], face).coherence
        return cells.average(torch.where(used[:, None], found, 0.0), used)

    if len(lines[0]) > 1:
        return over_cells(*lines), len(lines[0])
    seconds = record.duration - options["start"]
    columns, counts = [], []
    for f in frequency:
        segment = COHERENCE_PERIODS / float(f)
        if seconds < 1.5 * segment or segment * record.sampling_rate < FEWEST_SAMPLES:
            columns.append(torch.full((cells.count, 1), torch.nan, dtype=torch.float64))
            continue
        parts = _amplitudes(record, f[None], {**options, "segment": segment})
        columns.append(over_cells(*parts))
        counts.append(len(parts[0]))
    return torch.cat(columns, -1), min(counts, default=0)


def _coherence_notes(record: PressureRecord, coherence: Tensor, segments: int) -> list[Note]:
    low = coherence < LOW_COHERENCE
    if not bool(low.any()):
        return []
    text = (
        f"{record.name}: the coherence of facesheet and backplate pressure is {float(coherence[low].min()):.2g} at "
        f"worst, below {LOW_COHERENCE:g} in {int(low.sum())} of {low.numel()} values ({segments} segments): there is "
        "turbulence, or no sound"
    )
    return [Note("low-coherence", text)]


def _mode_notes(record: PressureRecord, frequency: Tensor) -> list[Note]:
    """Above c/(2 pitch) a cavity as wide as its cell carries more than the plane wave."""
    if record.cell_pitch is None:
        return []
    limit = record.fluid.sound_speed / (2 * record.cell_pitch)
    if float(frequency.max()) < limit:
        return []
    text = (
        f"{record.name}: above {limit:.4g} Hz a cavity as wide as its cell, {1e3 * record.cell_pitch:g} mm, carries "
        "transverse waves; Dean's formula knows the plane one alone"
    )
    return [Note("cavity-modes", text)]
