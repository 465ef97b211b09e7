"""The in situ method from the command line, beside the educed maps and in figures."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import torch
from conftest import DATA
from test_in_situ import file_of

import torchliner as tl
from torchliner.cli.main import main
from torchliner.report.alongside import alongside_surfaces


def test_command_prints_writes_and_draws(tmp_path, capsys):
    """The table has every method, the CSV the same numbers."""
    csv, png, points = (tmp_path / name for name in ("rows.csv", "z.png", "points.h5"))
    path = str(DATA / "pressure_g01_145.h5")
    assert main(["insitu", path, "-o", str(csv), "--figure", str(png)]) == 0
    text = capsys.readouterr().out
    assert "cell 2, x = 18.7 mm" in text
    assert "waves, 2 microphones" in text
    assert "reference Z = 0.948-0.340j" in text
    assert len(csv.read_text().splitlines()) == 1 + 4 + 2 + 3
    assert png.stat().st_size > 10_000
    assert main(["insitu", path, "-o", str(points), "--json", "--quiet"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert rows[5]["distance_to_true"] < 0.02
    assert tl.read_points(points).cell_impedance.shape == (2, 1)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ([str(DATA / "slit_n130_y2.5mm.h5")], "is no pressure record"),
        ([str(DATA / "pressure_n130.h5"), "--frequency", "60000"], "at or above Nyquist"),
        ([str(DATA / "pressure_n130.h5"), "-o", str(DATA / "pressure_n130.h5")],
         "is an input"),
        ([str(DATA / "pressure_n130.h5"), "--microphones", "0", "9"], "microphones 0 to 4, not 9"),
        ([str(DATA / "pressure_n130.h5"), "--interval", "0.9", "--no-intervals"],
         "--no-intervals leaves out what --interval is of"),
    ],
)  # fmt: skip
def test_command_refuses(arguments, match, capsys):
    assert main(["insitu", *arguments]) == 2
    assert match in capsys.readouterr().err


def test_options_of_what_a_record_has_not_are_refused(tmp_path, capsys):
    """A pair without microphones, losses without a cavity."""
    whole, path = file_of("n130"), str(tmp_path / "part.h5")
    dataclasses.replace(whole, microphones=None, microphone_y=None, microphone_velocity=None).write(path)
    assert main(["insitu", path, "--microphones", "0", "1", "--quiet"]) == 2
    assert "holds 0 microphones; there is no pair to choose" in capsys.readouterr().err
    dataclasses.replace(whole, facesheet=None, backplate=None, x=None, probe_cell=None).write(path)
    assert main(["insitu", path, "--losses", "viscothermal", "--quiet"]) == 2
    assert "holds microphones alone; losses 'viscothermal' are" in capsys.readouterr().err
    assert main(["insitu", path, "--microphones", "0", "1", "--quiet"]) == 0


def test_maps_carry_the_in_situ_values(tmp_path, capsys):
    """educe --in-situ: in the table, in the file and back, in the figures."""
    plane, pressure = DATA / "slit_n130_y2.5mm.h5", DATA / "pressure_n130.h5"
    target, folder = tmp_path / "map.h5", tmp_path / "pictures"
    arguments = ["educe", str(plane), "--in-situ", str(pressure), "-o", str(target)]
    assert main([*arguments, "--figure", str(folder), "--quiet"]) == 0
    assert "in situ (Dean), pressure first: 0.168-0.068j" in capsys.readouterr().out
    again = tl.read_map(target)
    wanted = tl.in_situ(tl.read_pressure(pressure))
    assert again.alongside[0].name == "in situ (Dean)"
    assert torch.equal(again.alongside[0].cell_impedance, wanted.cell_impedance)
    assert len(alongside_surfaces([again], 0)) == 2
    assert (folder / "along_x.png").exists()
    import h5py

    with h5py.File(target, "a") as file:
        del file["alongside_0"]
    assert tl.read_map(target).alongside == ()
    assert main(["educe", str(plane), "--in-situ", str(pressure), "-o", str(pressure)]) == 2
    assert "is an input" in capsys.readouterr().err


def test_other_times_are_warned_of(capsys, tmp_path):
    """A pressure record that lasts another time."""
    record = file_of("n130")
    keep = record.facesheet.shape[-1] // 2
    signals = ("facesheet", "backplate", "microphones", "microphone_velocity")
    parts = {name: getattr(record, name)[..., :keep] for name in signals}
    dataclasses.replace(record, **parts).write(tmp_path / "half.h5")
    arguments = ["educe", str(DATA / "slit_n130_y2.5mm.h5"), "--verbose", "--in-situ"]
    assert main([*arguments, str(tmp_path / "half.h5")]) == 0
    assert "of different times" in capsys.readouterr().err


def test_another_case_is_refused(capsys):
    """Another level, flow or case does not stand beside the educed values."""
    arguments = ["educe", str(DATA / "slit_n130_y2.5mm.h5"), "--in-situ"]
    assert main([*arguments, str(DATA / "pressure_n115.h5")]) == 2
    assert "are not one case: incident_level is 130.0 and 115.0" in capsys.readouterr().err
    assert main([*arguments, str(DATA / "no.h5")]) == 2
    assert "no.h5: no such file" in capsys.readouterr().err


def test_record_of_another_kind():
    plane = tl.read_plane(DATA / "slit_n130_y2.5mm.h5")
    for method in (tl.in_situ, tl.decompose_waves):
        with pytest.raises(TypeError, match="record is VelocityPlane; a PressureRecord is needed"):
            method(plane)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_probe_of_no_cell_has_no_backplate(rows):
    """Whatever the backplate's layout, a probe labelled -1 is nan and in no average."""
    time = np.arange(2000) / 50e3
    tone = np.cos(2 * np.pi * 1000 * time)
    face = np.array([1.0, 9.0, 1.0])[:, None] * tone
    back = 0.5 * np.sin(2 * np.pi * 1000 * time) * np.ones((rows, 1))
    labels = [0, -1, 1] if rows == 2 else [0, -1, 0]
    record = tl.PressureRecord(
        face, back[0] if rows == 1 else back, sampling_rate=50e3, frequency=1000.0,
        cavity_depth=0.03, probe_cell=labels,
    )  # fmt: skip
    found = tl.in_situ(record)
    assert bool(found.point_impedance[1].isnan().all())
    wanted = complex(found.point_impedance[0, 0])
    assert abs(complex(found.liner_impedance[0]) - wanted) < 1e-9
    assert abs(complex(found.liner_impedance_pressure_first[0]) - wanted) < 1e-9


def test_legend_names_the_method():
    """Black symbols at the cells with an entry of their own."""
    from torchliner.report.figures import draw_against_height, draw_along_x

    planes = [tl.read_plane(DATA / f"slit_n130_y{y}mm.h5") for y in ("1.0", "2.5")]
    beside = tl.in_situ(file_of("n130"))
    liner = tl.load_liner("lbm_slit")
    maps = [tl.educe(plane, liner).with_alongside(beside) for plane in planes]
    for draw in (draw_along_x, draw_against_height):
        figure = draw(maps)
        legend = figure.legends[0] if figure.legends else figure.axes[0].get_legend()
        names = [text.get_text() for text in legend.get_texts()]
        assert "in situ (Dean), admittance over points" in names
        assert len(names) == len(set(names))
    assert alongside_surfaces(maps, 0)["in situ (Dean), pressure first"] == pytest.approx(
        complex(beside.liner_impedance_pressure_first[0])
    )
