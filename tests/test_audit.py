"""The audit: each row is an eduction with one choice changed, and the reading count is honest."""

from __future__ import annotations

import csv
import dataclasses
import json
import warnings

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.cli.main import main
from torchliner.engine.kernels import build_kernels, interpolate
from torchliner.liners.sdof import porosity_readings
from torchliner.records.boxes import grid_of, windows_of
from torchliner.studies.audit import audit

SLIT = DATA / "slit_n130_y2.5mm.h5"
SPACING = 12.44e-3 / 16
EXACT = 2e-9  # R is interpolated over |v| to 1e-9, by another basis where other liners share it


class Counted:
    """A stored velocity that counts how often it is read through, and the samples."""

    def __init__(self, velocity: torch.Tensor) -> None:
        self.velocity = velocity
        self.shape, self.dtype = tuple(velocity.shape), velocity.dtype
        self.tile_rows, self.samples_read, self.passes = 1, 0, 0

    def read(self, begin, end, out=None):
        self.samples_read += min(end, self.shape[-1]) - begin
        self.passes += begin == 0
        return self.velocity[..., begin:end].reshape(-1, end - begin).T

    def load(self):
        return self.velocity


def make_plane(seed: int = 0, height: float = 2e-3, **about) -> tl.VelocityPlane:
    """Two cells of 16 probes: a tone and turbulence, 20 whole periods."""
    samples = round(20 * RATE / FREQUENCY)
    time = torch.arange(samples, dtype=torch.float64) / RATE
    tone = 1.5 * torch.cos(2 * torch.pi * FREQUENCY * time + 0.4)
    velocity = 0.3 + tone + turbulence((32, samples), seed, rms=1.5)
    x = SPACING * (torch.arange(32) + 0.5)
    return plane_of(velocity, x=x, height=height, **about)


@pytest.fixture(scope="module")
def planes() -> list[tl.VelocityPlane]:
    return [make_plane(), make_plane(1, 1e-3)]


@pytest.fixture(scope="module")
def found(planes, onera):
    return audit(planes, onera)


def educed(plane, liner, **choices):
    """Without an interval, which no row has."""
    return tl.educe(plane, liner, interval=None, **choices)


def row(found, factor: str, start: str):
    (one,) = [each for each in found.of(factor=factor) if each.variant.startswith(start)]
    return one


EDUCED = {
    ("mean velocity", "removed"): {"mean": "removed"},
    ("drive", "rms"): {"drive": "rms"},
    ("drive", "running-rms"): {"drive": "running-rms"},
    ("phase rule", "self-consistent"): {"phase": "self-consistent"},
}


@pytest.fixture(scope="module")
def found_velocity(planes, onera):
    return audit(planes[0], onera, averaging="velocity")


@pytest.mark.parametrize("which", EDUCED, ids=" ".join)
def test_row_is_an_eduction_with_that_choice(planes, onera, found, found_velocity, which):
    """One pass for all gives what a run for each gives, in two averagings."""
    single = educed(planes[0], onera, **EDUCED[which])
    for one, wanted in (
        (found, single.answer),
        (found_velocity, single.liner["velocity"].impedance),
    ):
        mine = row(one, *which)
        if which == ("drive", "rms"):
            (mine,) = [each for each in one.of(factor="drive") if each.variant == "rms"]
        assert abs(mine.impedance - complex(wanted[0])) < EXACT
        assert mine.change == mine.impedance - one.base


def test_a_window_is_of_a_base_of_the_running_rms(planes, onera):
    found = audit(planes[0], onera, running_window=2e-3, drive="running-rms")
    single = educed(planes[0], onera, drive="running-rms", running_window=2e-3)
    assert abs(found.base - complex(single.answer[0])) < EXACT
    with pytest.raises(ValueError, match="running_window"):
        audit(planes[0], onera, running_window=2e-3)


@pytest.mark.parametrize("value", [0.75, 0.85])
def test_vena_contracta(planes, onera, found, value):
    single = educed(planes[0], onera.replace(vena_contracta=value))
    assert abs(row(found, "vena contracta", f"{value}").impedance - complex(single.answer[0])) < EXACT


def test_readings_of_the_liner(planes, onera, found):
    """Velocity as the cells see it; porosity of the whole surface, the cavity its share or all."""
    alpha = onera.open_area_fraction
    whole = onera.replace(porosity=0.065 * alpha, open_area_fraction=1.0)
    for which, liner in (
        (("velocity reading", "conserved"), onera.replace(velocity_reading="conserved")),
        (("porosity reading", "global, phi_c = 1"), whole),
        (("porosity reading", "global, phi_c = 0.635"), whole.replace(cavity_porosity=alpha)),
    ):
        single = educed(planes[0], liner)
        assert abs(row(found, *which).impedance - complex(single.answer[0])) < EXACT


def test_global_liner_is_read_locally(planes):
    """PoliTo in cells of 9.90 mm every 12.44 mm; the paper's rounder 8.78 % gives 1636.3 Hz."""
    found = audit(planes[0], tl.load_liner("polito_as_printed"))
    local = row(found, "porosity reading", "local 8.68 %")
    readings = porosity_readings(tl.load_liner("polito_as_printed"))
    assert readings[local.variant].resonance() == pytest.approx(1636.3, abs=6)


def test_parts_of_the_record(planes, onera):
    """Halves and every second sample, as records of their own, whose coherent part is the whole's
    where that is averaged first."""
    plane, n = planes[0], planes[0].samples
    found = audit(plane, onera, averaging="admittance")
    for which, velocity, rate in (
        (("half the record", "first, mean over 10 whole"), plane.velocity[:, : n // 2], RATE),
        (("half the record", "second, mean over 10 whole"), plane.velocity[:, n // 2 :], RATE),
        (("sampling rate", "every second sample, 21000 Hz"), plane.velocity[:, ::2], RATE / 2),
    ):
        part = dataclasses.replace(plane, velocity=velocity, sampling_rate=rate)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tl.DataWarning)  # half of 14 ms is a short record
            single = educed(part, onera, averaging="admittance")
        assert abs(row(found, *which).impedance - complex(single.answer[0])) < EXACT


@pytest.mark.parametrize(("kind", "limit"), [("two-sided", 1e-7), ("causal", 2e-4)])
def test_kernels_are_those_of_the_table(planes, onera, kind, limit):
    """The mean of H(f; |v|) over the record, interpolated between levels sample by sample.

    That of a causal kernel is less smooth over |v| than R itself; it moves Z by 0.09.
    """
    found = audit(planes[0], onera, averaging="admittance")
    mine = row(found, "kernel", kind)
    speed = planes[0].velocity.abs()
    table = build_kernels(onera, RATE, velocity_max=float(speed.max()), kind=kind, levels=400)
    response = table.response(torch.tensor([FREQUENCY], dtype=torch.float64))
    reflection = interpolate(response, *table.grid.locate(speed))[..., 0].mean(1)
    wanted = complex(1 / ((1 - reflection) / (1 + reflection)).mean())
    assert abs(mine.impedance - wanted) < limit
    assert abs(wanted - found.base) < 0.1


def test_given_phase_is_the_worst_of_a_turn(planes, onera, found):
    """No phase of the incident wave lies outside the rows of a stated phase."""
    rows = [each.impedance for each in found.of(factor="phase rule") if "given" in each.variant]
    assert len(rows) == 4
    for psi in (0.1, 0.8, 1.9, 2.9):
        single = educed(planes[0], onera, phase="given", reference_phase=psi)
        value = complex(single.answer[0])
        assert min(z.real for z in rows) - 1e-3 < value.real < max(z.real for z in rows) + 1e-3
        assert min(z.imag for z in rows) - 1e-3 < value.imag < max(z.imag for z in rows) + 1e-3


def test_height_averaging_and_length(planes, onera, found):
    """The other plane; the other averaging; the velocity over windows of a share of a cell."""
    other = educed(planes[1], onera)
    above = row(found, "height", "y = 1 mm").impedance
    assert abs(above - complex(other.answer[0])) < EXACT
    base = tl.educe(planes[0], onera)
    assert abs(found.base - complex(base.answer[0])) < EXACT
    first = complex(base.liner["velocity"].impedance[0])
    assert abs(row(found, "averaging", "velocity").impedance - first) < EXACT
    grid = grid_of(planes[0])
    windows = windows_of(grid, 0.25 * 12.44e-3, torch.ones(1, 32, dtype=torch.bool))
    averaged = plane_of(windows.mean(planes[0].velocity.T).T)
    single = educed(averaged, onera, averaging="admittance")
    quarter = row(found, "averaging length", "velocity over 0.25").impedance
    assert abs(quarter - complex(single.answer[0])) < EXACT
    low, high = base.bounds_of_liner("phase-locked")
    assert abs(found.low - low) < EXACT
    assert abs(found.high - high) < EXACT


def test_sorted_by_what_moves_most(found):
    factors = list(dict.fromkeys(each.factor for each in found.rows))
    sizes = [max(abs(r.change) for r in found.of(factor=factor)) for factor in factors]
    assert sizes == sorted(sizes, reverse=True)
    assert set(factors) == {
        "kernel",
        "vena contracta",
        "velocity reading",
        "porosity reading",
        "half the record",
        "sampling rate",
        "phase rule",
        "drive",
        "mean velocity",
        "averaging",
        "averaging length",
        "height",
    }


def test_readings_are_counted(onera):
    """What the audit says it read is what was read: 3 times one plane, 2 times the other."""
    stored = [Counted(make_plane(seed).velocity) for seed in (0, 1)]
    planes = [
        dataclasses.replace(make_plane(seed, height), velocity=each)
        for seed, height, each in zip((0, 1), (2e-3, 1e-3), stored, strict=True)
    ]
    found = audit(planes, onera)
    assert ([each.passes for each in stored], found.readings) == ([3, 2], 5)


# What cannot be varied


class Plain:
    """A user's liner without parameters."""

    def __init__(self, liner: tl.SDoFLiner) -> None:
        self.inner = liner

    def impedance(self, frequency, speed):
        return self.inner.impedance(frequency, speed)


def test_what_does_not_apply_is_listed(onera):
    """Another model, no cells, short, coarse, no tone in the data: each with its reason."""
    velocity = turbulence((3, 7 * 10), rms=2.0)
    plane = plane_of(velocity, sampling_rate=14000.0)
    with pytest.warns(tl.DataWarning, match="error bars"):  # of seven periods
        found = audit(plane, Plain(onera), minimum_coherence=1.0)
    skipped = found.skipped
    assert "Plain has no such parameter; only SDoF liners have" in skipped["vena contracta"]
    assert "only SDoF" in skipped["velocity reading"]
    assert "only SDoF" in skipped["porosity reading"]
    assert skipped["half the record"] == "half the record holds 3 whole periods, fewer than 4"
    assert "would leave 5 samples per period, fewer than 8" in skipped["sampling rate"]
    assert skipped["averaging length"] == "the liner states no cell_pitch"
    assert "one plane is given" in skipped["height"]
    assert "no probe is coherent with 1400 Hz by 1" in skipped["phase rule, self-consistent"]


def test_planes_of_other_cases_are_no_heights(onera, planes):
    with pytest.raises(ValueError, match=r"are not one case: mach is 0\.3 and None"):
        audit([planes[0], dataclasses.replace(planes[1], mach=0.3)], onera)
    with pytest.raises(ValueError, match="are both at 2 mm"):
        audit([planes[0], make_plane(3)], onera)
    with pytest.raises(TypeError, match="plane is str; a VelocityPlane or Moments"):
        audit(["plane.h5"], onera)


def test_wall_everywhere_leaves_no_base(onera):
    plane = plane_of(turbulence((3, 600)), x=[0.0, 1e-3, 2e-3])
    with pytest.raises(ValueError, match="every probe counts as wall; lower or leave out wall_f"):
        audit(plane, onera, wall_filter=1.0)


# The command


def test_command(tmp_path, capsys):
    """Table, CSV, figure and JSON say the same."""
    out, picture, plane = tmp_path / "a.csv", tmp_path / "a.png", tmp_path / "plane.h5"
    make_plane(liner="onera").write(plane)
    words = ["audit", str(plane), "--quiet", "--verbose", "-o", str(out), "--figure", str(picture)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert picture.stat().st_size > 10_000
    rows = list(csv.DictReader(out.read_text().splitlines()))
    low, high = ((float(r["resistance"]), float(r["reactance"])) for r in rows if r["factor"] == "interval")
    assert f"R {low[0]:.3f} to {high[0]:.3f}, X {low[1]:.3f} to {high[1]:.3f}" in printed
    for row in rows:
        assert row["factor"] in ("base", "interval") or row["factor"] in printed
        assert row["note"] in printed
    assert [r["variant"] for r in rows if r["factor"] == "interval"] == ["low", "high"]
    assert any(r["variant"] == "does not apply" and "one plane" in r["note"] for r in rows)
    assert main(["audit", str(plane), "--quiet", "--json", "--averaging", "velocity"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["averaging"] == "velocity"
    assert found["readings"] == 3
    base = tl.educe(tl.read_plane(plane), tl.load_liner("onera"), interval=None)
    wanted = float(base.liner["velocity"].impedance[0].real)
    assert found["base"]["resistance"] == pytest.approx(wanted, rel=1e-6)
    assert found["skipped"]["height"].startswith("one plane")


def test_moments_are_audited_as_far_as_they_go(planes, onera):
    """The rows that moments hold are those of the plane; the rest is left out with the reason."""
    plane, liner = planes[0], onera
    chosen = {"phase": "given", "interval": 0.95}
    known = tl.moments(plane, liner, **chosen)
    whole, found = tl.audit(plane, liner), tl.audit(known, liner)
    rows = {(row.factor, row.variant): row.impedance for row in whole.rows}
    assert found.readings == 0
    assert {row.factor for row in found.rows} >= {"phase rule", "kernel", "half the record"}
    for row in found.rows:
        limit = 1e-5 if row.factor == "kernel" else 1e-7  # K is chosen for the liner's own R
        assert abs(row.impedance - rows[row.factor, row.variant]) < limit
    assert "time samples are gone" in found.skipped["drive, mean velocity"]
    assert "alternating sign" in found.skipped["sampling rate"]
    assert "phase rules" in tl.audit(tl.moments(plane, liner), liner).skipped["phase rule"]


@pytest.mark.filterwarnings("ignore:.*level check")
@pytest.mark.parametrize("averaging", ["phase-locked", "velocity"])
def test_a_stated_background_is_of_the_base(averaging):
    """It enters phase-locked averaging alone, and lengths, which are of another, do without."""
    plane, liner = tl.read_plane(DATA / "slit_g03_145_y0.5mm.h5"), tl.load_liner("lbm_slit")
    found = tl.audit(plane, liner, averaging=averaging, background=1.0)
    wanted = tl.educe(plane, liner, background=1.0).liner[averaging].impedance[0]
    assert found.base == pytest.approx(complex(wanted), rel=1e-6)
    assert any(row.factor == "averaging length" for row in found.rows)
