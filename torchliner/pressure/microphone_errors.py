r"""Errors of microphones, independent in level and in phase: draws of them, what they leave of a fit, and warnings.

Errors of :math:`s_l` nepers and :math:`s_p` radians are a relative error of variance :math:`s_l^2 + s_p^2`, of which a
fit of U complex unknowns to N microphones leaves the share :math:`(N - U)/N`. Where the residual is above what 1 in 20
right models has, the assumed errors are multiplied by the ratio, known from
:math:`\nu = (N - U)(s_l^2 + s_p^2)^2/(s_l^4 + s_p^4)` real degrees of freedom (Satterthwaite 1946); hence each draw has
a ratio of its own, as Student's interval has it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from scipy.special import chdtri
from torch import Tensor

from torchliner.checks import FEEDS, whole_number
from torchliner.duct.dispersion import higher_mode_notes
from torchliner.records import FieldFit, WallEduction
from torchliner.records.notes import Note
from torchliner.records.wall_eduction import DrawnImpedance

LEVEL_ERROR, PHASE_ERROR = 0.1, 0.1  # dB and degrees, section 5.5.5
SMALLEST = 1e-4  # dB, degrees: no microphone is as good, and rounding keeps smaller ones apart
POOR = 0.01  # share of right models that are warned of
CONTRADICTED = 0.05  # share of right models whose errors are taken for larger than they are
LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
ROUNDING = 1e-10  # residual that is rounding, whatever errors are assumed
GAINS = 1 + 1e-6  # of an end; nearer to 1 it is rounding of the fit


def largest_misfit(freedom: float, share: float = POOR) -> float:
    """That which only a share of right models exceeds, over its mean of 1; freedom above 0, or inf."""
    return float(chdtri(freedom, share)) / freedom if math.isfinite(freedom) else 1.0


@dataclass(frozen=True)
class MicrophoneErrors:
    """What is assumed of the errors, and how many draws of them an eduction takes.

    Args:
        level_error: standard deviation of the levels, dB, default 0.1; multiplied by the root of the misfit where the
            residual is one that only 1 correct model in 20 would exceed.
        phase_error: standard deviation of the phases, degrees, default 0.1; multiplied likewise.
        draws: of the errors, at least 2 (the paper: 500); default 0, none: intervals to first order.
        seed: of the draws; default 0.
    """

    level_error: float = LEVEL_ERROR
    phase_error: float = PHASE_ERROR
    draws: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in self.stated.items():
            if not SMALLEST <= value < math.inf:
                raise ValueError(f"{name} is {value:g}; dB and degrees must be finite and at least {SMALLEST:g}")
        if whole_number("draws", self.draws) < 0 or self.draws == 1:
            raise ValueError(f"draws is {self.draws}; 0 for none, or at least 2, since one has no deviation")

    @property
    def stated(self) -> dict[str, float]:
        """As a result's choices have them."""
        return {"level_error": self.level_error, "phase_error": self.phase_error}

    @property
    def parts(self) -> tuple[float, float]:
        """Nepers and radians."""
        return self.level_error * math.log(10) / 20, math.radians(self.phase_error)

    def freedom(self, spare: int) -> float:
        """nu of N - U spare microphones; inf where nothing can contradict the errors."""
        level, phase = self.parts
        return spare * (level**2 + phase**2) ** 2 / (level**4 + phase**4) if spare > 0 else math.inf

    def misfit(self, residual: Tensor, microphones: int, spare: int) -> Tensor:
        """Squared residual (relative rms of what a fit leaves of N microphones) over that which the errors leave: 1 in
        the mean where all is right; nan without a spare microphone."""
        level, phase = self.parts
        return residual.square() / ((level**2 + phase**2) * spare / microphones if spare > 0 else math.nan)

    def drawn(self, pressure: Tensor, scale: Any = 1.0, freedom: float = math.inf) -> Tensor:
        """Complex pressures (..., N, F) with errors, (D, ..., N, F); ``scale``: factor of both errors, (..., F), which
        above 1 was estimated with ``freedom`` real degrees of freedom."""
        (level, phase), source = self.parts, torch.Generator().manual_seed(self.seed)
        noise = torch.randn(2, self.draws, *pressure.shape, generator=source, dtype=torch.float64)
        own = torch.as_tensor(scale).cpu()
        if bool((own > 1).any()):
            power = torch.randn(max(1, int(freedom)), self.draws, *own.shape, generator=source, dtype=torch.float64)
            noise = noise * torch.where(own > 1, own / power.square().mean(0).sqrt(), own)[..., None, :]
        return pressure * torch.exp(torch.complex(noise[0] * level, noise[1] * phase)).to(pressure.device)

    def with_draws(self, result: Any, pressure: Tensor, freedom: float, educed: Callable[[Tensor], Any]) -> Any:
        """An eduction of pressures (..., N, F), if wanted with that (``educed``) of draws of their errors, (D, ..., N,
        F), whose ``error_scale`` has ``freedom`` real degrees of freedom."""
        if not self.draws:
            return result
        about = {**result.choices, "draws": self.draws, "seed": self.seed}
        return replace(result, draws=educed(self.drawn(pressure, result.error_scale, freedom)), choices=about)


def wave_notes(result: WallEduction, freedom: float) -> tuple[Note, ...]:
    """Of waves that may not be those of a lined wall, or leave more than the assumed errors, which have ``freedom``
    real degrees of freedom."""
    assert result.line is not None
    choices, z, side, share = result.choices, result.impedance, result.source_side, result.energy_share
    # Re alpha is known up to 2 pi/spacing; a rigid wall's wave must lie within half of that.
    along, spacing = 1 + choices["mach"] * (1 if side == "upstream" else -1), choices.get("spacing", 0.0)
    highest = choices["sound_speed"] * along / (2 * spacing) if spacing else math.inf
    poor, misfit = _misfit(result, max(largest_misfit(freedom, POOR / z.numel()), choices["largest_misfit"]))
    poor &= result.residual > ROUNDING
    spread = result.deviation
    size = None if spread is None or not bool(poor.any()) else float(spread[poor].abs().max())
    short = f"the spacing is more than half a rigid duct's wavelength above {highest:.4g} Hz; Z may be of an alias"
    weak = f"the wave that runs away from a source {side} has at worst {_least(share):.2g} of the energy of the "
    weak += "strongest wave: the source may be on the other side, or phases be of exp(-j omega t)"
    gains = f"the resistance is negative, {_least(z.real):.3g} at least: not the wave assumed, or an active wall"
    left = f"the waves leave up to {-100 * _least(-result.residual):.2g} % of the pressures, {misfit}, which draws take"
    lost = f"{choices.get('unsettled')} of {z.numel()} fits did not settle; their waves may not be the best"
    notes = [Note("unsettled", f"{choices['source']}: {lost}")] if choices.get("unsettled") else []
    rows = [
        ("aliasing", result.frequency >= highest, short),
        ("no-wave", ~torch.isfinite(result.wavenumber), f"no wave runs away from a source {side}; Z is nan"),
        ("source-side", share < LEAST_SHARE, weak),
        ("active-wall", z.real < FEEDS, gains),
        ("model-misfit", poor, f"{left}: other waves, or larger errors; compare ranks, margins and methods"),
    ]
    return (*notes, *higher_mode_notes(result.line), *_notes(result, rows, size))


def field_notes(result: FieldFit) -> tuple[Note, ...]:
    """Of a fit of the field."""
    end, z, wall = result.end_reflection.abs(), result.impedance, result.choices["wall"]
    assert result.covariance is not None
    rigid = torch.isinf(result.covariance[..., 0, 0]) & result.converged
    resistance = z.real.masked_fill(rigid, 0.0)
    poor, misfit = _misfit(result, largest_misfit(result.freedom or math.inf, POOR / z[..., 0].numel()))
    causes = f"duct, flow, far end or wall ({wall}) are not those measured, or a deeper minimum (start=)"
    rows = [
        ("unsettled", ~result.converged, "the fit did not settle; Z is the best one met"),
        ("model-misfit", poor, f"the residuals are {misfit}, which error bars take: {causes}"),
        ("rigid-wall", rigid, "the microphones do not tell the liner from a rigid wall: the error of Z has no bound"),
        ("active-wall", resistance < FEEDS, f"the resistance is {_least(resistance):.3g}, below 0"),
        ("active-end", end > GAINS, f"the far end would reflect {-_least(-end):.3g} times the incident wave"),
    ]
    return _notes(result, rows)


def _misfit(result: DrawnImpedance, limit: float) -> tuple[Tensor, str]:
    """Where the misfit is above a limit, (..., F), and what it says of the errors."""
    assert result.misfit is not None
    scale, most = -_least(-result.error_scale), float(result.misfit.nan_to_num(0.0).max()) ** 0.5
    level, phase = (result.choices[f"{name}_error"] for name in ("level", "phase"))
    stated = f"{most:.3g} times the {level:g} dB and {phase:g} degrees stated (limit {limit**0.5:.3g})"
    return result.misfit > limit, f"{stated}, equivalent to {level * scale:.2g} dB and {phase * scale:.2g} degrees"


def _notes(result: DrawnImpedance, rows: list[tuple[str, Tensor, str]], size: float | None = None) -> tuple[Note, ...]:
    """Of codes that hold somewhere, (..., F), how often, where first, and what that says; of draws that are lost.
    ``size``: how far Z may be off by a misfit."""
    notes, source = [], result.choices["source"]
    for code, which, said in rows:
        if bool(which.any()):
            first = result.frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
            place = f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz"
            notes.append(Note(code, f"{source}: {place}, {said}", size if code == "model-misfit" else None))
    if result.draws is not None and bool(result.failed.any()):
        lost = f"{int(result.failed.sum())} of {result.draws.impedance.numel()} draws have no impedance"
        notes.append(Note("lost-draws", f"{source}: {lost} and are left out of mean and interval"))
    return tuple(notes)


def _least(values: Tensor) -> float:
    """Of those that are numbers."""
    return float(values.nan_to_num(torch.inf).min())
