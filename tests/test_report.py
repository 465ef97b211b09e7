"""Numbers behind the figures; that the drawings carry axes and units; the validation table."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from matplotlib.collections import LineCollection

import torchliner as tl
from torchliner.names import AVERAGINGS
from torchliner.report import figures
from torchliner.report.figures import draw_spectrum
from torchliner.report.level_check_report import draw_level_check
from torchliner.report.numbers import (
    against_height,
    impedance_along_x,
    impedance_over_frequency,
    velocity_along_x,
)
from torchliner.report.pictures import draw_pictures
from torchliner.report.truth_table import format_summary, format_truth
from torchliner.studies.validate import DEFAULT, reference_wave_phase, validation_table

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def maps(liner):
    x, z = np.arange(6) * 1e-3, np.arange(4) * 1e-3
    found = []
    for i, height in enumerate((2.5e-3, 0.5e-3)):
        plane = plane_of(turbulence((4, 6, 480), seed=i), x=x, z=z, height=height,
                         reference={"true": 1 - 0.2j, "in situ": 1.1 - 0.2j})  # fmt: skip
        found.append(tl.educe(plane, liner))
    return found


def test_along_x_is_the_admittance_average_over_z(maps):
    """Not the mean of Z."""
    profile = impedance_along_x(maps[0])
    wanted = 1 / (1 / maps[0].impedance[..., 0]).mean(0)
    assert profile.values["resistance"] == pytest.approx(wanted.real.numpy(), rel=1e-12)
    assert profile.values["reactance"] == pytest.approx(wanted.imag.numpy(), rel=1e-12)
    assert profile.label == "y = 2.5 mm"


def test_scattered_probes_are_grouped_by_x(liner):
    """Probes of equal x are averaged, in the order of x."""
    v = turbulence((5, 480), seed=3)
    plane = plane_of(v, x=[0.3, 0.1, 0.3, 0.2, 0.1], z=[0.0, 0, 1, 0, 1])
    found = tl.educe(plane, liner)
    profile = impedance_along_x(found)
    assert profile.at.tolist() == [0.1, 0.2, 0.3]
    wanted = 1 / (1 / found.impedance[[1, 4], 0]).mean()
    assert profile.values["resistance"][0] == pytest.approx(float(wanted.real))


def test_velocity_profile_separates_mean_and_fluctuation():
    """v0 is the time mean; v' and u' are rms without it, averaged over z as squares."""
    v = turbulence((3, 4, 900), seed=5) + 2.0
    u = 3 * turbulence((3, 4, 900), seed=6) + 70
    values = velocity_along_x(plane_of(v, streamwise=u, x=np.arange(4.0))).values
    assert values["v0 (m/s)"] == pytest.approx(v.mean((0, 2)).numpy())
    assert values["v' rms (m/s)"] == pytest.approx(v.var(2, correction=0).mean(0).sqrt().numpy())
    assert values["u' rms (m/s)"] == pytest.approx(u.var(2, correction=0).mean(0).sqrt().numpy())


def test_rows_against_height_are_ordered(maps):
    """Lowest plane first, every averaging, spread over probes."""
    rows = against_height(maps)
    assert [row.height for row in rows] == [0.5e-3, 2.5e-3]
    assert rows[1].impedance == {name: complex(maps[0].liner[name].impedance[0]) for name in AVERAGINGS}
    assert rows[1].interval["velocity"] == maps[0].bounds_of_liner("velocity")
    assert rows[1].spread.real == pytest.approx(float(maps[0].resistance.std()))


def labels(figure) -> str:
    return " ".join(axis.get_xlabel() + axis.get_ylabel() for axis in figure.axes)


def test_every_drawing_has_axes_and_units(maps, liner, tmp_path):
    """Symbols and units on the axes; a file of either kind is written."""
    map_figure = figures.draw_map(maps[0])
    along = figures.draw_along_x(maps, tmp_path / "along.pdf")
    height = figures.draw_against_height(maps)
    plane = plane_of(turbulence((2, 4, 300)), x=np.arange(4) * 1e-3)
    velocity = figures.draw_velocity([plane], tmp_path / "velocity.png")
    assert "(mm)" in labels(map_figure)
    assert "(mm)" in labels(along)
    assert "Re" in labels(height)
    assert "m s" in labels(velocity)
    shown = {text.get_text() for text in along.legends[0].get_texts()}
    assert {"true", "in situ", "$y$ = 0.5 mm", "$y$ = 2.5 mm"} <= shown
    assert all((tmp_path / name).stat().st_size > 4000
               for name in ("along.pdf", "velocity.png"))  # fmt: skip


def test_goodrich_stands_in_map_file_and_figure(liner, tmp_path):
    """Where Mach number and delta* are known: linear Z plus M/(phi (2 + 1.256 delta*/d))."""
    plane = plane_of(turbulence((5, 480)), x=np.arange(5) * 1e-3, mach=0.3,
                     displacement_thickness=2e-3)  # fmt: skip
    found = tl.educe(plane, liner, [1000.0, 1400.0])
    added = 0.3 / (0.055 * (2 + 1.256 * 2e-3 / 1.17e-3))
    wanted = liner.impedance([1000.0, 1400.0]) + added
    assert float((found.goodrich - wanted).abs().max()) < 1e-12
    found.write(tmp_path / "m.h5")
    assert float((tl.read_map(tmp_path / "m.h5").goodrich - wanted).abs().max()) < 1e-12
    figure = found.plot()
    assert any("Goodrich" in text.get_text() for text in figure.legends[0].get_texts())
    assert tl.educe(plane_of(turbulence((2, 480))), liner).goodrich is None


@pytest.mark.filterwarnings("ignore:.*so flow would count twice")
def test_goodrich_counts_the_flow_once(liner):
    """A law that adds the same flow itself gives the same value."""
    plane = plane_of(turbulence((5, 480)), x=np.arange(5) * 1e-3, mach=0.3,
                     displacement_thickness=2e-3)  # fmt: skip
    plate = {"thickness": 0.8e-3, "orifice_diameter": 1.17e-3, "porosity": 0.055}
    still, moved = (
        tl.LayeredLiner([tl.sheet("two-parameter", **plate, **flow), tl.Cavity(38e-3, 5e-3)])
        for flow in ({}, {"mach": 0.3, "displacement_thickness": 2e-3})
    )
    values = [tl.educe(plane, each, interval=None).goodrich for each in (still, moved)]
    assert float((values[0] - values[1]).real.abs().max()) < 1e-12


def test_the_style_stays_ours(maps):
    """Drawing does not change the caller's matplotlib settings."""
    import matplotlib

    from torchliner.report.figure import RC

    before = {key: matplotlib.rcParams[key] for key in RC}
    figures.draw_map(maps[0])
    assert {key: matplotlib.rcParams[key] for key in RC} == before


def test_truth_table_covers_every_rule_once(liner):
    """4 drives x 3 phase rules x 3 averagings a plane; 'given' uses the true wave's phase."""
    plane = plane_of(turbulence((3, 480)), height=1e-3, reference={"true": 1 - 0.2j})
    rows = validation_table([plane], lambda _: liner)
    keys = {(r.drive, r.mean, r.phase, r.averaging) for r in rows}
    assert len(rows) == len(keys) == 36
    averaged = tl.educe(plane, liner)
    psi = reference_wave_phase(plane, averaged)
    stated = tl.educe(plane, liner, phase="given", reference_phase=psi)
    row = next(r for r in rows if (r.drive, r.mean, r.phase, r.averaging)
               == ("instantaneous", "kept", "given", "admittance"))  # fmt: skip
    assert row.educed == pytest.approx(complex(stated.liner["admittance"].impedance[0]), abs=1e-12)
    assert format_truth(rows).count("instantaneous, mean removed") == 3  # all averagings
    by_averaging = [row for row in rows if row.rule == DEFAULT]
    assert all(f"{row.error:.3f} to {row.error:.3f}" in format_summary(rows) for row in by_averaging)


def test_reference_wave_phase_by_hand(liner):
    """v_in = c (X - Y): with Z = 1 there is no reflection and x has the phase of v_in = -v."""
    t = torch.arange(480, dtype=torch.float64) / 42000.0
    plane = plane_of(-torch.cos(2 * torch.pi * 1400 * t + 0.8)[None], reference={"true": 1 + 0j})
    found = tl.educe(plane, liner)
    assert reference_wave_phase(plane, found) == pytest.approx(0.8, abs=1e-9)


def test_truth_needs_a_truth(liner):
    """A plane without a reference impedance is refused."""
    with pytest.raises(ValueError, match="states no reference impedance"):
        validation_table([plane_of(turbulence((2, 480)))], lambda _: liner)


def test_spectrum_of_every_plane(liner, tmp_path):
    """All averagings and the quartiles over frequency, drawn and as CSV; a pole of Z is cut off."""
    planes = [plane_of(turbulence((6, 400), seed=i), height=i * 1e-3) for i in (1, 2)]
    results = [tl.educe(plane, liner, [500.0, 1000.0, 1500.0, 2000.0]) for plane in planes]
    numbers = impedance_over_frequency(results[0])
    assert numbers.at.tolist() == [500.0, 1000.0, 1500.0, 2000.0]
    assert np.array_equal(numbers.values["resistance"], results[0].answer.real.numpy())
    assert {f"resistance, {name}" for name in ("velocity", "phase-locked")} < set(numbers.values)
    reactance = results[0].reactance.numpy()
    assert np.allclose(numbers.values["reactance, 25 % of probes"], np.percentile(reactance, 25, 0))
    numbers.write_csv(tmp_path / "s.csv")
    rows = (tmp_path / "s.csv").read_text().splitlines()
    assert rows[0].startswith("frequency (Hz),resistance,")
    assert len(rows) == 5
    figure = draw_spectrum(results, tmp_path / "s.png")
    assert "(kHz)" in labels(figure)
    shown = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"$y$ = 1 mm", "$y$ = 2 mm", "middle half of the probes", *AVERAGINGS} <= shown
    results[0].probes["admittance"].reflection[..., 3] = 1 - 1e-6
    low, high = draw_spectrum(results).axes[0].get_ylim()
    assert high - low < 1e4


def test_a_figure_over_height_needs_heights(liner):
    """Said with the name of the result."""
    from torchliner.report.figures import draw_against_height

    found = tl.educe(plane_of(turbulence((2, 480)), title="bare"), liner, interval=None)
    with pytest.raises(ValueError, match="bare states no height; a figure over height needs one"):
        draw_against_height([found])


def test_every_spectrum_has_its_bars(liner):
    """Bars of planes are drawn at frequencies in turn only where there are enough of them."""
    planes = [plane_of(turbulence((6, 400), seed=i), height=i * 1e-3) for i in (1, 2, 3)]
    results = [tl.educe(plane, liner, [1000.0, 2000.0]) for plane in planes]
    bars = [lines for lines in draw_spectrum(results).axes[0].collections
            if isinstance(lines, LineCollection)]  # fmt: skip
    assert [len(lines.get_segments()) for lines in bars] == [2, 2, 2]


def test_the_level_check_is_drawn_where_a_pressure_is_known(liner, tmp_path):
    """None of the other frequencies has a picture, and no height that is not stated is 0."""
    tone = torch.cos(2 * torch.pi * FREQUENCY * torch.arange(480) / RATE)
    plane = plane_of(tone.expand(3, -1) + 0.1 * turbulence((3, 480)), frequency=FREQUENCY,
                     incident_level=120.0, source_side="normal")  # fmt: skip
    found = tl.educe(plane, liner, [1000.0, FREQUENCY])
    draw_pictures([found], [plane], tmp_path)
    assert sorted(path.name for path in tmp_path.glob("level_check*")) == [
        f"level_check_{FREQUENCY:g}Hz.csv", f"level_check_{FREQUENCY:g}Hz.png"]  # fmt: skip
    (axis,) = draw_level_check([found], None, 1).axes
    assert axis.get_xlabel() == "height not stated"
    assert len(axis.get_xticks()) == 0


def test_a_figure_shows_the_heights_of_one_case(liner, tmp_path):
    """Other cases, and planes whose legends would be alike, have folders of their own."""
    stated = [{"height": 1e-3}, {"height": 2e-3}, {"height": 1e-3},
              {"height": 3e-3, "provenance": {"case": "other"}}, {}]  # fmt: skip
    planes = [plane_of(turbulence((2, 480), seed=i), name=f"p{i}.h5", **about)
              for i, about in enumerate(stated)]  # fmt: skip
    draw_pictures([tl.educe(plane, liner, FREQUENCY) for plane in planes], planes, tmp_path)
    shown = {path.parent.name if path.parent != tmp_path else "": sorted(
        each.stem[-2:] for each in path.parent.glob("along_x_*.csv"))
        for path in tmp_path.rglob("along_x.png")}  # fmt: skip
    assert shown == {"": ["p0", "p1"], "p2": ["p2"], "p3": ["p3"], "p4": ["p4"]}
    assert [path.parent for path in tmp_path.rglob("height.png")] == [tmp_path]


def test_a_legend_names_no_cells_that_are_not_drawn(liner):
    """Of a plane without coordinates the cells have no place."""
    for x, there in ((None, False), ([0.0, 0.01, 0.02], True)):
        plane = plane_of(turbulence((3, 480)), x=x)
        figure = figures.draw_along_x([tl.educe(plane, liner, FREQUENCY)])
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        assert any(name.startswith("cells") for name in names) == there
