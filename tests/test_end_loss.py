"""The law of lost mass: worked by hand, its limits, and the page that it was fitted on."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.liners.catalogue import liner_text
from torchliner.liners.sdof import EndLossSDoFLiner

ROOT = Path(__file__).resolve().parent.parent


def liner(name="lbm_slit", **own):
    """A preset under the law."""
    return EndLossSDoFLiner.of(tl.load_liner(name), **own)


def ends(made, frequency=1400.0):
    """E: reactance at rest without flow, less cavity and air inside the holes; by plain numbers."""
    omega = 2 * math.pi * frequency
    still = made.replace(mach=0.0)
    bare = still.replace(impedance_offset=0j, facesheet_thickness=1e-9, orifice_diameter=1e-3)
    cavity = complex(bare.impedance(frequency)) * made.open_area_fraction
    plate = 1e-9 + 2 * 0.85 * 0.5e-3 * (1 - 1.14 * made.porosity**0.5)
    viscous = math.sqrt(made.fluid.dynamic_viscosity * omega * made.fluid.density) / (
        made.fluid.density * made.fluid.sound_speed * made.porosity
    )
    viscous *= (2 * 1e-9 / 0.5e-3 + 4 * (plate - 1e-9) / 2 / 0.5e-3) / 2**0.5
    speed = made.fluid.sound_speed
    cavity = cavity.imag - viscous - omega * plate / (speed * made.porosity)
    inside = omega * made.facesheet_thickness / (speed * made.porosity)
    reactance = complex(still.impedance(frequency)).imag
    return reactance - (cavity + inside) / made.open_area_fraction


@pytest.mark.parametrize("mach", [0.0, 0.2])
@pytest.mark.parametrize("reading", ["as_measured", "conserved"])
def test_the_share_is_that_of_the_formula(mach, reading):
    """X at rest less X is s E, with s written out; the resistance is the paper's."""
    made = liner(
        mach=mach,
        hydraulic_diameter=1.368e-3,
        open_area_fraction=0.7,
        velocity_reading=reading,
        velocity_gain=1.3,
    )
    for speed in (0.05, 0.4, 3.0):
        cell = speed * 1.3 / (0.7 if reading == "conserved" else 1)
        xi = cell / (made.porosity * 2 * math.pi * 1400 * 1.368e-3)
        a = 0.5 * xi**2.5 / (xi**2.5 + 0.29**2.5)
        share = math.hypot(a, 1.54 * mach)
        lost = made.replace(mach=0.0).impedance(1400.0) - made.impedance(1400.0, speed)
        assert lost.imag.item() == pytest.approx(share * ends(made), rel=1e-6)
        base = tl.load_liner("lbm_slit").replace(open_area_fraction=0.7, velocity_reading=reading, velocity_gain=1.3)
        found = made.impedance(1400.0, speed).real
        assert found.item() == pytest.approx(base.impedance(1400.0, speed).real.item(), rel=1e-12)


def test_at_rest_without_flow_it_is_the_paper_s_liner():
    """Nothing is lost, at any frequency."""
    f = torch.linspace(300, 6000, 40, dtype=torch.float64)
    wanted = tl.load_liner("onera").impedance(f)
    assert float((liner("onera").impedance(f) - wanted).abs().max()) < 1e-12


def test_no_more_than_the_stated_share_is_lost():
    """Fast |v| takes A, and with p = 1 flow adds k M."""
    made = liner(mach=0.1, combination=1.0)
    lost = made.replace(mach=0.0).impedance(1400.0) - made.impedance(1400.0, 1e4)
    assert lost.imag.item() == pytest.approx((0.5 + 0.154) * ends(made), rel=1e-5)


@given(st.floats(0, 0.4), st.floats(1, 8), st.floats(0, 20), st.floats(100, 6000))
def test_reactance_falls_with_speed_and_flow_and_the_wall_stays_passive(mach, p, speed, frequency):
    """For whatever parameters."""
    made = liner(mach=mach, combination=p)
    more = made.impedance(frequency, speed * 1.1 + 1e-3)
    here = made.impedance(frequency, speed)
    assert more.imag <= here.imag + 1e-12
    assert made.replace(mach=mach + 0.1).impedance(frequency, speed).imag <= here.imag + 1e-12
    assert here.real > 0
    assert torch.isfinite(here.abs())


def test_derivatives_are_exact():
    """In all parameters of the law, also at rest and without flow."""
    made = liner(mach=0.1)
    names = ("end_loss", "loss_displacement", "mach_loss", "mach", "combination", "hydraulic_diameter", "porosity")
    start = [torch.tensor(made.numbers()[n].value, dtype=torch.float64) for n in names]
    speed = torch.tensor([0.3, 2.0], dtype=torch.float64)

    def impedance(*values):
        return made.with_numbers(dict(zip(names, values, strict=True))).impedance(1400.0, speed)

    assert torch.autograd.gradcheck(impedance, [v.requires_grad_() for v in start])
    still = made.with_numbers({"end_loss": torch.tensor(0.5, requires_grad=True), "mach": 0.0})
    (slope,) = torch.autograd.grad(still.impedance(1400.0, 0.0).imag, still.end_loss)
    assert slope == 0


def test_it_is_written_and_read_back(tmp_path):
    """All of its keys; a mistyped one is named."""
    made = liner(mach=0.3, hydraulic_diameter=1.368e-3)
    path = tmp_path / "mine.toml"
    path.write_text(liner_text(made, "a test"))
    assert tl.load_liner(path).describe() == made.describe()
    path.write_text(path.read_text().replace("mach_loss", "mach_los"))
    with pytest.raises(ValueError, match="mach_loss"):
        tl.load_liner(path)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"mach": -0.1}, "liner 'lbm_slit': mach is -0.1; it is at least 0 and at most 1"),
        ({"mach": 30.0}, "mach is 30"),
        ({"loss_displacement": 0.0}, "loss_displacement is 0; it is above 0"),
        ({"hydraulic_diameter": math.nan}, "hydraulic_diameter is nan"),
        ({"combination": 64.0}, "at most 8"),
        ({"end_loss": 1.5}, "end_loss is 1.5"),
    ],
)
def test_values_outside_their_range_are_refused(own, words):
    """By name and limit."""
    with pytest.raises(ValueError, match=words):
        liner(**own)


def test_the_page_says_what_its_numbers_say():
    """Of each law, left out one by one: eight of nine within 0.1, and the two laws that fail."""
    with (ROOT / "docs/figures/mass_loss.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    away = {}
    for row in rows:
        away.setdefault(row["law"], {})[row["case"]] = float(row["reactance"]) - float(row["true_reactance"])
    paper, speed, mach, both = (np.array(list(each.values())) for each in list(away.values())[:4])
    assert abs(paper).max() == pytest.approx(0.33, abs=5e-3)
    assert abs(speed).max() == pytest.approx(0.20, abs=5e-3)
    assert abs(mach).max() == pytest.approx(0.30, abs=5e-3)
    assert (abs(both) < 0.1).sum() == 8
    assert (both**2).mean() ** 0.5 == pytest.approx(0.060, abs=1e-3)
    assert (paper**2).mean() ** 0.5 == pytest.approx(0.187, abs=1e-3)


def test_a_case_of_the_page_comes_out_again():
    """t03 at 0.5 mm with the coefficients of the package, all of them fitted."""
    plane = tl.read_plane(ROOT / "data/orifice_t03_130_y0.5mm.h5")
    made = liner("lbm_orifice_coarse", vena_contracta=0.411)
    z = complex(tl.educe(plane, made, interval=None).liner["phase-locked"].impedance[0])
    assert z == pytest.approx(2.330 - 0.803j, abs=6e-3)


T03 = ROOT / "data/orifice_t03_130_y0.5mm.h5"


def test_the_mach_number_is_that_of_the_plane():
    """Of a plane, of its moments, of each plane of a fit; the map states it."""
    plane, bare = tl.read_plane(T03), liner("lbm_orifice_coarse")
    assert (bare.mach, bare.lacks_mach) == (None, True)
    found = tl.educe(plane, bare, interval=None)
    stated = tl.educe(plane, bare.replace(mach=0.3), interval=None)
    still = tl.educe(dataclasses.replace(plane, mach=0.0), bare, interval=None)
    assert complex(found.answer[0]) == pytest.approx(complex(stated.answer[0]), abs=1e-12)
    assert abs(complex(found.answer[0]) - complex(still.answer[0])) > 0.1
    assert found.choices["liner"]["mach"] == 0.3
    known = tl.moments(plane, bare)
    assert complex(known.educe(bare, interval=None).answer[0]) == pytest.approx(complex(found.answer[0]), abs=1e-6)
    slopes = tl.sensitivities(known, bare, parameters=["porosity"])
    wanted = tl.sensitivities(known, bare.replace(mach=0.3), parameters=["porosity"])
    assert torch.allclose(slopes.liner["phase-locked"], wanted.liner["phase-locked"], rtol=1e-12)
    twice = [known, dataclasses.replace(known, plane=dataclasses.replace(known.plane, mach=0.0))]
    each = [bare.replace(mach=mach) for mach in (0.3, 0.0)]
    fit, fit_of_each = (
        tl.calibrate(twice, made, [2 - 1j, 2 - 0.5j], {"offset": (-3.0, 3.0)}, averaging="phase-locked", draws=0)
        for made in (bare, each)
    )
    assert torch.allclose(fit.values, fit_of_each.values, rtol=1e-9)
    assert fit.liner.mach is None


def test_a_stated_mach_number_holds_where_the_data_state_none_and_may_not_contradict():
    """A plane without one: the liner's; two that differ are refused; none at all is told."""
    plane = tl.read_plane(T03)
    with pytest.raises(ValueError, match=r"states mach 0.1, and the data 0.3; leave mach out"):
        tl.educe(plane, liner("lbm_orifice_coarse", mach=0.1), interval=None)
    silent, made = dataclasses.replace(plane, mach=None), liner("lbm_orifice_coarse", mach=0.3)
    found, wanted = (complex(tl.educe(each, made, interval=None).answer[0]) for each in (silent, plane))
    assert found == pytest.approx(wanted, abs=1e-12)
    with pytest.warns(tl.DataWarning, match=r"neither the liner nor .* states a Mach number.*0 is taken"):
        tl.educe(silent, liner("lbm_orifice_coarse"), interval=None)
