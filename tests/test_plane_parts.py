"""Restarts joined in time, parts of planes, and the conversion that streams."""

from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from test_plane_file import make_plane

import torchliner as tl
from torchliner.cli.main import main
from torchliner.io.plane_parts import join_planes, select

RATE, V = 50e3, "wall_normal_velocity"
WHOLE = make_plane(samples=60, x=[0.0, 0.001, 0.002, 0.003], z=[0.0, 0.01, 0.02], start=0.5)


def piece(low, high, **changes):
    """Samples of the whole, on its clock."""
    plane = replace(WHOLE, velocity=WHOLE.velocity[..., low:high].clone(), start=0.5 + low / RATE)
    return replace(plane, **changes)


def files(folder, cuts, **changes):
    """Restarts of one run, one file each; names that do not sort in time."""
    for number, (low, high) in enumerate(cuts):
        piece(low, high, **changes).write(folder / f"run_{9 - number}.h5")
    return str(folder / "run_*.h5")


def test_restarts_are_one_plane(tmp_path):
    pattern = files(tmp_path, [(0, 20), (20, 45), (45, 60)])
    found, lazy = tl.read_plane(pattern), tl.read_plane(sorted(tmp_path.iterdir()), lazy=True)
    assert torch.equal(found.velocity, WHOLE.velocity)
    assert (found.start, found.sampling_rate) == (0.5, pytest.approx(RATE))
    for low, high in ((0, 60), (18, 47), (44, 46), (59, 99)):
        assert torch.equal(lazy.read(low, high), WHOLE.read(low, high))
    assert [each["samples"] for each in found.provenance["joined"]] == [20, 25, 15]
    assert found.provenance["overlaps"] == []
    with pytest.raises(ValueError, match="list of plane files is empty"):
        tl.read_plane([])


@settings(max_examples=40)
@given(st.lists(st.integers(1, 59), min_size=1, max_size=4), st.integers(0, 5), st.randoms())
def test_any_cuts_and_overlaps_join_to_the_whole(cuts, more, random):
    borders = [0, *sorted(set(cuts)), 60]
    pieces = [piece(low, min(60, high + more)) for low, high in pairwise(borders)]
    random.shuffle(pieces)
    if more:
        with pytest.warns(tl.DataWarning, match="stand in .* too, and count once"):
            found = join_planes(pieces)
    else:
        found = join_planes(pieces)
    assert torch.equal(found.load().velocity, WHOLE.velocity)


def test_an_overlap_must_agree_and_is_said(tmp_path):
    """Equal samples count once; others are refused with place and size; nan equals nan."""
    with pytest.warns(tl.DataWarning, match=r"5 samples of .*run_8.h5.* stand in .*run_9.h5"):
        found = tl.read_plane(files(tmp_path, [(0, 30), (25, 60)]))
    assert torch.equal(found.velocity, WHOLE.velocity)
    other = piece(25, 60)
    other.velocity[1, 2, 3] += 0.25
    with pytest.raises(ValueError, match=r"5 samples .* up to 0.25 m/s"):
        join_planes([piece(0, 30), other])
    hole = piece(25, 60)
    hole.velocity[1, 2, 3] = torch.nan
    with pytest.raises(ValueError, match="differ by up to inf m/s"):
        join_planes([piece(0, 30), hole])
    both = piece(0, 30)
    both.velocity[1, 2, 28] = torch.nan
    with pytest.warns(tl.DataWarning, match="count once"):
        assert bool(join_planes([both, hole]).load().velocity[1, 2, 28].isnan())
    with pytest.raises(ValueError, match="does the second count from 0 again"):
        join_planes([piece(0, 30), replace(piece(30, 60), start=0.5)])


def dated(path, low, high, units, first):
    """Samples of the whole, 1 ms apart, whose times count from an epoch."""
    with h5py.File(path, "w") as file:
        file["time"] = first + np.arange(high - low) * (1_000_000 if units.startswith("ns") else 1e-3)
        file["time"].make_scale("time")
        file[V] = WHOLE.velocity[..., low:high].movedim(-1, 0).numpy()
        file[V].dims[0].attach_scale(file["time"])
        file[V].attrs["units"] = "m/s"
        file["time"].attrs["units"] = units
    return path


def test_restarts_with_one_epoch_are_joined(tmp_path):
    one = dated(tmp_path / "a.h5", 0, 20, "ns since 1970-01-01", 1_704_067_259_980_000_000)
    two = dated(tmp_path / "b.h5", 20, 60, "s since 1970-01-01", 1_704_067_260.0)
    found = tl.read_plane([two, one])
    assert torch.equal(found.velocity, WHOLE.velocity)
    assert found.start == pytest.approx(1_704_067_259.98)
    for units, first, message in (
        ("s since 2024-01-01", 0.0, "samples of .* are missing"),
        ("s since 1970-01-01", 1_704_067_261.0, "1000 samples of .* are missing"),
    ):
        with pytest.raises(ValueError, match=message):
            tl.read_plane([one, dated(tmp_path / "c.h5", 20, 60, units, first)])


FAULTS = {
    "gap": ({}, (35, 60), r"5 samples of 2e-05 s are missing between velocity and"),
    "rate": ({"sampling_rate": 51e3}, (30, 60), "two time bases: they are at 50000 and 51000 Hz"),
    "clock": ({"start": 0.5 + 30.4 / RATE}, (30, 60), "two time bases.* begins 30.4 samples later"),
    "places": ({"x": [0.0, 0.001, 0.002, 0.004]}, (30, 60), "other shapes or places"),
    "no places": ({"x": None}, (30, 60), "other shapes or places"),
    "case": ({"mach": 0.2}, (30, 60), "not one case: mach is None and 0.2"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_what_is_not_one_run_is_refused(kind):
    changes, (low, high), message = FAULTS[kind]
    with pytest.raises(ValueError, match=message):
        join_planes([piece(0, 30), piece(low, high, **changes)])


def test_other_probes_and_a_glob_of_nothing(tmp_path):
    with pytest.raises(ValueError, match="other shapes or places"):
        join_planes([WHOLE, make_plane((2,), 60, start=0.7)])
    files(tmp_path, [(0, 60)])
    with pytest.raises(FileNotFoundError, match=r"ran_\*.h5: no file matches"):
        tl.read_plane(tmp_path / "ran_*.h5")


@settings(max_examples=25)
@given(st.integers(0, 59), st.integers(1, 60), st.booleans())
def test_a_stretch_of_time_is_that_of_the_array(tmp_path_factory, low, length, lazy):
    """start and stop, in memory and in the file, on the clock of the data."""
    path = tmp_path_factory.getbasetemp() / "whole.h5"
    if not path.exists():
        WHOLE.write(path)
    high = min(60, low + length)
    times = {"start": 0.5 + low / RATE, "stop": 0.5 + high / RATE}
    found = tl.read_plane(path, lazy, **times).load()
    wanted = WHOLE.velocity[..., low:high]
    assert torch.equal(found.velocity, wanted)
    assert found.start == pytest.approx(0.5 + low / RATE)
    assert torch.equal(select(WHOLE, **times).velocity, wanted)


def test_a_stretch_without_samples_is_refused():
    for times, message in (
        ({"start": 0.7}, "0.7 to inf s; it runs from 0.5 to 0.50118 s"),
        ({"stop": 0.4}, "0.5 to 0.4 s"),
    ):
        with pytest.raises(ValueError, match=f"no sample from {message}"):
            select(WHOLE, **times)


def test_convert_takes_any_format(tmp_path, capsys):
    pattern, out = files(tmp_path, [(0, 20), (20, 60)]), tmp_path / "out.h5"
    assert main(["convert", pattern, "-o", str(out), "--start", "0.5002", "--quiet"]) == 0
    assert torch.equal(tl.read_plane(out).velocity, WHOLE.velocity[..., 10:])
    capsys.readouterr()
    assert main(["info", pattern, "--json"]) == 0
    assert '"format": "HDF5 or netCDF-4"' in capsys.readouterr().out
    assert main(["info", str(tmp_path / "none_*.h5")]) == 2
    assert "none_*.h5: no such file" in capsys.readouterr().err
