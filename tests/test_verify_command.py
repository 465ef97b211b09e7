"""``torchliner verify``."""

from __future__ import annotations

import json

from torchliner.cli.main import main
from torchliner.report import verify


def test_all_checks_hold(tmp_path, capsys):
    """Low degrees here; degree 4 is held in test_lee.py."""
    out = tmp_path / "orders.csv"
    assert main(["verify", "--degrees", "1", "2", "--json", "-o", str(out)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(check["passed"] for check in told["checks"])
    assert len(told["orders"]) == 16
    assert told["orders"][3]["error"] < told["orders"][0]["error"] / 50
    assert len(out.read_text().splitlines()) == 17


def test_a_failed_check_is_said_and_counted(capsys, monkeypatch):
    monkeypatch.setattr(verify, "PUBLISHED", 21.5 - 2.5j)
    assert main(["verify", "--degrees", "1"]) == 1
    text = capsys.readouterr().out
    assert "FAILS: dispersion relation against its published value (1/m) 4.37e-02" in text
    assert "holds: rigid-lined-rigid" in text
