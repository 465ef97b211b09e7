"""The in situ method from the command line, beside the educed maps and in figures."""

from __future__ import annotations

import torch
from conftest import DATA

import torchliner as tl
from torchliner.cli.main import main
from torchliner.report.studies import known_of


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
