"""Warnings about the tables of a replay: what kernels and velocity levels add to R."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.replay.edges import Record
from torchliner.replay.kernels import KernelTable, level_error, reflection_at_levels
from torchliner.replay.levels import VelocityGrid
from torchliner.signals.segments import segment_starts
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Prepared

LARGEST_ERROR = 1e-3  # in R; of Z it is some |1 + Z|^2/2 times that
LARGEST_GAIN = 10.0  # 1.3 on the default band, 5 up to 5 kHz
IN_Z = "Z is off by some |1 + Z|^2/2 times that"


def frequencies_read(record: Record, frequency: Tensor, chosen: Choices) -> Tensor:
    """Where the window reads R around each frequency asked for: f and its side lines, Hz, (n,)."""
    length, window = len(record.window.weights), record.window
    if chosen.incident is not None and chosen.segment is not None:
        rate = record.sampling_rate
        _, length = segment_starts(record.samples, record.start, chosen.segment, rate)
        window = make_window(chosen.window, length)
    side = record.sampling_rate / length * torch.tensor(window.orders, dtype=torch.float64)
    found = (frequency[:, None] + side).flatten()
    return torch.cat([frequency, found[(found > 0) & (found < record.sampling_rate / 2)]])


def review_tables(prepared: Prepared) -> list[str]:
    """Kernels that are far from the liner or amplify, levels too few, factors too coarse."""
    chosen, notes = prepared.chosen, []
    if prepared.kernels is not None:
        with torch.no_grad():
            notes += _review_kernels(prepared, prepared.kernels)
    if prepared.kernels is not None and isinstance(prepared.kernels.grid, VelocityGrid):
        with torch.no_grad():
            error = level_error(prepared.liner, prepared.frequency, prepared.kernels.grid)
        if error > LARGEST_ERROR:
            notes.append(
                f"between velocity levels R is off by up to {error:.2g} (limit {LARGEST_ERROR:g}); "
                f"{IN_Z}; take more than {chosen.levels} levels, or spacing='sqrt' with "
                "interpolation='cubic'"
            )
    tolerance = chosen.rank_tolerance or 0.0
    if chosen.engine == "unfold" and tolerance > LARGEST_ERROR:
        notes.append(
            f"rank_tolerance is {tolerance:g}, so that the kernels' factors may move R by as much "
            f"(limit {LARGEST_ERROR:g}); {IN_Z}; lower it"
        )
    return notes


def _review_kernels(prepared: Prepared, kernels: KernelTable) -> list[str]:
    low, high = kernels.band
    whole = prepared.chosen.uses_kernel_response
    where = "in every value" if whole else "in what enters at the record's two ends"
    notes = []
    if kernels.error > LARGEST_ERROR or kernels.gain > LARGEST_GAIN:
        remedy = "take kernel='two-sided'" if kernels.kind == "causal" else "narrow band=(low, high)"
        notes.append(
            f"the {kernels.kind} kernel is off by up to {kernels.error:.2g} in R within "
            f"{low:g}-{high:g} Hz (limit {LARGEST_ERROR:g}) and amplifies up to {kernels.gain:.3g} "
            f"times (limit {LARGEST_GAIN:g}), {where}; {IN_Z}; {remedy}"
        )
    read = frequencies_read(prepared.record, prepared.frequency, prepared.chosen)
    outside = read[(read < low) | (read > high)]
    known = prepared.liner.frequency_range or (0.0, torch.inf)
    outside = outside[(outside >= known[0]) & (outside <= known[1])]
    if len(outside):
        wanted = reflection_at_levels(prepared.liner, outside, kernels.grid)
        error = float((kernels.response(outside) - wanted).abs().max())
        if error > max(LARGEST_ERROR, kernels.error):
            notes.append(
                f"the window reads R from {float(read.min()):.6g} to {float(read.max()):.6g} Hz, "
                f"beyond the kernel's band, {low:.6g}-{high:.6g} Hz, where the kernel is off by up "
                f"to {error:.2g}, {where}; widen band=(low, high), or leave it out"
            )
    return notes
