"""Data that are reduced already: what was asked of them, and whether it is what is asked now."""

from __future__ import annotations

import dataclasses

from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.reduction.moments import Moments
from torchliner.reduction.periodic import Harmonics, coherent_tones
from torchliner.replay.edges import Record
from torchliner.replay.phase_rule import phase_rule
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import Choices

COHERENT_FIRST = ORDERS[2]


def fitted(known: Moments, chosen: Choices, liner: LinerModel, frequency: Tensor) -> Moments:
    """Moments as they answer what is chosen: those of one order of averaging hold others too.

    Args:
        known: of the data.
        chosen, liner, frequency: what is asked of them; Hz, (F,).
    Raises:
        ValueError: they were made for another drive, order, cell and so on.
    """
    name = known.plane.name
    known.require_speeds(liner)
    if chosen.drive == "running-rms":
        chosen = with_window(chosen, frequency)
    if chosen.engine != "spectral":
        raise ValueError(
            f"{name} holds moments, which engine {chosen.engine!r} cannot replay; leave engine and "
            "incident out, or take the plane that was reduced"
        )
    for key, made in known.settings.items():
        wanted = getattr(chosen, key)
        if wanted != made and not (key == "order" and wanted != COHERENT_FIRST):
            remedy = f"leave {key} out" if made is None else f"choose {key}={made!r}"
            raise ValueError(
                f"{name} was reduced with {key} {made!r}, and {wanted!r} is asked for; {remedy}, "
                "or reduce the data again"
            )
    if liner.cell_pitch != known.cell_pitch:
        raise ValueError(
            f"{name} was reduced for cells of {_length(known.cell_pitch)}, and the liner's are of "
            f"{_length(liner.cell_pitch)}; reduce the data again with that liner"
        )
    if chosen.wall_filter is not None:
        _require_walls(known, frequency)
    if chosen.order != COHERENT_FIRST:
        known = dataclasses.replace(known, sums=known.sums.without_coherent())
    elif not phase_rule(chosen.phase).several_tones:
        known = dataclasses.replace(known, notes=(*known.notes, *_other_sound(known, frequency)))
    needed = 2 + (known.sums.periodic is not None)
    if len(known.sums.groups) < needed:
        raise ValueError(
            f"{name} is the sum of a first reading alone; reduce each part once more with given= "
            "this sum, and add what comes of that with Moments.sum(parts, given=...)"
            + ("; or choose order='probes first'" if len(known.sums.groups) == 2 else "")
        )
    return known


def window_of(chosen: Choices, frequency: Tensor) -> float:
    """Length of the running rms, s: as chosen, or a period of the lowest frequency asked for."""
    return chosen.running_window or 1 / float(frequency.min())


def with_window(chosen: Choices, frequency: Tensor) -> Choices:
    """With the length of the running rms that follows from the frequencies asked for, (F,)."""
    return dataclasses.replace(chosen, running_window=window_of(chosen, frequency))


def _require_walls(known: Moments, frequency: Tensor) -> None:
    """Walls are told by the coherence of v with the frequencies asked for, Hz.

    Raises:
        ValueError: it was not measured there.
    """
    tones = known.sums.tones
    for f in frequency.tolist():
        if not bool(((tones / f - 1).abs() < SAME_FREQUENCY).any()):
            raise ValueError(
                f"{known.plane.name} holds the coherence of v with {_listed(tones)}, and "
                f"wall_filter asks for that with {f:g} Hz: reduce the data again with that "
                "frequency, or leave wall_filter out"
            )


def _other_sound(known: Moments, frequency: Tensor) -> tuple[str, ...]:
    """That a plane which states no tone has another periodic part at the frequencies asked for."""
    plane, periodic = known.plane, known.sums.periodic
    if plane.frequency is not None or periodic is None:
        return ()
    made = periodic.harmonics
    wanted = Harmonics.of(coherent_tones(None, frequency), made.sampling_rate)
    if wanted.lines.tolist() == made.lines.tolist():
        return ()
    return (
        f"{plane.name} states no tone: the part of v that belongs to the sound was taken at "
        f"{_listed(known.sums.tones)}, for which the data were reduced, and not at "
        f"{_listed(frequency[:3])}",
    )


def _listed(frequency: Tensor) -> str:
    return ", ".join(f"{f:g}" for f in frequency.tolist()) + " Hz" if len(frequency) else "no line"


def _length(pitch: float | None) -> str:
    return "all probes (no cell_pitch)" if pitch is None else f"{1e3 * float(pitch):.6g} mm"


def record_of(known: Moments, chosen: Choices) -> Record:
    """The record that moments were summed over."""
    plan = known.sums.plan
    name = "boxcar" if chosen.whole_periods else chosen.window
    window = make_window(name, plan.end - plan.begin)
    return Record(plan.samples, plan.begin, window, chosen.edge, plan.sampling_rate)
