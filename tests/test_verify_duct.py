"""``scripts/verify_duct.py``: its checks hold, and one that does not is said and counted."""

from __future__ import annotations

import itertools
import math

import pytest

import verify_duct as verify


def test_checks_hold_and_fail(capsys, monkeypatch):
    """Degree 1 here; test_lee.py holds the others."""
    assert verify.main(["--degrees", "1"]) == 0
    assert "holds: rigid-lined-rigid" in capsys.readouterr().out
    monkeypatch.setattr(verify, "PUBLISHED", 21.5 - 2.5j)
    monkeypatch.setattr(verify, "order_table", lambda *_: [])
    assert verify.main(["--degrees", "1"]) == 1
    assert "FAILS: dispersion relation against its published value (1/m) 4.37e-02" in capsys.readouterr().out


def test_an_error_that_grows_is_no_order():
    """Refined once too often: the last step counts, not the last good one."""
    errors = [1e-1, 2.5e-2, 6e-3, 5e-2]
    orders = [math.nan, *(math.log2(a / b) for a, b in itertools.pairwise(errors))]
    rows = [
        {"flow": "no flow", "degree": 1, "error": error, "order": order}
        for error, order in zip(errors, orders, strict=True)
    ]

    def first(some):
        return next(check for check in verify.checks(some) if "no flow" in check["check"])

    assert first(rows[:3])["passed"]
    assert first(rows)["value"] == pytest.approx(2 + math.log2(5e-2 / 6e-3))
    assert not first(rows)["passed"]
    below = {"flow": "no flow", "degree": 1, "error": 5e-12, "order": -3.0}
    assert first([*rows[:3], below])["passed"]
