"""Impedance and its relatives, the gas, and the displacement thickness: laws and known values."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.conversions import admittance_from_reflection, spl_from_pressure_amplitude

INF = float("inf")
CONVERSIONS = (
    tl.reflection_from_impedance,
    tl.impedance_from_reflection,
    tl.absorption_from_reflection,
    admittance_from_reflection,
)
resistances = st.floats(1e-3, 1e3)
reactances = st.floats(-1e3, 1e3)


def number(value, dtype=torch.complex128):
    return torch.tensor(value, dtype=dtype)


@given(r=resistances, x=reactances)
def test_impedance_and_reflection_are_inverse(r, x):
    """Back and forth; 1 - R = 2/(z + 1) sets how many digits a near-rigid wall keeps."""
    z = number(complex(r, x))
    reflection = tl.reflection_from_impedance(z)
    found = complex(tl.impedance_from_reflection(reflection))
    assert abs(found - complex(z)) < 1e-15 * (2 + abs(complex(z))) ** 2


@given(r=resistances, x=reactances)
def test_laws_of_a_passive_wall(r, x):
    """Absorbed power 4 Re z/|z + 1|^2, z y = 1, |R| < 1, and R(1/z) = -R(z)."""
    z = number(complex(r, x))
    reflection = tl.reflection_from_impedance(z)
    assert float(reflection.abs()) <= 1
    absorbed = 4 * r / abs(complex(r, x) + 1) ** 2
    assert float(tl.absorption_from_reflection(reflection)) == pytest.approx(absorbed, abs=1e-14)
    assert abs(complex(tl.reflection_from_impedance(1 / z)) + complex(reflection)) < 1e-14
    admittance = complex(admittance_from_reflection(reflection))
    assert abs(admittance * complex(z) - 1) < 1e-14 * (2 + abs(complex(z)) + 1 / abs(complex(z)))


# Worked by hand: z = j reflects with a quarter turn; a mass (positive reactance) leads.
@pytest.mark.parametrize(
    ("impedance", "reflection", "absorption"),
    [(1, 0, 1), (3, 0.5, 0.75), (1j, 1j, 0), (-1j, -1j, 0), (0, -1, 0), (0.6 + 0.8j, 0.5j, 0.75)],
)
@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
def test_values_by_hand(impedance, reflection, absorption, dtype):
    found = tl.reflection_from_impedance(number(impedance, dtype))
    assert found.dtype == dtype
    assert abs(complex(found) - reflection) < 1e-6
    assert float(tl.absorption_from_reflection(found)) == pytest.approx(absorption, abs=1e-6)
    back = tl.impedance_from_reflection(number(reflection, dtype))
    assert abs(complex(back) - impedance) < 1e-6


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
@pytest.mark.parametrize("count", [1, 2, 17])
def test_rigid_wall(dtype, count):
    """z = inf gives R = 1 exactly, whatever the direction; R = 1 gives y = 0 and no finite z."""
    for rigid in (complex(INF, 0), complex(0, INF), complex(0, -INF)):
        reflection = tl.reflection_from_impedance(torch.full((count,), rigid, dtype=dtype))
        assert reflection.tolist() == [1] * count
    assert admittance_from_reflection(reflection).tolist() == [0] * count
    assert tl.absorption_from_reflection(reflection).tolist() == [0] * count
    assert bool(tl.impedance_from_reflection(reflection).real.isinf().all())


@pytest.mark.parametrize("function", CONVERSIONS)
def test_conversions_keep_the_shape_and_are_smooth(function):
    z = torch.tensor([[0.3 + 0.1j, -0.2j, 0.5]], dtype=torch.complex128, requires_grad=True)
    assert function(z).shape == (1, 3)
    assert torch.equal(function(z)[0, 1], function(z[0, 1]))
    assert torch.autograd.gradcheck(lambda w: torch.view_as_real(function(w) + 0j), (z,))


def test_level_of_a_tone():
    """20 uPa rms is 0 dB, 1 Pa rms 93.98 dB, ten times more 20 dB more, silence -inf."""
    peaks = 2**0.5 * torch.tensor([20e-6, 1.0, 10.0], dtype=torch.float64)
    assert spl_from_pressure_amplitude(peaks).tolist() == pytest.approx([0, 93.9794, 113.9794])
    assert torch.equal(spl_from_pressure_amplitude(1j * peaks), spl_from_pressure_amplitude(peaks))
    assert spl_from_pressure_amplitude(torch.zeros(1)).tolist() == [-INF]


# U.S. Standard Atmosphere 1976 at 0, 5 and 10 km: K, Pa -> m/s, kg/m3, Pa s (tables I and III).
@pytest.mark.parametrize(
    ("temperature", "pressure", "sound_speed", "density", "viscosity"),
    [
        (288.15, 101325.0, 340.294, 1.2250, 1.7894e-5),
        (255.676, 54048.0, 320.545, 0.73643, 1.6282e-5),
        (223.252, 26500.0, 299.532, 0.41351, 1.4577e-5),
    ],
)
def test_air_against_the_standard_atmosphere(temperature, pressure, sound_speed, density, viscosity):
    found = tl.Fluid.from_temperature(temperature, pressure)
    assert found.sound_speed == pytest.approx(sound_speed, rel=1e-4)
    assert found.density == pytest.approx(density, rel=1e-4)
    assert found.dynamic_viscosity == pytest.approx(viscosity, rel=1e-4)
    assert (found.heat_capacity_ratio, found.prandtl) == (1.4, 0.71)


def test_default_fluid_is_air_at_20_degrees():
    found, wanted = tl.Fluid(), tl.Fluid.from_temperature()
    for name in ("sound_speed", "density", "dynamic_viscosity"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-3)
    assert found.characteristic_impedance == pytest.approx(413.2128)
    assert found.thermal_diffusivity == pytest.approx(2.1209e-5, rel=1e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: tl.Fluid(density=0), r"fluid density is 0; it must be finite and above 0"),
        (lambda: tl.Fluid(heat_capacity_ratio=0.9), r"heat_capacity_ratio is 0.9; it is at least"),
        (lambda: tl.Fluid.from_temperature(20), r"temperature is 20 K; .* 150 to 1500 K .* 293.15"),
        (lambda: tl.Fluid.from_temperature(300, 0), r"pressure is 0; it must be finite and above"),
    ],
)
def test_impossible_gases_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("value", [None, "1.2", np.ones(2), torch.ones(2), 1j])
def test_a_number_is_asked_for_where_one_is_needed(value):
    with pytest.raises(TypeError, match=r"fluid density is .*number is needed"):
        tl.Fluid(density=value)


def test_a_real_impedance_is_refused():
    """Resistance alone, or |Z|, would give an R that looks right."""
    for function in (tl.reflection_from_impedance, tl.impedance_from_reflection):
        with pytest.raises(TypeError, match=r"is torch\.float32; a complex tensor is needed"):
            function(torch.ones(2))
