"""Tones exact in any record, and transfer functions between signals."""

from __future__ import annotations

import cmath

import numpy as np
import pytest
import scipy.signal
import torch
from conftest import turbulence
from test_in_situ import FREQUENCY, RATE, tone

from torchliner.tones import segment_amplitudes, tone_amplitudes, transfer_function, window_weights


@pytest.mark.parametrize("window", ["hann", "boxcar", "blackman"])
@pytest.mark.parametrize("samples", [100, 457, 1000])
def test_tones_are_exact_in_any_record(window, samples):
    """Tone, mean and whole or broken periods: the amplitude comes out to rounding."""
    amplitude = 0.7 * cmath.exp(0.4j)
    weights = window_weights(window, samples)
    found = tone_amplitudes(tone(amplitude, samples) + 5.0, torch.tensor([FREQUENCY]), RATE, weights)
    assert abs(2 * complex(found[0]) - amplitude) < 1e-11


def test_phase_refers_to_sample_zero():
    """A part of a record gives the amplitude of the whole."""
    part = tone(1 + 2j, 800)[300:]
    weights = window_weights("hann", 500)
    found = tone_amplitudes(part, torch.tensor([FREQUENCY]), RATE, weights, begin=300)
    assert abs(2 * complex(found[0]) - (1 + 2j)) < 1e-11


def test_transfer_is_scipys():
    """At the bins of the segments H1 and coherence are those of csd and welch."""
    x, noise = (turbulence((1, 4096), seed=i)[0] for i in range(2))
    y = 0.3 * x.roll(3) + 0.2 * noise
    length = 512
    frequency = torch.arange(4, 100, 7, dtype=torch.float64) * RATE / length
    found = transfer_function(x, y, frequency, RATE, segment=length / RATE)
    about = {"fs": RATE, "nperseg": length, "window": "hann", "detrend": "constant"}
    f, cross = scipy.signal.csd(x.numpy(), y.numpy(), **about)
    _, power = scipy.signal.welch(x.numpy(), **about)
    _, coherence = scipy.signal.coherence(x.numpy(), y.numpy(), **about)
    bins = np.searchsorted(f, frequency.numpy() - 1e-6)
    assert np.abs(found.response.numpy() - (cross / power)[bins]).max() < 1e-9
    assert np.abs(found.coherence.numpy() - coherence[bins]).max() < 1e-9
    assert found.segments == 15


def test_noise_on_the_output_leaves_h1_unbiased():
    """Noise on y averages out; put on x instead, it would pull |H1| down."""
    x = tone(1.0, 40_000)
    noise = turbulence((1, 40_000), rms=1.0)[0]
    where = torch.tensor([FREQUENCY])
    about = {"segment": 0.02}
    good = transfer_function(x, 2 * x + noise, where, RATE, **about).response[0]
    assert abs(complex(good) - 2) < 0.05


def test_segments_share_one_clock():
    """A steady tone has the same amplitude and phase in every segment, between the bins too."""
    rate, frequency = 8000.0, torch.tensor([433.0, 1210.0], dtype=torch.float64)
    times = torch.arange(4000, dtype=torch.float64) / rate
    angle = 2 * torch.pi * frequency[:, None] * times
    signal = torch.cos(angle + torch.tensor([[0.7], [-1.1]], dtype=torch.float64))  # one tone a channel
    found = segment_amplitudes(signal, frequency, rate, segment=0.1)
    assert found.shape == (9, 2, 2)
    for i, phase in enumerate((0.7, -1.1)):
        wanted = 0.5 * torch.exp(torch.tensor(1j * phase, dtype=torch.complex128))
        assert float((found[:, i, i] - wanted).abs().max()) < 1e-9
