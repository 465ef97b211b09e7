"""Impedance from microphones at any places: an incident and a reflected wave of one wall.

``paired_waves`` says what is fitted. The start is the best of a grid of impedances, refined from
the three best, so that no guess is needed; draws start from the result.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor

from torchliner.checks import require_choice
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.duct.relation import DIRECTIONS, duct_of
from torchliner.names import WEIGHTS
from torchliner.pressure.from_source import (
    FromSource,
    duct_notes,
    over_liner,
    wall_eduction,
)
from torchliner.pressure.microphone_errors import LEVEL_ERROR, PHASE_ERROR
from torchliner.pressure.paired_waves import Pairs, WavePairs
from torchliner.pressure.wave_errors import with_errors
from torchliner.records import MicrophoneLine, WallEduction

RESISTANCES = (0.1, 0.3, 0.8, 2.0, 5.0)
REACTANCES = (-4.0, -1.5, -0.5, 0.0, 0.5, 1.5, 4.0)
STARTS = 3
FEWEST = 4  # microphones: more equations than the three unknowns


def two_wave_fit(
    line: MicrophoneLine, *, source_side: str | None = None, condition: str = "ingard-myers",
    tied: bool = True, weights: str = "absolute", margin: float = 0.0, draws: int = 0,
    level_error: float = LEVEL_ERROR, phase_error: float = PHASE_ERROR,
    generator: torch.Generator | None = None,
) -> WallEduction:  # fmt: skip
    """Impedance by least squares over a wave with the source and one against it.

    Args:
        line: microphones at any places; those over the liner are used, all if it names no liner.
        source_side, condition, margin, draws, level_error, phase_error, generator: as for
            ``kumaresan_tufts``.
        tied: both wavenumbers belong to one impedance; else each is free, and the impedance is
            that of the wave with the source.
        weights: ``absolute``, of equal errors in Pa, or ``relative``, of equal errors in dB.
    Returns:
        Wavenumbers of both waves in ``modes``, the one with the source first.
    Raises:
        ValueError: fewer than four microphones (five if free), as for ``kumaresan_tufts``.
    Warns:
        DataWarning: higher modes are cut on, a fit did not settle; as for ``kumaresan_tufts``.
    """
    require_choice("weights", weights, WEIGHTS)
    seen = over_liner(line, source_side, margin=margin, condition=condition, draws=draws)
    line = seen.line
    fewest = FEWEST + (not tied)
    if line.microphones < fewest:
        raise ValueError(
            f"{line.name}: {line.microphones} microphones are used; two "
            f"{'tied' if tied else 'free'} waves need at least {fewest}"
        )
    first = _educe(seen.pressure, seen, condition, tied, weights, None)
    start = seen.sign * first.modes

    def educe(pressure: Tensor) -> WallEduction:
        return _educe(pressure, seen, condition, tied, weights, start)

    unit = None if weights == WEIGHTS[0] else seen.pressure.abs()
    notes, lost = duct_notes(line), first.choices["unsettled"]
    if lost:
        notes += (
            f"{line.name}: {lost} of {first.impedance.numel()} fits did not settle; their waves may not be the best",
        )
    return with_errors(
        first, notes, educe, seen.pressure, unknowns=4 - tied, draws=draws, generator=generator, unit=unit,
        level_error=level_error, phase_error=phase_error,
    )  # fmt: skip


free_wave_fit = functools.partial(two_wave_fit, tied=False)


def _educe(
    pressure: Tensor, seen: FromSource, condition: str, tied: bool, weights: str,
    start: Tensor | None,
) -> WallEduction:  # fmt: skip
    """From pressures along s, (..., N, F); ``start`` is (..., 2, F) or None for the grid."""
    line = seen.line
    values = pressure.movedim(-2, -1).to(torch.complex128)  # (..., F, N)
    lead = values.shape[:-1]
    duct, _ = duct_of(
        values[..., 0], line.frequency.to(values.device), line.duct_height, seen.mach,
        line.fluid.sound_speed, condition,
    )  # fmt: skip
    flat, duct = values.reshape(-1, values.shape[-1]), duct.flattened()
    weight = torch.ones_like(flat.real) if weights == WEIGHTS[0] else 1 / flat.abs()
    distance = seen.distance.to(values.device)
    lines = WavePairs(flat, distance, weight, duct, tied)
    if start is None:
        grid = _grid(
            tuple(line.frequency.tolist()), line.duct_height, seen.mach, line.fluid.sound_speed,
            condition,
        )  # fmt: skip
        grid = grid.to(values.device).expand(*lead, -1, 2).reshape(len(flat), -1, 2)
        found = _best_of_grid(lines, grid)
    else:
        found = lines.fit(start.movedim(-2, -1).expand(*lead, 2).reshape(-1, 2))
    wave, amplitude = found.wavenumber, found.amplitude.clone()
    # The reflected wave is referred to the far end in the fit, to the origin in the record.
    amplitude[:, 1] *= torch.exp(1j * wave[:, 1] * distance[-1])
    return wall_eduction(
        seen, wave[:, 0].reshape(lead), wave.reshape(*lead, 2), amplitude.reshape(*lead, 2),
        found.residual.reshape(lead),
        method="two waves" if tied else "two free waves",
        condition=condition,
        choices={"method": "two-wave fit", "tied": tied, "weights": weights},
        found={"unsettled": int((~found.settled).sum())},
    )  # fmt: skip


@functools.lru_cache(maxsize=8)  # the draws of a line, and other lines of a duct, share it
def _grid(frequency: tuple[float, ...], height: float, mach: float, sound_speed: float, condition: str) -> Tensor:
    """Both wavenumbers of a grid of impedances along s, (F, G, 2)."""
    wanted = torch.tensor(frequency, dtype=torch.float64)[:, None]
    walls = torch.tensor([complex(r, x) for r in RESISTANCES for x in REACTANCES])
    both = [
        wavenumber_from_impedance(
            walls.to(torch.complex128), wanted, height=height, mach=mach,
            sound_speed=sound_speed, condition=condition, direction=direction,
        )
        for direction in DIRECTIONS
    ]  # fmt: skip
    return torch.stack(both, -1)


def _best_of_grid(lines: WavePairs, grid: Tensor) -> Pairs:
    """Refined from the best starts, (P, G, 2), of each line."""
    best = lines.residuals(grid).argsort(-1)[:, :STARTS]
    begin = grid.gather(1, best[..., None].expand(-1, -1, 2)).reshape(-1, 2)
    row = torch.arange(len(grid), device=grid.device)
    found = lines.at(row.repeat_interleave(best.shape[1])).fit(begin)
    residual = torch.where(torch.isfinite(found.residual), found.residual, torch.inf)
    index = residual.reshape(best.shape).argmin(-1) + row * best.shape[1]
    return Pairs(*(part[index] for part in found))
