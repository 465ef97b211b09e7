"""Z against height and averaging length, the cells' imprint, the recommendation, the command."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence
from test_audit import Counted

import torchliner as tl
from torchliner.cli.main import BAD_INPUT, DONE, main
from torchliner.records.boxes import grid_of, windows_of
from torchliner.studies.heights import recommend_height, study_heights
from torchliner.studies.jets import jet_velocity
from torchliner.studies.modulation import cell_modulation, fit_decay
from torchliner.studies.rows import Row, Study

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
PITCH, SPACING = 12.44e-3, 1e-3
WHOLE = {"interval": None}  # no error bars


def line_plane(velocity: torch.Tensor, height: float = 1e-3, **about):
    """A line of probes 1 mm apart, or a (z, x) plane 2 mm apart along z."""
    about.setdefault("x", SPACING * (0.5 + np.arange(velocity.shape[-2])))
    if velocity.ndim == 3:
        about.setdefault("z", 2e-3 * np.arange(velocity.shape[0]))
    return plane_of(velocity, height=height, **about)


@pytest.fixture(scope="module")
def planes():
    return [line_plane(turbulence((2, 26, 480), seed=i, rms=1.0 + i), 1e-3 * (1 + i)) for i in (1, 0)]


@pytest.fixture(scope="module")
def study(planes, liner):
    return study_heights(planes, liner, **WHOLE)


def test_one_spacing_has_no_averaging(study, liner, planes):
    """Windows of one probe: both are the map's own average over probes."""
    for row, plane in zip(study.of(length=study.lengths[0]), planes[::-1], strict=True):
        assert (row.probes, row.windows) == (1, 52)
        assert row.admittance == pytest.approx(row.velocity, rel=1e-12)
        found = tl.educe(plane, liner, **WHOLE)
        assert row.admittance == pytest.approx(complex(found.liner["admittance"].impedance[0]), rel=1e-9)


def test_the_whole_plane_is_one_window(study, liner, planes):
    """Admittance over all probes; R of the plane's mean velocity."""
    for row, plane in zip(study.of(length=study.lengths[-1]), planes[::-1], strict=True):
        whole = tl.educe(plane, liner, **WHOLE).liner["admittance"].impedance
        mean = tl.educe(plane_of(plane.velocity.reshape(-1, 480).mean(0)), liner, **WHOLE).impedance
        assert (row.probes, row.windows) == (52, 1)
        assert math.isnan(row.velocity_spread.real)
        assert row.velocity == pytest.approx(complex(mean[0]), rel=1e-9)
        assert row.admittance == pytest.approx(complex(whole[0]), rel=1e-9)


@pytest.mark.parametrize(
    "choices", [{"drive": "rms"}, {"drive": "running-rms"}, {"mean": "removed"}, {"phase": "self-consistent"}]
)
def test_windows_follow_every_choice(planes, liner, choices):
    """As of planes that hold the averaged velocities."""
    (row,) = study_heights(planes[:1], liner, lengths=[5e-3], **choices).rows
    grid = grid_of(planes[0])
    windows = windows_of(grid, 5e-3, torch.ones(grid.rows, grid.columns, dtype=torch.bool))
    averaged = plane_of(windows.mean(planes[0].velocity.reshape(52, 480).T).T)
    alone = tl.educe(averaged, liner, averaging="admittance", **WHOLE, **choices)
    assert row.velocity == pytest.approx(complex(alone.answer[0]), rel=1e-9)


def test_identical_probes_give_the_same_at_every_length(liner):
    """A velocity without any variation along x and z: no averaging, no length, no spread."""
    velocity = turbulence((480,), seed=3).expand(2, 26, 480)
    wanted = complex(tl.educe(plane_of(velocity[0, 0]), liner).impedance[0])
    for row in study_heights([line_plane(velocity)], liner).rows:
        assert row.velocity == pytest.approx(wanted, rel=1e-9)
        assert row.admittance == pytest.approx(wanted, rel=1e-9)
        if row.windows > 1:
            assert abs(row.velocity_spread) < 1e-9


def test_each_plane_is_read_three_times(planes, liner):
    """Twice for its map, once for the windows of every length."""
    stored = [Counted(plane.velocity) for plane in planes]
    given = [replace(p, velocity=each) for p, each in zip(planes, stored, strict=True)]
    study_heights(given, liner, **WHOLE)
    assert [each.passes for each in stored] == [3, 3]


def test_windows_equal_the_plain_loop():
    """Running boxes, wholly inside, over used probes only."""
    velocity = turbulence((4, 9, 50), seed=5)
    plane = line_plane(velocity, z=1e-3 * np.arange(4))
    used = torch.ones(4, 9, dtype=torch.bool)
    used[1, 2] = False
    windows = windows_of(grid_of(plane), 3e-3, used)
    found = windows.mean(velocity.reshape(36, 50).T).T
    assert found.shape == (2 * 7, 50)
    index = 0
    for z in range(2):
        for x in range(7):
            box = velocity[z : z + 3, x : x + 3][used[z : z + 3, x : x + 3]]
            assert found[index].numpy() == pytest.approx(box.mean(0).numpy(), abs=1e-12)
            index += 1


def test_planes_in_files_give_the_same(planes, study, liner, tmp_path):
    """Read by slabs from a file: the numbers of the plane in memory."""
    stored = []
    for i, plane in enumerate(planes):
        plane.write(tmp_path / f"{i}.h5")
        stored.append(tl.read_plane(tmp_path / f"{i}.h5", lazy=True))
    again = study_heights(stored, liner, dtype="float64", **WHOLE)
    for mine, theirs in zip(again.rows, study.rows, strict=True):
        assert mine.velocity == pytest.approx(theirs.velocity, rel=1e-6)


def test_left_out_probes_leave_no_trace(liner):
    """nan at one probe: windows are averages over the others."""
    velocity = turbulence((20, 480), seed=2)
    velocity[4, 7] = torch.nan
    rows = study_heights([line_plane(velocity)], liner, missing="exclude", **WHOLE).rows
    kept = [i for i in range(20) if i != 4]
    wanted = complex(tl.educe(plane_of(velocity[kept].mean(0)), liner, **WHOLE).impedance[0])
    assert rows[-1].velocity == pytest.approx(wanted, rel=1e-9)
    assert rows[0].windows == 20


def test_a_wall_filter_acts_on_the_averages_over_probes_alone(liner, planes, study):
    """Averaging velocity is as without it."""
    found = study_heights(planes, liner, wall_filter=1.0, **WHOLE)
    for mine, plain in zip(found.rows, study.rows, strict=True):
        assert mine.velocity == plain.velocity
        assert mine.admittance.real == math.inf


@pytest.mark.parametrize(("count", "spacing"), [(48, PITCH / 12), (30, 1e-3), (12, PITCH / 12)])
def test_imprint_finds_harmonics_on_any_grid(count, spacing):
    """Amplitudes 0.5 and 0.2 on a mean of 2, growing along x where cells repeat."""
    x = 0.3e-3 + spacing * np.arange(count)
    turn = 2 * np.pi * x / PITCH
    growth = 3.0 * x if count > 12 else 0.0
    profile = 2.0 + 0.5 * np.cos(turn - 1) + 0.2 * np.sin(3 * turn) + growth
    found = cell_modulation(x, profile, PITCH)
    assert found.cells == int(count * spacing / PITCH + 0.01)
    assert found.harmonics[0] == pytest.approx(0.5, abs=1e-10)
    assert found.harmonics[1:3] == pytest.approx((0.0, 0.2), abs=1e-10)
    assert found.rms == pytest.approx(math.sqrt((0.25 + 0.04) / 2), abs=1e-10)
    assert found.between is None if found.cells == 1 else found.between < 1e-10


def test_imprint_is_the_fourier_sum_on_whole_cells():
    """An independent transform, 24 probes to each of three cells."""
    profile = np.tile(np.random.default_rng(1).random(24), 3) + 1
    lines = np.abs(np.fft.rfft(profile)) / 36
    found = cell_modulation(PITCH / 24 * np.arange(72), profile, PITCH)
    # The random cell has more harmonics than are fitted; they do not leak but for the growth.
    assert found.harmonics == pytest.approx(lines[3:25:3], abs=0.02)
    assert found.cells == 3


def test_what_is_not_periodic_lies_between():
    """A wave of 2.5 to a cell shows in ``between`` and not in the imprint."""
    x = 1e-3 * np.arange(50)
    found = cell_modulation(x, 1 + 0.3 * np.cos(5 * np.pi * x / PITCH), PITCH)
    assert found.over_mean(found.rms) < 1e-10
    assert found.between == pytest.approx(0.3 / math.sqrt(2), abs=1e-10)


def test_imprint_refuses():
    with pytest.raises(ValueError, match=r"span 10 mm, less than one cell of 12\.44 mm"):
        cell_modulation(1e-3 * np.arange(10), np.ones(10), PITCH)
    with pytest.raises(ValueError, match="do not resolve it; at least 4"):
        cell_modulation(5e-3 * np.arange(10), np.ones(10), PITCH)


def test_decay_returns_its_own_law():
    """a exp(-y/l) exactly; beside it L_c/(2 pi); growth and scatter are no decay."""
    heights = [0.5e-3, 1e-3, 2.5e-3]
    law = fit_decay(heights, [0.8 * math.exp(-y / 1.7e-3) for y in heights])
    assert law.length == pytest.approx(1.7e-3)
    assert law.amplitude == pytest.approx(0.8)
    assert law.scatter == pytest.approx(1.0)
    assert law.follows
    assert fit_decay(heights[:2], [0.2, 0.1]) is None
    assert not fit_decay(heights, [0.1, 0.2, 0.3]).follows
    assert not fit_decay(heights, [0.4, 0.1, 0.3]).follows


def evanescent_planes(heights, decay=PITCH / (2 * math.pi), wave=1.0):
    """A plane wave over four cells plus their first harmonic, which dies off with height."""
    x = SPACING * (0.5 + np.arange(50))
    time = torch.arange(480, dtype=torch.float64) / RATE
    tone = torch.cos(2 * math.pi * FREQUENCY * time)
    shape = torch.as_tensor(np.cos(2 * math.pi * x / PITCH))
    return [line_plane(wave * (1 + 0.9 * math.exp(-y / decay) * shape)[:, None] * tone, y, x=x) for y in heights]


def test_a_sound_field_qualifies_where_its_imprint_has_died(liner):
    """Laws: the harmonic's decay is found. The cell's mean stands at once, whatever the imprint;
    averaging admittance where it agrees with velocity."""
    heights = [1e-3, 3e-3, 6e-3, 9e-3]
    study = study_heights(evanescent_planes(heights), liner, lengths=[PITCH], **WHOLE)
    assert study.decay.length == pytest.approx(PITCH / (2 * math.pi), rel=1e-3)
    found = recommend_height(study)
    apart = {j.height: j.value for j in found.rows if j.name == "averagings"}
    assert apart[1e-3] > 0.02 > apart[6e-3]
    assert study.facts[0].modulation > 0.1  # which refuses nothing
    assert found.heights["velocity"] == 1e-3
    strict = recommend_height(study, averagings=0.02, change=0.02)
    wanted = next(y for y in heights if apart[y] < 0.02)
    assert strict.heights == strict.heights | {"admittance": wanted, "velocity": 1e-3}


@pytest.mark.parametrize("side", ["upstream", "normal", "unknown"])
def test_the_drift_is_that_of_grazing_sound(liner, side):
    (plane,) = evanescent_planes([2e-3])
    (facts,) = study_heights([replace(plane, source_side=side)], liner, lengths=[PITCH], **WHOLE).facts
    assert facts.drift == (pytest.approx(0.05 + 0.06j) if side == "upstream" else None)


def test_turbulence_averages_out_of_the_cell(liner):
    """Averaging velocity does not hold in turbulence, though its Z may have settled."""
    planes = [line_plane(turbulence((26, 480), seed=i), 1e-3 * (1 + i)) for i in (0, 1)]
    found = recommend_height(study_heights(planes, liner, lengths=[PITCH], **WHOLE), 9, 9, 9)
    assert found.heights["velocity"] is None
    assert found.heights["admittance"] == 1e-3
    (one,) = [j for j in found.rows if (j.height, j.name) == (1e-3, "turbulence")]
    assert (one.averaging, one.passed) == ("velocity", False)
    assert one.value > 0.5


def test_the_level_check_decides_alone(liner):
    """Where the level is known nothing else is asked, and the highest plane may stand."""
    study = study_heights(evanescent_planes([1e-3, 3e-3]), liner, lengths=[PITCH], **WHOLE)
    gaps = ({"admittance": -0.9, "velocity": 0.31, "phase-locked": 0.4}, {"admittance": 0.2,
            "velocity": -0.1, "phase-locked": 0.3})  # fmt: skip
    facts = tuple(
        Row(one, impedance=dict.fromkeys(gap, 1 + 0j), level_check=gap, level_limit=0.3)
        for one, gap in zip(study.facts, gaps, strict=True)
    )
    found = recommend_height(Study(study, facts=facts))
    assert found.heights == {"admittance": 3e-3, "velocity": 3e-3, "phase-locked": 3e-3}
    assert {j.name for j in found.rows} == {"level check"}
    assert found.rows[0] == {"height": 1e-3, "averaging": "admittance", "name": "level check", "value": 0.9,
                             "limit": 0.3, "passed": False}  # fmt: skip


def test_the_top_height_is_never_chosen(liner):
    """Whether Z has settled there cannot be known."""
    study = study_heights(evanescent_planes([3e-3, 9e-3]), liner, lengths=[PITCH], **WHOLE)
    found = recommend_height(study, change=1e-9)
    assert set(found.heights.values()) == {None}
    last = [j for j in found.rows if j.height == 9e-3 and j.name == "change"]
    assert {(one.value, one.passed) for one in last} == {(None, False)}


def test_no_reference_is_used(liner):
    """Another reference, the same answer."""
    planes = evanescent_planes([1e-3, 6e-3, 9e-3])
    other = [tl.VelocityPlane(**{**vars(p), "reference": {"true": 9 + 9j}}) for p in planes]
    mine = recommend_height(study_heights(planes, liner, lengths=[PITCH], **WHOLE))
    theirs = recommend_height(study_heights(other, liner, lengths=[PITCH], **WHOLE))
    assert (mine.heights, mine.rows) == (theirs.heights, theirs.rows)


def shipped(case: str):
    planes = [tl.read_plane(path, lazy=True) for path in sorted(DATA.glob(f"{case}_y*.h5"))]
    return planes, tl.load_liner(planes[0].liner)


@pytest.mark.parametrize(
    ("case", "height", "admittance"),
    [("slit_g01_145", None, 2.5e-3), ("slit_g03_145", 0.5e-3, 0.5e-3)],
)
def test_with_flow_the_level_check_chooses(case, height, admittance):
    """g01 stands nowhere, but for admittance at 2.5 mm, by -0.25 dB; g03 at 0.5 mm, where R is
    right, unless turbulence is averaged out."""
    study = study_heights(*shipped(case), lengths=[12.44e-3])
    found = recommend_height(study)
    assert found.heights == {
        "admittance": admittance, "velocity": None, "phase-locked": height,
    }  # fmt: skip
    assert found.height == height
    assert all(0 < facts.jet_height < 1.2e-3 for facts in study.facts)


def test_jets_are_of_the_impedance_that_the_answer_gives():
    """Averaging admittance has |Z| = 0.47 in n145 at 0.5 mm, and U_j would be 33 m/s; true: 0.82, 19."""
    plane = tl.read_plane(DATA / "slit_n145_y0.5mm.h5")
    liner = tl.load_liner(plane.liner)
    for averaging in ("admittance", "phase-locked"):
        (facts,) = study_heights([plane], liner, lengths=[liner.cell_pitch], averaging=averaging).facts
        expected = jet_velocity(
            plane.incident_level, float(liner.surface_porosity), facts.impedance[averaging], plane.fluid
        )
        assert facts.jet_velocity == pytest.approx(expected, rel=1e-12)
    assert facts.jet_velocity == pytest.approx(19.0, abs=0.1)


@pytest.mark.parametrize("case", ["slit_n115", "slit_n130", "orifice_o115"])
def test_without_flow_the_cells_mean_stands_at_every_height(case):
    """Imprints of 4 to 178 %: Z of velocity moves by 0.2 % at most over all heights."""
    planes, liner = shipped(case)
    study = study_heights(planes, liner, lengths=[liner.cell_pitch])
    assert recommend_height(study).heights["velocity"] == 0.5e-3
    values = [facts.impedance["velocity"] for facts in study.facts]
    assert max(abs(z / values[0] - 1) for z in values) < 2e-3


def test_n115_is_an_evanescent_sound_field():
    """At 115 dB the first harmonic decays over 1.977 mm; L_c/(2 pi) is 1.981 mm."""
    study = study_heights(*shipped("slit_n115"), lengths=[12.44e-3])
    assert 1e3 * study.first_decay.length == pytest.approx(1.977, abs=2e-3)
    assert 1e3 * study.pitch / (2 * math.pi) == pytest.approx(1.981, abs=1e-3)
    assert any("a single cell" in note for note in study.notes)


def test_bad_planes_are_refused(liner):
    v = turbulence((8, 480), seed=1)
    for about, message in (
        ({"height": None}, "states no height; set 'height'"),
        ({"x": None}, "states no x; averaging lengths need the probes' places"),
        ({"x": np.arange(8.0) ** 2}, "windows need probes in even, rising steps"),
        ({"z": np.arange(8.0)}, "scattered probes"),
    ):
        with pytest.raises(ValueError, match=message):
            study_heights([line_plane(v, **about)], liner)
    with pytest.raises(ValueError, match="no plane is given"):
        study_heights([], liner)
    with pytest.raises(ValueError, match="1 probe along x; averaging lengths need several"):
        study_heights([line_plane(v[:1], x=[0.0])], liner)


def test_planes_of_several_cases_are_refused(liner):
    v = turbulence((8, 480), seed=1)
    low = line_plane(v, 1e-3, mach=0.1)
    for high, message in (
        (line_plane(v, 2e-3, mach=0.3), r"not one case: mach is 0\.1 and 0\.3"),
        (line_plane(v, 2e-3, mach=0.1, liner="onera"), "not one case: liner is '' and 'onera'"),
        (line_plane(v, 2e-3, mach=0.1, provenance={"case": "b"}), "not one case: case is None"),
        (line_plane(v, 2e-3, mach=0.1, frequency=1000.0), "different frequencies"),
        (line_plane(v, 1e-3, mach=0.1), "are both at 1 mm; give one plane a height"),
    ):
        with pytest.raises(ValueError, match=message):
            study_heights([low, high], liner)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lengths": [0.5e-3]}, r"length 0\.5 mm is below the spacing of the probes, 1 mm"),
        ({"lengths": [9e-3]}, r"length 9 mm is above the plane's length, 8 mm"),
        ({"lengths": [-1.0]}, "averaging length"),
        ({"frequency": [1000.0, 1400.0]}, "at one frequency; 2 are given"),
        ({"cell_pitch": 0.0}, "cell_pitch"),
    ],
)
def test_bad_options_are_refused(liner, options, message):
    with pytest.raises(ValueError, match=message):
        study_heights([line_plane(turbulence((8, 480), seed=1))], liner, **options)


def test_one_plane_without_a_cell_says_what_cannot_be_judged():
    """A user's liner without a pitch, one height: an answer, with its gaps named."""

    class Plain:
        def impedance(self, frequency, speed=0.0):
            return tl.load_liner("polito").impedance(frequency, speed)

    study = study_heights([line_plane(turbulence((8, 480), seed=1))], Plain())
    found = recommend_height(study)
    assert found.height is None
    assert {(row.name, row.value) for row in found.rows if row.averaging == "phase-locked"} == {("change", None)}
    text = " ".join(study.notes)
    assert "no cell pitch is known" in text
    assert "no jet height" in text


def run(capsys, *words: str) -> tuple[int, str, str]:
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


G03 = [str(DATA / f"slit_g03_145_y{y}mm.h5") for y in ("0.5", "1.5", "2.5")]
SHORT = ("--lengths", "6", "12.44", "--quiet")


def test_command_prints_writes_and_draws(capsys, tmp_path):
    """Table, facts, answer; CSV of the rows; figures with their numbers."""
    code, out, _ = run(capsys, "height", *G03, *SHORT, "-o", str(tmp_path / "rows.csv"), "--figure", str(tmp_path))
    assert code == DONE
    for text in ("no height of these qualifies", "length mm", "H_j mm", "true: 1.662-0.460j", "sound:"):
        assert text in out
    rows = list(csv.DictReader((tmp_path / "rows.csv").read_text().splitlines()))
    assert [row["length"] for row in rows[:2]] == ["0.006", "0.01244"]
    assert float(rows[-1]["velocity_resistance"]) == pytest.approx(2.33, abs=0.02)
    made = {path.name for path in tmp_path.iterdir()}
    assert {"heights.png", "modulation.png", "facts.csv"} <= made


def test_command_json(capsys):
    """JSON alone, with judgements; unknown values are null."""
    code, out, _ = run(capsys, "height", G03[0], *SHORT, "--json", "--limits", "0.5", "2", "1")
    found = json.loads(out)
    assert code == DONE
    assert found["recommended"]["height"] == 0.5e-3
    assert set(found["recommended"]["heights"]) >= {"admittance", "velocity"}
    checks = {one["averaging"]: one["passed"] for one in found["recommended"]["rows"]}
    assert checks == {"admittance": True, "velocity": False, "phase-locked": True}
    assert found["decay_length"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([G03[0], str(DATA / "slit_g01_145_y1.0mm.h5")], "not one case"),
        ([G03[0], str(DATA / "orifice_o145_y1.0mm.h5")], "different liners, lbm_orifice, lbm_slit"),
        ([G03[0], "-o", G03[0]], "is an input; name another file"),
        ([G03[0], "--lengths", "0.01"], "below the spacing of the probes"),
        ([G03[0], "--limits", "0", "1", "1"], "limit on modulation is 0"),
        ([G03[0], "--shear", "0.01"], "shear is 0.01, below 0.03"),
        ([str(DATA / "channel_y1.04mm.h5")], "names 'hard wall'"),
        ([str(DATA / "channel_y1.04mm.h5"), "--liner", "polito"], "states no frequency"),
    ],
)
def test_command_refuses(capsys, words, message):
    code, out, err = run(capsys, "height", *words, "--quiet")
    assert (code, out) == (BAD_INPUT, "")
    assert message in err


def test_moments_stand_for_planes(planes, study, liner):
    """From moments every number of the planes but velocity over more than one probe."""
    known = [tl.moments(plane, liner) for plane in planes]
    with pytest.warns(tl.DataWarning, match="velocity is known of its cells alone"):
        found = study_heights(known, liner, **WHOLE)
    assert found.lengths == study.lengths
    for mine, wanted in zip(found.rows, study.rows, strict=True):
        assert (mine.height, mine.probes, mine.windows) == (
            wanted.height, wanted.probes, wanted.windows)  # fmt: skip
        assert mine.admittance == pytest.approx(wanted.admittance, rel=1e-6)
        if wanted.probes == 1:
            assert mine.velocity == pytest.approx(wanted.velocity, rel=1e-6)
        else:
            assert math.isnan(mine.velocity.real)
    for mine, wanted in zip(found.facts, study.facts, strict=True):
        for order, value in wanted.impedance.items():
            assert mine.impedance[order] == pytest.approx(value, rel=1e-6)
        assert mine.modulation == wanted.modulation
    assert recommend_height(found).heights == recommend_height(study).heights


def test_moments_beside_a_plane(planes, study, liner):
    """One height reduced, one not: each as by itself."""
    found = study_heights([planes[0], tl.moments(planes[1], liner)], liner, **WHOLE)
    high, low = (study.of(length=study.lengths[-1])[i] for i in (1, 0))
    mine = found.of(length=found.lengths[-1])
    assert mine[1].velocity == pytest.approx(high.velocity, rel=1e-6)
    assert math.isnan(mine[0].velocity.real)
    assert mine[0].admittance == pytest.approx(low.admittance, rel=1e-6)


def test_command_takes_moments(capsys, tmp_path):
    """The same answer as of the planes; what is unknown is '-' and null, and nothing is drawn."""
    files = []
    for path in G03:
        files.append(str(tmp_path / f"{path[-8:-3]}.moments.h5"))
        assert run(capsys, "reduce", path, "-o", files[-1], "--quiet")[0] == DONE
    code, out, _ = run(capsys, "height", *G03, *SHORT, "--json")
    wanted = json.loads(out)
    code, out, err = run(capsys, "height", *files, *SHORT, "--json", "--figure", str(tmp_path / "figures"))
    found = json.loads(out)
    assert code == DONE, err
    assert found["recommended"]["heights"] == wanted["recommended"]["heights"]
    for mine, theirs in zip(found["rows"], wanted["rows"], strict=True):
        assert mine["velocity"]["resistance"] is None
        assert mine["admittance"]["resistance"] == pytest.approx(theirs["admittance"]["resistance"], rel=1e-5)
    assert (tmp_path / "figures" / "heights.png").exists()
    code, out, _ = run(capsys, "height", *files, *SHORT)
    assert "nan" not in out


def test_a_stated_background_is_of_phase_locked_averaging(planes, study, liner):
    """The rows by length, which are of the others, stay."""
    found = study_heights(planes, liner, background=0.5, **WHOLE)
    for mine, other in zip(found.rows, study.rows, strict=True):
        assert mine.admittance == pytest.approx(other.admittance, rel=1e-9)
        assert mine.velocity == pytest.approx(other.velocity, rel=1e-9)
    mine, other = (each.facts[0].impedance["phase-locked"] for each in (found, study))
    assert mine != other
