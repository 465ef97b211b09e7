"""The validation page: laws of reach, hole velocity and phase-locked power; its numbers."""

import math

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, load_script, plane_of, turbulence
from test_audit import Counted

import torchliner as tl
from common import tables_of
from studies.limits import hole_velocity, reach, speed_that_gives
from studies.validation import reference_wave_phase, validate

page = load_script("validation_page")
TABLES = tables_of(page.PAGE)
ROWS = page.read_rows(page.FIGURES / "validation_errors.csv")

# --- what a model can return


def test_a_constant_speed_is_found_again(liner):
    z = complex(liner.impedance(FREQUENCY, 0.7))
    for value, part in ((z.real, "real"), (z.imag, "imag")):
        assert speed_that_gives(liner, FREQUENCY, value, part) == pytest.approx(0.7, rel=1e-9)


def test_a_sine_is_what_educe_makes_of_one(liner):
    """The rms named for a sine returns that R when a sine of it is educed (phase averaged)."""
    rms = speed_that_gives(liner, FREQUENCY, 2.0, "real", "sine")
    t = torch.arange(4800, dtype=torch.float64) / (10 * RATE)  # |v| has corners
    velocity = rms * 2**0.5 * torch.sin(2 * torch.pi * FREQUENCY * t + 0.3)
    plane = plane_of(velocity[None], sampling_rate=10 * RATE)
    found = tl.educe(plane, liner)
    assert float(found.liner["admittance"].impedance[0].real) == pytest.approx(2.0, abs=1e-3)


def test_beyond_the_asymptote_there_is_no_speed(liner):
    """X falls by less than c, whatever |v|."""
    lowest = float(liner.impedance(FREQUENCY, 1e9).imag)
    assert speed_that_gives(liner, FREQUENCY, lowest - 1e-6, "imag") is None
    assert speed_that_gives(liner, FREQUENCY, lowest + 0.05, "imag") is not None


@pytest.mark.parametrize("rms", [0.2, 1.5, 15.0])
def test_educed_values_lie_within_reach(liner, rms):
    velocity = turbulence((4, 480), 1, rms=rms)
    found = tl.educe(plane_of(velocity), liner, interval=None)
    reachable = reach(liner, FREQUENCY, 1.001 * float(velocity.abs().max()))
    for z in [*found.impedance[:, 0].tolist(), complex(found.liner["velocity"].impedance)]:
        assert abs(reachable.nearest(z) - z) < 1e-3


def test_reach_ends_where_the_curve_does(liner):
    """The model's own curve is inside; what lies on the far side of it, or X above rest, is not."""
    reachable = reach(liner, FREQUENCY, 10.0)
    speeds = torch.tensor([0.0, 0.3, 2.0, 10.0], dtype=torch.float64)
    for z in liner.impedance(FREQUENCY, speeds).reshape(-1).tolist():
        assert abs(reachable.nearest(z) - z) < 1e-4
    rest = complex(liner.impedance(FREQUENCY, 0.0))
    for outside in (rest - 0.1, rest + 0.2j, rest - 0.3j):
        assert abs(reachable.nearest(outside) - outside) > 0.05


# --- velocity in the holes


def cavity_record(into: float, phase: float, **about: object) -> tl.PressureRecord:
    """The pressure at the bottom that a velocity cos(omega t + phase) into the surface leaves."""
    gas = tl.Fluid()
    t = torch.arange(480, dtype=torch.float64) / RATE
    k = 2 * math.pi * FREQUENCY / gas.sound_speed
    ratio = 1j * 0.8 * math.sin(k * 0.03)  # rho c v_in / p_b
    amplitude = gas.characteristic_impedance * into * np.exp(1j * phase) / ratio
    wave = torch.exp(2j * torch.pi * FREQUENCY * t) * complex(amplitude)
    return tl.PressureRecord(
        torch.ones_like(t)[None],
        wave.real[None],
        sampling_rate=RATE,
        frequency=FREQUENCY,
        cavity_depth=0.03,
        cavity_porosity=0.8,
        fluid=gas,
        **about,
    )


def test_hole_velocity_of_a_tone():
    """Dean's relation at one frequency, in time: a cosine of known size and phase, away = -in."""
    found = hole_velocity(cavity_record(1.3, 0.7))
    first = math.ceil(0.03 / 343.2 * RATE)
    t = (torch.arange(found.samples, dtype=torch.float64) + first) / RATE
    wanted = -1.3 * torch.cos(2 * torch.pi * FREQUENCY * t + 0.7)
    assert found.samples == 480 - 2 * first
    assert float((found.velocity[0] - wanted)[8:-8].abs().max()) < 1e-4


# --- rows and tables


def test_rows_survive_their_csv(tmp_path):
    page.write_rule_rows([ROWS[0], ROWS[36]], tmp_path / "rows.csv")  # phases averaged: with an interval
    assert page.read_rows(tmp_path / "rows.csv") == [ROWS[0], ROWS[36]]


@pytest.mark.filterwarnings("ignore:self-consistent phase")
def test_rows_are_educed_in_two_readings(liner):
    """Each rule's value and interval as ``educe`` gives them; the survey serves all four drives."""
    velocity = turbulence((6, 600), seed=7) + torch.cos(2 * torch.pi * FREQUENCY * torch.arange(600) / RATE)
    stored = Counted(velocity)
    about = {"reference": {"true": 1 - 0.3j}, "x": 1e-3 * np.arange(6)}
    rows = {(*row.rule, row.averaging): row for row in validate(plane_of(stored, **about), liner)}
    assert len(rows) == 36
    assert stored.passes == 2
    for drive, mean in (("instantaneous", "removed"), ("rms", "kept"), ("running-rms", "kept")):
        for phase in ("averaged", "self-consistent"):
            found = tl.educe(plane_of(velocity, **about), liner, drive=drive, mean=mean, phase=phase)
            for averaging in found.averagings:
                row = rows[drive, mean, phase, averaging]
                assert abs(row.educed - complex(found.liner[averaging].impedance[0])) < 2e-9
                assert abs(row.low - found.bounds_of_liner(averaging)[0]) < 1e-6


def test_page_states_every_case_and_rule():
    """1332 rows; the tables made of rows are those of the committed ones, to the letter."""
    assert len(ROWS) == len({(r.case, r.height, *r.rule, r.averaging) for r in ROWS}) == 1332
    assert page.default_table(ROWS) == TABLES["default"]
    assert page.rule_table(ROWS) == TABLES["rules"]
    others = {"answers", "scores", "checked"}  # of scripts/answers_page.py
    assert set(TABLES) == {"default", "rules", "reasons", "limits"} | others


def test_reference_wave_phase_by_hand(liner):
    """v_in = c (X - Y): with Z = 1 there is no reflection and x has the phase of v_in = -v."""
    t = torch.arange(480, dtype=torch.float64) / 42000.0
    plane = plane_of(-torch.cos(2 * torch.pi * 1400 * t + 0.8)[None], reference={"true": 1 + 0j})
    assert reference_wave_phase(plane, tl.educe(plane, liner)) == pytest.approx(0.8, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "index"), [("n130", 3), ("g01_145", 0)])
def test_committed_rows_are_current(case, index):
    plane = page.planes_of(case)[index]
    fresh = page.rows_of(case, [plane])
    kept = [r for r in ROWS if r.case == case and abs(r.height - plane.height) < 1e-9]
    for row, old in zip(fresh, kept, strict=True):
        assert (row.rule, row.averaging) == (old.rule, old.averaging)
        for name in ("educed", "true", "in_situ", "low", "high"):
            now, then = getattr(row, name), getattr(old, name)
            if now == now or then == then:
                assert now == pytest.approx(then, rel=1e-3, abs=1e-3), name
        assert row.level_check == pytest.approx(old.level_check, abs=2e-3)
