r"""Errors of microphones, independent in level and in phase: draws of them, what they leave of a fit, and warnings.

Errors of :math:`s_l` nepers and :math:`s_p` radians are a relative error of variance :math:`s_l^2 + s_p^2`, of which a
fit of U complex unknowns to N microphones leaves the share :math:`(N - U)/N`. Where the residual is above what 1 in 20
right models has, the assumed errors are multiplied by the ratio, known from
:math:`\nu = (N - U)(s_l^2 + s_p^2)^2/(s_l^4 + s_p^4)` real degrees of freedom (Satterthwaite 1946); hence each draw has
a ratio of its own, as Student's interval has it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from scipy.special import chdtri
from torch import Tensor

from torchliner.checks import FEEDS, whole_number
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.records.notes import Note

LEVEL_ERROR, PHASE_ERROR = 0.1, 0.1  # dB and degrees, section 5.5.5
SMALLEST = 1e-4  # dB, degrees: no microphone is as good, and rounding keeps smaller ones apart
POOR = 0.01  # share of right models that are warned of
CONTRADICTED = 0.05  # share of right models whose errors are taken for larger than they are
LEAST_SHARE = 0.5  # of the kept wave's energy over the strongest's; about 1 where all is right
ROUNDING = 1e-10  # residual that is rounding, whatever errors are assumed
GAINS = 1 + 1e-6  # of an end; nearer to 1 it is rounding of the fit

Row = tuple[str, Tensor, str]  # code, where it holds, what it says


def largest_misfit(freedom: float, share: float = POOR) -> float:
    """That which only a share of right models exceeds, over its mean of 1; freedom above 0, or inf."""
    return float(chdtri(freedom, share)) / freedom if math.isfinite(freedom) else 1.0


@dataclass(frozen=True)
class MicrophoneErrors:
    """What is assumed of the errors, and how many draws of them an eduction takes.

    Args:
        level_error: standard deviation of the levels, dB, default 0.1; what is used is larger by the root of the misfit
            where the waves leave more than 1 right model in 20.
        phase_error: standard deviation of the phases, degrees, default 0.1; as of the levels.
        draws: of the errors, at least 2 (the paper: 500); default 0, none: intervals to first order.
        generator: of random numbers, on the CPU; default one with seed 0.
    """

    level_error: float = LEVEL_ERROR
    phase_error: float = PHASE_ERROR
    draws: int = 0
    generator: torch.Generator | None = None

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

    def with_draws(self, result: Any, pressure: Tensor, freedom: float, educed: Callable[[Tensor], Any]) -> Any:
        """An eduction of pressures (..., N, F), if wanted with that (``educed``) of draws of their errors, (D, ..., N,
        F), whose ``error_scale`` has ``freedom`` real degrees of freedom."""
        if not self.draws:
            return result
        source = self.generator or torch.Generator().manual_seed(0)
        drawn = draw_pressures(pressure, self.draws, source, **self.stated, scale=result.error_scale, freedom=freedom)
        about = {**result.choices, "draws": self.draws, "seed": source.initial_seed()}
        return replace(result, draws=educed(drawn), choices=about)


def draw_pressures(
    pressure: Tensor,
    draws: int,
    generator: torch.Generator,
    *,
    level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
    scale: Tensor | None = None,
    freedom: float = math.inf,
) -> Tensor:
    """Complex pressures (..., N, F) with errors, (D, ..., N, F), as of ``MicrophoneErrors``; ``scale``: factor of both,
    (..., F), which above 1 was estimated with ``freedom`` real degrees of freedom."""
    level, phase = MicrophoneErrors(level_error, phase_error).parts
    noise = torch.randn(2, draws, *pressure.shape, generator=generator, dtype=torch.float64)
    if scale is not None and bool((scale > 1).any()):
        own = scale.cpu()
        power = torch.randn(max(1, int(freedom)), draws, *own.shape, generator=generator, dtype=torch.float64)
        noise = noise * torch.where(own > 1, own / power.square().mean(0).sqrt(), own)[..., None, :]
    return pressure * torch.exp(torch.complex(noise[0] * level, noise[1] * phase)).to(pressure.device)


def wave_notes(result: WallEduction, freedom: float) -> tuple[Note, ...]:
    """Of waves that may not be those of a lined wall, or leave more than the assumed errors, which have ``freedom``
    real degrees of freedom."""
    assert result.line is not None
    choices, z, side = result.choices, result.impedance, result.source_side
    # Re alpha is known up to 2 pi/spacing; a rigid wall's wave must lie within half of that.
    along, spacing = 1 + choices["mach"] * (1 if side == "upstream" else -1), choices.get("spacing", 0.0)
    highest = choices["sound_speed"] * along / (2 * spacing) if spacing else math.inf
    weak, feeds = result.energy_share < LEAST_SHARE, z.real < FEEDS
    poor, misfit = _misfit(result, max(largest_misfit(freedom, POOR / z.numel()), choices["largest_misfit"]))
    poor &= result.residual > ROUNDING
    size = None
    if bool(poor.any()) and (spread := result.deviation) is not None:
        size = float(spread[poor].abs().max())
    short = f"the spacing is more than half a rigid duct's wavelength above {highest:.4g} Hz; Z may be of an alias"
    share = f"the wave that runs away from a source {side} has at worst {_least(result.energy_share, weak):.2g} of the"
    of_other = "energy of the strongest wave: the source may be on the other side, or phases be of exp(-j omega t)"
    gains = f"the resistance is negative, {_least(z.real, feeds):.3g} at least: not the wave assumed, or an active wall"
    left = f"the waves leave up to {100 * _most(result.residual, poor):.2g} % of the pressures, {misfit}, which draws"
    rows = [
        ("aliasing", result.frequency >= highest, short),
        ("no-wave", ~torch.isfinite(result.wavenumber), f"no wave runs away from a source {side}; they are nan"),
        ("source-side", weak, f"{share} {of_other}"),
        ("active-wall", feeds, gains),
        ("model-misfit", poor, f"{left} take: other waves, or larger errors; compare ranks, margins and methods"),
    ]
    text = f"{choices.get('unsettled')} of {z.numel()} fits did not settle; their waves may not be the best"
    first = [Note("unsettled", f"{choices['source']}: {text}")] if choices.get("unsettled") else []
    return (*first, *duct_notes(result.line), *_notes(result, rows, size))


def field_notes(result: FieldFit) -> tuple[Note, ...]:
    """Of a fit of the field."""
    end, z, choices = result.end_reflection.abs(), result.impedance, result.choices
    assert result.covariance is not None
    rigid = torch.isinf(result.covariance[..., 0, 0]) & result.converged
    feeds = (z.real < FEEDS) & ~rigid
    poor, misfit = _misfit(result, largest_misfit(result.freedom or math.inf, POOR / z[..., 0].numel()))
    causes = f"duct, flow, far end or wall ({choices['wall']}) are not those measured, or a deeper minimum (start=)"
    bound = "the microphones do not tell the liner from a rigid wall: the error of Z has no bound"
    rows = [
        ("unsettled", ~result.converged, "the fit did not settle; Z is the best one met"),
        ("model-misfit", poor, f"the residuals are {misfit}, which error bars take: {causes}"),
        ("rigid-wall", rigid, bound),
        ("active-wall", feeds, f"the resistance is {_least(z.real, feeds):.3g}, below 0"),
        ("active-end", end > GAINS, f"the far end would reflect {_most(end, end > GAINS):.3g} times what it gets"),
    ]
    return _notes(result, rows)


def duct_notes(line: MicrophoneLine) -> tuple[Note, ...]:
    """Higher modes of the rigid duct that carry sound."""
    notes = []
    for what, size in (("height", line.duct_height), ("width", line.duct_width)):
        if size is not None:
            limit = cut_on_frequency(UniformProfile(abs(line.stated_mach), float(size), float(line.fluid.sound_speed)))
            if above := line.frequency[line.frequency >= limit].tolist():
                text = f"from {limit:.4g} Hz on the duct's {what}, {1e3 * float(size):g} mm, carries a higher mode"
                share = f"{len(above)} of {len(line.frequency)} frequencies from {min(above):g} Hz on"
                notes.append(Note("higher-modes", f"{line.name}: {text}: {share}"))
    return tuple(notes)


def _misfit(result: WallEduction | FieldFit, limit: float) -> tuple[Tensor, str]:
    """Where the misfit is above a limit, (..., F), and what it says of the errors."""
    assert result.misfit is not None
    poor, choices = result.misfit > limit, result.choices
    level, phase = (_most(choices[f"{name}_error"] * result.error_scale, poor) for name in ("level", "phase"))
    stated = f"times the {choices['level_error']:g} dB and {choices['phase_error']:g} degrees stated"
    as_of = f"(limit {limit**0.5:.3g}), as of {level:.2g} dB and {phase:.2g} degrees"
    return poor, f"{_most(result.misfit, poor) ** 0.5:.3g} {stated} {as_of}"


def _notes(result: WallEduction | FieldFit, rows: Sequence[Row], size: float | None = None) -> tuple[Note, ...]:
    """Of the codes that hold somewhere: how often, where first, and what; of draws that are lost. ``size``: how far Z
    may be off by a misfit."""
    found, source = [], result.choices["source"]
    for code, which, said in rows:
        if bool(which.any()):
            first = result.frequency[which.reshape(-1, which.shape[-1]).any(0).cpu()][0]
            place = f"at {int(which.sum())} of {which.numel()} values, first at {float(first):g} Hz"
            found.append(Note(code, f"{source}: {place}, {said}", size if code == "model-misfit" else None))
    if result.draws is not None and bool(result.failed.any()):
        lost = f"{int(result.failed.sum())} of {result.draws.impedance.numel()} draws have no impedance"
        found.append(Note("lost-draws", f"{source}: {lost} and are left out of mean and interval"))
    return tuple(found)


def _least(values: Tensor, which: Tensor) -> float:
    """Of some values; nan of none."""
    return float(values[which].min()) if bool(which.any()) else math.nan


def _most(values: Tensor, which: Tensor) -> float:
    """Of some values; nan of none."""
    return -_least(-values, which)
