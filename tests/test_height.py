"""Z against height, and the recommendation."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.studies.heights import study_heights

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
PITCH, SPACING = 12.44e-3, 1e-3


def line_plane(velocity: torch.Tensor, height: float = 1e-3, **about):
    about.setdefault("x", SPACING * (0.5 + np.arange(velocity.shape[-2])))
    if velocity.ndim == 3:
        about.setdefault("z", 2e-3 * np.arange(velocity.shape[0]))
    return plane_of(velocity, height=height, **about)


def test_a_row_is_the_eduction_of_its_plane(liner):
    planes = [line_plane(turbulence((2, 26, 480), seed=i, rms=1.0 + i), 1e-3 * (1 + i)) for i in (1, 0)]
    for options in ({}, {"wall_filter": 0.3}, {"background": 0.5}):
        found = study_heights(planes, liner, **options)
        for row, plane in zip(found.rows, planes[::-1], strict=True):
            wanted = tl.educe(plane, liner, interval=None, **options).liner
            assert row.impedance == {name: complex(each.impedance[0]) for name, each in wanted.items()}
    mixed = study_heights([planes[0], tl.moments(planes[1], liner)], liner)
    for mine, wanted in zip(mixed.rows, study_heights(planes, liner).rows, strict=True):
        assert mine.impedance == {name: pytest.approx(z, rel=1e-6) for name, z in wanted.impedance.items()}


def evanescent_planes(heights, decay=PITCH / (2 * math.pi)):
    """A plane wave over four cells plus their first harmonic, which dies off with height."""
    x = SPACING * (0.5 + np.arange(50))
    tone = torch.cos(2 * math.pi * FREQUENCY * torch.arange(480, dtype=torch.float64) / RATE)
    shape = torch.as_tensor(np.cos(2 * math.pi * x / PITCH))
    return [line_plane((1 + 0.9 * math.exp(-y / decay) * shape)[:, None] * tone, y, x=x) for y in heights]


def test_a_sound_field_qualifies_where_its_modulation_has_died(liner):
    """The cell's mean holds at once, whatever the modulation; averaging admittance where it agrees with velocity; the
    highest plane never, since whether Z has settled there cannot be known."""
    heights = [1e-3, 3e-3, 6e-3, 9e-3]
    study = study_heights(evanescent_planes(heights), liner)
    apart = {j.height: j.value for j in study.judged if j.name == "averagings"}
    assert apart[1e-3] > 0.02 > apart[6e-3]
    assert study.heights["velocity"] == 1e-3
    settled = {j.height for j in study.judged if j.averaging == "admittance" and j.name == "change" and j.passed}
    assert study.heights["admittance"] == next(y for y in heights if apart[y] <= 0.1 and y in settled)
    low, above = (row.impedance["admittance"] for row in study.rows[:2])
    (moved,) = (j for j in study.judged if (j.height, j.averaging, j.name) == (1e-3, "admittance", "change"))
    assert moved.value == pytest.approx(abs(above - low) / abs(low))
    last = [j for j in study.judged if j.height == 9e-3 and j.name == "change"]
    assert {(one.value, one.passed) for one in last} == {(None, False)}


def test_the_drift_is_that_of_grazing_sound(liner):
    (plane,) = evanescent_planes([2e-3])
    for side, drift in (("upstream", pytest.approx(0.05 + 0.06j)), ("normal", None), ("unknown", None)):
        (facts,) = study_heights([replace(plane, source_side=side)], liner).rows
        assert facts.drift == drift


def shipped(case: str):
    planes = [tl.read_plane(path, lazy=True) for path in sorted(DATA.glob(f"{case}_y*.h5"))]
    return planes, tl.load_liner(planes[0].liner)


def test_with_flow_the_level_check_chooses_and_no_reference_does():
    """g01 qualifies for admittance at 2.5 mm alone, by -0.25 dB; g03 at 0.5 mm, unless turbulence is averaged out."""
    for case, height, admittance in (("slit_g01_145", None, 2.5e-3), ("slit_g03_145", 0.5e-3, 0.5e-3)):
        planes, model = shipped(case)
        blind = [replace(plane, reference={"true": 9 + 9j}) for plane in planes]
        found = study_heights(blind, model)
        assert found.heights == {"admittance": admittance, "velocity": None, "phase-locked": height}
        assert found.height == height


@pytest.mark.parametrize("case", ["slit_n115", "slit_n130", "orifice_o115"])
def test_without_flow_the_cells_mean_holds_at_every_height(case):
    """Modulations of 4 to 178 %: Z of velocity moves by 0.2 % at most over all heights."""
    study = study_heights(*shipped(case))
    assert study.heights["velocity"] == 0.5e-3
    values = [row.impedance["velocity"] for row in study.rows]
    assert max(abs(z / values[0] - 1) for z in values) < 2e-3


V = turbulence((8, 480), seed=1)
LOW = line_plane(V, 1e-3, mach=0.1)


@pytest.mark.parametrize(
    ("given", "options", "message"),
    [
        ([line_plane(V, height=None)], {}, "states no height"),
        ([], {}, "no plane is given"),
        ([LOW, line_plane(V, 2e-3, mach=0.3)], {}, r"mach is 0\.1 and 0\.3"),
        ([LOW, line_plane(V, 2e-3, mach=0.1, provenance={"case": "b"})], {}, "case is None"),
        ([LOW, line_plane(V, 2e-3, mach=0.1, frequency=1000.0)], {}, "different frequencies"),
        ([LOW, line_plane(V, 1e-3, mach=0.1)], {}, "both at 1 mm"),
        ([LOW], {"frequency": [1000.0, 1400.0]}, "one frequency; 2 are given"),
    ],
)
def test_bad_input_is_refused(liner, given, options, message):
    with pytest.raises(ValueError, match=message):
        study_heights(given, liner, **options)
