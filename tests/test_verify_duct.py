"""``scripts/verify_duct.py``: its checks hold, and one that does not is said and counted."""

from __future__ import annotations

import verify_duct as verify


def test_checks_hold_and_fail(capsys, monkeypatch):
    """Degree 1 here; test_lee.py holds the others."""
    assert verify.main(["--degrees", "1"]) == 0
    assert "holds: rigid-lined-rigid" in capsys.readouterr().out
    monkeypatch.setattr(verify, "PUBLISHED", 21.5 - 2.5j)
    monkeypatch.setattr(verify, "order_table", lambda *_: [])
    assert verify.main(["--degrees", "1"]) == 1
    assert "FAILS: dispersion relation against its published value (1/m) 4.37e-02" in capsys.readouterr().out
