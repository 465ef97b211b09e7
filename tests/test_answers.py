"""What a user may know beside the velocity: the flow without sound, the level; and whether there is a tone at all."""

import csv
import dataclasses
import json
import math

import pytest
import torch
from conftest import DATA, codes, load_script

import torchliner as tl
from torchliner.cli.main import main
from torchliner.engine.drives import incoherent_square
from torchliner.records.level_check import FAILS, INCONCLUSIVE, PASSES
from torchliner.studies.calibrate import calibrate_without_flow
from torchliner.velocity.review import CHANCE

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")  # the notes are looked at instead
RATE, TONE, PERIODS, PITCH = 42e3, 1400.0, 20, 4e-3
SAMPLES = int(PERIODS * RATE / TONE)


def plane_of(tone: float = 2.0, noise: float = 1.5, seed: int = 1, **facts) -> tl.VelocityPlane:
    """Two cells of eight probes at normal incidence: a tone of one phase and white noise of an rms, m/s."""
    generator = torch.Generator().manual_seed(seed)
    velocity = noise * torch.randn(16, SAMPLES, generator=generator, dtype=torch.float64)
    velocity += tone * torch.cos(2 * torch.pi * TONE * torch.arange(SAMPLES, dtype=torch.float64) / RATE)
    x = (torch.arange(16, dtype=torch.float64) + 0.5) * PITCH / 8
    usual = {"height": 6e-4, "mach": 0.2, "frequency": TONE, "source_side": "normal", "incident_level": 140.0}
    return tl.VelocityPlane(velocity, sampling_rate=RATE, x=x, **usual | facts)


def quiet_of(noise: float = 0.8, seed: int = 9, **facts) -> tl.VelocityPlane:
    return plane_of(0.0, noise, seed, frequency=None, source_side="none", incident_level=None, **facts)


def broken() -> tl.VelocityPlane:
    """A run without sound of which one sample is no number."""
    plane = quiet_of(name="quiet.h5")
    plane.velocity[3, 7] = torch.nan
    return plane


@pytest.fixture(scope="module")
def liner():
    return tl.load_liner("lbm_orifice").replace(cell_pitch=PITCH)


def test_a_number_and_a_plane_of_that_rms_agree(liner):
    """And the record's own rms, or any that is larger, changes nothing."""
    plane, quiet = plane_of(), quiet_of()
    of_plane = tl.educe(plane, liner, background=quiet)
    known = of_plane.choices["background"]
    assert known["rms"] == pytest.approx([0.8, 0.8], rel=0.05)
    both = dataclasses.replace(quiet, velocity=quiet.velocity * 0.8 / known["rms"][0])  # of one cell
    one = liner.replace(cell_pitch=None)
    rms = tl.educe(plane, one, background=both).choices["background"]["rms"]
    stated, measured = (tl.educe(plane, one, background=each) for each in (rms[0], both))
    assert torch.equal(stated.answer, measured.answer)
    assert measured.choices["incoherent_scale"] == pytest.approx(rms[0] / 1.5, rel=0.02)
    as_it_is = tl.educe(plane, liner)
    for own in (30.0, quiet_of(30.0)):
        assert torch.equal(tl.educe(plane, liner, background=own).answer, as_it_is.answer)
    assert float(of_plane.answer.real) < float(as_it_is.answer.real)


def test_one_cell_stands_for_several(liner):
    quiet = quiet_of()
    part = dataclasses.replace(quiet, velocity=quiet.velocity[:8], x=quiet.x[:8])
    found = tl.educe(plane_of(), liner, background=part)
    assert len(found.choices["background"]["rms"]) == 1


def test_cells_that_are_gone_leave_one_rms_for_the_others(liner):
    """Their numbers are then not those of the quiet run; of that a probe that is left out counts for nothing."""
    plane, quiet = plane_of(), quiet_of()
    plane.velocity[:8], quiet.velocity[:8], quiet.velocity[12] = torch.nan, quiet.velocity[:8] / 2, torch.nan
    found = tl.educe(plane, liner, background=quiet, missing="exclude").choices
    rms = found["background"]["rms"]
    assert rms == pytest.approx([0.4, 0.8], rel=0.05)
    assert found["incoherent_scale"] == pytest.approx(sum(rms) / 2 / 1.5, rel=0.02)
    plane, quiet = plane_of(), quiet_of()
    plane.velocity[:4], quiet.velocity[12:] = torch.nan, torch.nan  # as many cells, and not the same ones
    found = tl.educe(plane, liner.replace(cell_pitch=PITCH / 2), background=quiet, missing="exclude").choices
    assert len(found["background"]["rms"]) == 1


def test_the_tone_that_is_asked_for_counts_where_none_is_stated(liner):
    plane, quiet = plane_of(), quiet_of()
    stated = tl.educe(plane, liner, background=quiet)
    asked = tl.educe(dataclasses.replace(plane, frequency=None), liner, TONE, background=quiet)
    assert asked.choices["background"] == stated.choices["background"]


def test_heights_are_interpolated_to_half_a_hole(liner):
    """Half of 1.2 mm lies in the middle of two planes at 0.5 and 0.7 mm: so does the rms."""
    one = liner.replace(cell_pitch=None, orifice_diameter=1.2e-3)
    low, high = quiet_of(0.6, height=5e-4), quiet_of(1.0, height=7e-4)
    known = [tl.educe(plane_of(height=float(q.height)), one, background=q).choices["background"] for q in (low, high)]
    rms = [each["rms"][0] for each in known]
    found = tl.educe(plane_of(height=5e-4), one, background=[high, low]).choices["background"]
    assert found["rms"][0] == pytest.approx(sum(rms) / 2, rel=1e-6)
    assert found["height"] == pytest.approx(6e-4)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda: quiet_of(height=1e-3), ("height", "0.0006", "0.001")),
        (lambda: quiet_of(mach=0.3), ("Mach number", "0.3", "0.2")),
        (lambda: plane_of(), ("holds the tone of 1400 Hz", "run without sound")),
        (lambda: [quiet_of(height=8e-4), quiet_of(height=1e-3)], ("0.8, 1 mm", "half a hole diameter", "0.6001 mm")),
        (lambda: [quiet_of(), quiet_of(height=None)], ("heights",)),
        (lambda: 0.0, ("background", "above 0")),
        (lambda: torch.ones(3), ("background", "one number")),
        (lambda: ["quiet.h5"], ("background", "'quiet.h5'", "planes")),
        (lambda: broken(), ("quiet.h5 holds nan or inf at 1 of 16 probes", "probe (3,), sample 7")),
    ],
)
def test_backgrounds_that_are_refused(liner, given, words):
    with pytest.raises((ValueError, TypeError)) as fault:
        tl.educe(plane_of(), liner, background=given())
    assert all(word in str(fault.value) for word in words), str(fault.value)


def test_velocity_ratio_in_closed_form(liner):
    """|V1|/(phi M c), with a note above 0.1 that a background silences."""
    found = tl.educe(plane_of(2.0), liner)
    wanted = 2.0 / (liner.surface_porosity * 0.2 * float(found.fluid.sound_speed))
    assert found.choices["velocity_ratio"] == pytest.approx(wanted, rel=0.1)
    (note,) = [note for note in found.notes if note.code == "velocity-ratio"]
    assert 0 < note.size < float(found.answer.real)
    assert "velocity-ratio" not in codes(tl.educe(plane_of(2.0), liner, background=0.8))
    assert "velocity-ratio" not in codes(tl.educe(plane_of(0.2), liner))
    assert tl.educe(plane_of(2.0, mach=None), liner).choices["velocity_ratio"] is None


def test_the_curve_is_fitted_to_the_cases():
    """The constants are those of the stored shares, which scripts/answers_page.py computes; others would be told."""
    curve = load_script("answers_page")
    with (DATA.parent / "docs" / "figures" / "velocity_ratio.csv").open(newline="") as file:
        rows = [{name: float(value) for name, value in row.items() if name != "case"} for row in csv.DictReader(file)]
    assert curve.differs(rows) == []
    moved = [row | {"velocity_ratio": 1.1 * row["velocity_ratio"]} for row in rows]
    assert len(curve.differs(moved)) >= 2


def test_noise_of_a_stated_tone_has_none(liner):
    noise = plane_of(0.0, 1.5, frequency=1500.0, incident_level=None)
    found = tl.educe(noise, liner)
    assert "no-tone" in codes(found)
    assert found.averaging == "admittance" == found.choices["averaging"]
    assert torch.equal(found.answer, found.liner["admittance"].impedance)
    with pytest.raises(ValueError, match="no tone of 1500 Hz"):
        tl.educe(noise, liner, phase="self-consistent")
    assert "no-tone" not in codes(tl.educe(plane_of(0.2), liner))
    hidden = tl.educe(plane_of(0.01), liner)  # its level is stated
    assert hidden.averaging == "phase-locked"
    assert "hidden-tone" in codes(hidden)


def test_chance_is_what_it_says(liner):
    """Noise exceeds the limit of a chance in that share of records, and the note follows the limit."""
    one, found = liner.replace(cell_pitch=None), []
    for seed in range(100):
        noise = plane_of(0.0, 1.0, seed, incident_level=None)
        known = tl.moments(noise, one, averaging="velocity")
        tone = torch.tensor([TONE], dtype=torch.float64)
        found.append(float(known.survey.coherence(tone, known.membership)))
        blocks = known.survey.blocks.count
        if seed < 15:
            noted = "no-tone" in codes(tl.educe(noise, one, interval=None, averaging="velocity"))
            assert noted == (found[-1] <= 1 - CHANCE ** (1 / (blocks - 1)))
    for chance in (0.5, 0.1):
        share = sum(each > 1 - chance ** (1 / (blocks - 1)) for each in found) / len(found)
        assert share == pytest.approx(chance, abs=3 * math.sqrt(chance * (1 - chance) / len(found)))


def test_level_matched_gives_the_level(liner, tmp_path):
    """The velocity so scaled, given as background, passes the check at 0 dB; a doubtful level widens the bounds."""
    plane = plane_of()
    gap = float(tl.educe(plane, liner).level_check.liner.level[2, 0])
    same = tl.educe(dataclasses.replace(plane, incident_level=140.0 + gap), liner, level_matched=True)
    assert float(same.level_matched.share) == pytest.approx(1.0, abs=1e-4)
    assert complex(same.level_matched.impedance) == pytest.approx(complex(same.answer), rel=1e-4)
    louder = dataclasses.replace(plane, incident_level=140.0 + gap - 0.3)
    sure, unsure = (tl.educe(louder, liner, level_matched=True, level_uncertainty=u) for u in (0.0, 0.5))
    share = float(sure.level_matched.share)
    assert share < 1
    own = tl.educe(louder, liner).level_check
    assert float(own.liner.level[2, 0]) == pytest.approx(0.3, abs=1e-6)
    known = tl.moments(louder, liner)
    mean = float(incoherent_square(known.survey, known.membership).mean().sqrt())  # of cells that differ little
    rms = share * tl.educe(louder, liner, background=mean).choices["background"]
    checked = tl.educe(louder, liner, background=rms)
    assert float(checked.level_check.liner.level[2, 0]) == pytest.approx(0.0, abs=0.02)
    assert complex(checked.answer) == pytest.approx(complex(sure.level_matched.impedance), rel=5e-3)
    widths = [float(each.level_matched.high.real - each.level_matched.low.real) for each in (sure, unsure)]
    assert widths[0] < widths[1]
    unsure.write(tmp_path / "map.h5")
    again = tl.read_map(tmp_path / "map.h5").level_matched
    assert vars(again).keys() == vars(unsure.level_matched).keys()
    assert complex(again.low) == complex(unsure.level_matched.low)
    assert again.uncertainty == 0.5


def test_level_matched_is_pressure_over_velocity(liner):
    """|Z + 1| = 2 |p|/(rho c |V|) at the plate, in closed form, whatever the turbulence."""
    plane = plane_of(height=1e-7)
    level = 140.0 + float(tl.educe(plane, liner).level_check.liner.level[2, 0]) - 0.3
    found = tl.educe(dataclasses.replace(plane, incident_level=level), liner, level_matched=True)
    time = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    tone = 2 * (plane.velocity * torch.exp(-2j * torch.pi * TONE * time)).mean()
    pressure = math.sqrt(2) * 20e-6 * 10 ** (level / 20)
    wanted = 2 * pressure / (float(found.fluid.density * found.fluid.sound_speed) * float(tone.abs()))
    assert abs(complex(found.level_matched.impedance) + 1) == pytest.approx(wanted, rel=1e-4)
    assert abs(complex(found.answer) + 1) != pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"noise": 1e-4}, ("dB by a factor e", "0.5")),
        ({"incident_level": 180.0}, ("4 times", "model")),
        ({"source_side": "unknown"}, ("source_side",)),
    ],
)
def test_levels_that_say_nothing(liner, facts, words):
    found = tl.educe(plane_of(**facts), liner, level_matched=True)
    (note,) = [note for note in found.notes if note.code == "level-matched"]
    assert all(word in note.text for word in words), note.text
    assert found.level_matched is None or not bool(found.level_matched.share.isfinite().any())


def test_level_matched_needs_samples_and_phase_locking(liner):
    for given, choices in ((tl.moments(plane_of(), liner), {}), (plane_of(), {"averaging": "velocity"})):
        with pytest.raises(ValueError, match="level_matched"):
            tl.educe(given, liner, level_matched=True, **choices)


@pytest.mark.parametrize(
    ("low", "high", "value", "verdict", "failed"),
    [(0.0, 0.2, 0.1, PASSES, False), (0.1, 0.9, 0.5, INCONCLUSIVE, True), (0.4, 0.6, 0.5, FAILS, True)],
)
def test_a_value_beyond_the_limit_counts(liner, low, high, value, verdict, failed):
    check = tl.educe(plane_of(), liner).level_check
    numbers = {"level": value, "level_low": low, "level_high": high}
    stated = {name: torch.full_like(check.liner.level, number) for name, number in numbers.items()}
    check = dataclasses.replace(check, liner=dataclasses.replace(check.liner, **stated))
    assert (check.verdict(check.averaging), check.failed) == (verdict, failed)
    assert ("+0.50 dB" in check.sentence(check.averaging, TONE)) == failed


def test_liner_from_runs_without_flow():
    """Offset and contraction coefficient from two levels, under the law that is chosen, give the third within 2 %."""
    *planes, loud = (tl.read_plane(DATA / f"orifice_{case}_y0.5mm.h5") for case in ("o115", "o130", "o145"))
    fit, scores = calibrate_without_flow(planes, tl.load_liner("lbm_orifice"))
    assert set(fit.numbers) == {"vena_contracta", "offset_resistance", "offset_reactance"}
    assert isinstance(fit.liner, tl.EndLossSDoFLiner)
    assert scores["end loss"] < scores["as given"]
    found = complex(tl.educe(loud, fit.liner, interval=None).answer)
    assert found.real == pytest.approx(loud.reference["true"].real, rel=0.02)
    assert found.imag == pytest.approx(loud.reference["true"].imag, abs=0.06)


def test_the_recipe_in_a_shell(tmp_path, capsys):
    """docs/from_simulation.md: the commands give what Python gives."""
    mine, plane = str(tmp_path / "mine.toml"), DATA / "orifice_q02_145_y0.5mm.h5"
    quiet = [DATA / f"quiet_q02_y{height}mm.h5" for height in ("0.5", "1.0")]
    run = [str(DATA / "orifice_t00_130_y0.5mm.h5"), "--allow-short", "-o", mine]
    assert main(["calibrate", *run]) == 0
    capsys.readouterr()
    main(["educe", str(plane), "--liner", mine, "--background", *map(str, quiet), "--level-matched", "--json"])
    shown = json.loads(capsys.readouterr().out)
    read_quiet = [tl.read_plane(path) for path in quiet]
    found = tl.educe(tl.read_plane(plane), tl.load_liner(mine), background=read_quiet, level_matched=True)
    (row,) = (row for row in shown["rows"] if row["averaging"] == "level-matched")
    assert row["impedance"]["resistance"] == pytest.approx(float(found.level_matched.impedance.real))
    true = found.reference["true"]
    assert float(found.answer.real) == pytest.approx(true.real, rel=0.1)
    assert float(found.level_matched.impedance.real) == pytest.approx(true.real, rel=0.02)
