"""Laser Doppler stations with a reference channel, and the wall filter."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from test_stations import FREQUENCY, RATE, educed, noise, station

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def drifting(seed: int, seconds: float = 0.6):
    """A tone whose phase wanders, and the loudspeaker's signal that wanders with it."""
    generator = np.random.default_rng(seed)
    clock = np.arange(int(seconds * 40e3)) / 40e3
    wander = np.interp(clock, np.linspace(0, seconds, 13), generator.uniform(-9, 9, 13))
    times = np.cumsum(generator.exponential(1 / RATE, int(1.2 * RATE * seconds)))
    times = times[times < clock[-1] - 0.001]
    angle = 2 * np.pi * FREQUENCY * times + np.interp(times, clock, wander)
    velocity = noise(times, generator, 0.4) + 1.5 * np.cos(angle + 0.9)
    loud = 3.0 * np.cos(2 * np.pi * FREQUENCY * clock + wander)
    record = tl.BurstRecord(times, wall_normal=velocity, x=0.0, y=1e-3, z=0.0, frequency=FREQUENCY, title="wanders")
    return record, tl.ReferenceChannel(loud, 40e3)


def test_a_reference_sees_a_tone_that_wanders(onera):
    """Coherence with a steady tone is lost, that with the loudspeaker is not; v comes out with its
    amplitude and its lead over the reference (pi on top: v into the liner is -v)."""
    record, channel = drifting(1)
    plain = educed([record], onera, correction="none", segment=0.05)
    referred = educed([record], onera, correction="none", reference=channel, segment=0.05)
    assert float(referred.coherence[0, 0]) > 0.8
    assert float(plain.velocity_level[0, 0]) < 0.7 * float(referred.velocity_level[0, 0])
    lead = complex(referred.velocity_amplitude[0, 0] * -1)
    assert np.angle(lead) == pytest.approx(0.9, abs=0.05)


def test_a_given_phase_comes_from_the_reference(onera):
    """x in phase with the loudspeaker: a wandering tone gives what a steady one gives with psi."""
    steady = station(0, rms=0.2, phase=0.9, seconds=0.6)
    clock = np.arange(26_000) / 40e3
    loud = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * clock), 40e3)
    by_hand = educed([steady], onera, phase="given", reference_phase=0.4)
    referred = educed([steady], onera, phase="given", reference_phase=0.4, reference=loud)
    assert float((by_hand.reflection - referred.reflection).abs().max()) < 1e-3
    other = educed([steady], onera, phase="given", reference_phase=1.4)
    assert float((by_hand.impedance - other.impedance).abs().max()) > 0.05


@pytest.mark.parametrize("others", [[500.0], [200.0, 700.0], [3000.0]])
def test_a_frequency_with_a_reference_depends_on_no_other(onera, others):
    """Pieces as long as each needs: 200 Hz beside the tone raised its coherence, 0.40 to 0.88."""
    times = np.arange(26_000) / 40e3
    loud = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * times), 40e3)
    record = station(0, tone=0.3)
    rough = torch.from_numpy(np.random.default_rng(1).normal(size=record.bursts))
    record = dataclasses.replace(record, wall_normal=record.wall_normal + rough)
    choices = {"reference": loud, "phase": "self-consistent"}
    alone = educed([record], onera, **choices)
    beside = educed([record], onera, frequency=[*others, FREQUENCY], **choices)
    assert float(alone.coherence[0, 0]) < 0.6
    assert float(beside.coherence[0, -1]) == pytest.approx(float(alone.coherence[0, 0]), rel=1e-12)
    assert float((beside.reflection[..., -1] - alone.reflection[..., 0]).abs().max()) < 1e-9


def test_the_wall_filter_counts_silent_stations_as_wall(onera):
    """Admittance 0 in (5.2): one silent station of two doubles Z."""
    loud, silent = station(0, rms=0.2), station(1, tone=0.0, rms=0.2)
    alone = educed([loud], onera)
    both = educed([loud, silent], onera, wall_filter=0.5)
    assert both.wall.tolist() == [[False], [True]]
    wanted = 2 * complex(alone.average.impedance[0])
    assert complex(both.average.impedance[0]) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("which", [0, 1])
def test_one_clock_for_all_stations(onera, which):
    """V relative to a channel and V on the clock of the arrivals have no common mean."""
    both = [station(0), station(1)]
    channels: list = [tl.ReferenceChannel(np.cos(np.arange(26_000) / 5), 40e3)] * 2
    channels[which] = None
    with pytest.raises(ValueError, match=r"s1 has phases relative to .*, s0 .*share one case"):
        educed(both, onera, reference=channels)


def test_references_that_tell_no_phase_say_so(onera):
    """Noise, and another tone: v does not follow; too few samples a period are refused."""
    times = np.arange(26_000) / 40e3
    random = np.random.default_rng(0).standard_normal(len(times))
    for values in (random, np.cos(2 * np.pi * 700 * times)):
        channel = tl.ReferenceChannel(values, 40e3)
        found = educed([station(0)], onera, reference=channel, phase="given", reference_phase=0.0)
        assert any("it tells nothing of the phase of the sound" in note for note in found.station_notes[0])
    coarse = tl.ReferenceChannel(np.cos(2 * np.pi * FREQUENCY * np.arange(3000) / 6e3), 6e3)
    with pytest.raises(ValueError, match="reference is sampled at 6000 Hz, less than 8 times"):
        educed([station(0)], onera, reference=coarse)
    with pytest.raises(TypeError, match="a reference is ndarray; make a ReferenceChannel"):
        educed([station(0)], onera, reference=np.zeros(5))
