"""What the dispersion relation is asked for: batches, types, derivatives; and what is refused."""

from __future__ import annotations

import math

import pytest
import torch
from conftest import relative_error
from test_dispersion import DUCT, FREQUENCY, HEIGHT, SPEED, exact, passive

import torchliner as tl
from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.names import CONDITIONS

# --- batches, types, derivatives ----------------------------------------------------------------


def test_batch_is_the_loop():
    """A root does not know its neighbours; everything broadcasts."""
    walls, frequency = passive(6, seed=3), torch.tensor([400.0, 1500.0, 2900.0]).double()
    height = torch.tensor([0.03, 0.05]).double()[:, None, None]
    together = wavenumber_from_impedance(walls[:, None], frequency, height=height, mach=0.2)
    assert together.shape == (2, 6, 3)
    for h in range(2):
        for i in range(6):
            for f in range(3):
                one = wavenumber_from_impedance(walls[i], float(frequency[f]), height=float(height[h]), mach=0.2)
                assert abs(complex(one - together[h, i, f])) < 1e-13 * abs(complex(one))


def test_precision_follows_the_input():
    """complex64 in, complex64 out, computed in double."""
    walls = passive(5)
    single = wavenumber_from_impedance(walls.to(torch.complex64), FREQUENCY, mach=0.3, **DUCT)
    assert single.dtype == torch.complex64
    double = wavenumber_from_impedance(walls, FREQUENCY, mach=0.3, **DUCT)
    assert relative_error(single.to(torch.complex128), double) < 1e-6
    back = impedance_from_wavenumber(single, FREQUENCY, mach=0.3, **DUCT)
    assert back.dtype == torch.complex64


@pytest.mark.parametrize("condition", CONDITIONS)
def test_derivatives(condition):
    """In Z, k, H and M, first and second, at |Z| above and below 1."""
    walls = exact(2.33 - 0.3j, 0.4 + 0.5j).requires_grad_()
    reals = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (1500.0, 0.05, 0.3)]

    def forward(z, f, h, m):
        return wavenumber_from_impedance(z, f / SPEED, height=h, mach=m, sound_speed=1.0, condition=condition)

    def backward(z, f, h, m):
        alpha = exact(9.0 - 1.5j, -35 + 8j) * z
        return impedance_from_wavenumber(alpha, f, height=h, mach=m, condition=condition)

    for function in (forward, backward):
        torch.autograd.gradcheck(function, (walls, *reals), eps=1e-7, atol=1e-4, rtol=1e-5)
    torch.autograd.gradgradcheck(lambda z: forward(z, *(r.detach() for r in reals)), (walls,),
                                 eps=1e-6, atol=1e-3, rtol=1e-4)  # fmt: skip


# --- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"mach": 1.0}, r"mach is 1; its size must be below 1 \(a Mach number, not m/s\)"),
        ({"mach": -102.0}, "mach is -102"),
        ({"frequency": 0.0}, r"frequency \(Hz\) is 0; it must be finite and above 0"),
        ({"frequency": [500.0, float("nan")]}, r"frequency \(Hz\) is nan"),
        ({"height": -0.05}, r"height \(m\) is -0\.05"),
        ({"sound_speed": math.inf}, r"sound_speed \(m/s\) is inf"),
        ({"condition": "ingard"}, "unknown condition 'ingard' .did you mean 'ingard-myers'"),
    ],
)
def test_both_ways_refuse(about, match):
    given = {"height": HEIGHT, **about}
    frequency = given.pop("frequency", FREQUENCY)
    with pytest.raises(ValueError, match=match):
        impedance_from_wavenumber(exact(20 - 1j), frequency, **given)
    with pytest.raises(ValueError, match=match):
        wavenumber_from_impedance(exact(2.0), frequency, **given)


def test_other_refusals():
    real = torch.tensor([1.0])
    for function in (impedance_from_wavenumber, wavenumber_from_impedance):
        with pytest.raises(TypeError, match=r"is torch\.float32; a complex tensor is needed"):
            function(real, FREQUENCY, **DUCT)
    with pytest.raises(ValueError, match="unknown direction 'down'"):
        wavenumber_from_impedance(exact(2.0), FREQUENCY, direction="down", **DUCT)
    with pytest.raises(ValueError, match="impedance is nan; a hard wall is inf"):
        wavenumber_from_impedance(exact(complex("nan")), FREQUENCY, **DUCT)
    for mode in (-1, 0.5):
        with pytest.raises(ValueError, match=f"mode is {mode}; modes are numbered 0, 1, 2"):
            wavenumber_from_impedance(exact(2.0), FREQUENCY, mode=mode, **DUCT)
    at_cut_on = cut_on_frequency(UniformProfile(0.3, HEIGHT, SPEED))
    with pytest.raises(ValueError, match=r"mode 1 is exactly at its cut-on .*H = 50 mm"):
        wavenumber_from_impedance(exact(2.0), at_cut_on, mach=0.3, mode=1, **DUCT)


def test_an_active_wall_is_warned_of():
    with pytest.warns(tl.DataWarning, match=r"negative resistance, -0\.2 at least, in 1 of 2"):
        wavenumber_from_impedance(exact(1.0, -0.2 + 1j), FREQUENCY, **DUCT)
    wavenumber_from_impedance(exact(-1e-12 + 1j), FREQUENCY, **DUCT)  # rounding: quiet
