"""The liner model: tables of 40 digits, limits, passivity, gradients."""

from __future__ import annotations

import json

import mpmath
import numpy as np
import pytest
import torch
from conftest import SHARED

import torchliner as tl
from torchliner.liners.plates import goodrich_resistance, ratio_i2_i0

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
    """(2.2) and (2.4) against 40-digit tables: 1e-12."""
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
    shifts = [
        goodrich_resistance(0.3, 0.0395, d, 0.991e-3) - goodrich_resistance(0.1, 0.0395, d, 0.991e-3)
        for d in (1.7e-3, 2.3e-3)
    ]
    assert shifts == pytest.approx([1.22, 1.03], abs=0.01)


def test_a_plate_that_would_feed_sound_is_refused(liner):
    """Thin and more than 77 % open: eq. (2.2b) makes mass and resistance negative."""
    assert float(liner.replace(facesheet_thickness=1e-4, porosity=0.75).impedance(1400.0).real) > 0
    with pytest.raises(ValueError, match=r"end corrections are -\S+ m together at porosity 1"):
        liner.replace(facesheet_thickness=1e-4, porosity=1.0)


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


def test_bad_arguments():
    for frequency, speed, message in ((0.0, 1.0, "frequency.*is 0"), (1400.0, -1.0, "not negative")):
        with pytest.raises(ValueError, match=message):
            tl.load_liner("polito").impedance(frequency, speed)
    for numbers, message in (
        ((0.3, 0.05, 2e-3, 0), "diameter is 0 m; it is above 0 m"),
        ((0.3, 5.0, 2e-3, 1e-3), "flow_facing_porosity is 5; .* at most 1"),
        ((torch.tensor([0.3, 30.0]), 0.05, 2e-3, 1e-3), "bulk_mach is 30"),
    ):
        with pytest.raises(ValueError, match=f"goodrich_resistance: {message}"):
            goodrich_resistance(*numbers)
