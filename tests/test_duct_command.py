"""Ducts from TOML, and ``torchliner duct``."""

import csv
import json
import warnings

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
        (("[[0.0, 0.150]]", "[[0.0, 0.550]]"), "from x = 0 to 0.55 m .* 0.45 m, the duct's end"),
        (("[[0.0, 0.150]]", "[[0.15, 0.0]]"), "from x = 0.15 to 0 m must have a length"),
        (("end = 0.450", "end = -0.450"), r"duct length, end - start \(m\) is -0\.15"),
        (("[[2.33, -0.30]]", "[[2.3, -0.3], [1, 0]]"), "2 impedances for 1 lined patches"),
        (("impedance = [[2.33, -0.30]]", ""), "0 impedances for 1 lined patches, and no impedance_file"),
        (("shear = 0.1 ", "shear = 0.02 "), "profile shear is 0.02, below 0.03"),
        (("step = 0.012", "step = 1e-9"), "microphones from -0.027 to 0.177 m in steps of 1e-09 m"),
        (("last = 0.177", "last = 0.477"), r"microphone 40 at x = 0\.453 m lies outside the duct, -"),
        (("step = 0.012", ""), "microphones need first, last and step"),
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


HEADER = "x [mm], resistance, reactance\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER, r"z\.csv holds no values: the file ends at line 1"),
        ("x [m],resistance [Pa s/m],reactance\n0,1,0\n", "column 'resistance' has units 'Pa s/m'.*a number is n"),
        (HEADER + "0,1,nan\n", r"z\.csv: line 2, column 'reactance' is 'nan'"),
        (HEADER + "0,0,0\n", r"mine\.toml: z\.csv: the impedance profile is 0 at x = 0 m"),
        (HEADER + "9,1,0\n0,1,0\n", r"mine\.toml: z\.csv: the stations of an impedance prof"),
        ("x [m],resistance,reactance\n0,1,0\n150,1,0\n", "x = 0 to 150 m, leave the duct, -0.3 to 0.45 m; is their"),
    ],
)
def test_tables_with_faults(tmp_path, text, message):
    (tmp_path / "z.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        load_duct(with_table(tmp_path))


def with_table(tmp_path):
    return write(tmp_path, ("impedance = [[2.33, -0.30]]", 'impedance_file = "z.csv"'))


def test_a_table_is_read_by_its_names_and_units(tmp_path):
    at = torch.tensor([0.0, 0.06, 0.15]).double()
    walls = []
    for text in (
        "x [m],resistance,reactance\n0,2,-0.3\n0.15,4,1\n",
        "reactance; x [cm]; resistance [1]\n-0,3; 0; 2\n1; 15; 4\n",
        "\ufeffX [mm];Resistance;REACTANCE\r\n0;2;-0,3\r\n150;4;1\r\n",
    ):
        (tmp_path / "z.csv").write_text(text)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            walls.append(load_duct(with_table(tmp_path)).impedance(at, torch.tensor([900.0]))[0])
    assert walls[0].tolist() == pytest.approx([2 - 0.3j, 1 / (0.6 / (2 - 0.3j) + 0.4 / (4 + 1j)), 4 + 1j])
    for wall in walls[1:]:
        assert wall.tolist() == pytest.approx(walls[0].tolist())


def test_a_change_replaces_what_says_the_same(tmp_path):
    (tmp_path / "z.csv").write_text(HEADER + "0,2,-0.3\n150,2,-0.3\n")
    path = with_table(tmp_path)
    assert callable(load_duct(path).impedance)
    for given, wanted in (([1.5 + 0.2j], 1.5 + 0.2j), (1.5 + 0.2j, 1.5 + 0.2j), (np.array([2.0]), 2.0)):
        assert load_duct(path, impedance=given).impedance.tolist() == [wanted]
    for hard in ("rigid", np.inf):
        assert load_duct(path, impedance=hard).impedance.real.tolist() == [np.inf]
    thick = write(tmp_path, ("shear = 0.1 ", "shear = 0.2 "))
    assert load_duct(thick, profile="tanh").case.profile.shear == 0.2
    changed = load_duct("b2a", profile="uniform", end_reflection=0.1 - 0.2j)
    assert changed.case.end_reflection == 0.1 - 0.2j
    assert float(changed.case.profile.mach(0.0)) == 0.3
    with pytest.raises(ValueError, match="flow allow_thin is for profile 'tanh', not 'uniform'"):
        load_duct("b2a", profile="uniform", allow_thin=True)


def test_solve_prints_what_it_writes(tmp_path, capsys):
    words, out = ["duct", "solve", "b2a", *SMALL, *MESH, "--quiet"], tmp_path / "m.h5"
    assert main([*words, "--json", "--field", str(tmp_path / "field.png")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["microphones"][0]["x"] == -0.027
    assert main([*words, "-o", str(out)]) == 0
    assert f"{told['microphones'][3]['spl']:.3f}" in capsys.readouterr().out
    line = tl.read_microphones(out)
    assert line.level[:, 0].tolist() == pytest.approx([row["spl"] for row in told["microphones"]])
    assert (line.liner_end, line.source_side, line.duct_height) == (0.15, "upstream", 0.05)
    found = complex(tl.kumaresan_tufts(line).impedance[0])
    assert abs(found - (2.33 - 0.30j)) < 0.4  # what the liner's ends do to KT at 900 Hz
    assert told["rows"][0]["transmission"] < 1
    assert (tmp_path / "field.png").stat().st_size > 10_000


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
