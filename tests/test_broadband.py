"""R(f) from one replay of any incident signal."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, frozen_plane, plane_of, relative_error, turbulence
from scipy.io import wavfile

import torchliner as tl
from torchliner.replay.waves import parse_signal
from torchliner.tdibc.broadband import educe_signal
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepare import prepare

SAMPLES = 840  # lines 50 Hz apart
LINES = [500.0, 1400.0, 3000.0, 4800.0]


@pytest.mark.parametrize(
    "wave",
    [tl.BandNoise(300, 5000), tl.Sweep(300, 5000), tl.Sweep(300, 5000, "logarithmic")],
    ids=lambda w: w.label,
)
@pytest.mark.parametrize("engine", ["unfold", "direct"])
def test_frozen_velocity_returns_the_model(liner, wave, engine):
    """|v| constant, the record one period of the signal: Z of the model, but for the kernel."""
    plane = frozen_plane(2.0, periods=28)
    assert plane.samples == SAMPLES
    found = tl.educe(plane, liner, LINES, incident=wave, engine=engine)
    wanted = liner.impedance(torch.tensor(LINES), 2.0)
    limit = 3 * found.choices["kernel_error"]
    assert float((found.reflection - tl.reflection_from_impedance(wanted)).abs().max()) < limit
    assert limit < 2e-5
    assert found.choices["phase"] == "signal"
    assert found.choices["incident"] == wave.label


def test_frozen_velocity_and_steady_tones(liner):
    """Several tones at once, none on a line of the record: Hann leakage between them is small."""
    plane = frozen_plane(2.0, periods=33.3)
    tones = [512.0, 1391.0, 2777.0]
    found = tl.educe(plane, liner, incident=tl.Tones(tones))
    assert found.frequency.tolist() == tones
    wanted = liner.impedance(torch.tensor(tones), 2.0)
    assert relative_error(found.impedance, wanted) < 2e-3


def test_noise_tends_to_what_spectral_gives_at_once(liner):
    """Over draws of a noise the H1 estimate tends to <R(f, |v|)>, with 1/sqrt(draws)."""
    plane = plane_of(turbulence((1, SAMPLES), seed=3))
    wanted = tl.educe(plane, liner, LINES, edge="wrap", window="boxcar").reflection[0]

    (ready,) = prepare([plane], liner, LINES, Choices(incident=tl.BandNoise(300, 5000)))

    def draw(seed):  # the kernels are those of all draws
        noise = tl.BandNoise(300, 5000, seed)
        chosen = dataclasses.replace(ready.chosen, incident=noise)
        sent = noise.sampled(SAMPLES, RATE)
        own = dataclasses.replace(ready, chosen=chosen, sent=sent)
        return educe_signal(own, None, None).reflection[0]

    draws = torch.stack([draw(seed) for seed in range(48)])
    error = (draws.mean(0) - wanted).abs()
    spread = draws.std(0) / 48**0.5
    assert bool((error < 3.5 * spread).all())
    assert float(spread.max()) < 0.1
    # not a test of nothing: one draw is off by far more
    assert bool(((draws[0] - wanted).abs() > 2 * error).any())


def test_segments_average(liner):
    """Long records are cut into segments; their average comes near the mean."""
    v = turbulence((1, 42000), seed=4)
    wanted = tl.educe(plane_of(v), liner, FREQUENCY).reflection[0]
    options = {"incident": tl.BandNoise(300, 3500), "segment": 0.1}
    found = tl.educe(plane_of(v), liner, FREQUENCY, **options)
    assert float((found.reflection[0] - wanted).abs()) < 0.25
    assert found.choices["window"] == "hann"
    assert found.choices["segment"] == 0.1


def test_default_frequencies_are_the_lines(liner):
    """Lines of the record in the signal's band, thinned evenly if there are many."""
    found = tl.educe(plane_of(turbulence((1, SAMPLES))), liner, incident="noise:300:1000")
    assert found.frequency.tolist() == pytest.approx([50.0 * k for k in range(6, 21)])
    many = tl.educe(plane_of(turbulence((1, 8400))), liner, incident="noise:300:5000")
    assert 100 < len(many.frequency) <= 200
    steps = many.frequency.diff()
    assert float(steps.max() - steps.min()) < 1e-9


@pytest.mark.filterwarnings("ignore:.*replies last 12 ms")
def test_recorded_signals(liner, tmp_path):
    """A .wav and a .npy of a signal give what the array gives; integers are only scaled."""
    plane = plane_of(turbulence((2, SAMPLES)))
    noise = tl.BandNoise(400, 4600).sampled(SAMPLES, RATE).numpy()
    recorded = tl.Recorded(noise, RATE)
    wanted = tl.educe(plane, liner, [500.0, 1400.0, 4600.0], incident=recorded)
    assert wanted.choices["edge"] == "silent"
    np.save(tmp_path / "s.npy", noise[:, None])
    from_npy = tl.read_signal(tmp_path / "s.npy", RATE)
    assert torch.equal(from_npy.signal, recorded.signal)
    wavfile.write(tmp_path / "s.wav", int(RATE), (noise / 4).astype(np.float32))
    found = tl.educe(plane, liner, [500.0, 1400.0, 4600.0], incident=tl.read_signal(tmp_path / "s.wav"))
    assert float((found.reflection - wanted.reflection).abs().max()) < 1e-5
    for kind, limit in ((np.int16, 1e-3), (np.int32, 1e-6), (np.uint8, 0.1)):
        top = np.iinfo(kind).max
        shifted = noise / 4 * 127 + 128 if kind is np.uint8 else noise / 4 * top
        wavfile.write(tmp_path / "i.wav", int(RATE), shifted.round().astype(kind))
        read = tl.read_signal(tmp_path / "i.wav").signal.numpy()
        assert np.abs(read - noise / 4).max() < limit


def test_reflected_signal_is_written(liner, tmp_path):
    """(time, probe), and its own spectrum over the incident one's is the map."""
    xarray = pytest.importorskip("xarray")
    plane = plane_of(turbulence((2, 3, SAMPLES)), x=[0.0, 0.01, 0.02], z=[0.0, 0.01])
    path = tmp_path / "y.h5"
    found = tl.educe(plane, liner, LINES, incident="noise:300:5000", reflected=path)
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        assert data["reflected"].shape == (SAMPLES, 6)
        assert data["reflected"].dims == ("time", "probe")
        at = [round(f / 50) for f in LINES]
        reflected = np.fft.rfft(data["reflected"].values, axis=0)[at]
        ratio = reflected / np.fft.rfft(data["incident"].values)[at, None]
        wanted = found.reflection.reshape(6, -1).T.numpy()
        assert np.abs(ratio - wanted).max() < 1e-5
        assert data["x"].values.tolist() == pytest.approx([0.0, 0.01, 0.02] * 2)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="no energy at 100 Hz"):
        tl.educe(plane, liner, 100.0, incident="noise:300:5000", reflected=path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["y.h5"]


@pytest.mark.parametrize(
    ("incident", "options", "message"),
    [
        (tl.Recorded(torch.ones(SAMPLES), 50e3), {}, "sampled at 50000 Hz, the plane at 42000 Hz"),
        (tl.Recorded(torch.ones(SAMPLES - 1), RATE), {}, "839 samples, the plane's record 840"),
        (tl.Recorded(torch.zeros(SAMPLES), RATE), {}, "zero throughout"),
        (tl.Sweep(300, 22000), {}, "sweep 300-22000 Hz reaches 22000 Hz, .*Nyquist"),
        (tl.BandNoise(300, 21000), {}, "Nyquist"),
        (tl.Tones([300, 21500]), {}, "Nyquist"),
        (tl.BandNoise(300, 310), {"frequency": 300.0}, None),
        (tl.BandNoise(310, 340), {}, "lines are 50 Hz apart and none lies in the band"),
        (tl.BandNoise(300, 1000), {"frequency": 1400.0}, r"no energy at 1400 Hz.*-\d+ dB"),
        (tl.BandNoise(300, 5000), {"band": (300.0, 3500.0), "frequency": 500.0},
         "reaches beyond the kernel's band, 300-3500 Hz"),
        (tl.BandNoise(300, 5000), {"frequency": 1410.0}, "the nearest is 1400 Hz"),
        (tl.BandNoise(300, 5000), {"segment": 1.0}, "segment is 1 s, 42000 samples.*840"),
        (tl.BandNoise(300, 5000), {"engine": "spectral"}, "needs 'unfold' or 'direct'"),
        (tl.BandNoise(300, 5000), {"phase": "given"}, "rule for tones"),
        (tl.BandNoise(300, 5000), {"reference_phase": 0.3}, "for tones"),
        ("speech.wav", {}, "no generated one; read a file with"),
        ("noise:300", {}, "cannot be read.*noise:300:6000:0"),
        ("sweep:300:5000:square", {}, "unknown sweep 'square'"),
        ("tones:a,b", {}, "cannot be read"),
        (None, {"segment": 0.01}, "segment is only used"),
        (None, {"reflected": "y.h5"}, "needs an incident one"),
    ],
)  # fmt: skip
def test_signals_that_cannot_serve(liner, incident, options, message):
    """Each says what would."""
    plane = plane_of(turbulence((1, SAMPLES)))
    if message is None:
        assert torch.isfinite(tl.educe(plane, liner, incident=incident, **options).resistance).all()
        return
    with pytest.raises(ValueError, match=message):
        tl.educe(plane, liner, incident=incident, **options)


def test_arrays_are_wrapped_first(liner):
    """A bare array has no rate."""
    with pytest.raises(TypeError, match=r"wrap your samples as Recorded\(signal, rate\)"):
        tl.educe(plane_of(turbulence((1, SAMPLES))), liner, incident=torch.ones(SAMPLES))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tl.Sweep(3000, 300), "must run upwards"),
        (lambda: tl.Sweep(300, 3000, "cubic"), "unknown sweep 'cubic'"),
        (lambda: tl.BandNoise(-1, 300), "above 0"),
        (lambda: tl.Tones([300, 500], amplitude=[1, 2, 3]), "amplitude has 3 values for 2 tones"),
        (lambda: tl.Tones([]), "no frequency"),
        (lambda: tl.BandNoise(300, 500, 1 << 70), "seed is .*; it is 0 to"),
        (lambda: tl.Recorded([[1.0, 2.0]], RATE), "one channel is needed"),
        (lambda: tl.Recorded([1.0, float("nan")], RATE), "nan or inf"),
        (lambda: tl.Recorded([1.0], 0.0), "above 0"),
    ],
)
def test_signals_are_checked_when_made(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_signal_files_that_cannot_be_read(tmp_path):
    """Missing, truncated, several channels, no or another rate."""
    with pytest.raises(FileNotFoundError, match="no such file"):
        tl.read_signal(tmp_path / "a.wav")
    wavfile.write(tmp_path / "two.wav", 42000, np.ones((100, 2), dtype=np.float32))
    with pytest.raises(ValueError, match=r"\(100, 2\).*choose one channel"):
        tl.read_signal(tmp_path / "two.wav")
    assert len(tl.read_signal(tmp_path / "two.wav", channel=1).signal) == 100
    with pytest.raises(ValueError, match="channels 0 to 1, not 2"):
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
    with pytest.raises(ValueError, match="has no name"):
        tl.read_signal("")
    np.save(tmp_path / "s.npy", np.ones(10))
    with pytest.raises(ValueError, match="channels 0 to 0, not 5"):
        tl.read_signal(tmp_path / "s.npy", 50e3, channel=5)
    with pytest.raises(ValueError, match="does not state its sampling rate"):
        tl.read_signal(tmp_path / "s.npy")


def test_texts_of_signals():
    """What the command line takes."""
    assert parse_signal("sweep:300:5000:logarithmic") == tl.Sweep(300, 5000, "logarithmic")
    assert parse_signal("noise:300:5000:7") == tl.BandNoise(300, 5000, 7)
    assert parse_signal("tones:500,900").frequency.tolist() == [500, 900]
    assert parse_signal("speech.wav") is None


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
        from scipy.signal import hilbert

        phase = np.unwrap(np.angle(hilbert(sweep)))
        assert np.gradient(phase)[4150:4250].mean() * RATE / 2 / np.pi == pytest.approx(middle, rel=0.01)
    tones = tl.Tones([500.0 * k for k in range(1, 11)]).sampled(SAMPLES, RATE)
    assert float(tones.abs().max()) < 0.75 * 10


def test_energy_outside_the_band_is_warned_of(liner):
    """A recorded signal may hold what the kernel does not stand for; the share is said."""
    plane = plane_of(turbulence((1, SAMPLES)))
    t = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    signal = torch.cos(2 * torch.pi * 1400 * t) + torch.cos(2 * torch.pi * 9000 * t)
    with pytest.warns(tl.DataWarning, match="50 % of the energy of recorded signal lies outside"):
        tl.educe(plane, liner, 1400.0, incident=tl.Recorded(signal, RATE))


@pytest.mark.parametrize("segment", [0.005, 0.0131])
@pytest.mark.filterwarnings("ignore:.*replies last 12 ms")
def test_segments_need_not_divide_the_record(liner, segment):
    """Default lines are those of the segments, whatever the record's are."""
    plane = plane_of(turbulence((1, 4200)))
    found = tl.educe(plane, liner, incident="noise:400:3000", segment=segment)
    spacing = RATE / round(segment * RATE)
    orders = found.frequency / spacing
    assert float((orders - orders.round()).abs().max()) < 1e-9
    with pytest.raises(ValueError, match=r"needs whole periods.*of 1391 Hz"):
        tl.educe(plane, liner, 500.0, incident=tl.Tones([500.0, 1391.0]), edge="wrap")


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_excluded_probes_are_nan_everywhere(liner, tmp_path):
    """In the map and in the reflected signal; their neighbours are as without them."""
    import h5py

    v = turbulence((3, SAMPLES))
    wanted = tl.educe(plane_of(v), liner, LINES, incident="noise:300:5000")
    v[1, 7] = torch.nan
    path = tmp_path / "y.h5"
    found = tl.educe(plane_of(v), liner, LINES, incident="noise:300:5000", missing="exclude",
                     reflected=path)  # fmt: skip
    for name in ("reflection", "mean_velocity", "velocity_rms"):
        value = getattr(found, name)
        parts = (value.real, value.imag) if value.is_complex() else (value,)
        for part in parts:
            assert bool(torch.isnan(part[1]).all())
            assert bool(torch.isfinite(part[[0, 2]]).all())
    assert torch.equal(found.reflection[[0, 2]], wanted.reflection[[0, 2]])
    with h5py.File(path) as file:
        assert np.isnan(file["reflected"][:, 1]).all()
        assert np.isfinite(file["reflected"][:, [0, 2]]).all()
