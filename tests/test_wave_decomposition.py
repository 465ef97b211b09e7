"""Plane waves between microphones: synthetic ones with and without flow, then resolved cases."""

from __future__ import annotations

import cmath
import dataclasses
import math

import pytest
import torch
from conftest import turbulence
from test_in_situ import CASES, FLUID, FREQUENCY, RATE, as_the_file, file_of

import torchliner as tl

SAMPLES = 457
WAVELENGTH = FLUID.sound_speed / FREQUENCY


def record_of(
    reflection: complex, places: list[float], mach: float = 0.0, frequency: float = FREQUENCY, **about
) -> tl.PressureRecord:
    """Microphones and velocities in A e^{jk+ y} + B e^{-jk- y}, A = 2 Pa, written out by hand.

    The incident wave makes c (1 - M) towards the surface, the reflected one c (1 + M) away from it.
    """
    omega, c = 2 * math.pi * frequency, FLUID.sound_speed
    time = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    pressure, velocity = [], []
    for y in places:
        arriving = 2 * cmath.exp(1j * omega * y / (c * (1 - mach)))
        leaving = 2 * reflection * cmath.exp(-1j * omega * y / (c * (1 + mach)))
        turn = torch.exp(1j * omega * time)
        pressure.append(((arriving + leaving) * turn).real)
        velocity.append(((leaving - arriving) * turn).real / FLUID.characteristic_impedance)
    return tl.PressureRecord(
        microphones=torch.stack(pressure),
        microphone_y=places,
        microphone_velocity=torch.stack(velocity),
        microphone_mach=mach,
        sampling_rate=RATE,
        frequency=frequency,
        **about,
    )


@pytest.mark.parametrize("mach", [0.0, 0.3, -0.3, 0.9])
@pytest.mark.parametrize("reflection", [0.0, 0.5 - 0.4j, -0.9, 1j])
@pytest.mark.parametrize("options", [{}, {"microphones": "pair"}, {"velocities": True}])
def test_known_waves_come_back(mach, reflection, options):
    """R, Z and the level of the incident wave, whatever the flow along the axis."""
    record = record_of(reflection, [0.01, 0.02, 0.028], mach)
    found = tl.decompose_waves(record, **options)
    assert abs(complex(found.reflection[0]) - reflection) < 1e-9
    assert abs(complex(found.impedance[0]) - (1 + reflection) / (1 - reflection)) < 1e-8
    level = 20 * math.log10(2 / math.sqrt(2) / 20e-6)
    assert float(found.incident_level[0]) == pytest.approx(level, abs=1e-8)
    if options == {"microphones": "pair"}:  # two waves fit any two pressures: no residual
        assert math.isnan(float(found.residual[0]))
    else:
        assert float(found.residual[0]) < 1e-9


def test_least_squares_average_noise():
    """Many microphones err less than two; the residual says how noisy they were."""
    places = [0.01 + 0.004 * i for i in range(12)]
    clean = record_of(0.5, places)
    noise = turbulence((12, SAMPLES), rms=0.05)
    noisy = dataclasses.replace(clean, microphones=clean.microphones + noise)
    many = tl.decompose_waves(noisy)
    two = tl.decompose_waves(noisy, microphones=(0, 3))
    assert abs(complex(many.reflection[0]) - 0.5) < abs(complex(two.reflection[0]) - 0.5)
    assert 0 < float(many.residual[0]) < 0.05


@pytest.mark.filterwarnings("ignore:.*two plane waves leave:torchliner.DataWarning")
@pytest.mark.parametrize("case", CASES)
def test_the_files_own_waves(case):
    """Over the periods the file used, its own values: by five microphones, by p and v."""
    record = file_of(case)
    for options, own in (({}, "waves"), ({"velocities": True}, "pressure and velocity")):
        found = tl.decompose_waves(record, **options, **as_the_file(record))
        assert abs(complex(found.impedance[0]) - record.reference[own]) < 0.003


def test_vortices_bias_the_microphones():
    """o145: the waves are 0.12 off the truth, as the file's; the fit says so; p and v are not."""
    record = file_of("o145")
    true = record.reference["true"]
    with pytest.warns(tl.DataWarning, match=r"two plane waves leave 3.3 % of the signals"):
        found = tl.decompose_waves(record)
    assert abs(complex(found.impedance[0]) - true) == pytest.approx(0.116, abs=0.005)
    two = tl.decompose_waves(record, microphones=(0, 3), **as_the_file(record))
    assert abs(complex(two.impedance[0]) - record.reference["two microphones"]) < 0.002
    both = tl.decompose_waves(record, velocities=True)
    assert abs(complex(both.impedance[0]) - true) < 0.02


def test_half_a_wavelength_is_singular():
    """Named with the spacing; with flow the half wavelength is shorter by 1 - M^2."""
    for mach in (0.0, 0.5):
        half = WAVELENGTH / 2 * (1 - mach**2)
        with pytest.raises(ValueError, match="their spacing is 1 times half a wavelength"):
            tl.decompose_waves(record_of(0.5, [0.01, 0.01 + half], mach))
    with pytest.raises(ValueError, match="2 times half a wavelength"):
        tl.decompose_waves(record_of(0.5, [0.0, WAVELENGTH]))
    with pytest.warns(tl.DataWarning, match="condition number of"):
        tl.decompose_waves(record_of(0.5, [0.01, 0.01 + 0.49 * WAVELENGTH]))


@pytest.mark.parametrize(
    ("places", "options", "match"),
    [
        ([0.01], {}, "microphones: 1 given; two waves need at least two"),
        ([0.01, 0.01], {}, "0 mm apart are singular at 1400 Hz"),
        ([0.01, 0.02], {"microphones": [0, 5]}, "has microphones 0 to 1, not 5"),
        ([0.01, 0.02], {"frequency": 20000.0}, "at or above Nyquist"),
        ([0.01, 0.02], {"segment": float("inf")}, "segment is inf s"),
        ([0.01, 0.02], {"start": 0.01}, "holds 1.99 periods of 1400 Hz"),
    ],
)
def test_refusals(places, options, match):
    with pytest.raises(ValueError, match=match):
        tl.decompose_waves(record_of(0.5, places), **options)
