"""Velocity levels and impulse responses: errors, gains, and what the causal recipe loses."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.conversions import impedance_from_reflection
from torchliner.liners.response import impedance_of
from torchliner.replay.kernels import build_kernels, reflection_at_levels
from torchliner.replay.levels import VelocityGrid, interpolate

F1400 = torch.tensor([1400.0], dtype=torch.float64)


@pytest.mark.parametrize("name", ["onera", "polito"])
@pytest.mark.parametrize("rate", [15e3, 30e3, 50e3, 200e3])
def test_two_sided_kernel_is_the_model_in_band(name, rate):
    """Error at most 4e-7 for every |v| up to 20 m/s, gain at most 1.25."""
    kernels = build_kernels(tl.load_liner(name), VelocityGrid(20.0, 40), rate)
    assert kernels.error <= 4e-7
    assert kernels.gain <= 1.25
    check = torch.linspace(300, 3500, 311, dtype=torch.float64)
    distance = kernels.response(check) - reflection_at_levels(tl.load_liner(name), check, kernels.grid)
    assert float(distance.abs().max()) <= kernels.error * 1.05


def test_causal_kernel_loses_a_third_of_the_resistance():
    """The published recipe at |v| = 5 m/s: 3.05-0.32j instead of 4.61-0.27j (PoliTo)."""
    liner = tl.load_liner("polito")
    kernels = build_kernels(liner, VelocityGrid(5.0, 4), 200e3, kind="causal")
    found = complex(impedance_from_reflection(kernels.response(F1400))[-1, 0])
    assert abs(found - (3.05 - 0.32j)) < 0.03
    assert abs(complex(liner.impedance(1400.0, 5.0)) - (4.61 - 0.27j)) < 0.01
    assert kernels.error > 0.1
    assert kernels.first == 0


def test_linear_liner_needs_no_taps_before_zero():
    """At rest the model is causal: the causal kernel is within 1e-2 there, 10 times its error."""
    liner = tl.load_liner("onera")
    kernels = build_kernels(liner, VelocityGrid(5.0, 4), 200e3, kind="causal")
    wanted = reflection_at_levels(liner, F1400, kernels.grid)
    distance = (kernels.response(F1400) - wanted).abs()[:, 0]
    assert float(distance[0]) < 0.2 * float(distance[-1])


# maximum |v|, levels, spacing, interpolation -> largest error in R allowed
GRIDS = [
    (1.0, 200, "uniform", "linear", 6e-5), (5.0, 200, "uniform", "linear", 1.5e-3),
    (20.0, 200, "uniform", "linear", 2.2e-2), (20.0, 200, "sqrt", "cubic", 6e-6),
    (20.0, 100, "sqrt", "cubic", 1e-4), (5.0, 200, "sqrt", "cubic", 1e-6),
]  # fmt: skip


@pytest.mark.parametrize(("top", "levels", "spacing", "kind", "limit"), GRIDS)
def test_interpolation_error(top, levels, spacing, kind, limit):
    """Levels uniform in sqrt|v| with cubic interpolation beat the paper's by three orders."""
    grid = VelocityGrid(top, levels, spacing, kind)
    speeds = torch.linspace(0, top, 20001, dtype=torch.float64)
    worst = 0.0
    for name in ("onera", "polito"):
        liner = tl.load_liner(name)
        for frequency in (300.0, 1400.0, 3500.0):
            at = torch.tensor([frequency], dtype=torch.float64)
            found = interpolate(reflection_at_levels(liner, at, grid), *grid.locate(speeds))[:, 0]
            wanted = tl.reflection_from_impedance(liner.impedance(frequency, speeds))
            worst = max(worst, float((found - wanted).abs().max()))
    assert limit / 20 < worst <= limit


@given(
    top=st.floats(1e-3, 100), levels=st.integers(4, 50), share=st.floats(0, 1),
    spacing=st.sampled_from(["sqrt", "uniform"]), kind=st.sampled_from(["linear", "cubic"]),
)  # fmt: skip
def test_interpolation_is_exact_on_its_polynomials(top, levels, share, spacing, kind):
    """Weights sum to 1 and reproduce sqrt|v| or |v| and, if cubic, its cube, at any |v|."""
    grid = VelocityGrid(top, levels, spacing, kind)
    speed = torch.tensor([share * top], dtype=torch.float64)

    def natural(v: torch.Tensor) -> torch.Tensor:
        return (v / top).sqrt() if spacing == "sqrt" else v / top

    for power in (0, 1, 3) if kind == "cubic" else (0, 1):
        found = interpolate(natural(grid.speeds) ** power, *grid.locate(speed))
        assert float((found - natural(speed) ** power).abs()) < 1e-9


def test_bad_grids_and_bands():
    """Too few levels, unknown names, empty bands."""
    liner = tl.load_liner("polito")
    with pytest.raises(ValueError, match=r"levels is 3; it is 4 to 10000"):
        VelocityGrid(1.0, 3)
    with pytest.raises(ValueError, match=r"spacing 'squrt'.*'sqrt'"):
        VelocityGrid(1.0, 10, "squrt")
    grid = VelocityGrid(1.0, 10)
    with pytest.raises(ValueError, match="3500-300"):
        build_kernels(liner, grid, 50e3, band=(3500.0, 300.0))
    with pytest.raises(ValueError, match="beyond the rate 500"):
        build_kernels(liner, grid, 500.0)
    kernels = build_kernels(liner, grid, 50e3)
    with pytest.raises(ValueError, match=r"4000 Hz is outside the kernel's band, 300-3500.*band="):
        kernels.require_band(torch.tensor([4000.0]))


def test_a_users_liner_of_the_wrong_shape_is_named():
    """A liner that returns the wrong shape is told which shape is meant."""

    class Wrong:
        def impedance(self, frequency, speed):
            return torch.ones(7, dtype=torch.complex128)

    with pytest.raises(ValueError, match=r"Wrong.impedance.*\(7,\).*\(3,\)"):
        impedance_of(Wrong(), torch.ones(3), torch.ones(()))
