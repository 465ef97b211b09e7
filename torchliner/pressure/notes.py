"""Warnings of impedances from microphones along a duct: by their code where they hold, and what they say."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.checks import FEEDS
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.pressure.microphone_errors import POOR, largest_misfit
from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.records.notes import Note

LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
TURNS, DECAYS = 0.5, 0.1  # rad, neper over the array: a wave's direction can be told from more
LIKE_RIGID = 0.05  # rad or neper over the array, some times what 0.1 dB and 0.1 degrees tell
HARD = 10.0  # |Z|; a short array tells no softer wall from a rigid one either
ROUNDING = 1e-10  # residual that is rounding, whatever errors are assumed
GAINS = 1 + 1e-6  # of an end; nearer to 1 it is rounding of the fit
Notes = tuple[Note, ...]


def wave_notes(result: WallEduction, freedom: float) -> Notes:
    """Of waves that may not be those of a lined wall, or leave more than the assumed errors, which have ``freedom``
    real degrees of freedom."""
    assert result.line is not None
    assert result.misfit is not None
    choices, z, residual, span = result.choices, result.impedance, result.residual, float(result.x[-1] - result.x[0])
    # exp(-j alpha x) of a decaying wave has Re alpha and Im alpha of opposite signs.
    strongest = result.modes.gather(-2, result.energies.argmax(-2, keepdim=True))[..., 0, :]
    turn, decay = strongest.real * span, strongest.imag * span
    against = (turn * decay > 0) & (decay.abs() > DECAYS) & (turn.abs() > TURNS) & (turn.abs() > decay.abs())
    # Re alpha is known up to 2 pi/spacing; a rigid wall's wave must lie within half of that.
    sign, spacing = 1 if result.source_side == "upstream" else -1, choices.get("spacing", 0.0)
    along, side = 1 + sign * choices["mach"], result.source_side
    highest = choices["sound_speed"] * along / (2 * spacing) if spacing else math.inf
    k = 2 * torch.pi * result.frequency.to(z.device) / choices["sound_speed"]
    rigid = ((result.wavenumber - sign * k / along).abs() * span < LIKE_RIGID) & (z.abs() > HARD)
    weak, feeds = result.energy_share < LEAST_SHARE, z.real < FEEDS
    poor, misfit = _misfit(result, max(largest_misfit(freedom, POOR / z.numel()), choices["largest_misfit"]))
    poor &= residual > ROUNDING
    size = None
    if bool(poor.any()) and (result.draws is not None or result.covariance is not None):
        spread = result.standard_error if result.draws is None else result.standard_deviation
        size = float(spread[poor].abs().max())
    all_of_them = against & (2 * against.sum() > against.numel())
    rows = [
        (
            "aliasing",
            result.frequency >= highest,
            f"above {highest:.4g} Hz the spacing, {1e3 * spacing:.4g} mm, is more than half the wavelength of a rigid "
            "duct's wave; wavenumbers may be off by 2 pi/spacing",
        ),
        ("no-wave", ~torch.isfinite(result.wavenumber), f"no wave runs away from a source {side}; they are nan"),
        (
            "source-side",
            weak,
            f"the wave that runs away from a source {side} has at worst {least(result.energy_share, weak):.2g} of the "
            "energy of the strongest wave: the source may be on the other side, or phases be of exp(-j omega t)",
        ),
        ("conjugated-phases", all_of_them, "the phases look conjugated; exp(+j omega t) is needed"),
        (
            "rigid-wall",
            rigid,
            f"the wavenumber is that of a rigid duct within {LIKE_RIGID:g} rad over the array: the wall looks rigid, "
            f"and the impedance, |Z| {least(z.abs(), rigid):.3g} and more, is only hard",
        ),
        (
            "active-wall",
            feeds,
            f"the resistance is negative, {least(z.real, feeds):.3g} at least: the wave gains energy at the wall, or "
            "is not the one assumed",
        ),
        (
            "model-misfit",
            poor,
            f"the waves leave up to {100 * most(residual, poor):.2g} % of the pressures, {misfit}, which draws take: "
            "there are other waves, or larger errors; compare ranks, margins and methods",
        ),
    ]
    found = [*duct_notes(result.line), *_lost_draws(result)]
    found += [_note(result, *row, size if row[0] == "model-misfit" else None) for row in rows if bool(row[1].any())]
    if choices.get("unsettled"):
        text = f"{choices['unsettled']} of {z.numel()} fits did not settle; their waves may not be the best"
        found.insert(0, Note("unsettled", f"{choices['source']}: {text}"))
    return tuple(found)


def field_notes(result: FieldFit, rigid: Tensor, hard: Tensor, gains: Tensor) -> Notes:
    """Of a fit of the field.

    Args:
        result: the fit.
        rigid, hard: whether a rigid wall lies within two, and within six standard errors, (..., F).
        gains: energy out and absorbed over that coming in where a wave feeds it, else 0, (..., F).
    """
    assert result.freedom is not None
    end, settled, z = result.end_reflection.abs(), result.converged, result.impedance
    feeds = (z.real < FEEDS) & ~(rigid & settled)
    poor, misfit = _misfit(result, largest_misfit(result.freedom, POOR / z[..., 0].numel()))
    rows = [
        ("unsettled", ~settled, "the fit did not settle; Z is the best one met"),
        (
            "model-misfit",
            poor,
            f"the residuals are {misfit}, which error bars take: duct, flow, far end or wall "
            f"({result.choices['wall']}) are not those of the measurement, or this is not the deepest minimum (start=)",
        ),
        (
            "rigid-wall",
            rigid & settled,
            "the microphones do not tell the liner from a rigid wall: the error of Z has no bound",
        ),
        (
            "near-rigid-wall",
            hard & ~rigid & settled,
            "a rigid wall is within 6 standard errors: those of 1/Z hold, those of Z are too small",
        ),
        ("active-wall", feeds, f"the resistance is {least(z.real, feeds):.3g}, below 0"),
        ("active-end", end > GAINS, f"the far end would reflect {most(end, end > GAINS):.3g} times what it gets"),
        (
            "growing-wave",
            gains > 0,
            f"the duct with this impedance gives back and absorbs {float(gains.max()):.3g} times the energy that comes "
            "in: a wave of its shear layer grows along the liner; compare other profiles of the flow",
        ),
    ]
    return (*(_note(result, *row) for row in rows if bool(row[1].any())), *_lost_draws(result))


def duct_notes(line: MicrophoneLine) -> Notes:
    """Higher modes of the rigid duct that carry sound."""
    notes = []
    for what, size in (("height", line.duct_height), ("width", line.duct_width)):
        if size is None:
            continue
        limit = cut_on_frequency(UniformProfile(abs(line.stated_mach), float(size), float(line.fluid.sound_speed)))
        above = line.frequency[line.frequency >= limit]
        if len(above):
            text = f"from {limit:.4g} Hz on the duct's {what}, {1e3 * float(size):g} mm, carries a higher mode"
            share = f"{len(above)} of {len(line.frequency)} frequencies from {float(above.min()):g} Hz on"
            notes.append(Note("higher-modes", f"{line.name}: {text}: {share}"))
    return tuple(notes)


def _misfit(result: WallEduction | FieldFit, limit: float) -> tuple[Tensor, str]:
    """Where the misfit is above a limit, (..., F), and what it says of the errors."""
    assert result.misfit is not None
    poor, choices = result.misfit > limit, result.choices
    level, phase = (most(used, poor) for used in result.used_errors)
    stated = f"times the {choices['level_error']:g} dB and {choices['phase_error']:g} degrees stated"
    limits = f"(limit {limit**0.5:.3g})"
    return (
        poor,
        f"{most(result.misfit, poor) ** 0.5:.3g} {stated} {limits}, as of {level:.2g} dB and {phase:.2g} degrees",
    )


def _lost_draws(result: WallEduction | FieldFit) -> Notes:
    if result.draws is None or not bool(result.failed.any()):
        return ()
    lost, count = int(result.failed.sum()), result.draws.impedance.numel()
    text = f"{lost} of {count} draws have no impedance and are left out of mean and interval"
    return (Note("lost-draws", f"{result.choices['source']}: {text}"),)


def _note(result: WallEduction | FieldFit, code: str, which: Tensor, said: str, size: float | None = None) -> Note:
    """Of a code that holds somewhere: how often, where first, and what; ``size``: how far Z may be off by it."""
    first = result.frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
    place = f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz"
    return Note(code, f"{result.choices['source']}: {place}, {said}", size)


def least(values: Tensor, which: Tensor) -> float:
    """Of some values; nan of none."""
    return float(values[which].min()) if bool(which.any()) else math.nan


def most(values: Tensor, which: Tensor) -> float:
    """Of some values; nan of none."""
    return -least(-values, which)
