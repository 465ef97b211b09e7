r"""Plane waves between microphones and a surface: incident, reflected, and the impedance at y = 0.

y is the distance from the surface. A wave exp(j omega t + j k+ y) runs towards it, exp(j omega t -
j k- y) away from it, so

.. math:: p(y) = A e^{+jk_+y} + B e^{-jk_-y}, \quad R = B/A, \quad Z = (1 + R)/(1 - R).

With a mean flow of Mach number M along +y, away from the surface, the incident wave makes its way
against it at c (1 - M) and the reflected one with it at c (1 + M): k+ = k/(1 - M), k- = k/(1 + M).
In each wave p = -+ rho c v holds whatever the uniform M, v along +y, so the velocity into the
surface is v_in = (A e^{jk_+y} - B e^{-jk_-y})/(rho c), and Z follows as without flow.

Two microphones s apart determine A and B unless sin((k+ + k-) s/2) = 0: spacings of a multiple of
half a wavelength, n (1 - M^2) lambda/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import tell, whole_number
from torchliner.conversions import impedance_from_reflection, spl_from_pressure_amplitude
from torchliner.pressure.dean import frequencies_of
from torchliner.pressure.in_situ_intervals import (
    LEVEL,
    few_blocks_note,
    require_level,
    wave_interval,
)
from torchliner.pressure.plane_waves import LARGE_CONDITION, best_pair, split_waves
from torchliner.records import Interval, PressureRecord
from torchliner.records.pressure_record import require_record
from torchliner.signals.transfer import segment_amplitudes, transfer_from_amplitudes

BIAS = 0.05  # of R: what two waves leave, times the condition number


@dataclass(frozen=True, eq=False)
class WaveDecomposition:
    """Plane waves in front of a surface.

    Args:
        name: of the method, for tables.  frequency: Hz, (F,).
        reflection: R at y = 0, complex128, (F,).
        incident: rms over the segments of the incident wave's peak amplitude at y = 0, Pa, (F,).
        residual: rms of what the two waves leave over that of the pressures, (F,); nan for two
            pressures, or one with its velocity, which two waves always fit.
        condition: condition number of the equations, (F,): errors of the microphones grow by it.
        microphones: indices of those that were used.  notes: warnings, with numbers.
        interval: statistical, of Z, (F,), because the record is finite; None without any.
    """

    name: str
    frequency: Tensor
    reflection: Tensor
    incident: Tensor
    residual: Tensor
    condition: Tensor
    microphones: tuple[int, ...]
    notes: tuple[str, ...] = ()
    interval: Interval | None = None

    @property
    def impedance(self) -> Tensor:
        """Z at y = 0, (F,)."""
        return impedance_from_reflection(self.reflection)

    @property
    def incident_level(self) -> Tensor:
        """dB re 20 uPa rms, (F,)."""
        return spl_from_pressure_amplitude(self.incident)


def decompose_waves(
    record: PressureRecord, frequency: Any = None, *, microphones: Sequence[int] | str = "all",
    velocities: bool = False, window: Any = "hann", segment: float | None = None,
    start: float = 0.0, allow_short: bool = False, interval: float | None = LEVEL,
) -> WaveDecomposition:  # fmt: skip
    """Reflection and impedance at y = 0 from microphones in front of the surface.

    Over several segments R is the H1 estimate with the incident wave as the input.

    Args:
        record: with microphones.  frequency: Hz, one or several; default the record's own tone.
        microphones: indices, ``all``, or ``pair``: the two best conditioned.
        velocities: use the velocities at the microphones as well.
        window, segment, start, allow_short, interval: as for ``in_situ``.
    Raises:
        ValueError: microphones are missing, too few, coincide or are half a wavelength apart; one
            has no pressure; the record is too short; a frequency is at or above Nyquist.
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

    fluid = record.fluid
    signals = [record.microphones[chosen]]
    if velocities:
        # Stored along +y, away from the surface; the waves' velocity is that into it.
        velocity = record.microphone_velocity[chosen].to(torch.float64)
        signals.append(-fluid.characteristic_impedance * velocity)
    pressure, *inward = (segment_amplitudes(signal, wanted, record.sampling_rate, **options) for signal in signals)
    if not bool((pressure.abs().amax(0) > 0).all()):
        first = chosen[int((pressure.abs().amax(0) == 0).any(-1).nonzero()[0])]
        raise ValueError(f"{record.name}: the pressure of microphone {first} is zero; leave it out")
    places = record.microphone_y[chosen]
    waves, residual, condition = split_waves(
        pressure, places, wanted, fluid.sound_speed, record.microphone_mach, *inward
    )
    spread = residual.square().mean(0).sqrt()
    name = f"waves, {len(chosen)} microphones" + (" with velocities" if velocities else "")
    reflection = transfer_from_amplitudes(waves[:, 0], waves[:, 1]).response
    bounds = wave_interval(record, signals, wanted, places, options, interval)
    notes = _notes(record, name, wanted, places, spread, condition)
    if record.facesheet is None:  # else the in situ method says it
        notes += few_blocks_note(f"{record.name}: {name}", bounds, interval)
    tell(notes)
    return WaveDecomposition(
        name=name, frequency=wanted, reflection=reflection,
        incident=2 * waves[:, 0].abs().square().mean(0).sqrt(), residual=spread,
        condition=condition, microphones=tuple(chosen), notes=tuple(notes), interval=bounds,
    )  # fmt: skip


def _chosen(record: PressureRecord, microphones: Sequence[int] | str, frequency: Tensor) -> list[int]:
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


def _notes(
    record: PressureRecord, name: str, frequency: Tensor, places: Tensor, residual: Tensor,
    condition: Tensor,
) -> list[str]:  # fmt: skip
    notes = []
    bias = residual * condition
    bad, poor = int(condition.argmax()), int(bias.argmax())
    if float(condition[bad]) > LARGE_CONDITION:
        span = 1e3 * float(places.max() - places.min())
        notes.append(
            f"{record.name}: {name} over {span:.3g} mm have a condition number of "
            f"{float(condition[bad]):.3g} at {float(frequency[bad]):g} Hz; errors of the pressures "
            "grow by it"
        )
    if float(bias[poor]) > BIAS:
        notes.append(
            f"{record.name}: {name}: two plane waves leave {100 * float(residual[poor]):.2g} % of "
            f"the signals at {float(frequency[poor]):g} Hz; there is more than these (vortices, "
            f"turbulence), and R may be off by {float(bias[poor]):.2g}"
        )
    return notes
