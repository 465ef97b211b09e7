"""Incident waves: what is sent, what is read from files, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from conftest import RATE, plane_of, relative_error, turbulence
from scipy.io import wavfile
from scipy.signal import hilbert

import torchliner as tl

SAMPLES = 840
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def test_recorded_waves(liner, tmp_path):
    """A .wav and a .npy give what the array gives; integers are only scaled."""
    plane, lines = plane_of(turbulence((2, SAMPLES))), [500.0, 1400.0, 4600.0]
    noise = tl.BandNoise(400, 4600).sampled(SAMPLES, RATE).numpy()
    wanted = tl.replay(plane, liner, tl.Recorded(noise, RATE), lines)
    assert wanted.choices["edge"] == "silent"
    np.save(tmp_path / "s.npy", noise[:, None])
    assert np.array_equal(tl.read_signal(tmp_path / "s.npy", RATE).signal, noise)
    wavfile.write(tmp_path / "s.wav", int(RATE), (noise / 4).astype(np.float32))
    found = tl.replay(plane, liner, tl.read_signal(tmp_path / "s.wav"), lines)
    assert relative_error(found.impedance, wanted.impedance) < 1e-4
    for kind, limit in ((np.int16, 1e-3), (np.int32, 1e-6), (np.uint8, 0.1)):
        shifted = noise / 4 * 127 + 128 if kind is np.uint8 else noise / 4 * np.iinfo(kind).max
        wavfile.write(tmp_path / "i.wav", int(RATE), shifted.round().astype(kind))
        assert np.abs(tl.read_signal(tmp_path / "i.wav").signal.numpy() - noise / 4).max() < limit


def test_signal_files_that_cannot_be_read(tmp_path):
    """Missing, truncated, several channels, no or another rate."""
    with pytest.raises(FileNotFoundError, match="no such file"):
        tl.read_signal(tmp_path / "a.wav")
    wavfile.write(tmp_path / "two.wav", 42000, np.ones((100, 2), dtype=np.float32))
    with pytest.raises(ValueError, match=r"\(100, 2\).*choose one channel"):
        tl.read_signal(tmp_path / "two.wav")
    assert len(tl.read_signal(tmp_path / "two.wav", channel=1).signal) == 100
    with pytest.raises(ValueError, match="choose one channel, not 2"):
        tl.read_signal(tmp_path / "two.wav", channel=2)
    with pytest.raises(ValueError, match="says 42000 Hz, sampling_rate 50000"):
        tl.read_signal(tmp_path / "two.wav", 50e3)
    whole = (tmp_path / "two.wav").read_bytes()
    for cut in (300, 20, 0):
        (tmp_path / "cut.wav").write_bytes(whole[:cut])
        with pytest.raises(ValueError, match=r"not a whole \.wav file"):
            tl.read_signal(tmp_path / "cut.wav")
    with pytest.raises(OSError, match="is a folder"):
        tl.read_signal(tmp_path, 50e3)
    np.save(tmp_path / "s.npy", np.ones(10))
    with pytest.raises(ValueError, match="choose one channel, not 5"):
        tl.read_signal(tmp_path / "s.npy", 50e3, channel=5)
    with pytest.raises(ValueError, match="does not state its sampling rate"):
        tl.read_signal(tmp_path / "s.npy")


def test_sent_signals_are_what_they_say():
    """rms 1 and flat lines for noise; instantaneous frequency for sweeps; low peaks for tones."""
    noise = tl.BandNoise(300, 5000, seed=2).sampled(SAMPLES, RATE)
    lines = torch.fft.rfft(noise).abs()
    assert float(noise.square().mean()) == pytest.approx(1)
    assert float(lines[6:101].std() / lines[6:101].mean()) < 1e-12
    assert float(lines[:6].max()) < 1e-9
    assert float((noise - tl.BandNoise(300, 5000, seed=3).sampled(SAMPLES, RATE)).abs().max()) > 1
    for spacing, middle in (("linear", 2650.0), ("logarithmic", (300 * 5000) ** 0.5)):
        sweep = tl.Sweep(300, 5000, spacing).sampled(8400, RATE).numpy()
        phase = np.unwrap(np.angle(hilbert(sweep)))
        assert np.gradient(phase)[4150:4250].mean() * RATE / 2 / np.pi == pytest.approx(middle, rel=0.01)
    tones = tl.Tones([500.0 * k for k in range(1, 11)]).sampled(SAMPLES, RATE)
    assert float(tones.abs().max()) < 0.75 * 10
