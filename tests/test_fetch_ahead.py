"""Inputs that are looked at and asked for while Python imports."""

from __future__ import annotations

import os

import pytest

from torchliner.cli import fetch_ahead


@pytest.fixture
def asked(monkeypatch):
    """Beginnings of the ranges that the system is asked for."""
    found: list[int] = []
    monkeypatch.setattr(os, "posix_fadvise", lambda _file, begin, _size, _advice: found.append(begin), raising=False)
    monkeypatch.setattr(os, "POSIX_FADV_WILLNEED", 3, raising=False)
    return found


@pytest.fixture
def large(tmp_path):
    path = tmp_path / "plane.bin"
    with path.open("wb") as file:
        file.truncate(2 * fetch_ahead.SMALLEST)
    return str(path)


def test_nothing_is_fetched_once_torch_is_there(large, asked, monkeypatch):
    """Small reads here and there, with which commands begin, would wait behind large ones."""
    fetch_ahead._ahead([large])
    assert asked == []  # these tests import torch
    monkeypatch.setattr(fetch_ahead, "_torch_is_to_come", lambda: len(asked) < 3)
    fetch_ahead._ahead([large])
    assert asked == [i * fetch_ahead.CHUNK for i in range(3)]


def test_no_more_than_is_worth_it(large, asked, monkeypatch):
    monkeypatch.setattr(fetch_ahead, "_torch_is_to_come", lambda: True)
    monkeypatch.setattr(fetch_ahead, "MOST", 3 * fetch_ahead.CHUNK)
    fetch_ahead._ahead([large, large])
    assert len(asked) == 3


@pytest.mark.parametrize("names", [["\0"], [""], ["."], ["there is none.h5"], [f"{'x' * 5000}.h5"]])
def test_names_of_no_file_are_left_to_the_command(names, asked, monkeypatch):
    monkeypatch.setattr(fetch_ahead, "_torch_is_to_come", lambda: True)
    fetch_ahead._ahead(names)
    assert asked == []
