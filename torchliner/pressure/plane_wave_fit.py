"""Reflection and level from microphones: in front of a surface, and flush with the wall of a rigid duct.

In a duct the flow runs along the microphones: of the waves of ``plane_waves`` the one towards smaller y, at c (1 - M),
is the one that runs upstream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell, whole_number
from torchliner.conversions import impedance_from_reflection, spl_from_pressure_amplitude
from torchliner.engine.intervals import FROM_REFLECTION
from torchliner.pressure.from_source import seen_from_source
from torchliner.pressure.plane_waves import best_pair, condition_notes, split_waves
from torchliner.pressure.time_blocks import LEVEL, few_blocks_notes, frequencies_of, require_level, time_intervals
from torchliner.pressure.wave_notes import duct_notes
from torchliner.records import Interval, MicrophoneLine, PressureRecord
from torchliner.records.notes import Note
from torchliner.records.pressure_record import require_record
from torchliner.tones import segment_amplitudes, transfer_from_amplitudes

BIAS = 0.05  # of R: what two waves leave, times the condition number


@dataclass(frozen=True, eq=False)
class PlaneWaves:
    """A wave towards a surface, or from a source, and the one that comes back.

    Args:
        name: of the method, for tables.
        frequency: Hz, (F,).
        incident: peak amplitude at ``at``, Pa, (..., F); its rms over segments, where there are some.
        reflection: of the wave that comes back over it, complex128, (..., F).
        at: y or x, m.
        residual: rms of what the two waves leave over that of the pressures, (..., F); nan for two pressures, or one
            with its velocity, which two waves always fit.
        condition: condition number of the equations, (F,): errors of the microphones grow by it.
        microphones: y or x of those that were used, m, (M,).
        notes: warnings, with numbers.
        interval: statistical, of Z, (F,), because the record is finite; None without any.
    """

    name: str
    frequency: Tensor
    incident: Tensor
    reflection: Tensor
    at: float
    residual: Tensor
    condition: Tensor
    microphones: Tensor
    notes: tuple[Note, ...] = ()
    interval: Interval | None = None

    @property
    def impedance(self) -> Tensor:
        """Z of a surface at ``at``, (..., F)."""
        return impedance_from_reflection(self.reflection)

    @property
    def incident_level(self) -> Tensor:
        """dB re 20 uPa rms, (..., F)."""
        return spl_from_pressure_amplitude(self.incident)


def decompose_waves(
    record: PressureRecord,
    frequency: Any = None,
    *,
    microphones: Sequence[int] | str = "all",
    velocities: bool = False,
    window: Any = "hann",
    segment: float | None = None,
    start: float = 0.0,
    allow_short: bool = False,
    interval: float | None = LEVEL,
) -> PlaneWaves:
    """Reflection and impedance at y = 0 from microphones in front of the surface.

    Over several segments R is the H1 estimate with the incident wave as the input.

    Args:
        record: with microphones.
        frequency: Hz, one or several; default the record's own tone.
        microphones: indices, ``all``, or ``pair``: the two best conditioned.
        velocities: use the velocities at the microphones as well.
        window, segment, start, allow_short, interval: as for ``in_situ``.
    Raises:
        ValueError: microphones are missing, too few, coincide or are half a wavelength apart; one has no pressure; the
            record is too short; a frequency is at or above Nyquist.
    Warns:
        DataWarning: badly conditioned, or not two plane waves; the same text is in ``notes``.
    """
    require_record(record)
    if record.microphones is None:
        raise ValueError(f"{record.name} has no microphones; the decomposition needs two or more")
    if velocities and record.microphone_velocity is None:
        raise ValueError(f"{record.name} has no microphone_velocity; leave velocities out")
    require_level(interval)
    wanted = frequencies_of(record, frequency, start, allow_short)
    chosen = _chosen(record, microphones, wanted)
    options: dict[str, Any] = {"window": window, "segment": segment, "start": start}

    fluid, places, signals = record.fluid, record.microphone_y[chosen], [record.microphones[chosen]]
    if velocities:
        # Stored along +y, away from the surface; the waves' velocity is that into it.
        velocity = record.microphone_velocity[chosen].to(torch.float64)
        signals.append(-fluid.characteristic_impedance * velocity)
    pressure, *inward = (segment_amplitudes(signal, wanted, record.sampling_rate, **options) for signal in signals)
    silent = (pressure.abs().amax(0) == 0).any(-1)
    if bool(silent.any()):
        first = chosen[int(silent.nonzero()[0])]
        raise ValueError(f"{record.name}: the pressure of microphone {first} is zero; leave it out")

    def split(hertz: Tensor, *amplitudes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return split_waves(amplitudes[0], places, hertz, fluid.sound_speed, record.microphone_mach, *amplitudes[1:])

    waves, left, condition = split(wanted, pressure, *inward)
    residual = left.square().mean(0).sqrt()
    intervals = time_intervals(
        signals,
        wanted,
        record.sampling_rate,
        options,
        interval,
        lambda blocks, f: {"": (blocks.h1(*split(wanted[f, None], *blocks.amplitudes)[0].unbind(1)), FROM_REFLECTION)},
    )
    bounds = intervals and intervals[0][""]
    name = f"waves, {len(chosen)} microphones" + (" with velocities" if velocities else "")
    notes = condition_notes(f"{record.name}: {name}", wanted, condition)
    bias = residual * condition
    poor = int(bias.argmax())
    if float(bias[poor]) > BIAS:
        text = (
            f"{record.name}: {name}: two plane waves leave {100 * float(residual[poor]):.2g} % of the signals at "
            f"{float(wanted[poor]):g} Hz; there is more (vortices, turbulence), and R may be off by "
            f"{float(bias[poor]):.2g}"
        )
        notes.append(Note("other-waves", text))
    if record.facesheet is None:  # else the in situ method says it
        notes += few_blocks_notes(f"{record.name}: {name}", bounds, interval)
    tell([str(note) for note in notes])
    return PlaneWaves(
        name,
        wanted,
        2 * waves[:, 0].abs().square().mean(0).sqrt(),
        transfer_from_amplitudes(waves[:, 0], waves[:, 1]).response,
        0.0,
        residual,
        condition,
        places,
        tuple(notes),
        bounds,
    )


def _chosen(record: PressureRecord, microphones: Sequence[int] | str, frequency: Tensor) -> list[int]:
    """Indices of the microphones that are used."""
    count = len(record.microphone_y)
    if microphones == "pair" and count > 1:
        speed, mach = record.fluid.sound_speed, record.microphone_mach
        return list(best_pair(record.microphone_y, frequency, speed, mach))
    if isinstance(microphones, str):
        if microphones not in ("all", "pair"):
            raise ValueError(f"microphones is {microphones!r}; give indices, 'all' or 'pair'")
        return list(range(count))
    chosen = [whole_number("microphones", i) for i in microphones]
    wrong = [i for i in chosen if not 0 <= i < count]
    if wrong:
        raise ValueError(f"{record.name} has microphones 0 to {count - 1}, not {wrong[0]}")
    return chosen


def sort_waves(
    line: MicrophoneLine,
    microphones: Sequence[int] | None = None,
    *,
    at: float | None = None,
    source_side: str | None = None,
) -> PlaneWaves:
    """Waves both ways from two flush microphones or more in the rigid duct: the level that meets a liner.

    Args:
        line: microphones.
        microphones: indices; default all that stand before the liner, seen from the source.
        at: x to which the amplitudes refer, m; default the liner's end nearest the source, or the microphone nearest to
            it.
        source_side: ``upstream`` or ``downstream``; default what the line says.
    Raises:
        ValueError: fewer than two microphones, microphones that coincide or are half a wavelength apart, no known side
            of the source, a place that is not finite.
    Warns:
        DataWarning: badly conditioned, or higher modes cut on; the same text is in ``notes``.
    """
    seen = seen_from_source(line, source_side)
    edge = line.liner_start if seen.sign == 1 else line.liner_end
    if microphones is None:
        if edge is None:
            raise ValueError(
                f"{line.name} does not say where its liner is; name the microphones of the rigid duct or give "
                "liner_start and liner_end"
            )
        microphones = ((edge - line.x) * seen.sign > 0).nonzero()[:, 0].tolist()
        if len(microphones) < 2:
            raise ValueError(
                f"{line.name}: {len(microphones)} microphones stand before the liner, seen from a source "
                f"{seen.source_side}; two are needed to sort the waves"
            )
    some = line.select(microphones)
    place = next(x for x in (at, edge, float(some.x[-1 if seen.sign == 1 else 0])) if x is not None)
    if not math.isfinite(place):
        raise ValueError(f"at is {place:g} m; it must be finite")
    there = some.pressure.device
    waves, residual, condition = split_waves(
        some.pressure,
        (some.x - place).to(there),
        some.frequency.to(there),
        float(some.fluid.sound_speed),
        some.stated_mach,
    )
    upstream, downstream = waves.unbind(-2)
    incident, back = (downstream, upstream) if seen.sign == 1 else (upstream, downstream)
    name = f"{line.name}: the microphones of the rigid duct"
    notes = (*duct_notes(line), *condition_notes(name, line.frequency, condition))
    tell([str(note) for note in notes])
    return PlaneWaves(
        "sorted waves", line.frequency, incident, back / incident, place, residual, condition, some.x, notes
    )
