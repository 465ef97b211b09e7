"""``torchliner verify``."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
import torch

from oracles.mode_matching import match_modes
from torchliner.cli.main import main
from torchliner.lee import verification as verify


@pytest.fixture(scope="module")
def rows():
    """Low degrees here; test_lee.py holds degrees 3 and 4."""
    return verify.order_rows([1, 2])


@pytest.fixture(autouse=True)
def solved_once(rows, monkeypatch):
    """The command takes the rows of the degrees that it asks for from those solved here."""
    monkeypatch.setattr(verify, "order_rows", lambda degrees: [row for row in rows if row["degree"] in degrees])


def test_all_checks_hold(tmp_path, capsys):
    """As JSON and CSV."""
    out = tmp_path / "orders.csv"
    assert main(["verify", "--degrees", "1", "2", "--json", "-o", str(out)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(check["passed"] for check in told["checks"])
    assert len(told["orders"]) == 16
    assert told["orders"][3]["error"] < told["orders"][0]["error"] / 50
    assert len(out.read_text().splitlines()) == 17


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


def test_the_matched_modes_are_those_of_the_oracle():
    """The stored wall pressure is what 40 matched modes give."""
    both = match_modes(verify.HEIGHT, (0.0, 0.15), verify.FREQUENCY, verify.TRUE, modes=40)
    matched = both.fields(np.linspace(-0.05, 0.2, 26), verify.HEIGHT)[0]
    stored = torch.tensor(verify.MATCHED, dtype=torch.complex128)
    assert float((matched - stored).abs().max()) < 1e-12


def test_the_ending_is_checked_first(capsys):
    assert main(["verify", "-o", "x.txt"]) == 2
    assert "--output x.txt ends in '.txt'; it must be one of .csv" in capsys.readouterr().err


def test_a_failed_check_is_said_and_counted(capsys, monkeypatch):
    monkeypatch.setattr(verify, "PUBLISHED", 21.5 - 2.5j)
    assert main(["verify", "--degrees", "1"]) == 1
    text = capsys.readouterr().out
    assert "FAILS: dispersion relation against its published value (1/m) 4.37e-02" in text
    assert "holds: rigid-lined-rigid" in text
