"""Ducts from TOML, and ``torchliner duct``."""

import csv
import json

import numpy as np
import pytest
import torch

import torchliner as tl
from torchliner.cli.main import main
from torchliner.duct.case import impedance_along
from torchliner.duct.presets import duct_names, duct_text, load_duct

SMALL = ["--profile", "uniform", "--frequency", "900"]
MESH = ["--mesh", "0.01"]  # m; without the second mesh, for speed
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def test_the_presets_are_the_two_facilities():
    """Heights, liners and flow of table 1; 145 dB are 502 Pa peak; 18 microphones in 12 mm."""
    assert duct_names() == ["b2a", "ufsc"]
    b2a, ufsc = (load_duct(name) for name in duct_names())
    assert (b2a.case.height, ufsc.case.height) == (0.05, 0.04)
    assert b2a.case.liner == ((0.0, 0.15),)
    assert ufsc.case.liner == ((0.0, 0.137),)
    assert b2a.case.profile.displacement_thickness == pytest.approx(1.73e-3, abs=1e-5)
    assert abs(b2a.case.incident) == pytest.approx(502.97, abs=0.01)
    assert len(b2a.microphones) == 18
    assert complex(b2a.impedance[0]) == 2.33 - 0.30j


def write(tmp_path, change):
    old, new = change
    text = duct_text("b2a")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("height = 0.050", "heigth = 0.05"), r"duct\.heigth: no such key.*height"),
        (("bulk_mach = 0.3", "bulk_mach = 1.2"), r"flow\.bulk_mach = 1\.2: .*less than 1"),
        (("[[0.0, 0.150]]", "[[0.0, 0.550]]"), "from x = 0 to 0.55 m .* and 0.45 m"),
        (("[[0.0, 0.150]]", "[[0.15, 0.0]]"), "from x = 0.15 to 0 m must have a length"),
        (("end = 0.450", "end = -0.450"), r"duct length, end - start \(m\) is -0\.15"),
        (("[[2.33, -0.30]]", "[[2.3, -0.3], [1, 0]]"), "2 impedances for 1 lined patches"),
        (("impedance = [[2.33, -0.30]]", ""), "0 impedances for 1 lined patches"),
        (("[flow]", "[flow"), "is not valid TOML"),
        (("frequency = [1500.0]", "frequency = []"), r"sound\.frequency"),
    ],
)
def test_mistakes_of_a_file_are_named(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        load_duct(write(tmp_path, change))


def test_an_impedance_profile_is_linear_in_the_admittance():
    along = impedance_along([0.0, 0.1], [1.0 + 0j, 1.0 / (3 + 1j)])
    found = along(torch.tensor([-1.0, 0.0, 0.05, 0.1, 0.2]), torch.tensor([500.0, 900.0]))
    assert found.shape == (2, 5)
    assert (1 / found[1]).tolist() == pytest.approx([1, 1, 2 + 0.5j, 3 + 1j, 3 + 1j])
    with pytest.raises(ValueError, match="must increase along x"):
        impedance_along([0.1, 0.1], [1.0, 2.0])


def test_a_change_replaces_the_file_s_value():
    for given, wanted in (([1.5 + 0.2j], 1.5 + 0.2j), (1.5 + 0.2j, 1.5 + 0.2j), (np.array([2.0]), 2.0)):
        assert load_duct("b2a", impedance=given).impedance.tolist() == [wanted]
    for hard in ("rigid", np.inf):
        assert load_duct("b2a", impedance=hard).impedance.real.tolist() == [np.inf]
    changed = load_duct("b2a", profile="uniform", end_reflection=0.1 - 0.2j, x=[])
    assert changed.case.end_reflection == 0.1 - 0.2j
    assert float(changed.case.profile.mach(0.0)) == 0.3
    assert (float(changed.microphones[0]), float(changed.microphones[-1])) == (-0.3, 0.45)
    with pytest.raises(ValueError, match=r"no key 'heigth' to change; there are height"):
        load_duct("b2a", heigth=0.1)


def test_a_table_of_the_flow_is_read(tmp_path):
    path = write(tmp_path, ('profile = "tanh"', 'profile = "table"\nfile = "u.csv"'))
    (tmp_path / "u.csv").write_text("y [mm], U [m/s]\n0, 0\n5, 80\n25, 100\n")
    flow = load_duct(path).case.profile
    assert flow.bulk_mach == 0.3
    assert flow.mach(0.005) / flow.mach(0.025) == pytest.approx(0.8)
    (tmp_path / "u.csv").write_text("y [mm], U [m/s]\n0, 0\n5, 80\n20, 100\n")
    with pytest.raises(ValueError, match=r"mine.toml: y runs from 0 to 0\.02 m"):
        load_duct(path)


def test_solve_prints_what_it_writes(tmp_path, capsys):
    words, out = ["duct", "solve", "b2a", *SMALL, *MESH, "--quiet"], tmp_path / "m.h5"
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["microphones"][0]["x"] == -0.027
    assert main([*words, "-o", str(out)]) == 0
    assert f"{told['rows'][0]['transmission']:.4g}" in capsys.readouterr().out
    line = tl.read_microphones(out)
    assert line.level[:, 0].tolist() == pytest.approx([row["spl"] for row in told["microphones"]])
    assert (line.liner_end, line.source_side, line.duct_height) == (0.15, "upstream", 0.05)
    found = complex(tl.kumaresan_tufts(line).impedance[0])
    assert abs(found - (2.33 - 0.30j)) < 0.4  # what the liner's ends do to KT at 900 Hz
    assert told["rows"][0]["transmission"] < 1


def test_modes_are_written(tmp_path, capsys):
    assert main(["duct", "modes", "b2a", "--profile", "uniform", "--count", "2", "-o", str(tmp_path / "m.csv")]) == 0
    rows = csv.DictReader((tmp_path / "m.csv").read_text().splitlines())
    assert [row["mode"] for row in rows] == ["0", "1", "0", "1"]


def test_presets_are_listed_and_copied(tmp_path, capsys):
    assert main(["duct", "solve"]) == 0
    assert "presets: b2a, ufsc" in capsys.readouterr().out
    assert main(["duct", "solve", "ufsc", "--copy", str(tmp_path / "u.toml")]) == 0
    assert load_duct(tmp_path / "u.toml").case.height == 0.04
    (tmp_path / "u.toml").write_text("edited")
    assert main(["duct", "solve", "ufsc", "--copy", str(tmp_path / "u.toml")]) == 2
    assert "u.toml exists; it is not overwritten" in capsys.readouterr().err
    assert (tmp_path / "u.toml").read_text() == "edited"
