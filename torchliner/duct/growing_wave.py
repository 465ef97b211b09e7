r"""The wave that grows along a lined wall under flow, if there is one.

A liner may be passive and the sound above it grow: the shear layer feeds a hydrodynamic wave, as between two streams.
It grows out of no rigid mode, so it is looked for: Newton's method on F/p from a grid of wavenumbers beyond k/M, in
panels cut fine for its critical layer. A root counts if finer panels have it too, within 1e-2, and still finer ones
within 1e-4; that of the fastest growth is kept.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import frequency_tensor
from torchliner.duct.case import DuctCase, require_slip_condition, wall_reflection
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.duct.modes import POINTS, PridmoreBrown
from torchliner.duct.roots import newton, with_slopes

# Parts of a panel, last step of Newton's method and change since the parts before, of |alpha|.
STAGES = ((4, math.inf, math.inf), (4, 1e-3, math.inf), (12, 1e-8, 1e-2), (30, 1e-8, 1e-4))
ALIKE = 1e-2  # of |alpha|: roots of a stage that are one
NEAREST, FARTHEST, ALONG = 0.8, 80.0, 14  # Re alpha of the starts, in k/M_max
ASIDE = (0.15, 0.5, 1.4)  # their Im over Re
STEPS, LONGEST = 6, 0.25  # of Newton's method, of |alpha|
LEAST = 1e-3  # of alpha H; below, the wave neither grows nor decays
NEPER = 20 * math.log10(math.e)  # dB
NONE = complex(math.nan, math.nan)


def growing_wave(profile: MeanFlow, frequency: Any, impedance: Any, slip_condition: str | None = None) -> Tensor:
    r"""Wavenumber of the fastest growing wave along the flow above an endless liner.

    Args:
        profile, frequency, impedance, slip_condition: as for ``duct_modes``, without leading axes.
    Returns:
        alpha, 1/m, (F,), complex128, of exp(-j alpha x): Im alpha > 0 and Re alpha > k; nan where none is found, which
        is no proof that there is none (Re alpha of 0.8 to 80 k/M, Im above some Re/50).
    Source: Briggs (1964), Electron-stream interaction with plasmas, for what runs downstream though it grows there;
        Rienstra and Darau (2011), J. Fluid Mech. 671, 559, for such waves above liners.
    """
    wanted = frequency_tensor(frequency).cpu()
    reflection = wall_reflection(impedance).detach().cpu()
    if reflection.shape not in ((), (1,), wanted.shape):
        shape, count = tuple(reflection.shape), len(wanted)
        raise ValueError(f"impedance has shape {shape}; one value is needed, or {count}, one a frequency")
    reflection, found = reflection.expand(wanted.shape), torch.full(wanted.shape, NONE, dtype=torch.complex128)
    height = profile.duct_height
    fastest = float(profile.mach(np.linspace(0, height, 201)).max())
    lined = (reflection != 1).nonzero()[:, 0].tolist() if fastest > 0 else []
    if lined:
        myers = require_slip_condition(profile, slip_condition)
        kappa = 2 * math.pi * height / profile.sound_speed * wanted
        sheared = float(profile.mach(0.0)) < fastest  # else there is no critical layer
        equations = {n: PridmoreBrown.of(profile, POINTS, myers, split=n if sheared else 1) for n, _, _ in STAGES}
        for i in lined:
            found[i] = _fastest(equations, kappa[i], fastest, reflection[i]) / height
    return found


def growth_over_liner(case: DuctCase, frequency: Tensor, impedance: Any) -> tuple[Tensor, Tensor]:
    """Growth of the fastest wave over all lined patches, dB, (F,), and its largest alpha, (F,).

    0 and nan where no wave grows. ``impedance`` is as for ``DuctSolver.solve``, without leading axes; of a function the
    value in the middle of each patch.
    """
    if callable(impedance):
        impedance = impedance(torch.tensor([sum(pair) / 2 for pair in case.liner]).to(frequency), frequency)
    walls = torch.as_tensor(impedance).detach().cpu().expand(len(frequency), len(case.liner))
    growth = torch.zeros(len(frequency), dtype=torch.float64)
    worst = torch.full(growth.shape, NONE, dtype=torch.complex128)
    for patch, (start, end) in enumerate(case.liner):
        alpha = growing_wave(case.profile, frequency, walls[:, patch], case.slip_condition)
        growth += NEPER * (end - start) * torch.nan_to_num(alpha.imag)
        worst = torch.where(torch.isnan(worst.real) | (alpha.imag > worst.imag), alpha, worst)
    return growth, worst


def _fastest(equations: dict[int, PridmoreBrown], kappa: Tensor, fastest: float, reflection: Tensor) -> Any:
    """alpha H of the fastest growing root, or nan."""
    low, high = (math.log(share * float(kappa) / fastest) for share in (NEAREST, FARTHEST))
    along = torch.linspace(low, high, ALONG, dtype=torch.float64).exp()
    a = (along[:, None] * (1 + 1j * torch.tensor(ASIDE, dtype=torch.float64))).flatten()
    for parts, close, change in STAGES:

        def relative(z: Tensor, equation: PridmoreBrown = equations[parts]) -> Tensor:
            value, pressure = equation.residual(z, kappa.expand(len(z)), reflection)
            return value / pressure  # F itself grows as exp(alpha H)

        start = a
        a, last = newton(lambda z, f=relative: with_slopes(f, z), start, STEPS, LONGEST)  # type: ignore[misc]
        held = (last < close * a.abs()) & (a.imag > LEAST) & (a.real > kappa)
        a = a[held & ((a - start).abs() < change * a.abs())]
        apart = (a[:, None] - a).abs() < ALIKE * a.abs()
        a = a[~torch.triu(apart, diagonal=1).any(0)]
        if not len(a):
            return NONE
    return a[a.imag.argmax()]
