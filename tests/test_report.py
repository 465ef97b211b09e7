"""Answers of results; numbers behind the figures; that the drawings carry axes and units."""

import matplotlib.figure
import numpy as np
import pytest
from conftest import DATA, FREQUENCY, plane_of, turbulence
from test_own_files import noisy
from test_results_out import line, points
from test_results_out import made as at

import torchliner as tl
from torchliner.names import AVERAGINGS
from torchliner.records.notes import Note
from torchliner.report import curves, maps
from torchliner.report.answer import answer_of, ordered
from torchliner.report.fields import level_and_phase
from torchliner.report.figure import AVERAGINGS as COLOUR_OF
from torchliner.report.maps import over_surface
from torchliner.studies.heights import study_heights

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def made(seed=0, **about):
    x, z = np.arange(6) * 1e-3, np.arange(4) * 1e-3
    return plane_of(turbulence((4, 6, 480), seed=seed), x=x, z=z, **about)


@pytest.fixture(scope="module")
def found(liner):
    about = {"reference": {"true": 1 - 0.2j, "in situ": 1.1 - 0.2j}}
    return [tl.educe(made(i, height=height, **about), liner) for i, height in enumerate((0.5e-3, 2.5e-3))]


def test_the_next_step_is_that_of_the_run_that_fails():
    planes = [tl.read_plane(DATA / f"{name}.h5") for name in ("slit_n130_y2.5mm", "orifice_o130_y1.0mm")]
    passes, fails = (tl.educe(plane, tl.load_liner(plane.liner)) for plane in planes)
    assert "audit" in answer_of(passes).step
    for several in ([passes, fails], [fails, passes]):
        assert answer_of(several).step.startswith("no averaging passes")


# --- one answer per result


def studies(liner):
    plane = made(height=1e-3, reference={"true": 1 - 0.2j})
    other = made(1, height=2e-3)
    return {
        "map": tl.educe(plane, liner),
        "maps": [tl.educe(each, liner) for each in (plane, other)],
        "spectrum": tl.educe(plane, liner, [1000.0, FREQUENCY]),
        "line": line(),
        "points": points(),
        "walls": [tl.kumaresan_tufts(noisy(side)) for side in ("upstream", "downstream")],
        "audit": tl.audit([plane, other], liner, averaging="velocity"),
        "compare": tl.compare(*(tl.educe(each, liner) for each in (plane, other))),
        "models": tl.compare_models(plane, {"one": liner, "two": liner.replace(vena_contracta=0.7)}),
        "sensitivities": tl.sensitivities(plane, liner, parameters=["porosity"]),
        "calibration": tl.calibrate([plane], liner, "true", {"vena_contracta": (0.5, 1.0)}),
        "heights": study_heights([plane, other], liner),
        "levels": tl.ir_tdibc(liner, [100.0, 120.0], [FREQUENCY]),
    }


def test_every_result_has_a_screen_rows_pictures_and_values(liner, tmp_path):
    for name, result in studies(liner).items():
        answer = answer_of(result)
        brief, full = answer.screen(), answer.screen(verbose=True)
        assert answer.title == brief.splitlines()[0], name
        assert sum(text.startswith("warning") for text in brief.splitlines()) <= 3
        assert len(full) >= len(brief) - 40
        answer.table.write_csv(tmp_path / f"{name}.csv")
        assert len((tmp_path / f"{name}.csv").read_text().splitlines()) == 1 + len(answer.table.rows)
        answer.write_pictures(tmp_path / name)
        for picture in answer.pictures:
            assert (tmp_path / name / f"{picture.name}.png").stat().st_size > 4000
            assert (tmp_path / name / f"{picture.name}.csv").read_text()
        assert isinstance(answer.plain, (dict, list))


def test_every_result_has_a_short_repr_and_a_table(liner, found):
    wall, several = noisy("upstream"), studies(liner)
    for one in (found[0], line(), tl.kumaresan_tufts(wall), wall, points(), several["audit"], several["compare"]):
        assert len(repr(one).splitlines()) < 30
        assert "tensor" not in repr(one)
        assert one._repr_html_().count("<tr>") > 1


def test_the_screen_says_z_interval_check_and_step(found):
    one, answer = found[0], answer_of(found[0])
    z, (low, _) = complex(one.answer[0]), one.bounds_of_liner(one.averaging)
    text = answer.screen()
    for words in (f"Z = {z.real:.3f}{z.imag:+.3f}j", f"R {low.real:.3f} to", "Level check:", "next: "):
        assert words in text
    rows = answer.plain["rows"]
    assert rows[0]["impedance"] == {"resistance": z.real, "reactance": z.imag}
    assert {row["averaging"] for row in rows} == {*AVERAGINGS, "reference", "in situ"}


def test_warnings_go_by_what_they_may_move():
    """What makes Z another quantity, the largest, and those of unknown size behind; each once."""
    notes = [Note("", "unknown"), Note("few-blocks", "small", 1e-3), Note("x", "large", 1.0), "text"]
    notes += [Note("level-check", "level", 0.1), Note("", "unknown")]
    assert [note.text for note in ordered(notes)] == ["level", "large", "small", "unknown", "text"]


# --- numbers


def test_along_x_is_the_admittance_average_over_z(found):
    rows = curves.impedance_along_x(found[1])
    wanted = 1 / (1 / found[1].impedance[..., 0]).mean(0)
    assert [row["impedance"] for row in rows] == pytest.approx(wanted.tolist(), rel=1e-12)
    assert [row["x (m)"] for row in rows] == found[1].x.tolist()


def test_scattered_probes_are_grouped_by_x(liner):
    plane = plane_of(turbulence((5, 480), seed=3), x=[0.3, 0.1, 0.3, 0.2, 0.1], z=[0.0, 0, 1, 0, 1])
    result = tl.educe(plane, liner)
    rows = curves.impedance_along_x(result)
    assert [row["x (m)"] for row in rows] == [0.1, 0.2, 0.3]
    wanted = 1 / (1 / result.impedance[[1, 4], 0]).mean()
    assert rows[0]["impedance"] == pytest.approx(complex(wanted))


def test_velocity_profile_separates_mean_and_fluctuation():
    """v0 is the time mean; v' is the rms without it, averaged over z as squares."""
    v = turbulence((3, 4, 900), seed=5) + 2.0
    rows = curves.velocity_along_x(plane_of(v, x=np.arange(4.0)))
    values = {name: [row[name] for row in rows] for name in rows[0]}
    assert values["v0 (m/s)"] == pytest.approx(v.mean((0, 2)).numpy())
    assert values["v' rms (m/s)"] == pytest.approx(v.var(2, correction=0).mean(0).sqrt().numpy())


def test_goodrich_stands_in_map_file_and_figure(liner, tmp_path):
    """Where Mach number and delta* are known: linear Z plus M/(phi (2 + 1.256 delta*/d))."""
    plane = plane_of(turbulence((5, 480)), x=np.arange(5) * 1e-3, mach=0.3, displacement_thickness=2e-3)
    result = tl.educe(plane, liner, [1000.0, 1400.0])
    added = 0.3 / (0.055 * (2 + 1.256 * 2e-3 / 1.17e-3))
    wanted = liner.impedance([1000.0, 1400.0]) + added
    assert float((result.goodrich - wanted).abs().max()) < 1e-12
    result.write(tmp_path / "m.h5")
    assert float((tl.read_map(tmp_path / "m.h5").goodrich - wanted).abs().max()) < 1e-12
    figure = result.plot(frequency=1000.0)
    assert any("Goodrich" in text.get_text() for text in figure.legends[0].get_texts())
    assert tl.educe(plane_of(turbulence((2, 480))), liner).goodrich is None


@pytest.mark.filterwarnings("ignore:.*so flow would count twice")
def test_goodrich_counts_the_flow_once(liner):
    plane = plane_of(turbulence((5, 480)), x=np.arange(5) * 1e-3, mach=0.3, displacement_thickness=2e-3)
    plate = {"thickness": 0.8e-3, "orifice_diameter": 1.17e-3, "porosity": 0.055}
    still, moved = (
        tl.LayeredLiner([tl.sheet("guess", **plate, mach=mach), tl.Cavity(38e-3, 5e-3)]) for mach in (0.0, 0.3)
    )
    values = [tl.educe(plane, each, interval=None).goodrich for each in (still, moved)]
    assert float((values[0] - values[1]).real.abs().max()) < 1e-12


# --- drawings


def test_every_drawing_has_axes_and_units_and_leaves_our_style_to_us(found, tmp_path):
    before = dict(matplotlib.rcParams)
    along = curves.draw_along_x(found, tmp_path / "along.pdf")
    for figure, words in ((along, "(mm)"), (curves.draw_velocity([made()]), "m s"), (maps.draw_map(found[0]), "(mm)")):
        assert words in " ".join(axis.get_xlabel() + axis.get_ylabel() for axis in figure.axes)
    names = {text.get_text() for text in along.legends[0].get_texts()}
    assert {"reference", "in situ", "y = 0.5 mm", "y = 2.5 mm"} <= names
    assert (tmp_path / "along.pdf").stat().st_size > 4000
    assert dict(matplotlib.rcParams) == before


def test_an_averaging_has_one_colour_everywhere(found, liner):
    spectrum = tl.educe(made(), liner, [500.0, 1000.0, 1500.0])
    (height,) = (each for each in answer_of(found).pictures if each.name == "height")
    drawn = [curves.draw_along_x(found[:1]), curves.draw_spectrum([spectrum]), height.draw(None)]
    for figure in drawn:
        colours = {line.get_label().split(", ")[-1]: line.get_color() for line in figure.axes[0].lines}
        assert {name: colours[name] for name in AVERAGINGS} == COLOUR_OF


def test_each_panel_shows_its_part(found):
    rows = curves.impedance_along_x(found[0])
    for axis, part in zip(curves.draw_along_x(found[:1]).axes, ("real", "imag"), strict=True):
        x, values = axis.lines[0].get_data()
        assert x == pytest.approx([1e3 * row["x (m)"] for row in rows])
        assert values == pytest.approx([getattr(row["impedance"], part) for row in rows])


def test_two_runs_in_one_pair_of_axes(found):
    axes = matplotlib.figure.Figure().subplots(1, 2)
    for one in found:
        curves.draw_along_x([one], axes=axes)
    drawn = [line for line in axes[0].lines if len(line.get_xdata()) == 6]
    assert len({line.get_color() for line in drawn}) == 2
    low, high = axes[0].get_ylim()
    assert all(low <= value <= high for line in drawn for value in line.get_ydata())


def test_a_phase_does_not_jump():
    level, phase = level_and_phase(20e-6 * 2**0.5 * np.exp(1j * np.radians([170.0, -170.0, -150.0])))
    assert level == pytest.approx(0)
    assert np.diff(phase) == pytest.approx(20)
    assert level_and_phase(np.exp(1j * np.radians([-170.0])), np.array([185.0]))[1] == pytest.approx(190)


def test_pictures_of_a_run(liner, tmp_path):
    """All of one set of frequencies in one figure of each kind; others have their own."""
    two = [made(i, height=h, frequency=FREQUENCY) for i, h in enumerate((1e-3, 2e-3))]
    sweep = [1000.0 + 10 * i for i in range(10)] + [FREQUENCY]
    found = [tl.educe(plane, liner, sweep, averaging="velocity", interval=None) for plane in two]
    answer_of(found, planes=two).write_pictures(tmp_path)
    names = {path.stem for path in tmp_path.glob("*.png")}
    assert names == {"along_x", "spectrum", "height", "difference", "velocity", "map", "map1"}
    assert {path.stem for path in tmp_path.glob("*.csv")} == names
    answer = answer_of([*found, tl.educe(made(2), liner, FREQUENCY)])
    assert {"1000Hz_height", "1000Hz_along_x", "1400Hz_along_x"} <= {each.name for each in answer.pictures}


# --- pictures

SHOWN = {"plane": True, "line": False, "slanted": False, "scattered": True}  # place of the probes: as a map


def test_scattered_probes_make_a_map():
    """A dot a probe; a line, also a slanted one, stays a line."""
    assert {place: over_surface(at(place)) for place in SHOWN} == SHOWN
    figure = at("scattered").plot(frequency=1400.0)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert figure.axes[0].collections[0].get_array().shape[0] == 4


def test_plots_go_into_given_axes_at_a_given_frequency(tmp_path):
    for place in SHOWN:
        axes = matplotlib.figure.Figure().subplots(1, 2)
        assert at(place).plot(frequency=1000.0, ax=axes) is axes
        assert all(axis.has_data() for axis in axes)
    one = matplotlib.figure.Figure().subplots()
    assert at("line").plot(ax=one, frequency=1000.0) is one
    (curve, *_) = one.get_lines()
    assert curve.get_ydata() == pytest.approx(at("line").impedance[:, 1].real.numpy())
    for words, message in (
        ({"frequency": 1200.0}, r"frequency is 1200 Hz; the record has \[1400.0, 1000.0\] Hz"),
        ({"ax": matplotlib.figure.Figure().subplots(1, 3)}, r"3 axes are given; 2 panels need 2, or one"),
        ({"path": tmp_path / "m.png", "ax": one}, r"m.png: give a path or axes"),
    ):
        with pytest.raises(ValueError, match=message):
            at("line").plot(**words)


# --- validation
