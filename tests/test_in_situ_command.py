"""The in situ method from the command line, beside the educed maps and in figures."""

from __future__ import annotations

import json

import torch
from conftest import DATA

import torchliner as tl
from torchliner.cli.main import main
from torchliner.report.planes import known_of


def test_command_prints_writes_and_draws(tmp_path, capsys):
    """The table has every method, the CSV the same numbers."""
    csv, png, points = (tmp_path / name for name in ("rows.csv", "z.png", "points.h5"))
    path = str(DATA / "pressure_g01_145.h5")
    assert main(["insitu", path, "-o", str(csv), "--figure", str(png)]) == 0
    text = capsys.readouterr().out
    assert "cell 2, x = 18.7 mm" in text
    assert "waves, 2 microphones" in text
    assert "Reference Z = 0.948-0.340j" in text
    assert "Z = 0.943-0.348j (95 % interval: R 0.904 to 0.982, X -0.368 to -0.327)" in text
    assert len(csv.read_text().splitlines()) == 1 + 4 + 2 + 3
    assert png.stat().st_size > 10_000
    assert main(["insitu", path, "-o", str(points), "--json", "--quiet"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    (first,) = (row for row in rows if row["place"] == "surface" and row["method"].endswith("pressure first"))
    assert first["distance_to_true"] < 0.01
    assert tl.read_points(points).cell_impedance.shape == (2, 1)


def test_maps_carry_the_in_situ_values(tmp_path, capsys):
    """educe --in-situ: in the table, in the file and back, in the figures."""
    plane, pressure = DATA / "slit_n130_y2.5mm.h5", DATA / "pressure_n130.h5"
    target, folder = tmp_path / "map.h5", tmp_path / "pictures"
    arguments = ["educe", str(plane), "--in-situ", str(pressure), "-o", str(target)]
    assert main([*arguments, "--figure", str(folder), "--quiet"]) == 0
    capsys.readouterr()
    again = tl.read_map(target)
    wanted = tl.in_situ(tl.read_pressure(pressure))
    assert again.alongside[0].name == "in situ (Dean)"
    assert torch.equal(again.alongside[0].cell_impedance, wanted.cell_impedance)
    assert [name for name in known_of([again], 0) if "Dean" in name] == [
        "in situ (Dean), admittance over points",
        "in situ (Dean), pressure first",
    ]
    assert (folder / "along_x.png").exists()
    import h5py

    with h5py.File(target, "a") as file:
        del file["alongside_0"]
    assert tl.read_map(target).alongside == ()
