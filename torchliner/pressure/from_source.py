r"""What the methods of single waves share: microphones seen from the source,
warnings (another side, other phases, a rigid wall).

With s the distance from the source's side the wave above the liner is :math:`e^{-j\alpha' s}`: for
a source upstream s = x and alpha' = alpha; for one downstream the array is read backwards, s = -x,
alpha' = -alpha, and the flow runs at -M along s. Either way the wave decays along s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEEDS, require_choice
from torchliner.duct.dispersion import cut_on_frequency, impedance_from_wavenumber
from torchliner.names import CONDITIONS, SOURCES
from torchliner.pressure.microphone_errors import require_draws
from torchliner.records import MicrophoneLine, WallEduction
from torchliner.version import __version__

LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
TURNS, DECAYS = 0.5, 0.1  # rad, neper over the array: a wave's direction can be told from more
LIKE_RIGID = 0.05  # rad or neper over the array, some times what 0.1 dB and 0.1 degrees tell
HARD = 10.0  # |Z|; a short array tells no softer wall from a rigid one either


@dataclass(frozen=True)
class FromSource:
    """A line seen from its source.

    Args:
        line: as recorded.  sign: 1 for a source upstream, -1 downstream.
        distance: s of the microphones from the first, m, (N,).
        pressure: Pa, (..., N, F), in the order of s.  mach: of the flow along s.
        margin: m that the microphones keep from the liner's ends.
    """

    line: MicrophoneLine
    sign: int
    distance: Tensor
    pressure: Tensor
    mach: float
    margin: float = 0.0

    @property
    def origin(self) -> float:
        """x of the microphone nearest the source, m."""
        return float(self.line.x[0 if self.sign == 1 else -1])

    @property
    def source_side(self) -> str:
        """``upstream`` or ``downstream``."""
        return SOURCES[self.sign == -1]


def seen_from_source(line: MicrophoneLine, source_side: str | None) -> FromSource:
    """The line along s.

    Args:
        line: microphones.  source_side: None for what the line says.
    Raises:
        ValueError: the side of the source or the Mach number is not known.
    """
    side = line.source_side if source_side is None else source_side
    if side not in SOURCES:
        raise ValueError(
            f"{line.name}: source_side is {side!r}; give 'upstream' or 'downstream': the array is "
            "read from the source on"
        )
    mach = line.stated_mach
    sign = 1 if side == "upstream" else -1
    x, pressure = sign * line.x, line.pressure
    if sign == -1:
        x, pressure = x.flip(0), pressure.flip(-2)
    return FromSource(line, sign, x - x[0], pressure, sign * mach)


def over_liner(
    line: MicrophoneLine, source_side: str | None, *, margin: float, condition: str, draws: int
) -> FromSource:
    """The microphones over the liner along s; arguments as of ``kumaresan_tufts``, checked."""
    require_choice("condition", condition, CONDITIONS)
    require_draws(draws)
    return replace(seen_from_source(line.over_liner(margin), source_side), margin=margin)


def wall_eduction(
    seen: FromSource, wave: Tensor, modes: Tensor, amplitude: Tensor, residual: Tensor,
    *, method: str, condition: str, choices: dict[str, Any],
    found: dict[str, Any] | None = None, **about: Any,
) -> WallEduction:  # fmt: skip
    """The record of waves along s, with the impedance of one of them.

    Args:
        seen: the line.  wave: alpha' of the wave whose impedance is wanted, (..., F); nan for none.
        modes, amplitude: of all waves, (..., F, K).  residual: (..., F).  method: for tables.
        condition: at the liner.  choices: the method's own.
        found: what the method notes beside them, last.  about: further fields of the record.
    """
    line, there = seen.line, ~torch.isnan(wave)
    impedance = impedance_from_wavenumber(
        torch.where(there, wave, 1 + 0j), line.frequency.to(wave.device), height=line.duct_height,
        mach=seen.mach, sound_speed=line.fluid.sound_speed, condition=condition,
    )  # fmt: skip
    return WallEduction(
        method=method,
        frequency=line.frequency,
        x=line.x,
        wavenumber=seen.sign * wave,
        impedance=torch.where(there, impedance, complex(math.nan, math.nan)),
        modes=seen.sign * modes.movedim(-1, -2),
        amplitudes=amplitude.movedim(-1, -2),
        origin=seen.origin,
        residual=residual,
        source_side=seen.source_side,
        choices={**choices, "condition": condition, "source_side": seen.source_side,
                 "margin": seen.margin, "source": line.name, "microphones": line.microphones,
                 "mach": line.stated_mach, "sound_speed": float(line.fluid.sound_speed),
                 "version": __version__, **(found or {})},
        line=line,
        **about,
    )  # fmt: skip


def runs_with_source(wavenumber: Tensor) -> Tensor:
    r"""Whether :math:`e^{-j\alpha' s}` counts as one that runs along s: Re alpha' > Im alpha'.

    Its phase runs along s and it does not grow along s as fast as it turns; or its phase runs
    against s, but it decays along s faster than it turns, so that its phase tells nothing.
    """
    return wavenumber.real > wavenumber.imag


def duct_notes(line: MicrophoneLine) -> tuple[str, ...]:
    """Higher modes of the rigid duct that carry sound."""
    notes = []
    speed, mach = float(line.fluid.sound_speed), line.stated_mach
    for what, size in (("height", line.duct_height), ("width", line.duct_width)):
        limit = math.inf if size is None else cut_on_frequency(float(size), mach, speed)
        above = line.frequency[line.frequency >= limit]
        if len(above) and size is not None:
            notes.append(
                f"{line.name}: from {limit:.4g} Hz on the duct's {what}, {1e3 * float(size):g} mm, "
                f"carries a higher mode (M = {mach:g}), so at {len(above)} of "
                f"{len(line.frequency)} frequencies from {float(above.min()):g} Hz on one wave may "
                "not be all there is"
            )
    return tuple(notes)


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
            f"{name}: {where_of(low, result.frequency)} the wave that runs away from a source "
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
            f"{name}: {where_of(against, result.frequency)} the phase of the strongest wave runs "
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
        f"{choices['source']}: {where_of(near, result.frequency)} the wavenumber is that of a rigid "
        f"duct's wave within {float(off[near].max()):.2g} rad over the array: the wall looks "
        f"rigid, and the impedance, |Z| {least:.3g} and more, says only that it is hard (or that "
        "height, Mach number or sound speed are not those stated)",
    )


def where_of(which: Tensor, frequency: Tensor) -> str:
    """'at 2 of 5 values, first at 600 Hz,'."""
    first = frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
    return f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz,"
