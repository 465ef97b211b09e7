"""The law of lost mass: worked by hand, its limits, and the page that it was fitted on."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from conftest import DATA
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.liners.sdof import EndLossSDoFLiner


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
        mach=mach, hydraulic_diameter=1.368e-3, open_area_fraction=0.7, velocity_reading=reading, velocity_gain=1.3
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


T03 = DATA / "orifice_t03_130_y0.5mm.h5"


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
        tl.calibrate(twice, made, [2 - 1j, 2 - 0.5j], {"offset": (-3.0, 3.0)}, averaging="phase-locked")
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
