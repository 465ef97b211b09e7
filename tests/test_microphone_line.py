"""Lines of microphones: the record, its files, and signals beside a reference channel."""

import cmath
import math

import h5py
import numpy as np
import pytest
import torch
from conftest import turbulence

import torchliner as tl
from torchliner.io.microphone_file import read_microphones
from torchliner.pressure import spectra
from torchliner.pressure.spectra import reject_flow_noise
from torchliner.pressure.waves import equal_spacing
from torchliner.records import MicrophoneLine

RATE = 20e3
PLACES = [0.012 * n for n in range(12)]


def line_of(places=PLACES, frequency=(1000.0, 1500.0), **about) -> MicrophoneLine:
    about = {"duct_height": 0.05, "mach": 0.3, "source_side": "upstream", **about}
    x = torch.tensor(places, dtype=torch.float64)[:, None]
    f = torch.tensor(frequency, dtype=torch.float64)
    alpha = 2 * math.pi * f / 343.2 / 1.3 * (1 - 0.1j)
    return MicrophoneLine(places, 2 * torch.exp(-1j * alpha * x), frequency, **about)


def test_levels_by_hand():
    """2 Pa peak is 96.99 dB; 1 Pa rms is 93.98 dB; j is +90 degrees."""
    line = MicrophoneLine([0.0, 1.0], np.array([2.0, 2**0.5 * 1j]), 500.0, duct_height=0.05)
    assert line.pressure.shape == (2, 1)
    assert line.level[:, 0].tolist() == pytest.approx([96.9897, 93.9794], abs=1e-4)
    assert line.phase[:, 0].tolist() == pytest.approx([0.0, 90.0])
    again = MicrophoneLine.from_levels(line.x, line.level, line.phase, 500.0, duct_height=0.05)
    assert float((again.pressure - line.pressure).abs().max()) < 1e-14


def test_spacing_is_asked_for():
    assert equal_spacing(line_of()) == pytest.approx(0.012)
    places = list(PLACES)
    places[4] += 0.0005
    with pytest.raises(ValueError, match=r"Tufts' method needs .*microphone 4 at x = 48\.5 mm is \+0\.45 mm .* 12 mm"):
        equal_spacing(line_of(places))
    places[4] = PLACES[4] + 0.00005
    assert equal_spacing(line_of(places)) == pytest.approx(0.012)


def test_selection():
    line = line_of(liner_start=0.01, liner_end=0.1, coherence=torch.rand(12, 2).double())
    assert line.over_liner().x.tolist() == pytest.approx(PLACES[1:9])
    assert torch.equal(line.over_liner().coherence, line.coherence[1:9])
    assert torch.equal(line.over_liner().pressure, line.pressure[1:9])
    assert line.over_liner(0.03).x.tolist() == pytest.approx(PLACES[4:6])
    assert line_of().over_liner().microphones == 12
    one = line.at([1500.0])
    assert torch.equal(one.pressure, line.pressure[:, 1:])
    assert torch.equal(one.coherence, line.coherence[:, 1:])
    with pytest.raises(ValueError, match="two"):
        line_of(liner_start=0.02, liner_end=0.03).over_liner()
    for margin in (-5e-3, math.nan):  # below 0 it would take in microphones beside the liner
        with pytest.raises(ValueError, match="margin is"):
            line_of().over_liner(margin)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x": [0.0], "pressure": np.array([1 + 0j])}, "x is [0.0] m; two or more"),
        ({"x": [0.0, 0.0, 0.01]}, "x is [0.0, 0.0, 0.01] m; two or more"),
        ({"x": [0.0, math.nan, 0.01]}, "x is nan m at 1"),
        ({"pressure": np.ones((2, 1)) + 0j}, "pressure has shape (2, 1); (draws, 3 microphone, 1 frequency)"),
        ({"pressure": np.array([1, 0, 1j])}, "pressure is 0 Pa at 1, 0"),
        ({"pressure": np.array([1, 1e200, 1j])}, "pressure is 1e+200 Pa at 1, 0 and 0 more; (0, 1.5e5] Pa"),
        ({"frequency": 0.0}, "frequency (Hz) is 0"),
        ({"duct_height": 0.0}, "duct_height is 0 m; (0, inf) m"),
        ({"mach": 1.0}, "mach is 1; [0, 1) is needed (bulk Mach number"),
        ({"source_side": "up"}, "source_side 'up'; choose one of: upstream"),
        ({"liner_start": 0.1, "liner_end": 0.0}, "liner_start is 0.1 m and liner_end 0.0 m"),
        ({"liner_start": -math.inf, "liner_end": 0.0}, "liner_start is -inf m; finite"),
        ({"coherence": np.ones((2, 1))}, "coherence has shape (2, 1); (3 microphone, 1 frequency)"),
    ],
)
def test_records_are_checked(change, words):
    good = {"x": [0.0, 0.01, 0.02], "pressure": np.array([1, 1j, -1]), "frequency": 900.0, "duct_height": 0.05}
    with pytest.raises(ValueError) as error:  # noqa: PT011
        MicrophoneLine(**{**good, **change})
    assert words in str(error.value)


def test_levels_are_no_pressures():
    with pytest.raises(TypeError, match=r"complex amplitudes in Pa are needed\. For SPL in dB and"):
        MicrophoneLine([0.0, 0.1], np.array([130.0, 125.0]), 1000.0, duct_height=0.05)
    about = {"duct_height": 0.05, "name": "b2a.csv"}
    for level, phase, words in (
        ([2.0, 1.0], [0.0, 0.0], r"b2a.csv: levels are 1 to 2 dB.* are these pascals\?"),
        ([1e5, 1.0], [0.0, 0.0], "levels are 1 to 100000 dB"),
        ([90.0, 0.0], [0.0, 0.0], "levels are 0 to 90 dB; .* 1 to 194 dB"),
        ([90.0, 80.0], [0.0], r"level has shape \(2,\), phase \(1,\)"),
    ):
        with pytest.raises(ValueError, match=words):
            MicrophoneLine.from_levels([0, 1], level, phase, 900.0, **about)


CSV = """# duct_height = 50 mm
# mach = 0.3 1
# temperature = 290 K
# source_side = upstream
# liner_start = 0 m
# liner_end = 24 mm
# duct_width = 5 cm
# title = a line
# liner = onera
# measured on a Tuesday
x [mm];phase [deg];SPL [dB];frequency [kHz]
12;-40,5;129,5;1,5
0;10;130;1,5
24;-91;129;1,5
"""


def test_a_table_by_hand(tmp_path):
    path = tmp_path / "b2a.csv"
    path.write_text(CSV)
    line = read_microphones(path)
    assert line.x.tolist() == [0.0, 0.012, 0.024]
    assert line.frequency.tolist() == [1500.0]
    assert line.level[:, 0].tolist() == pytest.approx([130.0, 129.5, 129.0])
    assert line.phase[:, 0].tolist() == pytest.approx([10.0, -40.5, -91.0])
    assert line.fluid == tl.Fluid.from_temperature(290.0)
    assert (line.liner_start, line.liner_end, line.duct_width, line.mach) == (0.0, 0.024, 0.05, 0.3)
    assert (line.title, line.liner, line.source_side) == ("a line", "onera", "upstream")
    assert read_microphones(path, source_side="downstream").source_side == "downstream"
    assert read_microphones(path, 1500.0).frequency.tolist() == [1500.0]
    path.write_text(CSV.replace("50 mm", "50mm"))
    assert float(read_microphones(path).duct_height) == 0.05
    for options, words in (({"frequency": 1400.0}, "has no 1400 Hz"), ({"segment": 0.1}, "leave segment out")):
        with pytest.raises(ValueError, match=words):
            read_microphones(path, **options)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("# duct_height = 50 mm\n", "", "the duct height is missing; add '# duct_height = 50 mm'"),
        ("50 mm", "50 mn", r"line 1, duct_height has units 'mn' .did you mean 'm'"),
        ("duct_height", "duct_hight", "line 1 states 'duct_hight' .did you mean 'duct_height'"),
        ("# mach = 0.3 1", "# mach = 0.3 1\n# mach = 0.2 1", "line 3 states 'mach' a second time"),
        ("x [mm]", "x", "column 'x' has no unit"),
        ("SPL [dB]", "SPL [Pa]", "column 'spl' has units 'Pa'.*a level is needed in one of dB"),
        (";1,5\n0;", "\n0;", "line 12, column 'frequency' is ''; a number is needed"),
        ("129;1,5", "129;1,2", "the frequencies of a line share their microphones"),
        ("290 K", "17 K", "temperature is 17 K; Sutherland's law"),
        ("0.3", "1.3", "mach is 1.3; .* is needed"),
    ],
)
def test_tables_with_faults(tmp_path, old, new, match):
    path = tmp_path / "b2a.csv"
    assert old in CSV
    path.write_text(CSV.replace(old, new))
    with pytest.raises(ValueError, match=match):
        read_microphones(path)


def signals_of(line: MicrophoneLine, samples: int, noise: float, seed: int = 0):
    """Tones in turbulence of an rms (Pa), and the loudspeaker's voltage, 3 V peak at 40 degrees."""
    time = torch.arange(samples, dtype=torch.float64) / RATE
    turns = torch.exp(2j * math.pi * line.frequency[:, None] * time)
    drive = 3 * cmath.exp(40j * math.pi / 180)
    clean = (line.pressure @ (turns * drive / 3)).real
    flow = turbulence((line.microphones, samples), seed, rms=noise) if noise else 0.0
    return clean + flow, (drive * turns).real.sum(0)


def test_tones_come_back_with_the_phase_of_the_reference():
    line = line_of()
    pressure, reference = signals_of(line, 16000, 0.0)
    amplitude, coherence, _ = reject_flow_noise(pressure, reference, line.frequency, RATE)
    assert float((amplitude - line.pressure).abs().max()) < 1e-9
    assert float((coherence - 1).abs().max()) < 1e-9


def test_overlapping_segments_count_as_fewer_independent_ones(monkeypatch):
    """15 that overlap by half as 11.4, under Hann's window: what noise reaches once in a hundred times says it."""
    line, counts = line_of(places=PLACES[:6], frequency=(1500.0,)), []
    known = spectra.coherence_by_chance
    monkeypatch.setattr(
        spectra, "coherence_by_chance", lambda count, chance: counts.append(count) or known(count, chance)
    )
    pressure, reference = signals_of(line, 8000, noise=40.0)
    with pytest.warns(tl.DataWarning, match=f"below {1 - 0.01 ** (1 / (11.44 - 1)):.2g} in 6 of 6 values"):
        reject_flow_noise(pressure, reference, line.frequency, RATE)
    assert counts == pytest.approx([15 / (1 + 2 * 14 / 15 / 6)], abs=1e-9)  # rho = 1/6 of Hann's window and its half


def test_flow_noise_is_rejected_and_its_error_predicted():
    """At coherences near 0.9 the scatter over 60 records is Bendat and Piersol's, of 11.4 segments, without bias."""
    line = line_of(places=PLACES[:6], frequency=(1500.0,))
    found = []
    for seed in range(60):
        pressure, reference = signals_of(line, 8000, noise=4.0, seed=seed)
        found.append(reject_flow_noise(pressure, reference, line.frequency, RATE))
    amplitudes, coherences, _ = zip(*found, strict=True)
    errors, coherence = torch.stack(amplitudes) / line.pressure - 1, torch.stack(coherences)
    assert 0.85 < float(coherence.mean()) < 0.95
    # 360 values: their standard deviation is known to 4 %.
    predicted = ((1 - coherence) / (2 * (11.4 - 1) * coherence)).mean().sqrt()
    for part in (errors.real, errors.imag):
        assert float(part.std() / predicted) == pytest.approx(1.0, abs=0.1)
        assert abs(float(part.mean())) < 4 * float(part.std()) / 360**0.5
    # The raw level of a segment holds the noise too; that much is rejected.
    assert -10 * math.log10(float(coherence[0].min())) > 0.5


def write_signals(line, pressure, reference, path) -> None:
    """A file of a line with time signals, (N, T), and a reference, (T,), for its amplitudes."""
    line.write(path)
    time = np.arange(len(reference)) / RATE
    with h5py.File(path, "a") as file:
        del file["pressure_real"], file["pressure_imaginary"]
        for name, values, unit in (("time", time, "s"), ("pressure", pressure, "Pa"), ("reference", reference, "1")):
            file[name] = np.asarray(values)
            file[name].attrs["units"] = unit


def test_signal_files(tmp_path):
    line = line_of()
    pressure, reference = signals_of(line, 16000, noise=0.5)
    path = tmp_path / "signals.h5"
    write_signals(line, pressure, reference, path)
    found = read_microphones(path)
    assert float((found.pressure / line.pressure - 1).abs().max()) < 0.02
    assert 0.95 < float(found.coherence.min()) < 1
    one = read_microphones(path, 1500.0, segment=0.02)
    assert one.frequency.tolist() == [1500.0]
    for name, words in (("reference", ":/reference is missing"), ("frequency", "states no frequency")):
        write_signals(line, pressure, reference, path)
        with h5py.File(path, "a") as file:
            del file[name]
        with pytest.raises(ValueError, match=words):
            read_microphones(path)


def test_signals_that_tell_nothing():
    line = line_of(frequency=(1500.0,))
    pressure, reference = signals_of(line, 16000, noise=0.0)
    with pytest.warns(tl.DataWarning, match="flow noise alone reaches that once in a hundred"):
        *_, told = reject_flow_noise(turbulence((2, 16000), seed=4), reference, line.frequency, RATE, name="kulites")
    assert told[0].startswith("kulites: the coherence with the reference is 0.")
    for given, options, words in (
        (0 * reference, {}, "the reference has no tone at 1500 Hz"),
        (reference, {"segment": 0.4}, r"3 segments of 0\.4 s fit; at least 8"),
        (reference[:100], {}, "the reference has 100 samples, the microphones 16000"),
    ):
        with pytest.raises(ValueError, match=words):
            reject_flow_noise(pressure, given, line.frequency, RATE, **options)
