"""Differences of two maps, and models compared on one plane."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from conftest import DATA, plane_of, turbulence

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")

X = [0.0, 0.004, 0.008, 0.02, 0.024, 0.028]


@cache
def made(seed=0, rms=3.0, tones=(1400.0,), count=6, **choices):
    plane = plane_of(turbulence((count, 1200), seed, rms), x=X[:count], title=f"seed {seed}")
    liner = tl.load_liner("polito")
    return tl.educe(plane, liner, list(tones), averaging="admittance", **choices)


def test_the_difference_and_its_interval():
    """Second less first; half-widths add, whatever the two records share."""
    a, b = made(0), made(1)
    found = tl.compare(a, b)
    assert [row.place for row in found.rows] == ["liner", *(f"cell {i}" for i in range(a.cell_x.numel()))]
    row = found.rows[0]
    assert row.difference == complex(b.answer[0] - a.answer[0])
    (a_low, a_high), (b_low, b_high) = (each.bounds_of_liner("admittance") for each in (a, b))
    assert (row.low, row.high) == (b_low - a_high, b_high - a_low)
    back = tl.compare(b, a).rows[0]
    assert (back.difference, back.low, back.high) == (-row.difference, -row.high, -row.low)


def test_what_a_record_does_not_bound_has_no_bounded_difference():
    """inf - inf is no number; the difference is unbounded, and shows nothing."""
    first, second = made(0), made(1)
    known = first.liner["admittance"]
    endless = torch.full_like(known.low, complex(torch.inf, torch.inf))
    open_ended = replace(known, interval=replace(known.interval, low=-endless, high=endless))
    first = replace(first, liner={**first.liner, "admittance": open_ended})
    for found in (tl.compare(first, second), tl.compare(second, first)):
        row = found.rows[0]
        assert (row.low.real, row.low.imag) == (-torch.inf, -torch.inf)
        assert (row.high.real, row.high.imag) == (torch.inf, torch.inf)
        assert row.differs_in == ""
        assert found.rows[1].low.real > -torch.inf


def test_louder_turbulence_differs_clearly_and_the_same_flow_does_not():
    assert "R" in tl.compare(made(0), made(1, rms=6.0)).rows[0].differs_in
    assert tl.compare(made(0), made(1)).rows[0].differs_in == ""


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"tones": (1000.0,)}, r"other frequencies: \[1400.0\] Hz and \[1000.0\] Hz"),
        ({"count": 3}, r"other cells \(2 and 1\)"),
        ({"interval": 0.9}, r"intervals of 0.95 and 0.9"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_remedy(other, message):
    with pytest.raises(ValueError, match=message):
        tl.compare(made(0), made(0, **other))


def test_averagings_must_be_held_by_both():
    other = replace(made(1), averaging="velocity")
    assert [tl.compare(made(0), other, each).averaging for each in (None, "velocity")] == ["admittance", "velocity"]
    with pytest.raises(ValueError, match="averaging 'phase-locked'"):
        tl.compare(made(0), made(1), "phase-locked")
    moved = replace(made(0), cell_x=made(0).cell_x + 1e-3)
    with pytest.raises(ValueError, match="other cells"):
        tl.compare(made(0), moved)


PLANE = DATA / "slit_n130_y0.5mm.h5"
NAMES = ("lbm_orifice", "lbm_slit", "goodrich_example")


def presets(names=NAMES):
    return {name: tl.load_liner(name).replace(cell_pitch=12.45e-3) for name in names}


def noisy(**facts):
    noise = torch.Generator().manual_seed(3)
    t = torch.arange(4200, dtype=torch.float64) / 42e3
    velocity = 0.5 * torch.randn(10, 4200, dtype=torch.float64, generator=noise)
    velocity = velocity + torch.cos(2 * torch.pi * 1500.0 * t)
    x = 1e-3 * torch.arange(10.0, dtype=torch.float64)
    return tl.VelocityPlane(velocity, sampling_rate=42e3, x=x, **{"frequency": 1500.0, "height": 1e-3} | facts)


def test_each_row_is_what_educe_gives():
    plane, liners = tl.read_plane(PLANE), presets()
    found = tl.compare_models(plane, liners, [1000.0, 1400.0], dtype="float64")
    assert len(found.rows) == 6
    for name, liner in liners.items():
        alone = tl.educe(plane, liner, [1000.0, 1400.0], dtype="float64")
        for i, row in enumerate(row for row in found.rows if row.model == name):
            assert row.frequency == (1000.0, 1400.0)[i]
            assert abs(row.impedance - complex(alone.answer[i])) < 1e-7
            low, high = alone.bounds_of_liner(alone.averaging, i)
            assert max(abs(row.low - low), abs(row.high - high)) < 1e-6
            assert row.model_error <= 1e-9
        check = alone.level_check
        wanted = float(check.liner.level[check.averagings.index(alone.averaging), 1])
        assert row.level_check == pytest.approx(wanted, abs=1e-5)


def test_distances_are_to_the_reference():
    found = tl.compare_models(tl.read_plane(PLANE), presets())
    off = {row.model: row.distance["true"] for row in found.rows}
    assert off.pop("lbm_slit") < 0.01 < 0.05 < min(off.values())
    for row in found.rows:
        assert row.distance["true"] == abs(row.impedance - found.references["true"])


def test_without_reference_and_level_there_is_no_distance():
    liners = presets()
    found = tl.compare_models(noisy(), liners)
    assert [row.model for row in found.rows] == list(liners)
    assert found.rows[0].level_check is None
    assert found.rows[0].distance == {}


def test_one_pass_over_the_data_for_all_models():
    plane, done = noisy(), []
    tl.educe(plane, presets()["lbm_slit"], progress=done.append)
    alone, done[:] = sum(done), []
    tl.compare_models(plane, presets(), progress=done.append)
    assert sum(done) == alone


def test_moments_serve_as_well(tmp_path):
    plane = noisy()
    tl.moments(plane, cell_pitch=12.45e-3).write(tmp_path / "m.h5")
    known = tl.read_moments(tmp_path / "m.h5")
    liners = presets(("polito", "mesh_example"))
    found, direct = tl.compare_models(known, liners), tl.compare_models(plane, liners)
    for one, other in zip(found.rows, direct.rows, strict=True):
        assert abs(one.impedance - other.impedance) < 1e-5


@pytest.mark.filterwarnings("always::torchliner.DataWarning")
def test_cells_are_one_for_all_models():
    liners = {name: tl.load_liner(name) for name in ("onera", "lbm_orifice", "mesh_example")}
    for plane, words in ((noisy(), r"cells are of 12.44 mm"), (tl.read_plane(PLANE), r"cells are of 12.45 mm")):
        with pytest.warns(tl.DataWarning, match=words):
            (mine,) = tl.compare_models(plane, liners).of(model="lbm_orifice")
        pitch = 12.44e-3 if plane.liner is None else 12.45e-3
        alone = tl.educe(plane, liners["lbm_orifice"].replace(cell_pitch=pitch))
        assert mine.impedance == pytest.approx(complex(alone.answer[0]), abs=1e-6)
    assert liners["lbm_orifice"].cell_pitch == 4.428e-3


@pytest.mark.parametrize("reduced", [False, True])
def test_flow_that_would_count_twice_is_told_with_its_resistance(reduced):
    """By ``educe`` and here; the plane's turbulence is in |v| already."""
    calm = tl.load_liner("goodrich_example")
    plate = calm.layers[0]
    windy = plate.replace(mach=0.3, displacement_thickness=1.7e-3)
    liner = calm.replace(layers=(windy, calm.layers[1]), open_area_fraction=0.5)
    still = calm.replace(open_area_fraction=0.5)
    added = complex(liner.impedance(1500.0, 1.0) - still.impedance(1500.0, 1.0)).real
    assert liner.flow_resistance == pytest.approx(added, rel=0.05)  # and takes some friction away
    plane = noisy()
    given = tl.moments(plane, cell_pitch=liner.cell_pitch) if reduced else plane
    with pytest.warns(tl.DataWarning, match=rf"windy: .* adds {liner.flow_resistance:.3g} rho c .* set its mach to 0"):
        tl.compare_models(given, {"calm": calm, "windy": liner})
    assert "flow-counted-twice" in {note.code for note in tl.educe(given, liner).notes}
    assert not [note for note in tl.educe(plane, calm).notes if note.code == "flow-counted-twice"]
