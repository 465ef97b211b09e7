"""The audit: each row is an eduction with one choice changed, and the data are read no more often than needed."""

import dataclasses
import warnings
from types import SimpleNamespace

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.engine.kernels import build_kernels, interpolate
from torchliner.liners.sdof import porosity_readings
from torchliner.studies.audit import audit

SPACING = 12.44e-3 / 16
EXACT = 2e-9  # R is interpolated over |v| to 1e-9, by another basis where other liners share it


class Counted:
    """A stored velocity that counts how often it is read through."""

    def __init__(self, velocity: torch.Tensor) -> None:
        self.velocity = velocity
        self.shape, self.dtype = tuple(velocity.shape), velocity.dtype
        self.passes = 0

    def read(self, begin, end, out=None):
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
    return plane_of(velocity, x=SPACING * (torch.arange(32) + 0.5), height=height, **about)


@pytest.fixture(scope="module")
def planes() -> list[tl.VelocityPlane]:
    return [make_plane(), make_plane(1, 1e-3)]


@pytest.fixture(scope="module")
def found(planes, onera):
    return {name: audit(planes, onera, averaging=name) for name in ("phase-locked", "velocity", "admittance")}


def educed(plane, liner, averaging="phase-locked", **choices):
    """Without an interval, which no row has."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)  # parts of a record are short
        return complex(tl.educe(plane, liner, interval=None, **choices).liner[averaging].impedance[0])


def row(found, factor: str, start: str):
    (one,) = [each for each in found.of(factor=factor) if each.variant.startswith(start)]
    return one


def test_halves_of_an_odd_number_of_blocks_are_as_long(onera):
    """The block in the middle, one of seven, belongs to neither."""
    plane = make_plane()
    plane = dataclasses.replace(plane, velocity=plane.velocity[:, : round(7 * RATE / FREQUENCY)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        rows = audit(plane, onera, averaging="admittance", allow_short=True).of(factor="half the record")
    assert {each.variant for each in rows} == {f"{name}, mean over 3 whole periods" for name in ("first", "second")}


@pytest.mark.parametrize("averaging", ["phase-locked", "velocity"])
@pytest.mark.parametrize(
    ("factor", "variant", "choices"),
    [
        ("mean velocity", "removed", {"mean": "removed"}),
        ("drive", "rms", {"drive": "rms"}),
        ("drive", "running-rms", {"drive": "running-rms"}),
        ("phase rule", "self-consistent", {"phase": "self-consistent"}),
    ],
)
def test_row_is_an_eduction_with_that_choice(planes, onera, found, averaging, factor, variant, choices):
    mine = row(found[averaging], factor, variant)
    assert abs(mine.impedance - educed(planes[0], onera, averaging, **choices)) < EXACT
    assert mine.change == mine.impedance - found[averaging].base


def test_row_is_an_eduction_with_that_liner(planes, onera, found):
    """Contraction; |v| as the cells see it; porosity of the whole surface, the cavity its share or all."""
    alpha = onera.open_area_fraction
    whole = onera.replace(porosity=0.065 * alpha, open_area_fraction=1.0)
    for factor, variant, liner in (
        ("contraction coefficient", "0.75", onera.replace(vena_contracta=0.75)),
        ("velocity reading", "conserved", onera.replace(velocity_reading="conserved")),
        ("porosity reading", "global, phi_c = 1", whole),
        ("porosity reading", "global, phi_c = 0.635", whole.replace(cavity_porosity=alpha)),
    ):
        mine = row(found["phase-locked"], factor, variant)
        assert abs(mine.impedance - educed(planes[0], liner)) < EXACT


def test_global_liner_is_read_locally(planes):
    """PoliTo in cells of 9.90 mm every 12.44 mm; the paper's rounder 8.78 % gives 1636.3 Hz."""
    local = row(audit(planes[0], tl.load_liner("polito_as_printed")), "porosity reading", "local 8.68 %")
    readings = porosity_readings(tl.load_liner("polito_as_printed"))
    assert readings[local.variant].resonance() == pytest.approx(1636.3, abs=6)


def test_parts_of_the_record(planes, onera, found):
    plane, n = planes[0], planes[0].samples
    for factor, variant, velocity, rate in (
        ("half the record", "first, mean over 10 whole", plane.velocity[:, : n // 2], RATE),
        ("half the record", "second, mean over 10 whole", plane.velocity[:, n // 2 :], RATE),
        ("sampling rate", "every second sample, 21000 Hz", plane.velocity[:, ::2], RATE / 2),
    ):
        part = dataclasses.replace(plane, velocity=velocity, sampling_rate=rate)
        mine = row(found["admittance"], factor, variant)
        assert abs(mine.impedance - educed(part, onera, "admittance")) < EXACT


@pytest.mark.parametrize(("kind", "limit"), [("two-sided", 1e-7), ("causal", 2e-4)])
def test_kernels_are_those_of_the_table(planes, onera, found, kind, limit):
    """The mean of H(f; |v|), interpolated sample by sample; that of a causal kernel, less smooth, moves Z by 0.09."""
    mine = row(found["admittance"], "kernel", kind)
    speed = planes[0].velocity.abs()
    table = build_kernels(onera, RATE, velocity_max=float(speed.max()), kind=kind, levels=400)
    response = table.response(torch.tensor([FREQUENCY], dtype=torch.float64))
    reflection = interpolate(response, *table.grid.locate(speed))[..., 0].mean(1)
    wanted = complex(1 / ((1 - reflection) / (1 + reflection)).mean())
    assert abs(mine.impedance - wanted) < limit
    assert abs(wanted - found["admittance"].base) < 0.1


def test_given_phase_is_the_worst_of_a_turn(planes, onera, found):
    rows = [each.impedance for each in found["phase-locked"].of(factor="phase rule") if "given" in each.variant]
    assert len(rows) == 4
    values = [educed(planes[0], onera, phase="given", reference_phase=psi) for psi in (0.1, 0.8, 1.9, 2.9)]
    for part in ("real", "imag"):
        least, *_, most = sorted(getattr(z, part) for z in rows)
        assert all(least - 1e-3 < getattr(z, part) < most + 1e-3 for z in values)


def test_base_height_and_averaging(planes, onera, found):
    mine = found["phase-locked"]
    base = tl.educe(planes[0], onera)
    wanted = (complex(base.answer[0]), *base.bounds_of_liner("phase-locked"))
    assert max(abs(a - b) for a, b in zip((mine.base, mine.low, mine.high), wanted, strict=True)) < EXACT
    assert abs(row(mine, "height", "y = 1 mm").impedance - educed(planes[1], onera)) < EXACT
    assert abs(row(mine, "averaging", "velocity").impedance - educed(planes[0], onera, "velocity")) < EXACT


def test_sorted_by_what_moves_most(found):
    rows = found["phase-locked"]
    factors = list(dict.fromkeys(each.factor for each in rows.rows))
    sizes = [max(abs(r.change) for r in rows.of(factor=factor)) for factor in factors]
    assert sizes == sorted(sizes, reverse=True)
    wanted = "kernel,contraction coefficient,velocity reading,porosity reading,half the record,sampling rate,phase rule"
    assert set(factors) == {*wanted.split(","), "drive", "mean velocity", "averaging", "height"}


def test_data_are_read_three_times(onera):
    stored = [Counted(make_plane(seed).velocity) for seed in (0, 1)]
    audit([dataclasses.replace(make_plane(0, 1e-3 * (2 - i)), velocity=each) for i, each in enumerate(stored)], onera)
    assert [each.passes for each in stored] == [3, 2]


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_what_does_not_apply_is_listed(onera):
    plane = plane_of(turbulence((3, 7 * 10), rms=2.0), sampling_rate=14000.0)
    skipped = audit(plane, SimpleNamespace(impedance=onera.impedance), minimum_coherence=1.0).skipped
    parameters = {"contraction coefficient", "velocity reading", "porosity reading"}
    assert set(skipped) == parameters | {"half the record", "sampling rate", "height", "phase rule"}
    assert all(skipped.values())


def test_bad_input_is_refused(onera, planes):
    for given, options, message in (
        ([planes[0], dataclasses.replace(planes[1], mach=0.3)], {}, r"are not one case: mach is 0\.3 and None"),
        ([planes[0], make_plane(3)], {}, "are both at 2 mm"),
        (planes[0], {"running_window": 2e-3}, "running_window"),
        (planes[0], {"frequency": [1000.0, 1400.0]}, "one frequency; 2 are given"),
    ):
        with pytest.raises(ValueError, match=message):
            audit(given, onera, **options)


@pytest.mark.filterwarnings("ignore:.*level check")
def test_a_stated_background_is_of_the_base():
    plane, liner = tl.read_plane(DATA / "slit_g03_145_y0.5mm.h5"), tl.load_liner("lbm_slit")
    found = audit(plane, liner, background=1.0)
    assert found.base == pytest.approx(educed(plane, liner, background=1.0), rel=1e-6)
