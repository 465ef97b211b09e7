"""The in situ method: exact cases by hand, the resolved slit and orifice, intervals, the command line."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from conftest import DATA, turbulence

import torchliner as tl
from torchliner.cli.main import main
from torchliner.liners.plates import cavity_propagation
from torchliner.pressure.dean import mouth_velocity_ratio
from torchliner.report.studies import known_of

RATE, FREQUENCY, DEPTH = 40000.0, 1400.0, 0.038
FLUID = tl.Fluid()
AVERAGINGS = ("", "_pressure_first")
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


def test_a_standing_wave_returns_its_impedance():
    """Pressures made by hand for a known Z come back as it, for any cavity porosity."""
    for porosity, impedance in ((1.0, 1.2 - 0.3j), (0.65, 0.2 + 0.9j)):
        face = standing_wave(impedance, porosity)
        found = tl.in_situ(record_of([face], 1.0, cavity_porosity=porosity))
        assert abs(complex(found.liner_impedance[0]) - impedance) < 1e-11
        assert abs(complex(found.liner_impedance_pressure_first[0]) - impedance) < 1e-11


def test_a_cavity_alone_is_its_own_impedance():
    """Without a facesheet p_f = p_b cosh(gamma H): Z is coth(gamma H), with losses too."""
    omega = torch.tensor([2 * math.pi * FREQUENCY], dtype=torch.float64)
    radius = 2e-3
    about = {"cavity_hydraulic_radius": radius}
    bare = record_of([1.0], 1.0, **about)
    ratio, _ = mouth_velocity_ratio(bare, torch.tensor([FREQUENCY]), "viscothermal")
    mouth = torch.sqrt(1 + ratio**2)  # cosh from sinh, Re > 0 below the first node
    found = tl.in_situ(record_of([complex(mouth[0])], 1.0, **about), losses="viscothermal")
    wanted = 1 / torch.tanh(cavity_propagation(omega, radius, FLUID) * DEPTH)
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
    about = {
        "pitch": {"cell_pitch": 0.002},
        "labels": {"probe_cell": [0, 0, 1, 1]},
        "per probe": {"cell_pitch": 0.002},
    }[how]
    back = [1.0, 1.0, 2j, 2j] if how == "per probe" else [1.0, 2j]
    found = tl.in_situ(record_of([unit, unit, unit, unit], back, x=x, **about))
    assert found.cell_x.tolist() == pytest.approx([0.001, 0.003])
    for order in (found.cell_impedance, found.cell_impedance_pressure_first):
        assert abs(complex(order[0, 0]) - 1) < 1e-11
        assert abs(complex(order[1, 0]) + 0.5j) < 1e-11
    # Admittances add over the surface; the plane wave sees <p>/<v>.
    assert abs(complex(found.liner_impedance[0]) - 2 / (1 + 2j)) < 1e-11
    assert abs(complex(found.liner_impedance_pressure_first[0]) - 1 / (0.5 + 1j)) < 1e-11


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


def test_coherence_tells_turbulence():
    """No flow: 1. Mach 0.3 over the slit: clearly less."""
    assert float(tl.in_situ(file_of("n130")).coherence.min()) > 0.999
    assert 0.5 < float(tl.in_situ(file_of("g03_145")).coherence.min()) < 0.95


def test_the_node_is_named():
    """sin(kH) = 0 is a velocity node of the mouth; zero frequency is not one."""
    node = FLUID.sound_speed / (2 * DEPTH)
    record = record_of([1.0], 1.0)
    with pytest.raises(ValueError, match=rf"near a velocity node of the cavity.s mouth, {node:.6g} Hz"):
        tl.in_situ(record, node)
    with pytest.warns(tl.DataWarning, match="near a velocity node"):
        tl.in_situ(record_of([1.0], 1.0, frequency=0.97 * node))
    assert mouth_velocity_ratio(record, torch.tensor([1.0]))[1] == []


def test_doubts_are_warned_of_and_kept():
    """Noise instead of sound; frequencies above the plane wave of a wide cavity."""
    noise = record_of([1.0], 1.0, samples=2000)
    face = turbulence((1, 2000), seed=3)
    with pytest.warns(tl.DataWarning, match="coherence of facesheet and backplate"):
        found = tl.in_situ(dataclasses.replace(noise, facesheet=face))
    assert found.notes[0].code == "low-coherence"
    with pytest.warns(tl.DataWarning, match="transverse waves"):
        tl.in_situ(dataclasses.replace(noise, cell_pitch=0.2))


@pytest.mark.parametrize(
    ("about", "options", "match"),
    [
        ({"samples": 100}, {}, "3.5 periods of 1400 Hz, fewer than 4"),
        ({"cavity_depth": None}, {}, "needs facesheet pressure and cavity_depth"),
        ({"frequency": None}, {}, "states no frequency"),
        ({}, {"frequency": 20000.0}, "at or above Nyquist"),
        ({}, {"losses": "some"}, "losses 'some'"),
        ({}, {"losses": "viscothermal"}, r"cavity_hydraulic_radius \(m\) is missing"),
        ({}, {"start": 1.0}, "start is 1 s; pressure lasts 0.011425 s"),
        ({}, {"segment": 1.0}, "segment is 1 s"),
        ({}, {"window": "hamn"}, "window 'hamn'"),
        ({"back": [0.0]}, {}, "backplate pressure has no tone at 1400 Hz in 1 of 1"),
        ({"back": [1.0, 1.0]}, {}, "backplate has 2 rows, for 1 cells"),
    ],
)
def test_what_makes_no_sense_is_refused(about, options, match):
    with pytest.raises(ValueError, match=match):
        tl.in_situ(record_of([1.0], about.pop("back", 1.0), **about), **options)


def noisy(seed: int, samples: int = 571, **about) -> tl.PressureRecord:
    """Z = 1 under noise on the facesheet whose correlation lasts a third of a period."""
    record = record_of([standing_wave(1.0, 1.0)], 1.0, samples=samples, **about)
    noise = np.random.default_rng(seed).standard_normal(samples + 60)
    kernel = np.exp(-np.arange(60) / 10)
    smooth = torch.from_numpy(np.convolve(noise, kernel, "full")[60 : samples + 60])
    return dataclasses.replace(record, facesheet=record.facesheet + 0.2 * smooth)


def covers(bounds: tuple[complex, complex], value: complex) -> list[bool]:
    low, high = bounds
    return [low.real < value.real < high.real, low.imag < value.imag < high.imag]


@pytest.mark.parametrize("options", [{}, {"segment": 4 / FREQUENCY}])
def test_intervals_hold_the_truth_as_often_as_they_say(options):
    """Blocks of time, or segments: 95 % of records of 20 periods, within what 40 tell."""
    held = []
    for seed in range(40):
        found = tl.in_situ(noisy(seed), **options)
        held.append([covers(found.bounds_of_liner(order), 1.0) for order in AVERAGINGS])
    share = np.mean(held, 0)
    assert share.min() > 0.85
    assert found.uncertainty.settings["blocks"] == (20 if not options else 9)


def test_too_few_blocks_are_said():
    """Three periods tell nothing of their scatter; without intervals nothing is said."""
    record = record_of([1.0], 1.0, samples=round(3.2 * RATE / FREQUENCY))
    with pytest.warns(tl.DataWarning, match="no statistical interval, since the record holds few"):
        found = tl.in_situ(record, allow_short=True)
    assert found.uncertainty is None
    assert found.bounds_of_liner() is None
    assert tl.in_situ(record, allow_short=True, interval=None).notes == ()
    with pytest.raises(ValueError, match="interval is 95; it is a level between 0 and 1"):
        tl.in_situ(record_of([1.0], 1.0), interval=95.0)


@pytest.mark.parametrize("case", ["g01_145", "g03_145", "o145"])
def test_turbulent_cases_lie_within(case):
    """With flow the miss of pressure first is the record's length: the truth is inside."""
    record = file_of(case)
    found = tl.in_situ(record).bounds_of_liner("_pressure_first")
    assert all(covers(found, complex(record.reference["true"])))


def test_microphones_have_intervals_and_a_pair_no_residual():
    """Waves: R through the same blocks. Two pressures leave nothing by construction: unknown."""
    record = file_of("g03_145")
    many, pair = (tl.decompose_waves(record, microphones=which) for which in ("all", "pair"))
    for found in (many, pair):
        assert all(covers(found.interval.bounds(0), complex(record.reference["true"])))
    assert 0 < float(many.residual[0]) < 0.01
    assert torch.isnan(pair.residual[0])
    steady = tl.decompose_waves(file_of("n130"), velocities=True).interval
    assert float((steady.high - steady.low).abs().max()) < 0.01
    assert tl.decompose_waves(record, interval=None).interval is None


def test_maps_carry_the_in_situ_values(tmp_path, capsys):
    """educe --in-situ: in the table, in the file and back, in the figures."""
    plane, pressure = DATA / "slit_n130_y2.5mm.h5", DATA / "pressure_n130.h5"
    target, folder = tmp_path / "map.h5", tmp_path / "pictures"
    arguments = ["educe", str(plane), "--in-situ", str(pressure), "-o", str(target)]
    assert main([*arguments, "--figure", str(folder), "--quiet"]) == 0
    capsys.readouterr()
    again = tl.read_map(target)
    wanted = tl.in_situ(tl.read_pressure(pressure))
    assert again.alongside[0].name == "in situ (Dean)"
    assert torch.equal(again.alongside[0].cell_impedance, wanted.cell_impedance)
    assert [name for name in known_of([again], 0) if "Dean" in name] == [
        "in situ (Dean), admittance over points",
        "in situ (Dean), pressure first",
    ]
    assert (folder / "along_x.png").exists()
    import h5py

    with h5py.File(target, "a") as file:
        del file["alongside_0"]
    assert tl.read_map(target).alongside == ()
