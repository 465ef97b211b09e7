"""What modes are asked for: extreme walls, batches, gradients, cut-on; and what is refused."""

from __future__ import annotations

import math

import pytest
import torch
from test_modes import B2A, HEIGHT, SPEED, TANH, UNIFORM, VELOCITY, WALLS, k_of

from torchliner.duct import modes as modes_module
from torchliner.duct.modes import cut_on_frequency, duct_modes

# --- walls at the ends of the range -------------------------------------------------------------


def test_extreme_walls():
    """Z = 0 has p = 0 on the wall; Z = inf, 1e9 and nothing are the rigid wall."""
    soft = duct_modes(TANH, 1500.0, 0.0)
    assert float(soft.pressure[..., -1].abs().max()) < 1e-9
    rigid = duct_modes(TANH, 1500.0)
    for hard in (math.inf, complex(0, math.inf), complex(-math.inf, 0), 1e9):
        found = duct_modes(TANH, 1500.0, hard).wavenumber
        assert float((found - rigid.wavenumber).abs().max()) < 1e-6
    assert float(rigid.normal[..., -1].abs().max()) < 1e-10


# --- batches, gradients, device -----------------------------------------------------------------


def test_batch_is_the_loop(monkeypatch):
    """Over walls and frequencies; also when more modes are wanted than fit one chunk."""
    monkeypatch.setattr(modes_module, "CHUNK", 32)
    frequency = [700.0, 1500.0, 2600.0]
    walls = torch.tensor(WALLS, dtype=torch.complex128).reshape(5, 1).expand(5, 3)
    walls = torch.stack([walls, walls + 0.3])  # (2, 5, 3): 60 modes
    whole = duct_modes(TANH, frequency, walls, count=2)
    for i, j, f in [(0, 0, 0), (1, 3, 2), (0, 4, 1)]:
        one = duct_modes(TANH, frequency[f], walls[i, j, f], count=2)
        assert torch.allclose(whole.wavenumber[i, j, f], one.wavenumber[0], rtol=1e-11, atol=1e-9)
        assert torch.allclose(whole.axial[i, j, f], one.axial[0], rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_gradients():
    """Of wavenumbers and shapes by Z, against differences."""
    walls = torch.tensor([[B2A], [0.5 - 1j]], dtype=torch.complex128, requires_grad=True)

    def outputs(z):
        modes = duct_modes(TANH, [1500.0], z, count=2, points=8)
        return modes.wavenumber, modes.pressure[..., ::30], modes.axial[..., ::30]

    assert torch.autograd.gradcheck(outputs, (walls,), eps=1e-5, atol=1e-5, rtol=1e-5)


# --- cut-on -------------------------------------------------------------------------------------


def test_cut_on():
    """Uniform flow: n c sqrt(1 - M^2)/(2 H). Sheared: complex just below, real just above."""
    for mode in (1, 2):
        wanted = mode * SPEED * math.sqrt(1 - 0.09) / (2 * HEIGHT)
        assert cut_on_frequency(UNIFORM, mode) == pytest.approx(wanted, rel=1e-7)
    limit = cut_on_frequency(TANH)
    assert 0.99 < limit / cut_on_frequency(UNIFORM) < 1
    below, above = duct_modes(TANH, [0.9999 * limit, 1.0001 * limit], count=2).wavenumber[:, 1]
    assert abs(below.imag) > 0.3
    assert abs(above.imag) < 1e-6
    at = float(duct_modes(UNIFORM, cut_on_frequency(UNIFORM), count=2).wavenumber[0, 1].abs())
    assert at == pytest.approx(0.3 * k_of(cut_on_frequency(UNIFORM)) / (1 - 0.09), rel=1e-6)  # a double root
    with pytest.raises(ValueError, match="mode is 0; the plane wave"):
        cut_on_frequency(TANH, 0)


# --- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"frequency": 0.0}, "frequency .*is 0"),
        ({"frequency": -5.0}, "frequency .*is -5"),
        ({"frequency": []}, "no frequency is given"),
        ({"impedance": math.nan}, "impedance is nan; a hard wall is inf"),
        ({"impedance": -1.0}, "impedance is -1, a wall that sends waves unasked"),
        ({"count": 0}, "count is 0; from one mode to 24"),
        ({"direction": "up"}, "unknown direction 'up'; choose one of: downstream, upstream"),
        (
            {"slip_condition": None},
            r"slips along the lined wall at Mach 0\.3; .*'continuous-velocity'",
        ),
        ({"slip_condition": "myers"}, "unknown slip condition 'myers'"),
    ],
)
def test_refusals(change, match):
    arguments = {
        "frequency": 1500.0,
        "impedance": B2A,
        "slip_condition": VELOCITY,
        **change,
    }
    with pytest.raises(ValueError, match=match):
        duct_modes(UNIFORM, arguments.pop("frequency"), arguments.pop("impedance"), **arguments)


def test_failures_that_computation_shows():
    with pytest.raises(ValueError, match="count is 60; from one mode to 24, twice the points"):
        duct_modes(TANH, 1500.0, count=60)
    modes = duct_modes(TANH, 1500.0, count=1)
    with pytest.raises(ValueError, match=r"run from 0 to 0\.05 m"):
        modes.at([0.06])
