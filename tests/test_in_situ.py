"""The in situ method: exact cases by hand, then the resolved slit and orifice."""

from __future__ import annotations

import cmath
import dataclasses
import json
import math

import numpy as np
import pytest
import scipy.signal
import torch
from conftest import DATA, turbulence

import torchliner as tl
from torchliner.cli.main import main
from torchliner.eduction.cavity_mouth import mouth_velocity_ratio
from torchliner.liners.cavity import cavity_impedance
from torchliner.report.alongside import alongside_surfaces
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.transfer import transfer_function
from torchliner.signals.windows import make_window

RATE, FREQUENCY, DEPTH = 40000.0, 1400.0, 0.038
FLUID = tl.Fluid()
CASES = ("n115", "n130", "g01_145", "g03_145", "o115", "o145")


def exact(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def tone(amplitude: complex, samples: int = 457, frequency: float = FREQUENCY) -> torch.Tensor:
    """Re(A e^{j omega t}): 16 periods and a bit, so that no window is whole."""
    time = torch.arange(samples, dtype=torch.float64) / RATE
    return (amplitude * torch.exp(2j * math.pi * frequency * time)).real


def record_of(face: list[complex], back: list[complex] | complex, **about) -> tl.PressureRecord:
    """Facesheet points and backplate from complex amplitudes."""
    about = {"sampling_rate": RATE, "cavity_depth": DEPTH, "frequency": FREQUENCY, **about}
    samples, frequency = about.pop("samples", 457), about["frequency"] or FREQUENCY
    rows = back if isinstance(back, list) else [back]
    signals = [torch.stack([tone(a, samples, frequency) for a in each]) for each in (face, rows)]
    return tl.PressureRecord(*signals, **about)


def standing_wave(impedance: complex, porosity: float, frequency: float = FREQUENCY) -> complex:
    """p_f for p_b = 1, by hand: v_in = phi sin(kH) j/(rho c), p_f = Z rho c v_in."""
    k = 2 * math.pi * frequency / FLUID.sound_speed
    return impedance * porosity * 1j * math.sin(k * DEPTH)


def file_of(case: str) -> tl.PressureRecord:
    return tl.read_pressure(DATA / f"pressure_{case}.h5")


def as_the_file(record: tl.PressureRecord) -> dict:
    """The periods that the file's own values come from, with no window."""
    periods = record.provenance["periods_behind_truth"]
    return {"window": "boxcar", "start": record.duration - periods / record.frequency}


# --- signals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("window", ["hann", "boxcar", "blackman"])
@pytest.mark.parametrize("samples", [100, 457, 1000])
def test_tones_are_exact_in_any_record(window, samples):
    """Tone, mean and whole or broken periods: the amplitude comes out to rounding."""
    amplitude = 0.7 * cmath.exp(0.4j)
    weights = make_window(window, samples).weights
    found = tone_amplitudes(
        tone(amplitude, samples) + 5.0, torch.tensor([FREQUENCY]), RATE, weights
    )
    assert abs(2 * complex(found[0]) - amplitude) < 1e-11


def test_phase_refers_to_sample_zero():
    """A part of a record gives the amplitude of the whole."""
    part = tone(1 + 2j, 800)[300:]
    weights = make_window("hann", 500).weights
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


def test_batch_is_the_loop_and_lengths_must_agree():
    """Signals do not know their neighbours."""
    x, y = turbulence((3, 500)), turbulence((3, 500), seed=5)
    where = torch.tensor([900.0, 1400.0])
    together = transfer_function(x, y, where, RATE).response
    alone = torch.stack([transfer_function(a, b, where, RATE).response
                         for a, b in zip(x, y, strict=True)])  # fmt: skip
    assert float((together - alone).abs().max()) < 1e-12
    with pytest.raises(ValueError, match="driver has 500 samples, response 400"):
        transfer_function(x, y[:, :400], where, RATE)
    assert torch.isnan(transfer_function(x, y, where, RATE).coherence).all()


# --- Dean's formula -----------------------------------------------------------------------------


def test_a_standing_wave_returns_its_impedance():
    """Pressures made by hand for a known Z come back as it, for any cavity porosity."""
    for porosity, impedance in ((1.0, 1.2 - 0.3j), (0.65, 0.2 + 0.9j)):
        face = standing_wave(impedance, porosity)
        found = tl.in_situ(record_of([face], 1.0, cavity_porosity=porosity))
        assert abs(complex(found.liner_impedance[0]) - impedance) < 1e-11
        assert abs(complex(found.liner_impedance_pressure_first[0]) - impedance) < 1e-11


def test_sign_by_hand():
    """At kH = pi/2 the mouth moves at phi p_b/(rho c), 90 degrees ahead of p_b: Z = -j p_f/p_b."""
    quarter = FLUID.sound_speed / (4 * FREQUENCY)
    found = tl.in_situ(record_of([1.0], 1.0, cavity_depth=quarter))
    assert abs(complex(found.liner_impedance[0]) + 1j) < 1e-11


def test_a_cavity_alone_is_its_own_impedance():
    """Without a facesheet p_f = p_b cosh(gamma H): Z is coth(gamma H), with losses too."""
    omega = torch.tensor([2 * math.pi * FREQUENCY], dtype=torch.float64)
    radius = 2e-3
    about = {"cavity_hydraulic_radius": radius}
    bare = record_of([1.0], 1.0, **about)
    ratio, _ = mouth_velocity_ratio(bare, torch.tensor([FREQUENCY]), "viscothermal")
    mouth = torch.sqrt(1 + ratio**2)  # cosh from sinh, Re > 0 below the first node
    found = tl.in_situ(record_of([complex(mouth[0])], 1.0, **about), losses="viscothermal")
    wanted = cavity_impedance(omega, exact(DEPTH), exact(radius), FLUID)
    assert abs(complex(found.liner_impedance[0]) - complex(wanted[0])) < 1e-10
    lossless, _ = mouth_velocity_ratio(bare, torch.tensor([FREQUENCY]))
    assert abs(complex(ratio[0] - lossless[0])) > 1e-3


def test_orders_of_averaging_by_hand():
    """Two points of p = 1 and 3: harmonic mean 1.5 against arithmetic mean 2."""
    face = standing_wave(1.0, 1.0)
    found = tl.in_situ(record_of([face, 3 * face], 1.0, x=[0.0, 0.001]))
    assert complex(found.liner_impedance[0]) == pytest.approx(1.5)
    assert complex(found.liner_impedance_pressure_first[0]) == pytest.approx(2.0)
    assert found.point_impedance[:, 0].real.tolist() == pytest.approx([1.0, 3.0])


@pytest.mark.parametrize("how", ["pitch", "labels", "per probe"])
def test_cells_have_their_own_backplate(how):
    """Each cell is divided by its own pressure, however the cells are told."""
    unit = standing_wave(1.0, 1.0)
    x = [0.0005, 0.0015, 0.0025, 0.0035]
    about = {"pitch": {"cell_pitch": 0.002}, "labels": {"probe_cell": [0, 0, 1, 1]},
             "per probe": {"cell_pitch": 0.002}}[how]  # fmt: skip
    back = [1.0, 1.0, 2j, 2j] if how == "per probe" else [1.0, 2j]
    found = tl.in_situ(record_of([unit, unit, unit, unit], back, x=x, **about))
    assert found.cell_x.tolist() == pytest.approx([0.001, 0.003])
    for order in (found.cell_impedance, found.cell_impedance_pressure_first):
        assert abs(complex(order[0, 0]) - 1) < 1e-11
        assert abs(complex(order[1, 0]) + 0.5j) < 1e-11
    # Admittances add over the surface; the plane wave sees <p>/<v>.
    assert abs(complex(found.liner_impedance[0]) - 2 / (1 + 2j)) < 1e-11
    assert abs(complex(found.liner_impedance_pressure_first[0]) - 1 / (0.5 + 1j)) < 1e-11


def test_points_of_no_cell_are_nan():
    """A probe labelled -1 has no impedance and spoils no average."""
    unit = standing_wave(1.0, 1.0)
    found = tl.in_situ(record_of([unit, 9.0, unit], [1.0, 1.0], probe_cell=[0, -1, 1]))
    assert torch.isnan(found.point_impedance[1].real)
    assert complex(found.liner_impedance[0]) == pytest.approx(1.0)


def test_several_frequencies_and_precision():
    """Frequencies are independent of each other; float32 data keep six digits."""
    record = file_of("g01_145")
    alone = tl.in_situ(record, 1400.0).liner_impedance
    both = tl.in_situ(record, [1000.0, 1400.0]).liner_impedance
    assert abs(complex(both[1] - alone[0])) < 1e-12
    wide = dataclasses.replace(
        record, facesheet=record.facesheet.double(), backplate=record.backplate.double()
    )
    assert abs(complex(tl.in_situ(wide).liner_impedance[0] - alone[0])) < 1e-6


# --- the resolved cases -------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_pressure_first_is_the_files_own_dean(case):
    """Over the periods the file used, its Z_dean comes back: the data are read rightly."""
    record = file_of(case)
    found = tl.in_situ(record, **as_the_file(record))
    own = complex(record.reference["Dean"])
    error = abs(complex(found.liner_impedance_pressure_first[0]) - own)
    assert error < (0.01 if case == "g03_145" else 0.001)


@pytest.mark.parametrize("case", ["n115", "n130", "o115", "o145"])
def test_truth_without_flow(case):
    """0.02 of the run's own truth, as it is called, by the plane wave's order of averaging."""
    record = file_of(case)
    found = complex(tl.in_situ(record).liner_impedance_pressure_first[0])
    assert abs(found - record.reference["true"]) < 0.02


@pytest.mark.parametrize(
    ("case", "error"), [("n115", 0.043), ("n130", 0.030), ("o115", 0.009), ("o145", 0.011)]
)
def test_what_the_admittance_over_points_costs(case, error):
    """The table of docs/in_situ.md: the slit is above 0.02, since p_f drops steeply there."""
    record = file_of(case)
    found = complex(tl.in_situ(record).liner_impedance[0])
    assert abs(found - record.reference["true"]) == pytest.approx(error, abs=1e-3)


def test_coherence_tells_turbulence():
    """No flow: 1. Mach 0.3 over the slit: clearly less."""
    assert float(tl.in_situ(file_of("n130")).coherence.min()) > 0.999
    assert 0.5 < float(tl.in_situ(file_of("g03_145")).coherence.min()) < 0.95


# --- bad input ----------------------------------------------------------------------------------


def test_the_node_is_named():
    """sin(kH) = 0 is a velocity node of the mouth; zero frequency is not one."""
    node = FLUID.sound_speed / (2 * DEPTH)
    record = record_of([1.0], 1.0)
    with pytest.raises(ValueError, match=rf"38 mm its mouth is a velocity node at {node:.6g} Hz"):
        tl.in_situ(record, node)
    with pytest.warns(tl.DataWarning, match="near a velocity node"):
        tl.in_situ(record_of([1.0], 1.0, frequency=0.97 * node))
    assert mouth_velocity_ratio(record, torch.tensor([1.0]))[1] == []


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"samples": 100}, "holds 3.5 periods of 1400 Hz, fewer than 4"),
        ({"cavity_depth": None}, "cavity_depth is missing"),
        ({"frequency": None}, "states no frequency"),
    ],
)
def test_records_that_cannot_answer(about, match):
    with pytest.raises(ValueError, match=match):
        tl.in_situ(record_of([1.0], 1.0, **about))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"frequency": 20000.0}, "at or above Nyquist"),
        ({"frequency": 21000.0}, "at or above Nyquist"),
        ({"frequency": -1.0}, "must be finite and above 0"),
        ({"losses": "some"}, "unknown losses"),
        ({"losses": "viscothermal"}, "cavity_hydraulic_radius is missing"),
        ({"start": 1.0}, "start is 1 s; it must be at least 0 and leave something of"),
        ({"start": -1e-3}, "start is -0.001 s"),
        ({"segment": 1.0}, "segment is 1 s"),
        ({"window": "hamn"}, "did you mean 'hann'"),
    ],
)
def test_options_that_make_no_sense(options, match):
    with pytest.raises(ValueError, match=match):
        tl.in_situ(record_of([1.0], 1.0), **options)


def test_a_pressure_of_zero_is_named():
    with pytest.raises(ValueError, match="backplate pressure is zero at 1400 Hz in 1 of 1"):
        tl.in_situ(record_of([1.0], 0.0))
    with pytest.raises(ValueError, match="facesheet pressure is zero at 1400 Hz in 1 of 2"):
        tl.in_situ(record_of([1.0, 0.0], 1.0))


def test_backplates_that_fit_no_cell():
    with pytest.raises(ValueError, match="backplate has 2 rows, but there are 1 cells and 3"):
        tl.in_situ(record_of([1.0, 1.0, 1.0], [1.0, 1.0]))


def test_doubts_are_warned_of_and_kept():
    """Noise instead of sound; frequencies above the plane wave of a wide cavity."""
    noise = record_of([1.0], 1.0, samples=2000)
    face = turbulence((1, 2000), seed=3)
    with pytest.warns(tl.DataWarning, match="coherence of facesheet and backplate"):
        found = tl.in_situ(dataclasses.replace(noise, facesheet=face))
    assert "coherence" in found.notes[0]
    with pytest.warns(tl.DataWarning, match="transverse waves"):
        tl.in_situ(dataclasses.replace(noise, cell_pitch=0.2))


# --- commands, maps, figures --------------------------------------------------------------------


def test_command_prints_writes_and_draws(tmp_path, capsys):
    """The table has every method, the CSV the same numbers."""
    csv, png, points = (tmp_path / name for name in ("rows.csv", "z.png", "points.h5"))
    path = str(DATA / "pressure_g01_145.h5")
    assert main(["insitu", path, "-o", str(csv), "--figure", str(png)]) == 0
    text = capsys.readouterr().out
    assert "cell 2, x = 18.7 mm" in text
    assert "waves, 2 microphones" in text
    assert "true Z = 0.948-0.340j" in text
    assert len(csv.read_text().splitlines()) == 1 + 4 + 2 + 3
    assert png.stat().st_size > 10_000
    assert main(["insitu", path, "-o", str(points), "--json", "--quiet"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert rows[5]["distance_to_true"] < 0.02
    assert tl.read_points(points).cell_impedance.shape == (2, 1)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["nothing.h5"], "no such file"),
        ([str(DATA / "slit_n130_y2.5mm.h5")], "is no pressure record"),
        ([str(DATA / "pressure_n130.h5"), "--frequency", "60000"], "at or above Nyquist"),
        ([str(DATA / "pressure_n130.h5"), "-o", str(DATA / "pressure_n130.h5")],
         "is an input or another output"),
        ([str(DATA / "pressure_n130.h5"), "-o", "rows.txt"], "must be one of .csv, .h5, .nc"),
        ([str(DATA / "pressure_n130.h5"), "--figure", "no/a.png"], "the folder no does not exist"),
        ([str(DATA / "pressure_n130.h5"), "--microphones", "0", "9"], "microphones 0 to 4, not 9"),
    ],
)  # fmt: skip
def test_command_refuses(arguments, match, capsys):
    assert main(["insitu", *arguments]) == 2
    assert match in capsys.readouterr().err


def test_maps_carry_the_in_situ_values(tmp_path, capsys):
    """educe --in-situ: in the table, in the file and back, in the figures."""
    plane, pressure = DATA / "slit_n130_y2.5mm.h5", DATA / "pressure_n130.h5"
    target, folder = tmp_path / "map.h5", tmp_path / "pictures"
    arguments = ["educe", str(plane), "--in-situ", str(pressure), "-o", str(target)]
    assert main([*arguments, "--figures", str(folder), "--quiet"]) == 0
    assert "in situ (Dean), pressure first: 0.168-0.068j" in capsys.readouterr().out
    again = tl.read_map(target)
    wanted = tl.in_situ(tl.read_pressure(pressure))
    assert again.alongside[0].name == "in situ (Dean)"
    assert torch.equal(again.alongside[0].cell_impedance, wanted.cell_impedance)
    assert len(alongside_surfaces([again], 0)) == 2
    assert (folder / "along_x.png").exists()
    import h5py

    with h5py.File(target, "a") as file:
        del file["alongside_0"]
    assert tl.read_map(target).alongside == ()
    assert main(["educe", str(plane), "--in-situ", str(pressure), "-o", str(pressure)]) == 2
    assert "what --in-situ reads" in capsys.readouterr().err


def test_other_times_are_warned_of(capsys, tmp_path):
    """A pressure record that lasts another time."""
    record = file_of("n130")
    keep = record.facesheet.shape[-1] // 2
    signals = ("facesheet", "backplate", "microphones", "microphone_velocity")
    parts = {name: getattr(record, name)[..., :keep] for name in signals}
    dataclasses.replace(record, **parts).write(tmp_path / "half.h5")
    arguments = ["educe", str(DATA / "slit_n130_y2.5mm.h5"), "--in-situ"]
    assert main([*arguments, str(tmp_path / "half.h5")]) == 0
    assert "of different times" in capsys.readouterr().err


def test_another_case_is_refused(capsys):
    """Another level, flow or case does not stand beside the educed values."""
    arguments = ["educe", str(DATA / "slit_n130_y2.5mm.h5"), "--in-situ"]
    assert main([*arguments, str(DATA / "pressure_n115.h5")]) == 2
    assert "are not one case: incident_level is 130.0 and 115.0" in capsys.readouterr().err
    assert main([*arguments, str(DATA / "no.h5")]) == 2
    assert "no.h5: no such file" in capsys.readouterr().err


def test_record_of_another_kind():
    plane = tl.read_plane(DATA / "slit_n130_y2.5mm.h5")
    for method in (tl.in_situ, tl.decompose_waves):
        with pytest.raises(TypeError, match="record is VelocityPlane; a PressureRecord is needed"):
            method(plane)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_probe_of_no_cell_has_no_backplate(rows):
    """Whatever the backplate's layout, a probe labelled -1 is nan and in no average."""
    time = np.arange(2000) / 50e3
    tone = np.cos(2 * np.pi * 1000 * time)
    face = np.array([1.0, 9.0, 1.0])[:, None] * tone
    back = 0.5 * np.sin(2 * np.pi * 1000 * time) * np.ones((rows, 1))
    labels = [0, -1, 1] if rows == 2 else [0, -1, 0]
    record = tl.PressureRecord(
        face, back[0] if rows == 1 else back, sampling_rate=50e3, frequency=1000.0,
        cavity_depth=0.03, probe_cell=labels,
    )  # fmt: skip
    found = tl.in_situ(record)
    assert bool(found.point_impedance[1].isnan().all())
    wanted = complex(found.point_impedance[0, 0])
    assert abs(complex(found.liner_impedance[0]) - wanted) < 1e-9
    assert abs(complex(found.liner_impedance_pressure_first[0]) - wanted) < 1e-9


def test_legend_names_the_method():
    """Black symbols at the cells with an entry of their own."""
    from torchliner.report.figures import draw_against_height, draw_along_x

    planes = [tl.read_plane(DATA / f"slit_n130_y{y}mm.h5") for y in ("1.0", "2.5")]
    beside = tl.in_situ(file_of("n130"))
    maps = [m.with_alongside(beside) for m in tl.educe(planes, tl.load_liner("lbm_slit"))]
    for draw in (draw_along_x, draw_against_height):
        figure = draw(maps)
        legend = figure.legends[0] if figure.legends else figure.axes[0].get_legend()
        names = [text.get_text() for text in legend.get_texts()]
        assert "in situ (Dean), admittance over points" in names
        assert len(names) == len(set(names))
    assert alongside_surfaces(maps, 0)["in situ (Dean), pressure first"] == pytest.approx(
        complex(beside.liner_impedance_pressure_first[0])
    )
