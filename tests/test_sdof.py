"""Liner models: tables of 40 digits, the law of lost mass, poles and residues, limits, passivity, gradients."""

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import torch
from conftest import DATA, SHARED
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

import torchliner as tl
from torchliner.conversions import admittance_from_reflection
from torchliner.liners.multipole import Multipole
from torchliner.liners.plates import goodrich_resistance, ratio_i2_i0
from torchliner.liners.sdof import EndLossSDoFLiner

ONERA_GLOBAL = tl.SDoFLiner(0.635e-3, 0.991e-3, 0.0395, 38.1e-3, 4.955e-3, name="onera global")


def numbers(pairs) -> torch.Tensor:
    flat = np.array(pairs, dtype=object).astype(float)
    return torch.complex(torch.from_numpy(flat[..., 0]), torch.from_numpy(flat[..., 1]))


@pytest.mark.parametrize("size", [1e-8, 1e-3, 0.3, 1.0, 7.0, 90.0, 3e3, 9.9e3, 1.01e4, 1e7])
def test_bessel_ratio_against_mpmath(size):
    """I2/I0 on the ray arg s = pi/4, where it is used, to 1e-12 from 1e-8 to 1e7."""
    s = size * np.exp(1j * np.pi / 4)
    found = complex(ratio_i2_i0(torch.tensor(s)))
    with mpmath.workdps(40):
        if size < 1e5:
            wanted = complex(mpmath.besseli(2, s) / mpmath.besseli(0, s))
        else:  # two terms more than the code keeps
            r = mpmath.mpc(s)
            ratio = 1 - 1 / (2 * r) - 1 / (8 * r**2) - 1 / (8 * r**3) - 25 / (128 * r**4)
            wanted = complex(1 - 2 / r * ratio)
    assert abs(found - wanted) <= 1e-12 * abs(wanted)


# Origin: 40-digit evaluation of (2.2), phi_p = 3.95 %, phi_c = 1, r_c = D/2.


@pytest.mark.skipif(not SHARED.exists(), reason="high-precision tables are not here")
def test_reference_tables():
    linear = json.loads((SHARED / "reference" / "linear_impedance.json").read_text())
    for table in linear["tables"].values():
        cavity = (38.1e-3, float(table["rc"]), float(table["phi_c"]))
        liner = tl.SDoFLiner(
            0.635e-3, 0.991e-3, float(table["phi_p"]), *cavity, open_area_fraction=float(table["alpha"])
        )
        wanted = numbers(table["Z"])
        found = liner.impedance([float(f) for f in table["f"]])
        assert float(((found - wanted).abs() / wanted.abs()).max()) < 1e-12
        assert liner.resonance() == pytest.approx(float(table["f_res"]), rel=1e-10)
    nonlinear = json.loads((SHARED / "reference" / "nonlinear_terms.json").read_text())
    table = nonlinear["tables"]["ONERA|global"]
    speeds = torch.tensor([float(v) for v in table["V"]], dtype=torch.float64)
    omega = 2 * torch.pi * torch.tensor([float(f) for f in table["f"]]).double()[:, None]
    added = ONERA_GLOBAL.in_motion(omega, speeds)
    wanted = numbers(table["G"])
    assert float((added.real / wanted.real - 1).abs().max()) < 1e-12
    assert float((added.imag / wanted.imag - 1).abs().max()) < 1e-12


def test_rest_is_the_linear_limit():
    """Z(0) is linear, and G falls like |v|^2 to rounding, where the printed form loses 1e-3."""
    omega, speeds = torch.tensor(3000 * torch.pi).double(), torch.tensor([0.0, 1e-9, 1e-6]).double()
    added = ONERA_GLOBAL.in_motion(omega, speeds).real.tolist()
    assert added[0] == 0
    assert added[2] == pytest.approx(1e6 * added[1], rel=1e-5)


def test_onera_reproduces_the_papers_reactance():
    """At the paper's resistance 2.33 the local preset has the paper's reactance -0.30."""
    speeds = torch.linspace(0, 5, 2001, dtype=torch.float64)
    values = tl.load_liner("onera").impedance(1500.0, speeds)
    at = int((values.real - 2.33).abs().argmin())
    assert float(values.imag[at]) == pytest.approx(-0.30, abs=0.03)


def test_goodrich_shift_of_the_paper():
    """One M_b gives 1.03-1.22 between Mach 0.1 and 0.3 for delta* = 2 +- 0.3 mm."""
    for thickness, wanted in ((1.7e-3, 1.22), (2.3e-3, 1.03)):
        slow, fast = (goodrich_resistance(mach, 0.0395, thickness, 0.991e-3) for mach in (0.1, 0.3))
        assert fast - slow == pytest.approx(wanted, abs=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"porosity": -0.1}, "porosity is -0.1"),
        ({"open_area_fraction": 1.2}, "open_area_fraction is 1.2.*at most 1"),
        ({"cavity_depth": float("nan")}, "cavity_depth.*is nan"),
        ({"velocity_reading": "as_mesured"}, "as_mesured.*'as_measured'"),
    ],
)
def test_bad_geometry(change, message):
    with pytest.raises(ValueError, match=message):
        tl.load_liner("onera").replace(**change)


def test_bad_arguments(liner):
    for call, numbers, message in (
        (liner.impedance, (0.0, 1.0), "frequency.*is 0"),
        (liner.impedance, (1400.0, -1.0), "not negative"),
    ):
        with pytest.raises(ValueError, match=message):
            call(*numbers)


def end_loss(name="lbm_slit", **own):
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
    about = {"open_area_fraction": 0.7, "velocity_reading": reading, "velocity_gain": 1.3}
    made = end_loss(mach=mach, hydraulic_diameter=1.368e-3, **about)
    for speed in (0.05, 0.4, 3.0):
        cell = speed * 1.3 / (0.7 if reading == "conserved" else 1)
        xi = cell / (made.porosity * 2 * math.pi * 1400 * 1.368e-3)
        a = 0.5 * xi**2.5 / (xi**2.5 + 0.29**2.5)
        share = math.hypot(a, 1.54 * mach)
        lost = made.replace(mach=0.0).impedance(1400.0) - made.impedance(1400.0, speed)
        assert lost.imag.item() == pytest.approx(share * ends(made), rel=1e-6)
        base = tl.load_liner("lbm_slit").replace(**about).impedance(1400.0, speed)
        assert made.impedance(1400.0, speed).real.item() == pytest.approx(base.real.item(), rel=1e-12)


def test_at_rest_without_flow_it_is_the_paper_s_liner():
    f = torch.linspace(300, 6000, 40, dtype=torch.float64)
    wanted = tl.load_liner("onera").impedance(f)
    assert float((end_loss("onera").impedance(f) - wanted).abs().max()) < 1e-12


@given(st.floats(0, 0.4), st.floats(1, 8), st.floats(0, 20), st.floats(100, 6000))
def test_reactance_falls_with_speed_and_flow_and_the_wall_stays_passive(mach, p, speed, frequency):
    made = end_loss(mach=mach, combination=p)
    more = made.impedance(frequency, speed * 1.1 + 1e-3)
    here = made.impedance(frequency, speed)
    assert more.imag <= here.imag + 1e-12
    assert made.replace(mach=mach + 0.1).impedance(frequency, speed).imag <= here.imag + 1e-12
    assert here.real > 0
    assert torch.isfinite(here.abs())


def test_derivatives_are_exact():
    made = end_loss(mach=0.1)
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
    plane, bare = tl.read_plane(T03), end_loss("lbm_orifice_coarse")
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
    assert torch.allclose(slopes.slopes["phase-locked"], wanted.slopes["phase-locked"], rtol=1e-12)
    twice = [known, dataclasses.replace(known, plane=dataclasses.replace(known.plane, mach=0.0))]
    each = [bare.replace(mach=mach) for mach in (0.3, 0.0)]
    asked = [2 - 1j, 2 - 0.5j], {"offset": (-3.0, 3.0)}
    fit, fit_of_each = (tl.calibrate(twice, made, *asked, averaging="phase-locked", noise=1.0) for made in (bare, each))
    assert torch.allclose(fit.values, fit_of_each.values, rtol=1e-9)
    assert fit.liner.mach is None


def test_a_stated_mach_number_holds_where_the_data_state_none_and_may_not_contradict():
    """A plane without one: the liner's; two that differ are refused; none at all is told."""
    plane = tl.read_plane(T03)
    with pytest.raises(ValueError, match=r"states mach 0.1, and the data 0.3; leave mach out"):
        tl.educe(plane, end_loss("lbm_orifice_coarse", mach=0.1), interval=None)
    silent, made = dataclasses.replace(plane, mach=None), end_loss("lbm_orifice_coarse", mach=0.3)
    found, wanted = (complex(tl.educe(each, made, interval=None).answer[0]) for each in (silent, plane))
    assert found == pytest.approx(wanted, abs=1e-12)
    with pytest.warns(tl.DataWarning, match=r"neither the liner nor .* states a Mach number.*0 is taken"):
        tl.educe(silent, end_loss("lbm_orifice_coarse"), interval=None)


FREQUENCY = torch.linspace(500.0, 4000.0, 36, dtype=torch.float64)
EVERYWHERE = torch.cat([torch.linspace(0, 2e4, 100_001), torch.logspace(4.3, 7, 3001)]).double()


def resonator(f: Tensor, *, resistance: float = 0.6, mass: float = 2e-4, stiffness: float = 6e3) -> Tensor:
    """Z = R + s m + k/s: R has two poles exactly."""
    s = 2j * torch.pi * f
    return resistance + s * mass + stiffness / s


def excess(model: Multipole) -> float:
    """Largest |R| - 1 from 0 to 100 MHz, looked for closely around each pole."""
    around = torch.tan(torch.linspace(-1.57, 1.57, 10_001)).double()
    near = [(p.imag - p.real * around).abs() / (2 * math.pi) for p in model.poles]
    return float(model.reflection(torch.cat([EVERYWHERE, *near])).abs().max()) - 1


def of(liner: str = "onera", poles: int = 8) -> Multipole:
    return tl.fit_multipole(FREQUENCY, tl.load_liner(liner).impedance(FREQUENCY, torch.tensor(3.0).double()), poles)


@pytest.mark.parametrize("resistance", [0.6, 4.0])  # conjugate poles, and two real ones
@pytest.mark.parametrize("poles", [2, 3])
def test_a_resonator_is_found_exactly(resistance: float, poles: int) -> None:
    model = tl.fit_multipole(FREQUENCY, resonator(FREQUENCY, resistance=resistance), poles)
    if poles == 2:  # s^2 m + s (R + 1) + k = 0
        root = torch.sqrt(torch.tensor((resistance + 1) ** 2 - 4 * 2e-4 * 6e3).to(torch.complex128))
        wanted = torch.stack([-(resistance + 1) + root, -(resistance + 1) - root]) / (2 * 2e-4)
        nearest = (model.poles[:, None] - wanted).abs().amin(0) / wanted.abs()
        assert float(nearest.max()) < 1e-6
    assert model.error < 1e-6
    beyond = torch.tensor([100.0, 10e3]).double()
    torch.testing.assert_close(model.impedance(beyond), resonator(beyond, resistance=resistance), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("liner", ["onera", "lbm_slit"])
@pytest.mark.parametrize(("poles", "error"), [(4, 0.03), (7, 0.015), (8, 0.01)])
def test_a_perforated_liner_is_met_by_a_stable_and_passive_model(liner: str, poles: int, error: float) -> None:
    model = of(liner, poles)
    assert len(model.poles) == len(model.residues) == poles
    assert float(model.poles.real.max()) < 0
    assert excess(model) < 1e-11
    assert model.error < error
    z = tl.load_liner(liner).impedance(FREQUENCY, torch.tensor(3.0).double())
    away = model.reflection(FREQUENCY) - tl.reflection_from_impedance(z)
    assert float(away.abs().max()) == pytest.approx(model.error, rel=1e-6)
    conjugates = (model.poles[:, None] - model.poles.conj()).abs().amin(0)
    assert float((conjugates / model.poles.abs()).max()) < 1e-12


def test_a_wall_that_gives_energy_becomes_passive_and_says_what_that_cost() -> None:
    z = resonator(FREQUENCY, resistance=0.05)
    z[10:14] -= 0.2  # |R| > 1 there
    model = tl.fit_multipole(FREQUENCY, z, 6)
    assert excess(model) < 1e-11
    assert model.correction > 1e-3
    assert model.error > 0.01


@pytest.mark.parametrize("frequency", [700.0, 2100.0])
def test_a_tone_through_the_recursion_meets_r_to_second_order(frequency: float) -> None:
    model, off = of(), []
    for rate in (100e3, 200e3):
        time = torch.arange(int(0.1 * rate)) / rate
        wave = torch.exp(2j * torch.pi * frequency * time.double())
        back = torch.complex(model.reflect(wave.real, rate), model.reflect(wave.imag, rate))
        off.append(abs(complex((back / wave)[-1]) - complex(model.reflection(torch.tensor(frequency)))))
    assert off[1] < 1e-3
    assert off[0] / off[1] == pytest.approx(4, rel=0.05)


def test_a_pulse_through_the_recursion_meets_r_and_gains_no_energy() -> None:
    model, rate = of(), 400e3
    time = (torch.arange(1 << 15) - 400) / rate
    pulse = torch.exp(-((time * 2 * math.pi * 2000) ** 2).double())
    back = model.reflect(torch.stack([pulse, 2 * pulse]), rate)
    torch.testing.assert_close(back[1], 2 * back[0])
    assert float(back[0].square().sum()) < float(pulse.square().sum())
    spectra, lines = torch.fft.rfft(torch.stack([pulse, back[0]])), torch.fft.rfftfreq(len(pulse), 1 / rate).double()
    band = (lines > 500) & (lines < 4000)
    found, wanted = (spectra[1] / spectra[0])[band], model.reflection(lines[band])
    assert float((found - wanted).abs().max()) < 2e-3


def read_back(own: dict[str, Any]) -> Tensor:
    """R or the admittance at ``FREQUENCY`` from coefficient lists, by the formula of the file."""
    s = 2j * torch.pi * FREQUENCY
    found = torch.full_like(s, own["constant"])
    for decay, a in own["real_poles"]:
        found += a / (s + decay)
    for alpha, beta, b, c in own["complex_poles"]:
        found += ((b + 1j * c) / (s + alpha + 1j * beta) + (b - 1j * c) / (s + alpha - 1j * beta)) / 2
    return found


@pytest.mark.parametrize("poles", [7, 8])
def test_coefficient_lists_give_r_and_the_admittance(tmp_path: Path, poles: int) -> None:
    model = of(poles=poles)
    model.write(tmp_path / "liner.json")
    held = json.loads((tmp_path / "liner.json").read_text())
    r = model.reflection(FREQUENCY)
    torch.testing.assert_close(read_back(held["reflection"]), r)
    torch.testing.assert_close(read_back(held["admittance"]), admittance_from_reflection(r))
    assert float(model.admittance()[0].real.max()) < 0
    model.write(tmp_path / "liner.txt")
    words = re.findall(r"    (\w+) (.*);", (tmp_path / "liner.txt").read_text())
    lists = [(key, json.loads(row.translate(str.maketrans("()", "[]")).replace(" ", ", "))) for key, row in words]
    assert lists == [*held["reflection"].items(), *held["admittance"].items()]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poles": 36}, "36 poles .* 36 frequencies"),
        ({"poles": 0}, "0 poles"),
        ({"impedance": resonator(FREQUENCY)[:5]}, r"shape \(5,\)"),
        ({"impedance": torch.where(FREQUENCY == 1000, math.nan, resonator(FREQUENCY))}, "nan, inf or -1 at 1000 Hz"),
        ({"impedance": torch.where(FREQUENCY == 1000, -1, resonator(FREQUENCY))}, "nan, inf or -1 at 1000 Hz"),
    ],
)
def test_what_cannot_be_fitted_is_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"frequency": FREQUENCY, "impedance": resonator(FREQUENCY), "poles": 4} | change
    with pytest.raises(ValueError, match=message):
        tl.fit_multipole(**arguments)
