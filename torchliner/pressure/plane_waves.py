r"""Pressures at several places split into two plane waves, one towards a surface and one away from it.

y is the distance from the surface. A wave exp(j omega t + j k+ y) runs towards it, exp(j omega t - j k- y) away from
it, so

.. math:: p(y) = A e^{+jk_+y} + B e^{-jk_-y}, \quad R = B/A, \quad Z = (1 + R)/(1 - R).

With a mean flow of Mach number M along +y, away from the surface, the incident wave makes its way against it at
c (1 - M) and the reflected one with it at c (1 + M): k+ = k/(1 - M), k- = k/(1 + M). In each wave p = -+ rho c v holds
whatever the uniform M, v along +y, so the velocity into the surface is v_in = (A e^{jk_+y} - B e^{-jk_-y})/(rho c), and
Z follows as without flow.

Two microphones s apart determine A and B unless sin((k+ + k-) s/2) = 0: spacings of a multiple of half a wavelength,
n (1 - M^2) lambda/2.
"""

from __future__ import annotations

from itertools import combinations

import torch
from torch import Tensor

from torchliner.pressure.variable_projection import solve_linear
from torchliner.records.notes import Note

SINGULAR = 1e3  # condition number: three digits of every pressure are lost
LARGE_CONDITION = 20.0
COINCIDENT = 1e-9  # m


def wavenumbers(frequency: Tensor, sound_speed: float, mach: float = 0.0) -> tuple[Tensor, Tensor]:
    """k+ (towards the surface) and k- (away from it), 1/m, (F,), of frequencies, Hz, with a mean flow of Mach number
    \\|M\\| < 1 away from the surface."""
    if not abs(mach) < 1:
        raise ValueError(f"mach is {mach:g}; plane waves run both ways only below Mach 1")
    k = 2 * torch.pi * frequency / sound_speed
    return k / (1 - mach), k / (1 + mach)


def split_waves(
    pressure: Tensor,
    places: Tensor,
    frequency: Tensor,
    sound_speed: float,
    mach: float = 0.0,
    velocity: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Least-squares amplitudes of the two waves from complex pressures.

    Args:
        pressure: Pa, complex, (..., M, F).
        places: y of the microphones, m, (M,).
        frequency: Hz, (F,).
        sound_speed: m/s.
        mach: of the mean flow away from the surface.
        velocity: rho c v_in at the microphones, Pa, (..., M, F), v_in towards the surface: as many equations more,
            which do not know the flow's turbulence as the pressures do.
    Returns:
        A and B at y = 0, (..., 2, F); relative residual, (..., F), nan for two equations, which two waves always fit;
        condition number, (F,).
    Raises:
        ValueError: fewer than two microphones (one with velocities), microphones that coincide, or a spacing of half a
            wavelength.
    Source: for M = 0 and two microphones, ISO 10534-2.
    """
    if len(places) < (2 if velocity is None else 1):
        count = f"{len(places)} microphone" if len(places) else "no microphone"
        raise ValueError(f"{count} is given; two waves need at least two")
    for i, j in combinations(range(len(places)), 2):
        if abs(float(places[i] - places[j])) < COINCIDENT:
            raise ValueError(
                f"microphones {i} and {j} coincide at y = {1e3 * float(places[i]):g} mm; they measure one pressure: "
                "move or leave out one of them"
            )
    plus, minus = wavenumbers(frequency, sound_speed, mach)
    towards, away = torch.exp(1j * plus[:, None] * places), torch.exp(-1j * minus[:, None] * places)
    rows, measured = torch.stack([towards, away], -1), pressure.to(torch.complex128)
    if velocity is not None:
        rows = torch.cat([rows, torch.stack([towards, -away], -1)], dim=1)
        measured = torch.cat([measured, velocity.to(torch.complex128)], dim=-2)
    values = torch.linalg.svdvals(rows)
    condition = values[:, 0] / values[:, 1].clamp(min=1e-300)
    worst = int(condition.argmax())
    if float(condition[worst]) >= SINGULAR:
        half = sound_speed * (1 - mach**2) / (2 * float(frequency[worst]))
        span = float(places.max() - places.min())
        raise ValueError(
            f"microphones {1e3 * span:.4g} mm apart are singular at {float(frequency[worst]):g} Hz (condition number "
            f"{float(condition[worst]):.2g}): their spacing is {span / half:.4g} times half a wavelength, "
            f"{1e3 * half:.4g} mm, and a whole number of these, or 0, tells the two waves not apart; take another "
            "frequency or another pair"
        )
    right = measured.movedim(-1, -2)  # (..., F, equations)
    _, waves, left = solve_linear(rows, right)
    residual = left.norm(dim=-1) / right.norm(dim=-1).clamp(min=1e-300)
    if rows.shape[1] == rows.shape[2]:
        residual = torch.full_like(residual, torch.nan)
    return waves.movedim(-1, -2), residual, condition


def best_pair(places: Tensor, frequency: Tensor, sound_speed: float, mach: float = 0.0) -> tuple[int, int]:
    """The two microphones best conditioned at their worst frequency."""
    mean = sum(wavenumbers(frequency, sound_speed, mach)) / 2
    return max(
        combinations(range(len(places)), 2),
        key=lambda ij: float(torch.sin(mean * (places[ij[0]] - places[ij[1]])).abs().min()),
    )


def condition_notes(name: str, frequency: Tensor, condition: Tensor) -> list[Note]:
    """Microphones whose errors grow."""
    worst = int(condition.argmax())
    if float(condition[worst]) <= LARGE_CONDITION:
        return []
    text = f"a condition number of {float(condition[worst]):.3g} at {float(frequency[worst]):g} Hz"
    return [Note("ill-conditioned", f"{name} have {text}; errors of the pressures grow by it")]
