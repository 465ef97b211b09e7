"""What the simulated line of the B2A configurations is made of."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import torch
from conftest import load_script

import torchliner as tl

SCRIPT = load_script("b2a_line")


def test_the_imprint_fades_with_height():
    """Like e^(-2 pi y/pitch) far above, where the first harmonic is all that is left."""
    pitch, diameter = 12.44e-3, 0.991e-3
    x = np.linspace(0, pitch, 400, endpoint=False)
    near, far, farther = (SCRIPT.imprint(x, y, pitch, diameter) for y in (1e-3, 2e-2, 2.2e-2))
    assert near.max() > 2.5
    assert np.ptp(far) < 0.05 * np.ptp(near)
    assert np.ptp(farther) / np.ptp(far) == pytest.approx(math.exp(-4e-3 * math.pi / pitch), rel=0.02)
    assert near == pytest.approx(near[::-1][np.r_[-1:399]], abs=1e-9)  # about the cell's middle


def test_the_impedance_settles_at_its_own_velocity():
    """Without turbulence and at small levels it is the linear liner; it rises with both."""
    liner = tl.load_liner("onera")
    still = SCRIPT.settled_impedance(liner, 1e-6, 1e-3, 1.0)
    wanted = complex(liner.impedance(1500.0, torch.zeros(1, dtype=torch.float64))[0])
    assert still == pytest.approx(wanted, abs=1e-5)
    loud = SCRIPT.settled_impedance(liner, 1e-6, 500.0, 1.0)
    turbulent = SCRIPT.settled_impedance(liner, 4.0, 500.0, 1.0)
    assert still.real < loud.real < turbulent.real


def test_turbulence_has_its_rms_and_scales_with_its_pace():
    """Twice the pace u_tau/y: half the time scale."""
    source = SCRIPT.Turbulence()
    times = np.arange(40_000) / SCRIPT.FINE
    slow, fast = (source.at(times, pace, 2.0, 1) for pace in (2000.0, 4000.0))
    assert slow.std() == pytest.approx(2.0, rel=0.02)
    crossings = [int((np.diff(np.sign(v)) != 0).sum()) for v in (slow, fast)]
    assert crossings[1] / crossings[0] == pytest.approx(2.0, rel=0.15)


def test_files_hold_what_was_asked_for(tmp_path):
    """Rate, tone towards the source's decay, level and case are those of the configuration."""
    liner, turbulence = tl.load_liner("onera"), SCRIPT.Turbulence()
    quiet = SCRIPT.replace(SCRIPT.CASES[4], mach=0.3)
    SCRIPT.write_case(quiet, liner, turbulence, tmp_path, 4, 1.0)
    made = SCRIPT.Sound.of(quiet, liner).facts()
    records = tl.read_bursts(tmp_path)
    assert [record.source_side for record in records] == ["downstream"] * 4
    assert records[0].bursts == pytest.approx(SCRIPT.RATE, rel=0.03)
    assert made["decay (dB)"] > 5
    tones = []
    for record in records:
        wave = np.exp(-2j * np.pi * SCRIPT.FREQUENCY * record.arrival_time.numpy())
        tones.append(2 * abs((record.wall_normal.numpy() * wave).mean()))
    assert tones[-1] > 1.5 * tones[0]  # the source is at the downstream end
    assert cmath.isfinite(complex(made["assumed resistance"], made["assumed reactance"]))
