"""Plane waves both ways in a rigid duct, from flush microphones: the level that meets a liner.

The waves and their least squares are those of ``wave_decomposition`` with the flow along the
microphones: its wave towards smaller y, at c (1 - M), is here the one that runs upstream, its wave
towards larger y the one that runs downstream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from torchliner.checks import tell
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.pressure.from_source import duct_notes, seen_from_source
from torchliner.pressure.plane_waves import LARGE_CONDITION, split_waves
from torchliner.records import MicrophoneLine


@dataclass(frozen=True, eq=False)
class SortedWaves:
    """Plane waves of a rigid section.

    Args:
        frequency: Hz, (F,).
        downstream, upstream: peak amplitudes of the waves that run there, at ``at``, Pa, complex,
            (..., F).
        at: x, m.  source_side: which of them is the incident one.
        residual: rms of what they leave over that of the pressures, (..., F); nan for two
            microphones, which two waves always fit.
        condition: condition number of the equations, (F,).  microphones: x of those used, m, (M,).
        notes: warnings, with numbers.
    """

    frequency: Tensor
    downstream: Tensor
    upstream: Tensor
    at: float
    source_side: str
    residual: Tensor
    condition: Tensor
    microphones: Tensor
    notes: tuple[str, ...] = ()

    @property
    def incident(self) -> Tensor:
        """Of the wave from the source, Pa, (..., F)."""
        return self.downstream if self.source_side == "upstream" else self.upstream

    @property
    def incident_level(self) -> Tensor:
        """SPL of the wave from the source, dB, (..., F)."""
        return spl_from_pressure_amplitude(self.incident)

    @property
    def reflection(self) -> Tensor:
        """Wave towards the source over the one from it, at ``at``, (..., F)."""
        back = self.upstream if self.source_side == "upstream" else self.downstream
        return back / self.incident


def sort_waves(
    line: MicrophoneLine, microphones: Sequence[int] | None = None, *, at: float | None = None,
    source_side: str | None = None,
) -> SortedWaves:  # fmt: skip
    """Waves both ways from two flush microphones or more in the rigid duct.

    Args:
        line: microphones.
        microphones: indices; default all that stand before the liner, seen from the source.
        at: x to which the amplitudes refer, m; default the liner's end nearest the source, or the
            microphone nearest to it.
        source_side: ``upstream`` or ``downstream``; default what the line says.
    Raises:
        ValueError: fewer than two microphones, microphones that coincide or are half a wavelength
            apart, no known side of the source, a place that is not finite.
    Warns:
        DataWarning: badly conditioned, or higher modes cut on; the same text is in ``notes``.
    """
    seen = seen_from_source(line, source_side)
    edge = line.liner_start if seen.sign == 1 else line.liner_end
    if microphones is None and edge is None:
        raise ValueError(
            f"{line.name} does not say where its liner is; name the microphones of the rigid duct "
            "or give liner_start and liner_end"
        )
    if microphones is None:
        before = (edge - line.x) * seen.sign > 0
        microphones = before.nonzero()[:, 0].tolist()
        if len(microphones) < 2:
            raise ValueError(
                f"{line.name}: {len(microphones)} microphones stand before the liner, seen from a "
                f"source {seen.source_side}; two are needed to sort the waves"
            )
    some = line.select(microphones)
    place = edge if at is None else at
    if place is None:
        place = float(some.x[-1 if seen.sign == 1 else 0])
    if not math.isfinite(place):
        raise ValueError(f"at is {place:g} m; it must be finite")
    there = some.pressure.device
    waves, residual, condition = split_waves(
        some.pressure, (some.x - place).to(there), line.frequency.to(there),
        float(line.fluid.sound_speed), line.stated_mach,
    )  # fmt: skip
    notes, worst = duct_notes(line), int(condition.argmax())
    if float(condition[worst]) > LARGE_CONDITION:
        notes += (
            f"{line.name}: the microphones of the rigid duct have a condition number of "
            f"{float(condition[worst]):.3g} at {float(line.frequency[worst]):g} Hz; errors of the "
            "pressures grow by it",
        )
    tell(notes)
    return SortedWaves(
        line.frequency, waves[..., 1, :], waves[..., 0, :], place, seen.source_side, residual,
        condition, some.x, notes,
    )  # fmt: skip
