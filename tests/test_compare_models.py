"""Models of a liner on one plane: as educed one by one, sorted by what is known, read once."""

from __future__ import annotations

import pytest
import torch
from conftest import DATA

import torchliner as tl

PLANE = DATA / "slit_n130_y0.5mm.h5"
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
NAMES = ("lbm_orifice", "lbm_slit", "goodrich_example")


def presets(names=NAMES):
    """Of one pitch, as the plane names it."""
    return {name: tl.load_liner(name).replace(cell_pitch=12.45e-3) for name in names}


def noisy(**facts):
    """Ten probes in one cell: turbulence and a tone of 1500 Hz."""
    noise = torch.Generator().manual_seed(3)
    t = torch.arange(4200, dtype=torch.float64) / 42e3
    velocity = 0.5 * torch.randn(10, 4200, dtype=torch.float64, generator=noise)
    velocity = velocity + torch.cos(2 * torch.pi * 1500.0 * t)
    x = 1e-3 * torch.arange(10.0, dtype=torch.float64)
    return tl.VelocityPlane(velocity, sampling_rate=42e3, x=x, **{"frequency": 1500.0, "height": 1e-3} | facts)


def test_each_row_is_what_educe_gives():
    """Z, interval, averagings and level check of each model, and the frequency table of all."""
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


def test_the_nearest_to_the_reference_comes_first():
    """By |Z - true| where the plane holds it, which the slit's own model wins on slit data."""
    found = tl.compare_models(tl.read_plane(PLANE), presets())
    assert found.sorted_by == "|Z - true|"
    off = [row.distance["true"] for row in found.rows]
    assert found.rows[0].model == "lbm_slit"
    assert off == sorted(off)
    assert off[0] < 0.01 < 0.05 < off[1]
    for row in found.rows:
        assert row.distance["true"] == abs(row.impedance - found.references["true"])


def test_without_reference_the_level_check_sorts_and_without_a_level_nothing():
    liners = presets()
    known = tl.compare_models(noisy(incident_level=140.0, source_side="normal"), liners)
    assert known.sorted_by == "|level check|"
    off = [abs(row.level_check) for row in known.rows]
    assert off == sorted(off)
    assert off[0] < off[-1]
    found = tl.compare_models(noisy(), liners)
    assert found.sorted_by == "as given"
    assert [row.model for row in found.rows] == list(liners)
    assert found.rows[0].level_check is None
    assert found.rows[0].distance == {}


def test_one_pass_over_the_data_for_all_models():
    """As many samples are read for three models as for one."""
    plane, done = noisy(), []
    tl.educe(plane, presets()["lbm_slit"], progress=done.append)
    alone, done[:] = sum(done), []
    tl.compare_models(plane, presets(), progress=done.append)
    assert sum(done) == alone


def test_moments_serve_as_well(tmp_path):
    """Read from their file, without the plane; with their cells, which models cannot change."""
    plane = noisy()
    tl.moments(plane, cell_pitch=12.45e-3).write(tmp_path / "m.h5")
    known = tl.read_moments(tmp_path / "m.h5")
    liners = presets(("polito", "mesh_example"))
    found, direct = tl.compare_models(known, liners), tl.compare_models(plane, liners)
    for one, other in zip(found.rows, direct.rows, strict=True):
        assert abs(one.impedance - other.impedance) < 1e-5
    with pytest.raises(ValueError, match=r"reduced for cells of 12.45 mm, and the liner.s are of 5 mm"):
        tl.compare_models(known, liners, cell_pitch=5e-3)


@pytest.mark.filterwarnings("always::torchliner.DataWarning")
def test_cells_belong_to_the_data():
    """Those of the preset that the plane names, or of the first model, or as stated; the others are told."""
    liners = {name: tl.load_liner(name) for name in ("onera", "lbm_orifice", "mesh_example")}
    for plane, options, words in (
        (noisy(), {}, r"cells are of 12.44 mm for all models; as files: .*4.428"),
        (noisy(), {"cell_pitch": 3e-3}, r"cells are of 3 mm"),
        (tl.read_plane(PLANE), {}, r"cells are of 12.45 mm"),
    ):
        with pytest.warns(tl.DataWarning, match=words):
            found = tl.compare_models(plane, liners, **options)
        if options:
            alone = tl.educe(noisy(), liners["onera"].replace(**options))
            (mine,) = found.of(model="onera")
            assert mine.impedance == pytest.approx(complex(alone.answer[0]), abs=1e-9)
    assert liners["onera"].cell_pitch == 12.44e-3


@pytest.mark.parametrize("reduced", [False, True])
def test_flow_that_would_count_twice_is_told_with_its_resistance(reduced):
    """By ``educe`` and here; the plane's turbulence is in |v| already."""
    calm = tl.load_liner("goodrich_example")
    plate = calm.layers[0]
    windy = tl.sheet(
        "goodrich",
        **{n: each.value for n, each in plate.numbers().items()} | {"mach": 0.3, "displacement_thickness": 1.7e-3},
    )
    liner = calm.replace(layers=(windy, calm.layers[1]), open_area_fraction=0.5)
    still = calm.replace(open_area_fraction=0.5)
    added = complex(liner.impedance(1500.0, 1.0) - still.impedance(1500.0, 1.0)).real
    assert liner.flow_resistance == pytest.approx(added, rel=0.05)  # and takes some friction away
    plane = noisy()
    given = tl.moments(plane, cell_pitch=liner.cell_pitch) if reduced else plane
    with pytest.warns(tl.DataWarning, match=rf"windy: .* adds {liner.flow_resistance:.3g} rho c .* count twice"):
        tl.compare_models(given, {"calm": calm, "windy": liner})
    assert "flow-counted-twice" in {note.code for note in tl.educe(given, liner).notes}
    assert not [note for note in tl.educe(plane, calm).notes if note.code == "flow-counted-twice"]
