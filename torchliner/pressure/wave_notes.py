"""Warnings of impedances from microphones along a duct."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.checks import FEEDS
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.rigid_spectrum import cut_on_frequency
from torchliner.pressure.microphone_errors import POOR, ROUNDING, largest_misfit
from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.records.notes import Note

LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
TURNS, DECAYS = 0.5, 0.1  # rad, neper over the array: a wave's direction can be told from more
LIKE_RIGID = 0.05  # rad or neper over the array, some times what 0.1 dB and 0.1 degrees tell
HARD = 10.0  # |Z|; a short array tells no softer wall from a rigid one either
Notes = tuple[Note, ...]


def wave_notes(result: WallEduction) -> Notes:
    """Of waves that may not be those of a lined wall."""
    assert result.line is not None
    return (
        *duct_notes(result.line),
        *_lost_draws(result),
        *_side_notes(result),
        *_phase_notes(result),
        *_rigid_notes(result),
        *resistance_notes(result),
    )


def duct_notes(line: MicrophoneLine) -> Notes:
    """Higher modes of the rigid duct that carry sound."""
    notes = []
    for what, size in (("height", line.duct_height), ("width", line.duct_width)):
        if size is None:
            continue
        limit = cut_on_frequency(UniformProfile(abs(line.stated_mach), float(size), float(line.fluid.sound_speed)))
        above = line.frequency[line.frequency >= limit]
        if len(above):
            text = (
                f"{line.name}: from {limit:.4g} Hz on the duct's {what}, {1e3 * float(size):g} mm, carries a higher "
                f"mode: {len(above)} of {len(line.frequency)} frequencies from {float(above.min()):g} Hz on"
            )
            notes.append(Note("higher-modes", text))
    return tuple(notes)


def resistance_notes(result: WallEduction) -> Notes:
    """Where the wall would feed sound."""
    active = result.impedance.real < FEEDS
    text = f"the resistance is negative, {least(result.impedance.real, active):.3g} at least: the wave gains energy"
    return noted(result, active, "active-wall", f"{text} at the wall, or is not the one assumed")


def _side_notes(result: WallEduction) -> Notes:
    """The wave kept is not the strongest."""
    low = result.energy_share < LEAST_SHARE
    text = (
        f"the wave that runs away from a source {result.source_side} holds {least(result.energy_share, low):.2g} of "
        f"the energy of the strongest wave at worst, less than {LEAST_SHARE:g}: the source may be on the other side "
        "(source_side), or phases be those of exp(-j omega t)"
    )
    return noted(result, low, "source-side", text)


def _phase_notes(result: WallEduction) -> Notes:
    """exp(-j alpha x) of a decaying wave has Re alpha and Im alpha of opposite signs."""
    strongest = result.energies.argmax(-2, keepdim=True)
    wave = result.modes.gather(-2, strongest)[..., 0, :]
    turn, decay = (part * float(result.x[-1] - result.x[0]) for part in (wave.real, wave.imag))
    against = (turn * decay > 0) & (decay.abs() > DECAYS) & (turn.abs() > TURNS) & (turn.abs() > decay.abs())
    if 2 * int(against.sum()) <= against.numel():
        return ()
    text = "the strongest wave grows where its phase runs to: the phases look conjugated; exp(+j omega t) is needed"
    return noted(result, against, "conjugated-phases", text)


def _rigid_notes(result: WallEduction) -> Notes:
    """Nothing but a bound of \\|Z\\| where the wave is that of a rigid duct."""
    sign = 1 if result.source_side == "upstream" else -1
    k = 2 * torch.pi * result.frequency / result.choices["sound_speed"]
    rigid = (sign * k / (1 + sign * result.choices["mach"])).to(result.wavenumber.device)
    size = result.impedance.abs()
    near = ((result.wavenumber - rigid).abs() * float(result.x[-1] - result.x[0]) < LIKE_RIGID) & (size > HARD)
    text = (
        f"the wavenumber is that of a rigid duct within {LIKE_RIGID:g} rad over the array: the wall looks rigid, and "
        f"the impedance, |Z| {least(size, near):.3g} and more, says only that it is hard"
    )
    return noted(result, near, "rigid-wall", text)


def _lost_draws(result: WallEduction) -> Notes:
    if result.draws is None or not bool(result.failed.any()):
        return ()
    text = f"{int(result.failed.sum())} of {result.draws.impedance.numel()} draws have no impedance and are left out"
    return (Note("lost-draws", f"{result.method}: {text}"),)


def misfit_notes(result: WallEduction, freedom: float) -> Notes:
    """The waves leave more than the assumed errors do, which have ``freedom`` real degrees of freedom."""
    misfit, choices = result.misfit, result.choices
    assert misfit is not None
    limit = max(largest_misfit(freedom, POOR / misfit.numel()), choices["largest_misfit"])
    poor = (misfit > limit) & (result.residual > ROUNDING)
    if not bool(poor.any()):
        return ()
    size = None
    if result.draws is not None or result.covariance is not None:
        spread = result.standard_error if result.draws is None else result.standard_deviation
        size = float(spread[poor].abs().max())
    level, phase = (float(used[poor].max()) for used in result.used_errors)
    text = (
        f"the waves leave up to {100 * float(result.residual[poor].max()):.2g} % of the pressures, "
        f"{float(misfit[poor].max()) ** 0.5:.3g} times what {choices['level_error']:g} dB and "
        f"{choices['phase_error']:g} degrees leave (limit {limit**0.5:.3g}). There are other waves, or the microphones "
        f"err by {level:.2g} dB and {phase:.2g} degrees, which draws take: compare ranks, margins and methods"
    )
    return noted(result, poor, "model-misfit", text, size)


def noted(result: WallEduction | FieldFit, which: Tensor, code: str, text: str, size: float | None = None) -> Notes:
    """One warning with how often and where first, (..., F); none where nothing is wrong."""
    if not bool(which.any()):
        return ()
    first = result.frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
    where = f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz"
    return (Note(code, f"{result.choices['source']}: {where}, {text}", size),)


def least(values: Tensor, which: Tensor) -> float:
    """Of some values; nan of none."""
    return float(values[which].min()) if bool(which.any()) else math.nan
