"""Data that are reduced already: what was asked of them, and whether it is what is asked now."""

from __future__ import annotations

from torchliner.liners.model import LinerModel
from torchliner.reduction.moments import Moments
from torchliner.replay.edges import Record
from torchliner.signals.windows import make_window
from torchliner.tdibc.choices import WHOLE_PERIODS, Choices


def check_settings(known: Moments, chosen: Choices, liner: LinerModel) -> None:
    """Refuse what moments were not made for.

    Raises:
        ValueError: another drive, order, cell and so on.
    """
    name = known.plane.name
    for key, made in known.settings.items():
        wanted = getattr(chosen, key)
        if wanted != made:
            raise ValueError(
                f"{name} was reduced with {key} {made!r}, and {wanted!r} is asked for; choose "
                f"{key}={made!r}, or reduce the data again"
            )
    if chosen.engine != "spectral":
        raise ValueError(
            f"{name} holds moments, which engine {chosen.engine!r} cannot replay; leave engine and "
            "incident out, or take the plane that was reduced"
        )
    if liner.cell_pitch != known.cell_pitch:
        raise ValueError(
            f"{name} was reduced for cells of {_length(known.cell_pitch)}, and the liner's are of "
            f"{_length(liner.cell_pitch)}; reduce the data again with that liner"
        )


def _length(pitch: float | None) -> str:
    return "all probes (no cell_pitch)" if pitch is None else f"{1e3 * float(pitch):.6g} mm"


def record_of(known: Moments, chosen: Choices) -> Record:
    """The record that moments were summed over."""
    plan = known.sums.plan
    name = "boxcar" if chosen.window == WHOLE_PERIODS else chosen.window
    window = make_window(name, plan.end - plan.begin)
    return Record(plan.samples, plan.begin, window, chosen.edge, plan.sampling_rate)
