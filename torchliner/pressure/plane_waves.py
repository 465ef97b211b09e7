r"""Pressures at several places split into two plane waves, one towards a surface and one away from it.

With y the distance from the surface and a mean flow of Mach number M along +y,

.. math:: p(y) = A e^{+jk_+y} + B e^{-jk_-y}, \quad k_\pm = \frac{k}{1 \mp M}, \quad R = B/A, \quad
    Z = (1 + R)/(1 - R), \quad \rho c\,v_{in} = A e^{jk_+y} - B e^{-jk_-y}.

Two microphones s apart determine A and B unless sin((k+ + k-) s/2) = 0. Along the wall of a rigid duct the wave towards
smaller y, at c (1 - M), is the one that runs upstream.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell, whole_number
from torchliner.conversions import impedance_from_reflection, spl_from_pressure_amplitude
from torchliner.duct.dispersion import higher_mode_notes
from torchliner.engine.intervals import FROM_REFLECTION
from torchliner.pressure.least_squares import solve_linear
from torchliner.pressure.tones import Tones
from torchliner.pressure.waves import seen_from_source
from torchliner.records import Interval, MicrophoneLine, PressureRecord
from torchliner.records.notes import Note

BIAS = 0.05  # of R: what two waves leave, times the condition number
SINGULAR = 1e3  # condition number: three digits of every pressure are lost
LARGE_CONDITION = 20.0


@dataclass(frozen=True, eq=False)
class PlaneWaves:
    """A wave towards a surface, or from a source, and the one that comes back.

    Args:
        name: of the method, for tables.
        frequency: Hz, (F,).
        incident: peak amplitude at ``at``, Pa, (..., F); its rms over segments, where there are some.
        reflection: of the wave that comes back over it, complex128, (..., F).
        at: y or x, m.
        residual: rms of what the two waves leave over that of the pressures, (..., F); nan for two equations.
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
    **cut: Any,
) -> PlaneWaves:
    """Reflection and impedance at y = 0 from microphones in front of the surface.

    Over several segments R is the H1 estimate with the incident wave as the input.

    Args:
        record: with microphones.
        frequency: Hz, one or several; default the record's own tone.
        microphones: indices, ``all``, or ``pair``: the two best conditioned.
        velocities: use the velocities at the microphones as well.
        cut: ``window``, ``segment``, ``start``, ``allow_short`` and ``interval``, as of ``pressure.tones.Tones``.
    Raises:
        ValueError: as ``Tones``; microphones are missing, too few or half a wavelength apart; one has no pressure.
    Warns:
        DataWarning: badly conditioned, or not two plane waves; the same text is in ``notes``.
    """
    tones = Tones(record, frequency, **cut)
    if record.microphones is None or (velocities and record.microphone_velocity is None):
        missing = "microphones" if record.microphones is None else "microphone_velocity"
        raise ValueError(f"{record.name} has no {missing}; splitting the waves needs it")
    chosen, rho_c = _chosen(record, microphones, tones.frequency), record.fluid.characteristic_impedance
    places, signals = record.microphone_y[chosen], record.microphones[chosen]
    y, sign, count = places, torch.ones(len(chosen)), len(chosen)
    if velocities:  # stored along +y, away from the surface; the waves' velocity is that into it
        signals = torch.cat([signals, -rho_c * record.microphone_velocity[chosen].to(torch.float64)])
        y, sign = places.repeat(2), torch.cat([sign, -sign])
    made, each = [], []
    for hertz in tones.frequency[:, None]:
        parts, about = tones.parts("microphone", signals, hertz), (hertz, record.fluid.sound_speed, y, sign)
        waves, left, condition = split_waves(parts.segments, *about, record.microphone_mach)
        inside, _, _ = split_waves(parts.amplitudes, *about, record.microphone_mach)
        reflection = parts.h1(*inside.unbind(1))
        each.append((2 * waves[:, 0].abs().square().mean(0).sqrt(), left.square().mean(0).sqrt(), condition))
        made.append((parts, {"": (reflection, FROM_REFLECTION)}))
    size, residual, condition = (torch.cat(values) for values in zip(*each, strict=True))
    found = tones.results(made)[0][""]
    name = f"waves, {count} microphones" + (" with velocities" if velocities else "")
    notes = condition_notes(f"{record.name}: {name}", tones.frequency, condition)
    bias, poor = (residual * condition).nan_to_num(0.0).max(0)
    if float(bias) > BIAS:
        share = f"{100 * float(residual[poor]):.2g} % of the signals at {float(tones.frequency[poor]):g} Hz"
        text = f"{share}; the signals hold more (vortices, turbulence), and R may be off by {float(bias):.2g}"
        notes.append(Note("other-waves", f"{record.name}: {name}: two plane waves leave {text}"))
    if record.facesheet is None:  # else the in situ method says it
        notes += tones.few_blocks_notes(name, found)
    tell([str(note) for note in notes])
    rest = (0.0, residual, condition, places, tuple(notes), found.interval)
    return PlaneWaves(name, tones.frequency, size, found.reflection, *rest)


def _chosen(record: PressureRecord, microphones: Sequence[int] | str, frequency: Tensor) -> list[int]:
    """Indices of the microphones that are used; of a pair the two best conditioned at their worst frequency."""
    places, count = record.microphone_y, len(record.microphone_y)
    if not isinstance(microphones, str):
        chosen = [whole_number("microphones", i) for i in microphones]
        if wrong := [i for i in chosen if not 0 <= i < count]:
            raise ValueError(f"{record.name} has microphones 0 to {count - 1}, not {wrong[0]}")
        return chosen
    if require_choice("microphones", microphones, ("all", "pair")) == "all" or count < 2:
        return list(range(count))
    mean = 2 * torch.pi * frequency / record.fluid.sound_speed / (1 - record.microphone_mach**2)  # of k+ and k-
    pairs = [list(pair) for pair in combinations(range(count), 2)]
    return max(pairs, key=lambda pair: float(torch.sin(mean * places[pair].diff()).abs().min()))


def sort_waves(line: MicrophoneLine) -> PlaneWaves:
    """Waves both ways from flush microphones in the rigid duct: the level that meets a liner, at its end nearest the
    source.

    Args:
        line: microphones; those that stand before the liner, seen from the source, are used.
    Raises:
        ValueError: fewer than two microphones or half a wavelength apart, no known side of the source or liner.
    Warns:
        DataWarning: badly conditioned, or higher modes cut on; the same text is in ``notes``.
    """
    seen = seen_from_source(line)
    edge = line.liner_start if seen.sign == 1 else line.liner_end
    if edge is None:
        raise ValueError(f"{line.name} does not say where its liner is; give liner_start and liner_end")
    before = ((edge - line.x) * seen.sign > 0).nonzero()[:, 0]
    if len(before) < 2:
        there = f"{len(before)} microphones stand before the liner, seen from a source {line.source_side}"
        raise ValueError(f"{line.name}: {there}; two are needed to sort the waves")
    some = line.select(before)
    waves, residual, condition = split_waves(
        some.pressure, line.frequency, float(line.fluid.sound_speed), some.x - edge, mach=line.stated_mach
    )
    back, incident = waves.unbind(-2)[:: seen.sign]
    notes = (*higher_mode_notes(line), *condition_notes(f"{line.name}: the microphones", line.frequency, condition))
    tell([str(note) for note in notes])
    found = (incident, back / incident, edge, residual, condition, some.x, notes)
    return PlaneWaves("sorted waves", line.frequency, *found)


def split_waves(
    measured: Tensor, frequency: Tensor, sound_speed: float, places: Tensor, sign: Any = 1.0, mach: float = 0.0
) -> tuple[Tensor, Tensor, Tensor]:
    """Least-squares amplitudes of the two waves from complex pressures, Pa, (..., M, F), at ``places`` y, m, (M,).

    ``sign``: 1, or -1 where rho c v_in is measured, Pa, v_in towards the surface, (M,). ``mach`` is of the mean flow
    away from the surface. Returns A and B at y = 0, (..., 2, F); the relative residual, (..., F), nan for two
    equations; the condition number, (F,). For M = 0 and two microphones this is ISO 10534-2.
    """
    if len(places) < 2:
        raise ValueError(f"microphones: {len(places)} given; two waves need at least two")
    frequency, places = (each.to(measured.device) for each in (frequency, places))
    turn = 2j * torch.pi / sound_speed * frequency[:, None] * places
    rows = torch.stack([torch.exp(turn / (1 - mach)), sign * torch.exp(-turn / (1 + mach))], -1)
    values = torch.linalg.svdvals(rows)
    condition = values[:, 0] / values[:, 1].clamp(min=1e-300)
    worst = int(condition.argmax())
    if float(condition[worst]) >= SINGULAR:
        half = sound_speed * (1 - mach**2) / (2 * float(frequency[worst]))
        span = float(places.max() - places.min())
        apart = f"their spacing is {span / half:.4g} times half a wavelength, {1e3 * half:.4g} mm"
        where = f"microphones {1e3 * span:.4g} mm apart are singular at {float(frequency[worst]):g} Hz"
        raise ValueError(f"{where}: {apart}; take another frequency or another pair")
    right = measured.movedim(-1, -2).to(torch.complex128)  # (..., F, M)
    _, waves, left = solve_linear(rows, right)
    residual = left.norm(dim=-1) / right.norm(dim=-1).clamp(min=1e-300)
    return waves.movedim(-1, -2), residual if len(places) > 2 else torch.full_like(residual, torch.nan), condition


def condition_notes(name: str, frequency: Tensor, condition: Tensor) -> list[Note]:
    """Microphones whose errors grow."""
    most, worst = condition.max(0)
    if float(most) <= LARGE_CONDITION:
        return []
    text = f"a condition number of {float(most):.3g} at {float(frequency[worst]):g} Hz"
    return [Note("ill-conditioned", f"{name} have {text}; errors of the pressures grow by it")]
