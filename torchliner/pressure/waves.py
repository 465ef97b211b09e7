r"""From waves along a wall to an impedance with error bars, and Kumaresan and Tufts' waves.

Microphones are seen from the source: with s the distance from its side the wave above the liner is
:math:`e^{-j\alpha' s}`, for a source upstream s = x, alpha' = alpha; for one downstream the array is read backwards,
s = -x, alpha' = -alpha, and the flow runs at -M along s.

Kumaresan and Tufts' method finds them over evenly spaced microphones: damped exponentials
:math:`p_n = \sum_k a_k\lambda_k^n`, conjugated and read backwards, obey
:math:`p^*_n = -\sum_{l=1}^{L} b_l\,p^*_{n+l}`, solved through the K largest singular values, and each
:math:`1/\lambda_k^*` is a root of :math:`z^L + b_1 z^{L-1} + \dots + b_L` outside the unit circle. Of the exponentials
that run with the source the one with most energy is the wave whose impedance is returned; a short liner's reflected and
higher waves fold into it (``docs/wall_pressure.md``).
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import tell, whole_number
from torchliner.duct.dispersion import impedance_from_wavenumber
from torchliner.names import SOURCES, __version__
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, largest_misfit, wave_notes
from torchliner.records import MicrophoneLine, WallEduction

EQUAL_SPACING = 5e-3  # of the mean spacing
STEP = 1e-4  # of the errors' unit; the slope of Z errs by its square
RANK = 2
ROUNDING = 1e-14  # of the first singular value: what a signal without noise leaves
SIGNALS = 1 << 14  # solved at once, 4 kB each: draws of many frequencies are not held whole


def equal_spacing(line: MicrophoneLine) -> float:
    """The mean spacing, m; a ValueError where a microphone is off the even grid by more than 0.5 % of it."""
    number, x = np.arange(line.microphones), line.x.numpy()
    spacing, off = float(x[-1] - x[0]) / number[-1], x - np.polyval(np.polyfit(number, x, 1), number)
    worst = int(np.abs(off).argmax())
    if abs(off[worst]) > EQUAL_SPACING * spacing:
        there = f"microphone {worst} at x = {1e3 * x[worst]:.6g} mm is {1e3 * off[worst]:+.3g} mm off an even grid of"
        needs = f"Kumaresan and Tufts' method needs equal spacing, but {there} {1e3 * spacing:.5g} mm"
        raise ValueError(f"{line.name}: {needs}; use the two-wave fit")
    return spacing


class FromSource(NamedTuple):
    """A line seen from its source."""

    line: MicrophoneLine  # as recorded
    sign: int  # 1 for a source upstream, -1 downstream
    distance: Tensor  # s of the microphones from the first, m, (N,)
    pressure: Tensor  # Pa, (..., N, F), in the order of s
    mach: float  # of the flow along s


def seen_from_source(line: MicrophoneLine) -> FromSource:
    """The line along s; ValueError where the side of its source or its Mach number is not known."""
    if line.source_side not in SOURCES:
        raise ValueError(f"{line.name}: source_side is {line.source_side!r}; give 'upstream' or 'downstream'")
    if line.source_side == "downstream":
        return FromSource(line, -1, (line.x[-1] - line.x).flip(0), line.pressure.flip(-2), -line.stated_mach)
    return FromSource(line, 1, line.x - line.x[0], line.pressure, line.stated_mach)


class Waves(NamedTuple):
    """What a method finds in pressures (..., N, F), along s."""

    wavenumber: Tensor  # alpha' of the wave whose impedance is wanted, (..., F); nan for none
    modes: Tensor  # alpha' of all waves, (..., K, F)
    amplitudes: Tensor  # theirs at s = 0, Pa, (..., K, F)
    residual: Tensor  # rms of what they leave over that of the pressures, (..., F)
    singular_values: Tensor | None = None  # of the prediction matrix, (..., L, F); None for fits
    settled: Tensor | None = None  # whether the fit ended, (..., F); None without a search


def educe_waves(
    seen: FromSource,
    waves_of: Callable[[Tensor], Waves],
    *,
    method: str,
    unknowns: int,
    condition: str,
    errors: MicrophoneErrors,
    choices: dict[str, Any],
) -> WallEduction:
    """The impedance of a line's waves, its error bars and its warnings, which are told.

    ``waves_of`` is the method, of pressures along s, (..., N, F), with any leading axes; ``unknowns`` U, complex ones
    of the waves; ``choices`` the method's own. RuntimeError where no wave runs with the source at any frequency.
    """
    line, pressure, count, spare = seen.line, seen.pressure, seen.line.microphones, seen.line.microphones - unknowns
    freedom = errors.freedom(spare)
    duct = {"height": line.duct_height, "mach": seen.mach, "sound_speed": line.fluid.sound_speed}
    choices = choices | {"condition": condition, "source_side": line.source_side, "source": line.name}
    choices |= {"microphones": count, "mach": line.stated_mach, "sound_speed": float(line.fluid.sound_speed)}
    choices |= {"version": __version__, **errors.stated, "largest_misfit": largest_misfit(freedom, CONTRADICTED)}

    def impedance_of(waves: Waves) -> Tensor:
        frequency = line.frequency.to(waves.wavenumber.device)
        return impedance_from_wavenumber(waves.wavenumber, frequency, **duct, condition=condition)

    def record_of(pressure: Tensor) -> WallEduction:
        waves = waves_of(pressure)
        settled = {} if waves.settled is None else {"unsettled": int((~waves.settled).sum())}
        return WallEduction(
            method=method,
            frequency=line.frequency,
            x=line.x,
            wavenumber=seen.sign * waves.wavenumber,
            impedance=impedance_of(waves),
            modes=seen.sign * waves.modes,
            amplitudes=waves.amplitudes,
            origin=float(line.x[0 if seen.sign == 1 else -1]),
            residual=waves.residual,
            misfit=errors.misfit(waves.residual, count, spare),
            source_side=line.source_side,
            singular_values=waves.singular_values,
            choices={**choices, **settled},
            line=line,
            freedom=2 * spare,
        )

    result = record_of(pressure)
    if not bool(torch.isfinite(result.wavenumber).any()):
        text = f"none of the waves found runs away from a source {line.source_side}; it may be on the other side"
        raise RuntimeError(f"{line.name}: {text}, or the phases of the other sign (exp(+j omega t) is needed)")
    if spare > 0 and pressure.ndim == 2:
        # Slopes of R and X with each microphone's real, then imaginary part, (2 N, F, 2): differences of two eductions,
        # of all microphones as one batch.
        steps = STEP * torch.eye(count).to(pressure)[..., None] * pressure.abs().square().mean(0).sqrt()
        steps = torch.cat([steps, 1j * steps])
        ahead, behind = impedance_of(waves_of(torch.cat([pressure + steps, pressure - steps]))).split(2 * count)
        slope = torch.view_as_real((ahead - behind) / (2 * STEP))
        # Half of the complex variance belongs to each part.
        variance = result.residual.square() * count / (2 * spare)
        result = replace(result, covariance=variance[:, None, None] * torch.einsum("dfi,dfj->fij", slope, slope))
    result = errors.with_draws(result, pressure, freedom, record_of)
    notes = wave_notes(result, freedom)
    tell([str(note) for note in notes], depth=2)
    return replace(result, notes=notes)


def kumaresan_tufts(
    line: MicrophoneLine,
    *,
    rank: int = RANK,
    order: int | None = None,
    condition: str = "ingard-myers",
    margin: float = 0.0,
    **errors: Any,
) -> WallEduction:
    """Impedance by Kumaresan and Tufts' prediction of evenly spaced microphones.

    Args:
        line: microphones; those over the liner are used, all of them if it names no liner.
        rank: K, waves and singular values that are kept.
        order: L of the prediction, at most half the microphones; default half of them.
        condition: boundary condition at the liner, ``ingard-myers`` or ``continuous-velocity``.
        margin: m, least distance of the microphones used from the liner's ends.
        errors: ``draws``, ``level_error``, ``phase_error`` and ``seed``, as of ``MicrophoneErrors``.
    Raises:
        TypeError: rank, order or draws is no whole number.
        ValueError: unequal spacing, fewer microphones than twice the order, rank above the order, no known side of the
            source or Mach number.
        RuntimeError: no wave runs with the source at any frequency.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``, with a code.
    Source: Roncen et al. (2026), sections 5.5.5 and 6.4.2; rank and order are not stated there.
    """
    seen = seen_from_source(line.over_liner(margin))
    spacing = equal_spacing(seen.line)
    rank = whole_number("rank", rank)
    length = seen.line.microphones // 2 if order is None else whole_number("order", order)

    def waves_of(pressure: Tensor) -> Waves:
        ratio, amplitude, energy, singular, residual = find_exponentials(pressure.movedim(-2, -1), rank, length)
        along = 1j * torch.log(ratio) / spacing  # (..., F, K)
        # A wave runs along s if its phase does and it does not grow faster than it turns, or if it decays faster than
        # its phase turns against s, which then tells nothing.
        with_source = along.real > along.imag
        best = torch.where(with_source, energy, -1.0).argmax(-1, keepdim=True)
        wave = torch.where(with_source.any(-1), along.gather(-1, best)[..., 0], math.nan + 0j)
        modes, amplitudes, singular = (each.movedim(-1, -2) for each in (along, amplitude, singular))
        return Waves(wave, modes, amplitudes, residual, singular)

    choices = {"method": "kumaresan-tufts", "rank": rank, "order": length, "margin": margin, "spacing": spacing}
    given = MicrophoneErrors(**errors)
    return educe_waves(
        seen, waves_of, method="Kumaresan-Tufts", unknowns=2 * rank, condition=condition, errors=given, choices=choices
    )


def find_exponentials(signal: Tensor, rank: int, order: int) -> tuple[Tensor, ...]:
    """K exponentials a lambda^n of signals p (..., N), Kumaresan & Tufts (1982), IEEE Trans. ASSP 30, 833: lambda, a at
    the first sample, energies over that of p, (..., K); singular values, (..., L); relative residual, (...)."""
    samples = signal.shape[-1]
    if order < 1 or samples < 2 * order:
        raise ValueError(f"{samples} microphones are fewer than twice the order, {order}; the most is {samples // 2}")
    if not 1 <= rank <= order:
        raise ValueError(f"rank is {rank}; it must be 1 to the order, {order}, at most half the microphones")
    signal = signal.to(torch.complex128)
    lead = signal.shape[:-1]
    if lead.numel() > SIGNALS:
        parts = [find_exponentials(each, rank, order) for each in signal.reshape(-1, samples).split(SIGNALS)]
        whole = (torch.cat(each) for each in zip(*parts, strict=True))
        return tuple(each.reshape(lead + each.shape[1:]) for each in whole)
    windows = signal.conj().unfold(-1, order + 1, 1)  # (..., N - L, L + 1)
    u, s, vh = torch.linalg.svd(windows[..., 1:], full_matrices=False)
    inverse = torch.where(s > ROUNDING * s[..., :1], 1 / s.clamp(min=1e-300), 0.0)[..., :rank, None]
    weights = -(vh[..., :rank, :].mH @ (inverse * (u[..., :rank].mH @ windows[..., :1])))
    # Roots of z^L + b_1 z^(L-1) + ... + b_L are the eigenvalues of the companion matrix.
    below = torch.eye(order, dtype=signal.dtype, device=signal.device)[:-1].expand(*lead, -1, -1)
    roots = torch.linalg.eigvals(torch.cat([-weights.mT, below], -2))
    kept = roots.gather(-1, roots.abs().argsort(-1, descending=True)[..., :rank])
    # A root at 0, of a rank above what the signal holds, is no exponential; it gets no amplitude.
    ratio = 1 / torch.where(kept.abs() > ROUNDING, kept, ROUNDING).conj()
    steps = torch.arange(samples, dtype=torch.float64, device=signal.device)
    # Growing waves are referred to the last sample, so that no power overflows.
    shift = torch.where(ratio.abs() > 1, steps[-1], 0.0)
    columns = ratio[..., None, :] ** (steps[:, None] - shift[..., None, :])
    amplitude = (torch.linalg.pinv(columns) @ signal[..., None])[..., 0]
    left = signal - (columns @ amplitude[..., None])[..., 0]
    power = signal.abs().square().sum(-1)
    energy = amplitude.abs().square() * columns.abs().square().sum(-2) / power[..., None]
    return ratio, amplitude * ratio ** (-shift), energy, s, (left.abs().square().sum(-1) / power).sqrt()
