"""Data that are reduced already: what was asked of them, and whether it is what is asked now."""

from __future__ import annotations

import dataclasses

from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.reduction.moments import Moments
from torchliner.replay.edges import Record
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices

COHERENT_FIRST = ORDERS[2]


def fitted(known: Moments, chosen: Choices, liner: LinerModel) -> Moments:
    """Moments as they answer what is chosen: those of one order of averaging hold others too.

    Raises:
        ValueError: they were made for another drive, order, cell and so on.
    """
    name = known.plane.name
    if chosen.engine != "spectral":
        raise ValueError(
            f"{name} holds moments, which engine {chosen.engine!r} cannot replay; leave engine and "
            "incident out, or take the plane that was reduced"
        )
    for key, made in known.settings.items():
        wanted = getattr(chosen, key)
        if wanted != made and not (key == "order" and wanted != COHERENT_FIRST):
            raise ValueError(
                f"{name} was reduced with {key} {made!r}, and {wanted!r} is asked for; choose "
                f"{key}={made!r}, or reduce the data again"
            )
    if liner.cell_pitch != known.cell_pitch:
        raise ValueError(
            f"{name} was reduced for cells of {_length(known.cell_pitch)}, and the liner's are of "
            f"{_length(liner.cell_pitch)}; reduce the data again with that liner"
        )
    if chosen.order != COHERENT_FIRST:
        known = dataclasses.replace(known, sums=known.sums.without_coherent())
    needed = 2 + (known.sums.periodic is not None)
    if len(known.sums.groups) < needed:
        raise ValueError(
            f"{name} is the sum of a first reading alone; reduce each part once more with given= "
            "this sum, and add what comes of that with Moments.sum(parts, given=...)"
            + ("; or choose order='probes first'" if len(known.sums.groups) == 2 else "")
        )
    return known


def _length(pitch: float | None) -> str:
    return "all probes (no cell_pitch)" if pitch is None else f"{1e3 * float(pitch):.6g} mm"


def record_of(known: Moments, chosen: Choices) -> Record:
    """The record that moments were summed over."""
    plan = known.sums.plan
    name = "boxcar" if chosen.whole_periods else chosen.window
    window = make_window(name, plan.end - plan.begin)
    return Record(plan.samples, plan.begin, window, chosen.edge, plan.sampling_rate)
