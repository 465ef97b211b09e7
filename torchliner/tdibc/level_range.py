"""Levels of |v| and the band of the kernels, which all planes share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.reduction.survey import Survey
from torchliner.replay.kernels import BAND, KernelTable
from torchliner.replay.levels import VelocityGrid
from torchliner.tdibc.choices import Choices

SMALL_SHARE = 1e-3  # of a recorded signal's energy


def review_signal(kernels: KernelTable, chosen: Choices, sent: Tensor | None) -> tuple[str, ...]:
    """Refuse a generated signal beyond the kernel's band; notes on a recorded one."""
    if sent is None:
        return ()
    wave, (low, high) = chosen.incident, kernels.band
    if wave.band is not None:
        if wave.band[0] < low or wave.band[1] > high:
            raise ValueError(
                f"incident signal {wave.label} reaches beyond the kernel's band, {low:g}-{high:g} "
                "Hz, where the kernel is not the liner; widen it with band=(low, high) or narrow "
                "the signal"
            )
        return ()
    power = torch.fft.rfft(sent).abs().square()
    lines = torch.fft.rfftfreq(len(sent), 1 / kernels.sampling_rate, dtype=torch.float64)
    inside = (lines >= low) & (lines <= high)
    share = 1 - float(power[inside].sum() / power.sum().clamp(min=1e-300))
    if share < SMALL_SHARE:
        return ()
    return (
        f"{100 * share:.2g} % of the energy of {wave.label} lies outside the kernel's band, "
        f"{low:g}-{high:g} Hz, where the reflected signal is not the liner's; filter it, or widen "
        "the band with band=(low, high)",
    )


def velocity_grid(
    planes: Sequence[VelocityPlane], surveys: Sequence[Survey], liner: LinerModel, chosen: Choices
) -> VelocityGrid:
    """Levels over the range of all planes; the top is rounded up so that the tables, and with
    them the last digits of a probe, rarely depend on which other probes are in the data."""
    top, fastest, plane, measured = -1.0, 0, planes[0], -1.0
    for one, seen in zip(planes, surveys, strict=True):
        peak = seen.peak
        if chosen.mean == "removed":
            peak = torch.maximum(seen.largest - seen.mean, seen.mean - seen.smallest)
        if chosen.drive == "rms":  # which alone the liner is asked for
            removed = seen.mean**2 if chosen.mean == "removed" else 0
            peak = (seen.mean_square - removed).clamp(min=0).sqrt()
        peak = peak.detach()
        if float(peak.max()) > top:  # of averages and of v* too
            top, plane = float(peak.max()), one
            fastest = int(peak[: one.probes].argmax())
            measured = float(peak[fastest])
    limit = chosen.velocity_max
    table_limit = liner.speed_max
    if limit is None:
        limit = 2.0 ** (math.ceil(2 * math.log2(max(top, 1e-3))) / 2) * (1 + 1e-9)
        if table_limit is not None:
            limit = min(limit, table_limit)
    if top > limit or (table_limit is not None and limit > table_limit):
        place = tuple(int(i) for i in torch.unravel_index(torch.tensor(fastest), plane.probe_shape))
        kind = "velocity_max" if chosen.velocity_max is not None else "the liner's table"
        ceiling = limit if table_limit is None else min(limit, table_limit)
        where, other = f"{measured:.4g} m/s at probe {place}", ""
        if measured <= ceiling:
            where = f"{top:.4g} m/s with the coherent velocity of a cell ({measured:.4g} m/s as "
            where, other = f"{where}measured)", ", or choose order='probes first'"
        raise ValueError(
            f"{plane.name} reaches |v| = {where}, above {kind}, {ceiling:.4g} m/s; extend it to "
            f"at least {top * 1.01:.3g} m/s{other}"
        )
    return VelocityGrid(limit, chosen.levels, chosen.spacing, chosen.interpolation)


def kernel_band(liner: LinerModel, asked: Tensor, chosen: Choices) -> tuple[float, float]:
    """As chosen, or wide enough for all frequencies read (Hz, (n,)); within the liner's range."""
    if chosen.band is not None:
        low, high = chosen.band
    else:
        low, high = min(BAND[0], float(asked.min())), max(BAND[1], float(asked.max()))
        if chosen.incident is not None and chosen.incident.band is not None:
            low, high = min(low, chosen.incident.band[0]), max(high, chosen.incident.band[1])
    known = liner.frequency_range
    if known is not None:
        low, high = max(low, known[0]), min(high, known[1])
    return low, high
