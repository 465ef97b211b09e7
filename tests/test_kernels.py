"""Kernels and levels of |v|: stated errors, gains, what the causal recipe loses, polynomials."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.engine.kernels import VelocityGrid, build_kernels, interpolate
from torchliner.liners.model import reflection_of

F64 = torch.float64


@pytest.mark.parametrize("name", ["onera", "polito_as_printed"])
@pytest.mark.parametrize("rate", [15e3, 50e3, 200e3])
def test_two_sided_kernels_are_the_model_in_the_band(name, rate):
    """Error at most 4e-7 for every |v| up to 20 m/s, gain at most 1.25, and the stated error is the true one."""
    kernels = build_kernels(tl.load_liner(name), rate, velocity_max=20.0, levels=40)
    assert max(kernels.error / 4e-7, kernels.gain / 1.25) <= 1
    check = torch.linspace(300, 3500, 311, dtype=F64)
    away = kernels.response(check) - reflection_of(tl.load_liner(name), check, kernels.grid.speeds[:, None])
    assert float(away.abs().max()) <= kernels.error * 1.05


@pytest.mark.parametrize(
    ("top", "levels", "spacing", "kind", "limit"),
    [
        (1.0, 200, "uniform", "linear", 6e-5),
        (20.0, 200, "uniform", "linear", 2.2e-2),
        (20.0, 200, "sqrt", "cubic", 6e-6),
        (5.0, 200, "sqrt", "cubic", 1e-6),
    ],
)
def test_interpolation_error(top, levels, spacing, kind, limit):
    """Cubics in the root of |v| beat the paper's levels by three orders."""
    grid, speeds = VelocityGrid(top, levels, spacing, kind), torch.linspace(0, top, 20001, dtype=F64)
    f, worst = torch.tensor([300.0, 1400.0, 3500.0], dtype=F64), 0.0
    for name in ("onera", "polito_as_printed"):
        liner = tl.load_liner(name)
        found = interpolate(reflection_of(liner, f, grid.speeds[:, None]), *grid.locate(speeds))
        worst = max(worst, float((found - reflection_of(liner, f, speeds[:, None])).abs().max()))
    assert limit / 20 < worst <= limit


@given(
    top=st.floats(1e-3, 100),
    levels=st.integers(4, 50),
    share=st.floats(0, 1),
    spacing=st.sampled_from(["sqrt", "uniform"]),
    kind=st.sampled_from(["linear", "cubic"]),
)
def test_interpolation_is_exact_on_its_polynomials(top, levels, share, spacing, kind):
    grid, speed = VelocityGrid(top, levels, spacing, kind), torch.tensor([share * top], dtype=F64)
    root = 0.5 if spacing == "sqrt" else 1.0
    for power in (0, 1, 3) if kind == "cubic" else (0, 1):
        wanted = (speed / top) ** (root * power)
        found = interpolate((grid.speeds[:, None] / top) ** (root * power), *grid.locate(speed))
        assert float((found - wanted).abs()) < 1e-9
