"""Eduction from wall pressures at the command line: table, files, figure, refusals."""

from __future__ import annotations

import csv
import json

import pytest
from test_two_wave_fit import both_ways
from test_wall_pressure import FREQUENCY, WALLS, line_of

from torchliner.cli.main import main
from torchliner.duct.presets import duct_text


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One wall seen by sources on both sides, and at one frequency alone."""
    tmp_path = tmp_path_factory.mktemp("lines")
    for side in ("upstream", "downstream"):
        line = line_of(both_ways(side)[0], side, title=f"{side} case")
        line.write(tmp_path / f"{side}.h5")
        one = line_of(both_ways(side)[0][:, 2:], side, frequency=1500.0)
        one.write(tmp_path / f"{side}_1500.h5")
    return tmp_path


def test_table_and_files(files, capsys):
    """The table has alpha, Z and singular values; the CSV the same numbers."""
    path = str(files / "upstream.h5")
    assert main(["kt", path, "-o", str(files / "rows.csv"), "--quiet"]) == 0
    text = capsys.readouterr().out
    assert "Impedance from microphones: upstream case" in text
    assert "2.330-0.300j" in text
    with (files / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["frequency"]) for row in rows] == FREQUENCY.tolist()
    for row, wall in zip(rows, WALLS.tolist(), strict=True):
        assert complex(float(row["resistance"]), float(row["reactance"])) == pytest.approx(wall)
        assert float(row["deviation_resistance"]) < 1e-12  # nothing is left of an exact line
        assert (float(row["energy_share"]), row["mach"]) == (pytest.approx(1.0), "0.3")


@pytest.mark.parametrize("method", ["kt", "two-waves", "free-waves"])
def test_both_sides_at_once(files, capsys, method):
    """JSON of two lines with draws; a seed makes them the same again."""
    names = [str(files / f"{side}.h5") for side in ("upstream", "downstream")]
    arguments = ["--method", method, "--draws", "2", "--json", "--quiet"]
    assert main(["kt", *names, *arguments]) == 0
    first = json.loads(capsys.readouterr().out)
    assert list(dict.fromkeys(row["line"] for row in first["rows"])) == ["upstream case", "downstream case"]
    for row in first["rows"][2::3]:
        assert row["impedance"]["resistance"] == pytest.approx(2.33, abs=1e-6)
        assert 0 < row["deviation"]["resistance"] < 1
        assert row["low"]["resistance"] < row["high"]["resistance"]
        assert first["choices"]["draws"] == 2
    again = []
    for seed in ("0", "0", "1"):
        main(["kt", str(files / "upstream_1500.h5"), *arguments, "--seed", seed])
        again.append(json.loads(capsys.readouterr().out)["rows"])
    assert again[0] == again[1] != again[2]


@pytest.fixture(scope="module")
def solved_files(tmp_path_factory):
    """Lines of a short solved duct, its file beside them, whose far end reflects."""
    folder = tmp_path_factory.mktemp("solved")
    text = duct_text("b2a").replace("start = -0.300", "start = -0.06")
    (folder / "b2a.toml").write_text(text.replace("end = 0.450", "end = 0.21"))
    for side in ("upstream", "downstream"):
        solve = ["duct", "solve", str(folder / "b2a.toml"), "--source-side", side, "--quiet"]
        written = str(folder / f"{side}.h5")
        assert main([*solve, "--end-reflection", "0.1+0.05j", "-o", written]) == 0
    return folder


@pytest.mark.slow
def test_fit_of_the_field(solved_files, capsys):
    """Both sides of a duct whose end is not known: one impedance, and the end as a number."""
    names = [str(solved_files / f"{side}.h5") for side in ("upstream", "downstream")]
    arguments = ["kt", *names, "--method", "field", "--duct", str(solved_files / "b2a.toml")]
    assert main([*arguments, "-o", str(solved_files / "rows.csv")]) == 0
    text = capsys.readouterr().out
    assert text.count("2.330-0.300j") == 2
    with (solved_files / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert complex(float(rows[0]["known_resistance"]), float(rows[0]["known_reactance"])) == pytest.approx(2.33 - 0.3j)
    assert float(rows[0]["misfit"]) < 1e-6
    assert 0 < float(rows[0]["deviation_resistance"]) < 0.1
    assert "wavenumber_real" not in rows[0]
    arguments.remove(names[1])
    assert main([*arguments, "--far-end", "stated", "--draws", "2", "--json"]) == 0
    output = capsys.readouterr()
    row = json.loads(output.out)["rows"][0]
    assert row["misfit"] > 10
    assert row["end_reflection"]["real"] == pytest.approx(0.0, abs=1e-12)
    picture = solved_files / "fit.png"
    drawn = ["--draws", "2", "--figure", str(picture)]
    assert main([*arguments, "--start", "2+0.1j", *drawn, "--quiet"]) == 0
    assert "2.330-0.300j" in capsys.readouterr().out
    assert picture.stat().st_size > 15_000


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["{}", "--far-end", "stated"], "--far-end is no option of --method kt"),
        (["{}", "--frequency", "700"], "has no 700 Hz; it holds [600.0, 1000.0, 1500.0] Hz"),
        (["{}", "--method", "two-waves", "--rank", "2"], "--rank is no option of --method two-wav"),
        (["{}", "--source-side", "downstream", "--rank", "1"], "runs away from a source downstream"),
    ],
)
def test_command_refuses(files, capsys, arguments, match):
    pure = line_of(both_ways(share=0.0)[0])
    pure.write(files / "pure.h5")
    filled = [word.format(files / "pure.h5") for word in arguments]
    assert main(["kt", *filled]) == 2
    assert match in capsys.readouterr().err
