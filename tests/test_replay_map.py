"""Maps from reflected signals, and the waves that are sent: noise, segments, the paper's recipe, files, refusals."""

import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, codes, frozen_plane, plane_of, relative_error, turbulence
from scipy.io import wavfile
from scipy.signal import hilbert

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")

SAMPLES = 840  # lines 50 Hz apart
LINES = [500.0, 1400.0, 3000.0, 4800.0]
PAPER = {"kernel": "causal", "levels": 200, "spacing": "uniform", "interpolation": "linear", "window": "hann"}
F64 = torch.float64


@pytest.mark.parametrize(
    "wave", [tl.BandNoise(300, 5000), tl.Sweep(300, 5000), tl.Sweep(300, 5000, "logarithmic")], ids=lambda w: w.label
)
def test_a_frozen_velocity_returns_the_model(liner, wave):
    """|v| constant, the record one period of the wave: Z of the model, but for the kernel, in every average."""
    found = tl.replay(frozen_plane(2.0, periods=28), liner, wave, LINES)
    wanted = tl.reflection_from_impedance(liner.impedance(torch.tensor(LINES, dtype=F64), 2.0))
    limit = 3 * found.choices["kernel_error"]
    for each in (found.probes["admittance"], *found.liner.values(), *found.cells.values()):
        assert float((each.reflection - wanted).abs().max()) < limit < 2e-5
    assert [found.choices[key] for key in ("phase", "incident", "edge")] == ["signal", wave.label, "periodic"]
    assert found.averagings == ("admittance", "velocity")
    assert found.level is None


def test_noise_tends_to_what_educe_gives_at_once(liner):
    """Over draws of a noise R tends to <R(f, |v|)>, with 1/sqrt(draws)."""
    plane = plane_of(turbulence((1, SAMPLES), seed=3))
    wanted = tl.educe(plane, liner, LINES, interval=None).probes["admittance"].reflection[0]
    maps = [tl.replay(plane, liner, tl.BandNoise(300, 5000, seed), LINES, levels=60) for seed in range(48)]
    draws = torch.stack([each.probes["admittance"].reflection[0] for each in maps])
    error, spread = (draws.mean(0) - wanted).abs(), draws.std(0) / 48**0.5
    assert bool((error < 3.5 * spread).all())
    assert float(spread.max()) < 0.1
    assert bool(((draws[0] - wanted).abs() > 2 * error).any())  # one draw is off by far more


def test_segments_and_their_intervals(liner):
    """Leaving out runs of segments gives intervals that hold <R> at the stated level, over draws."""
    many = tl.educe(plane_of(turbulence((1, 200_000), seed=99, rms=1.5)), liner, [900.0, 1500.0, 2500.0], interval=None)
    hits, z = [], many.impedance[0]
    for seed in range(24):
        plane, noise = plane_of(turbulence((1, 4200), seed=seed, rms=1.5)), tl.BandNoise(500, 3300, seed)
        found = tl.replay(plane, liner, noise, many.frequency, segment=0.01, levels=60)
        assert (found.choices["window"], found.choices["blocks"]) == ("hann", 19)
        low, high = found.liner["admittance"].low, found.liner["admittance"].high
        hits += [(low.real <= z.real) & (z.real <= high.real), (low.imag <= z.imag) & (z.imag <= high.imag)]
    assert 0.88 < float(torch.stack(hits).double().mean()) <= 1
    few = tl.replay(plane, liner, noise, 1500.0, segment=0.05)
    assert few.level is None
    assert "few-segments" in codes(few)


def test_the_paper_to_the_letter_against_stored_values():
    """Signals of the core before this one. It had steady waves before the record where there is silence now (3e-4 in R
    of 21 periods under Hann), and levels up to the bound of the phase-locked velocity, 11.3 m/s."""
    cases = {
        "broadband_two_sided": ("noise:300:3000", {}, 2e-6),
        "broadband_causal": ("noise:300:3000", {"kernel": "causal"}, 2e-6),
        "paper": (FREQUENCY, PAPER | {"velocity_max": 128**0.5 * (1 + 1e-9)}, 2e-6),
        "paper_incident_tone": (tl.Tones(FREQUENCY), PAPER, 2e-6),
        "unfold_two_sided_float64": (FREQUENCY, {"dtype": "float64"}, 4e-4),
    }
    plane, liner = tl.read_plane(DATA / "slit_n130_y1.0mm.h5"), tl.load_liner("lbm_slit")
    with h5py.File(DATA.parent / "tests" / "stored" / "reference_values.h5") as file:
        stored = file["slit_n130_y1.0mm"]
        for name, (wave, choices, limit) in cases.items():
            found = tl.replay(plane, liner, wave, interval=None, **choices)
            assert np.allclose(found.frequency, stored[name].attrs["frequency"])
            pairs = [(found.liner[a], stored[name]["liner"][i]) for i, a in enumerate(found.averagings)]
            pairs += [(found.cells[a], stored[name]["cells"][i]) for i, a in enumerate(found.averagings)]
            if "probes" in stored[name]:
                flat = found.probes["admittance"].map(lambda r: r.reshape(plane.probes, -1)[stored["probe_index"][:]])
                pairs.append((flat, stored[name]["probes"][0]))
            for mine, theirs in pairs:
                away = mine.reflection - tl.reflection_from_impedance(torch.from_numpy(theirs))
                assert float(away.abs().max()) < limit, name


def test_averages_and_probes_that_are_left_out(liner):
    v = turbulence((4, SAMPLES), seed=2)
    options = {"frequency": LINES, "velocity_max": 16.0}
    found = tl.replay(plane_of(v), liner, "noise:300:5000", **options)
    alone = tl.replay(plane_of(v[1:2]), liner, "noise:300:5000", **options)
    assert torch.allclose(alone.impedance[0], found.impedance[1], rtol=1e-12)
    mean = tl.replay(plane_of(v.mean(0, keepdim=True)), liner, "noise:300:5000", **options)
    assert torch.allclose(mean.answer, found.liner["velocity"].impedance, rtol=1e-10)
    assert torch.allclose(1 / found.answer, (1 / found.impedance).mean(0), rtol=1e-12)
    moved = plane_of(v - v.mean(1, keepdim=True) + 3.0)
    removed = tl.replay(moved, liner, "noise:300:5000", mean="removed", **options)
    kept = tl.replay(plane_of(v - v.mean(1, keepdim=True)), liner, "noise:300:5000", **options)
    assert torch.allclose(removed.impedance, kept.impedance, rtol=1e-9)
    broken = v.clone()
    broken[2, 7] = torch.nan
    left = tl.replay(plane_of(broken), liner, "noise:300:5000", missing="exclude", **options)
    assert bool(left.impedance[2].isnan().all())
    others = tl.replay(plane_of(v[[0, 1, 3]]), liner, "noise:300:5000", **options)
    assert torch.allclose(left.answer, others.answer, rtol=1e-12)


def test_gradients_pass_to_velocity_and_liner():
    liner = tl.load_liner("polito")
    porosity = torch.tensor(float(liner.porosity), dtype=F64, requires_grad=True)
    v = turbulence((1, 300), seed=1).requires_grad_()

    def answer(v, porosity):
        wave = tl.BandNoise(500, 3000)
        with_it = liner.replace(porosity=porosity)
        return tl.replay(plane_of(v), with_it, wave, 1400.0, interval=None, velocity_max=16.0, levels=24).answer.real[0]

    dv, dp = torch.autograd.grad(answer(v, porosity), (v, porosity))
    with torch.no_grad():
        step = torch.zeros_like(v)
        step[0, 150] = 1e-5
        of_v = (answer(v + step, porosity) - answer(v - step, porosity)) / 2e-5
        of_p = (answer(v, porosity + 1e-6) - answer(v, porosity - 1e-6)) / 2e-6
    assert float(dv[0, 150]) == pytest.approx(float(of_v), rel=1e-4)
    assert float(dp) == pytest.approx(float(of_p), rel=1e-4)


def test_what_is_doubtful_is_noted(liner):
    plane = plane_of(turbulence((2, SAMPLES), rms=5.0))
    found = tl.replay(plane, liner, FREQUENCY, **PAPER)
    assert {"kernel", "levels"} <= {*codes(found)}
    size = next(note.size for note in found.notes if note.code == "levels")
    assert size == pytest.approx(found.choices["level_error"] * float((1 + found.answer).abs().square().max()) / 2)
    wide = tl.Recorded(tl.BandNoise(300, 12000).sampled(SAMPLES, RATE), RATE)
    assert "signal-band" in codes(tl.replay(plane, liner, wide, FREQUENCY))
    assert not codes(tl.replay(plane, liner, "noise:300:3000", FREQUENCY))


@pytest.mark.parametrize("segment", [None, 0.004, 0.0048])  # the last does not end with the record
def test_the_reflected_signal_is_written(liner, tmp_path, segment):
    """All of it, (time, probe): its own spectrum over that of the wave is the map. The map can be kept, too."""
    xarray = pytest.importorskip("xarray")
    plane = plane_of(turbulence((2, 3, SAMPLES)), x=[0.0, 0.01, 0.02], z=[0.0, 0.01])
    wanted, path = tl.replay(plane, liner, "noise:300:5000", LINES), tmp_path / "y.h5"
    found = tl.replay(plane, liner, "noise:300:5000", LINES[2:3], reflected=path, segment=segment)
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        assert data["reflected"].dims == ("time", "probe")
        at = [round(f / 50) for f in LINES]
        ratio = np.fft.rfft(data["reflected"].values, axis=0)[at] / np.fft.rfft(data["incident"].values)[at, None]
        assert np.abs(ratio - wanted.probes["admittance"].reflection.reshape(6, -1).T.numpy()).max() < 1e-5
        assert data["x"].values.tolist() == pytest.approx([0.0, 0.01, 0.02] * 2)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="no energy at 100 Hz"):
        tl.replay(plane, liner, "noise:300:5000", 100.0, reflected=path)
    assert path.read_bytes() == before
    found.write(tmp_path / "map.h5")
    assert torch.equal(tl.read_map(tmp_path / "map.h5").answer, found.answer)


NOISE = tl.BandNoise(300, 5000)


@pytest.mark.parametrize(
    ("incident", "options", "words"),
    [
        (tl.Recorded(torch.ones(SAMPLES), 50e3), {}, "50000 Hz.*42000 Hz"),
        (tl.Recorded(torch.ones(SAMPLES - 1), RATE), {}, "839 samples.*840"),
        (tl.BandNoise(310, 340), {}, "310-340 Hz.*50 Hz apart"),
        (tl.BandNoise(300, 1000), {"frequency": 1400.0}, "300-1000 Hz.*1400 Hz"),
        (NOISE, {"frequency": 20700.0}, "20700 Hz.*20580 Hz"),
        (NOISE, {"segment": 1.0}, "1 s.*0.02 s"),
        (1400.0, {"frequency": 700.0}, "different tones.*once"),
        (1400.0, {"reflected": "y.h5"}, r"tl\.Tones"),
        ("speech.wav", {}, "speech.wav.*tl.read_signal"),
    ],
)
def test_what_cannot_serve_is_refused(liner, incident, options, words):
    plane = plane_of(turbulence((1, SAMPLES)))
    with pytest.raises(ValueError, match=words):
        tl.replay(plane, liner, incident, **options)


def test_moments_and_late_faults_are_refused(liner):
    plane = plane_of(turbulence((1, SAMPLES + 10)))
    with pytest.raises(TypeError, match=r"Moments.*VelocityPlane"):
        tl.replay(tl.moments(plane, liner), liner, 1400.0)
    plane.velocity[0, -1] = torch.nan  # behind the last whole period
    with pytest.raises(ValueError, match=r"probe \(0,\).*cut"):
        tl.replay(plane, liner, 1400.0)


def test_recorded_waves(liner, tmp_path):
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
    wavfile.write(tmp_path / "two.wav", 42000, np.ones((100, 2), dtype=np.float32))
    assert len(tl.read_signal(tmp_path / "two.wav", channel=1).signal) == 100
    np.save(tmp_path / "s.npy", np.ones(10))
    for cut in (300, 20, 0):
        (tmp_path / f"cut{cut}.wav").write_bytes((tmp_path / "two.wav").read_bytes()[:cut])
    for name, rate, channel, words in (
        ("a.wav", None, None, "no such file"),
        ("two.wav", None, None, r"\(100, 2\).*choose one channel"),
        ("two.wav", None, 2, "choose one channel, not 2"),
        *((f"cut{cut}.wav", None, None, r"not a whole \.wav file") for cut in (300, 20, 0)),
        (".", 50e3, None, "is a folder"),
        ("s.npy", 50e3, 5, "choose one channel, not 5"),
        ("s.npy", None, None, "does not state its sampling rate"),
    ):
        with pytest.raises((ValueError, OSError), match=words):
            tl.read_signal(tmp_path / name, rate, channel=channel)


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
