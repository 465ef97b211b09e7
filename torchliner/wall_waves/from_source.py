r"""A line of microphones seen from its source, and what makes a duct doubtful for one wave.

With s the distance from the source's side the wave above the liner is :math:`e^{-j\alpha' s}`: for
a source upstream s = x and alpha' = alpha; for one downstream the array is read backwards, s = -x,
alpha' = -alpha, and the flow runs at -M along s. Either way the wave decays along s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchliner.duct.dispersion import cut_on_frequency
from torchliner.records import MicrophoneLine, WallEduction
from torchliner.signals.microphone_errors import draw_pressures

SIDES = {"upstream": 1, "downstream": -1}


@dataclass(frozen=True)
class FromSource:
    """A line seen from its source.

    Args:
        line: as recorded.
        sign: 1 for a source upstream, -1 downstream.
        distance: s of the microphones from the first, m, (N,).
        pressure: Pa, (..., N, F), in the order of s.
        mach: of the flow along s.
    """

    line: MicrophoneLine
    sign: int
    distance: Tensor
    pressure: Tensor
    mach: float

    @property
    def origin(self) -> float:
        """x of the microphone nearest the source, m."""
        return float(self.line.x[0 if self.sign == 1 else -1])

    @property
    def source_side(self) -> str:
        """``upstream`` or ``downstream``."""
        return "upstream" if self.sign == 1 else "downstream"


def seen_from_source(line: MicrophoneLine, source_side: str | None) -> FromSource:
    """The line along s.

    Args:
        line: microphones.
        source_side: None for what the line says.
    Raises:
        ValueError: the side of the source is not known.
    """
    side = line.source_side if source_side is None else source_side
    if side not in SIDES:
        raise ValueError(
            f"{line.name}: source_side is {side!r}; give 'upstream' or 'downstream': the array is "
            "read from the source on"
        )
    sign = SIDES[side]
    x, pressure = sign * line.x, line.pressure
    if sign == -1:
        x, pressure = x.flip(0), pressure.flip(-2)
    return FromSource(line, sign, x - x[0], pressure, sign * float(line.mach))


def runs_with_source(wavenumber: Tensor) -> Tensor:
    r"""Whether :math:`e^{-j\alpha' s}` counts as one that runs along s: Re alpha' > Im alpha'.

    Its phase runs along s and it does not grow along s as fast as it turns; or its phase runs
    against s, but it decays along s faster than it turns, so that its phase tells nothing.
    """
    return wavenumber.real > wavenumber.imag


def duct_notes(line: MicrophoneLine) -> tuple[str, ...]:
    """Higher modes of the rigid duct that carry sound."""
    notes = []
    speed, mach = float(line.fluid.sound_speed), float(line.mach)
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


Educe = Callable[[Tensor], WallEduction]


def with_draws(
    result: WallEduction,
    educe: Educe,
    pressure: Tensor,
    draws: int,
    generator: torch.Generator | None,
    **errors: float,
) -> WallEduction:
    """The result with the same eduction over draws of the microphones' errors, as one batch.

    Args:
        result: without errors.
        educe: from pressures (D, ..., N, F).
        pressure: (..., N, F).
        draws: D; 0 for none.
        generator: default one with seed 0.
        errors: ``level_error`` (dB), ``phase_error`` (degrees).
    """
    if draws == 0:
        return result
    source = torch.Generator().manual_seed(0) if generator is None else generator
    drawn = educe(draw_pressures(pressure, draws, source, **errors))
    lost = int((~torch.isfinite(drawn.impedance)).sum())
    notes = result.notes
    if lost:
        notes += (
            f"{result.method}: {lost} of {drawn.impedance.numel()} draws have no impedance and are "
            "left out of mean, deviation and interval",
        )
    choices: dict[str, Any] = {**result.choices, "draws": draws, **errors}
    return replace(result, draws=drawn, choices=choices, notes=notes)
