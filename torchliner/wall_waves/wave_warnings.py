"""What the waves found say against themselves: another side, other phases, a rigid wall."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.checks import FEEDS
from torchliner.records import WallEduction

LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
TURNS, DECAYS = 0.5, 0.1  # rad, neper over the array: a wave's direction can be told from more
LIKE_RIGID = 0.05  # rad or neper over the array, some times what 0.1 dB and 0.1 degrees tell
HARD = 10.0  # |Z|; a short array tells no softer wall from a rigid one either


def wave_warnings(result: WallEduction) -> tuple[str, ...]:
    """Sentences on a result, none where it is as it should be."""
    return (*_direction_notes(result), *_rigid_notes(result),
            *resistance_notes(result, result.choices["source"]))  # fmt: skip


def resistance_notes(result: WallEduction, name: str) -> tuple[str, ...]:
    """Where the wall would feed sound."""
    active = result.impedance.real < FEEDS
    if not bool(active.any()):
        return ()
    return (
        f"{name}: the resistance is negative at {int(active.sum())} of {active.numel()} values, "
        f"{float(result.impedance.real[active].min()):.3g} at least: the wave found gains energy "
        "at the wall, or is not the one assumed",
    )


def _direction_notes(result: WallEduction) -> tuple[str, ...]:
    """The wave kept is not the strongest: another source side, or conjugated phases."""
    share, name = result.energy_share, result.choices["source"]
    low = share < LEAST_SHARE
    notes = []
    if bool(low.any()):
        notes.append(
            f"{name}: {_where(low, result.frequency)} the wave that runs away from a source "
            f"{result.source_side} holds {float(share[low].min()):.2g} of the energy of the "
            f"strongest wave at worst (about 1 where all is right, warned of below "
            f"{LEAST_SHARE:g}): the source may be on the other side (source_side), or phases be "
            "those of exp(-j omega t)"
        )
    strongest = result.energies.argmax(-2, keepdim=True)
    wave = result.modes.gather(-2, strongest)[..., 0, :]
    length = float(result.x[-1] - result.x[0])
    turn, decay = wave.real * length, wave.imag * length
    # exp(-j alpha x) of a decaying wave has Re alpha and Im alpha of opposite signs.
    against = (turn * decay > 0) & (decay.abs() > DECAYS) & (turn.abs() > TURNS)
    against &= turn.abs() > decay.abs()
    if 2 * int(against.sum()) > against.numel():
        first = wave[against][0]
        notes.append(
            f"{name}: {_where(against, result.frequency)} the phase of the strongest wave runs "
            f"towards where it grows (alpha {float(first.real):.4g}{float(first.imag):+.4g}j): the "
            "phases look conjugated, exp(-j omega t) for the exp(+j omega t) that is needed"
        )
    return tuple(notes)


def _rigid_notes(result: WallEduction) -> tuple[str, ...]:
    """Nothing but a bound of \\|Z\\| where the wave is that of a rigid duct."""
    choices = result.choices
    sign = 1 if result.source_side == "upstream" else -1
    k = 2 * torch.pi * result.frequency / choices["sound_speed"]
    rigid = (sign * k / (1 + sign * choices["mach"])).to(result.wavenumber.device)
    off = (result.wavenumber - rigid).abs() * float(result.x[-1] - result.x[0])
    near = (off < LIKE_RIGID) & (result.impedance.abs() > HARD)
    if not bool(near.any()):
        return ()
    least = float(result.impedance.abs()[near].min())
    return (
        f"{choices['source']}: {_where(near, result.frequency)} the wavenumber is that of a rigid "
        f"duct's wave within {float(off[near].max()):.2g} rad over the array: the wall looks "
        f"rigid, and the impedance, |Z| {least:.3g} and more, says only that it is hard (or that "
        "height, Mach number or sound speed are not those stated)",
    )


def _where(which: Tensor, frequency: Tensor) -> str:
    """'at 2 of 5 values, first at 600 Hz,'."""
    first = frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
    return f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz,"
