"""``torchliner ldv educe``: from a folder of burst files to a line file, and back after a break."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
import torch
from test_burst_files import write_burst_csv
from test_station_references import drifting
from test_stations import station

import torchliner as tl
from torchliner.bursts import line as bursts_module
from torchliner.cli.main import main

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
SHORT = ["--segment", "0.04", "--liner", "onera"]


def write_folder(place, stations):
    place.mkdir()
    for seed in range(stations):
        write_burst_csv(station(seed, seconds=0.2), place / f"p{seed}.csv")
    return place


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three stations, only read by the tests."""
    return write_folder(tmp_path_factory.mktemp("bursts") / "line", 3)


@pytest.fixture(scope="module")
def known(folder):
    """The line that Python finds in the folder."""
    return tl.educe_bursts(folder, tl.load_liner("onera"), segment=0.04)


def run(*words):
    return main(["ldv", "educe", *[str(word) for word in words], *SHORT])


def test_one_command_from_files_to_numbers(folder, known, tmp_path, capsys):
    """Table, JSON, netCDF-4, CSV and picture agree with the one Python call."""
    out = tmp_path / "line.h5"
    assert run(folder, "-o", out, "--figure", tmp_path / "line.png", "--json", "--quiet") == 0
    found = json.loads(capsys.readouterr().out)
    line = tl.read_line(out)
    assert torch.equal(line.impedance, known.impedance)
    row = found["rows"][0]
    assert row["impedance"]["resistance"] == float(known.average.impedance[0].real)
    assert row["spread"]["reactance"] == float(known.average.spatial_spread[0].imag)
    assert [row["station"] for row in found["stations"]] == ["s0", "s1", "s2"]
    assert found["stations"][2]["x"] == 0.02
    assert (tmp_path / "line.png").stat().st_size > 5000
    assert not (tmp_path / "line.h5.parts").exists()
    assert run(folder, "-o", tmp_path / "line.csv", "--quiet") == 0
    rows = (tmp_path / "line.csv").read_text().splitlines()
    assert len(rows) == 4
    assert "segment_spread_resistance" in rows[0]
    assert "resistance_low" in rows[0]


def counted(monkeypatch, fail_at=None):
    """How many stations were educed anew; optionally the power fails at one."""
    real, seen = bursts_module.educe_station, []

    def educe_station(record, *arguments):
        if len(seen) == fail_at:
            raise KeyboardInterrupt
        seen.append(record.title)
        return real(record, *arguments)

    monkeypatch.setattr(bursts_module, "educe_station", educe_station)
    return seen


def test_a_broken_run_goes_on_where_it_stopped(folder, known, tmp_path, monkeypatch, capsys):
    """Finished stations are taken up, bit for bit; then the parts are gone."""
    out = tmp_path / "line.h5"
    counted(monkeypatch, fail_at=2)
    assert run(folder, "-o", out, "--quiet") == 130
    assert "interrupted" in capsys.readouterr().err
    assert len(list((tmp_path / "line.h5.parts").glob("*.h5"))) == 2
    assert not out.exists()
    monkeypatch.undo()
    seen = counted(monkeypatch)
    assert run(folder, "-o", out) == 0
    assert "holds 2 finished stations" in capsys.readouterr().err
    assert seen == ["s2"]
    assert torch.equal(tl.read_line(out).reflection, known.reflection)
    assert not (tmp_path / "line.h5.parts").exists()


def test_parts_of_other_data_or_choices_are_not_taken_up(tmp_path, monkeypatch):
    folder = write_folder(tmp_path / "line", 1)
    parts, liner = tmp_path / "parts", tl.load_liner("onera")
    seen = counted(monkeypatch)

    def educe(source=folder, **choices):
        """Titles of the stations that were educed anew."""
        seen.clear()
        tl.educe_bursts(source, choices.pop("liner", liner), parts=parts, **{"segment": 0.04, **choices})
        return list(seen)

    assert educe() == ["s0"]
    assert educe() == []
    assert educe(phase="self-consistent") == ["s0"]
    assert educe(phase="given", reference_phase=0.1) == ["s0"]
    assert educe(phase="given", reference_phase=0.2) == ["s0"]
    assert educe(segment=0.05) == ["s0"]
    assert educe(liner=tl.load_liner("polito")) == ["s0"]
    assert educe(filters=tl.BurstFilters(outliers=5.0)) == ["s0"]
    write_burst_csv(station(1, seconds=0.2), folder / "p1.csv")
    assert educe() == ["s1"]
    write_burst_csv(station(7, seconds=0.2, x=0.01), folder / "p1.csv")
    assert educe() == ["s7"]
    records = [station(seed, seconds=0.2) for seed in range(2)]
    assert educe(records) == ["s0", "s1"]
    assert educe(records) == []


def test_references_from_a_folder(tmp_path, capsys):
    """A recording a station, of its file's name, on the clock that --reference-start states."""
    record, channel = drifting(1)
    place, recordings = tmp_path / "line", tmp_path / "loud"
    place.mkdir()
    recordings.mkdir()
    write_burst_csv(record, place / "a.csv")
    words = [place, "--reference", recordings, "--reference-rate", 40e3, "--quiet"]
    assert run(*words) == 2
    assert "loud holds no recording a{.npy,.wav,.mat,.h5} for" in capsys.readouterr().err
    np.save(recordings / "a.npy", channel.values.numpy())
    assert run(*words, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["stations"][0]["coherence"] > 0.8
    assert found["choices"]["referred"] is True
    assert run(*words, "--reference-start", -0.3) == 2
    assert "the velocity from" in capsys.readouterr().err
    assert run(place, "--reference", tmp_path / "none.npy") == 2
    assert "no such file" in capsys.readouterr().err


def test_parts_that_are_damaged_or_none_are_made_anew(tmp_path, monkeypatch):
    """Cut off, under the name of another, or without a variable: the station is educed again, the others are not."""
    folder, parts, liner = write_folder(tmp_path / "line", 2), tmp_path / "parts", tl.load_liner("onera")
    wanted = tl.educe_bursts(folder, liner, parts=parts, segment=0.04).reflection
    first, second = sorted(parts.iterdir())
    whole, seen = first.read_bytes(), counted(monkeypatch)
    for count, damaged in enumerate((whole[:2000], second.read_bytes(), whole), 1):
        first.write_bytes(damaged)
        if damaged is whole:
            with h5py.File(first, "r+") as file:
                del file["grid_rate"]
        assert torch.equal(tl.educe_bursts(folder, liner, parts=parts, segment=0.04).reflection, wanted)
        assert len(seen) == count
