"""The shipped reference cases: which is nearest to a map, and what is said of it."""

from __future__ import annotations

import pytest
import torch
from conftest import DATA, plane_of

import torchliner as tl
from torchliner.cli.main import main
from torchliner.names import AVERAGINGS
from torchliner.studies.validation import distance_of, factors_of, nearest_case, reference_cases, setting_of
from torchliner.studies.variants import Row

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
HOLE = Row(hole="round hole", hole_diameter=1.2e-3, porosity=0.058, mach=0.0, speed=0.8, velocity_rms=2.6, height=1e-3)


def map_like(**about):
    """A tone of 1.16 m/s peak over the orifice, without turbulence: o145 in its cell's mean."""
    liner = about.pop("liner", tl.load_liner("lbm_orifice").replace(name="mine"))
    t = torch.arange(480, dtype=torch.float64) / 42000.0
    tone = about.pop("speed", 0.82) * 2**0.5 * torch.cos(2 * torch.pi * 1400 * t)
    plane = plane_of(tone.expand(3, -1), **{"height": 5e-4, "mach": 0.0, **about})
    return tl.educe(plane, liner, interval=None)


def test_the_shipped_table_has_every_case_and_averaging():
    """Eleven cases, three heights or four, every averaging; numbers as the page has them."""
    cases = [known.case for known in reference_cases()]
    assert len(set(cases)) == 11
    assert len(cases) == 37
    assert all(tuple(known.educed) == tuple(AVERAGINGS) for known in reference_cases())
    (one,) = [k for k in reference_cases() if k.case == "o145" and k.height == 5e-4]
    assert one.reference == 1.099 - 0.511j
    assert one.educed["velocity"] == pytest.approx(0.528 - 0.396j, abs=2e-3)


@pytest.mark.parametrize(
    ("change", "case"),
    [
        ({"speed": 0.22}, "t00_130"),
        ({"speed": 0.05}, "o115"),
        ({"liner": tl.load_liner("lbm_slit"), "speed": 0.26}, "n130"),
    ],
)
def test_the_nearest_is_by_speed_mach_and_hole(change, case):
    assert f"case, {case} (" in nearest_case(map_like(**change))


@pytest.mark.parametrize("change", [{}, {"speed": 8.0}, {"mach": None}, {"mach": 0.5, "speed": 0.09}])
def test_of_what_is_not_near_nothing_is_said(change):
    assert nearest_case(map_like(**change)) == ""


def test_porosity_counts_as_the_speed_does():
    """Half the open area is twice the velocity in the holes."""
    assert factors_of(HOLE, Row(HOLE, porosity=0.029)) == pytest.approx([0.5, 0.5])
    assert distance_of(HOLE, HOLE) == 0
    assert distance_of(HOLE, Row(HOLE, hole="slit")) == 1
    assert distance_of(HOLE, Row(HOLE, mach=0.3)) == pytest.approx(3)


def test_a_grazing_tone_is_not_averaged_away(liner):
    """Its phase turns along x: the rms over probes stands for it."""
    t = torch.arange(480, dtype=torch.float64) / 42000.0
    turn = torch.linspace(0, 2 * torch.pi, 9)[:8, None]
    v = torch.cos(2 * torch.pi * 1400 * t + turn)
    for side, speed in (("upstream", 0.5**0.5), ("normal", 0.0)):
        found = tl.educe(plane_of(v, source_side=side), liner, interval=None)
        assert setting_of(found).speed == pytest.approx(speed, abs=0.02)


@pytest.mark.parametrize("command", ["educe", "audit"])
def test_commands_print_it(command, capsys):
    assert main([command, str(DATA / "slit_n130_y2.5mm.h5"), "--quiet", "--verbose"]) == 0
    assert "in the nearest reference case, n130 (0.26 m/s at the tone" in capsys.readouterr().out
