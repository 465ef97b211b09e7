"""Blocks shared out: to workers that end, that lack files, formats or versions; in steps that are kept; by hand."""

from __future__ import annotations

import os
import re
import signal
import socket
import sys
from itertools import pairwise

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st
from test_cli import run

import torchliner as tl
from torchliner.campaign import cluster
from torchliner.engine import workers
from torchliner.engine.workers import on_worker
from torchliner.io.plane_format import FrameVelocity

SAMPLES, PITCH = 1500, 12.44e-3  # 50 periods
EVERY = [{}, {"mean": "removed"}, {"averaging": "velocity"}, {"drive": "rms"}, {"drive": "running-rms"},
         {"phase": "self-consistent"}, {"background_rms": 0.5}]  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(SAMPLES))
    path = tmp_path_factory.mktemp("workers") / "plane.h5"
    v = (turbulence((40, SAMPLES)) + tone).float()
    plane_of(v, x=1e-3 * torch.arange(40.0), liner="polito").write(path)
    return path


@pytest.fixture
def small(monkeypatch):
    """Five shares of the plane above."""
    monkeypatch.setattr(workers, "SHARE", 40 * SAMPLES // 5)


@pytest.fixture(scope="module")
def client():
    with cluster.open_cluster("local:2") as found:
        yield found


@pytest.fixture
def read(monkeypatch):
    """Shares that are read, as they are."""
    seen = []
    whole = workers._rows
    monkeypatch.setattr(workers, "_rows", lambda sent, share: seen.append(list(share)) or whole(sent, share))
    return seen


def same_bits(one, other) -> bool:
    """Of two records of moments."""
    names = ("sums", "squares", "peaks", "gram")
    pairs = [(getattr(one.survey, key), getattr(other.survey, key)) for key in names]
    pairs += [(one.sums[key], other.sums[key]) for key in other.sums]
    return one.sums.keys() == other.sums.keys() and all(torch.equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("choices", EVERY, ids=str)
def test_shares_are_the_bits_of_one_reading(tmp_path, file, small, read, choices):
    """And what is kept is not read again, in both readings; a damaged file is."""
    plane = tl.read_plane(file, lazy=True)
    whole = tl.moments(plane, cell_pitch=PITCH, **choices)
    seen = []
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, kept=tmp_path, progress=seen.append, **choices), whole)
    readings = len(read) // 5
    assert (sum(seen), len(read)) == (readings * SAMPLES, readings * 5)
    read.clear()
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, kept=tmp_path, **choices), whole)
    assert read == []
    next(iter(tmp_path.iterdir())).write_bytes(b"nothing")
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, kept=tmp_path, **choices), whole)
    assert len(read) == 1
    assert not list(tmp_path.glob(".torchliner-*"))


def test_other_questions_are_not_answered_by_what_is_kept(tmp_path, file, small, read):
    """Another liner, precision, drive or cell: all is read."""
    plane, liner = tl.read_plane(file, lazy=True), tl.load_liner("polito")
    asked = [{"liner": liner}, {"cell_pitch": PITCH}, {"cell_pitch": PITCH, "dtype": "float64"}, {"cell_pitch": 0.02},
             {"cell_pitch": PITCH, "drive": "running-rms", "running_window": 1e-3}]  # fmt: skip
    for each in asked:
        read.clear()
        tl.moments(plane, kept=tmp_path, averaging="velocity", **each)
        assert len(read) == 5


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@settings(max_examples=25)
@given(st.lists(st.integers(0, 31), max_size=5), st.sampled_from(EVERY), st.randoms())
def test_any_split_by_hand_gives_the_bits_of_one_reading(cuts, choices, random):
    """Parts in any order; a second reading where the averaging needs one, and notes as of the whole."""
    v = turbulence((6, 960)).float() + torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(960))
    plane = plane_of(v, x=2e-3 * torch.arange(6.0))
    whole = tl.moments(plane, cell_pitch=6e-3, **choices)
    edges = sorted({0, 32, *cuts})
    spans = [range(low, high) for low, high in pairwise(edges)]
    random.shuffle(spans)
    found = tl.Moments.join([tl.moments(plane, cell_pitch=6e-3, blocks=span, **choices) for span in spans])
    second = "phase-locked" in whole.sums or choices.get("mean") == "removed"
    assert (found.only is not None) == second
    if second:
        given = found
        found = tl.Moments.join(
            [tl.moments(plane, cell_pitch=6e-3, blocks=span, given=given, **choices) for span in spans]
        )
    assert found.only is None
    assert same_bits(found, whole)
    assert found.notes == whole.notes
    liner = tl.load_liner("polito").replace(cell_pitch=6e-3)
    assert torch.equal(found.educe(liner, **choices).answer, whole.educe(liner, **choices).answer)


def test_parts_travel_as_files(tmp_path, file):
    """Of an array of jobs: each writes its part; the join of the first reading may be a file, too."""
    plane, liner = tl.read_plane(file, lazy=True), tl.load_liner("polito")
    halves = [range(0, 16), range(16, 32)]

    def job(blocks, given=None):
        path = tmp_path / f"{blocks[0]}.h5"
        tl.moments(plane, liner, blocks=blocks, given=given).write(path)
        return tl.read_moments(path)

    tl.Moments.join([job(half) for half in halves]).write(tmp_path / "given.h5")
    given = tl.read_moments(tmp_path / "given.h5")
    with pytest.raises(ValueError, match=r"holds a part.*as given"):
        given.educe(liner)
    found = tl.Moments.join([job(half, given) for half in halves])
    assert same_bits(found, tl.moments(plane, liner))


def part(blocks, **changed):
    about = {"cell_pitch": None, "averaging": "admittance", "frequency": 1400.0, "v": turbulence((3, 960))} | changed
    v, frequency = about.pop("v"), about.pop("frequency")
    return tl.moments(plane_of(v, frequency=frequency), blocks=blocks, **about)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (lambda: [], "no part is given"),
        (lambda: [part([0, 1]), part(range(1, 32))], "blocks 1 of .* are in several parts"),
        (lambda: [part(range(5)), part(range(7, 32))], "blocks 5, 6 of .* are in no part"),
        (lambda: [part(range(5)), part(range(5, 32), mean="removed")], "mean is kept and removed; reduce all"),
        (lambda: [part(range(5)), part(range(5, 32), averaging="velocity")], "averaging is admittance and velocity"),
        (lambda: [part(range(5)), part(range(5, 30), v=turbulence((3, 930)))], "samples is 960 and 930"),
        (lambda: [part(range(5)), part(range(5, 32), v=turbulence((4, 960)))], r"shapes \(3,\) and \(4,\)"),
        (lambda: [part(range(5)), part(range(5, 32), cell_pitch=0.01)], "cell_pitch is None and 0.01"),
        (lambda: [part(range(5)), part(range(5, 32), frequency=1401.0)], "frequency is 1400.0 and 1401.0"),
        (lambda: part([32]), r"blocks are \[32\]; .* has 32, 0 to 31"),
        (lambda: part([1, 1]), r"blocks are \[1, 1\]"),
        (lambda: part([]), r"blocks are \[\]"),
        (lambda: part([1], missing="exclude"), "a part does not know the faults of others"),
        (lambda: part([1], given=tl.Moments.join([part(range(32))])), "is complete: it needs no second reading"),
        (lambda: part(None, given=part([1])), "given is of parts; name their blocks"),
        (lambda: part([0], v=turbulence((3, 960)).index_fill(1, torch.tensor([7]), torch.nan)), "nan or inf at 3 of 3"),
    ],
)  # fmt: skip
def test_parts_that_do_not_fit_are_refused(parts, words):
    """What differs, overlaps or is missing is named."""
    with pytest.raises(ValueError, match=words):
        tl.Moments.join(parts())


def test_data_do_not_travel(tmp_path):
    """A plane in memory is refused, before any worker is asked."""
    for more in ({"client": object()}, {"kept": tmp_path}):
        with pytest.raises(ValueError, match="read that with lazy=True"):
            tl.moments(plane_of(turbulence((2, 600))), **more)


def test_two_workers_give_the_bits_of_one_machine(file, small, client, liner):
    """In both readings, and with probes that are left out."""
    plane = tl.read_plane(file, lazy=True)
    for choices in ({}, {"missing": "exclude"}):
        here = tl.moments(plane, cell_pitch=liner.cell_pitch, **choices)
        assert same_bits(tl.moments(plane, cell_pitch=liner.cell_pitch, client=client, **choices), here)


def test_a_lost_worker_changes_nothing(file, small, client):
    """Killed after the first share, with others under way on it."""
    plane = tl.read_plane(file, lazy=True)
    before = client.run(os.getpid)
    done = []

    def kill(samples: int) -> None:
        if not done:
            os.kill(next(iter(before.values())), signal.SIGKILL)
        done.append(samples)

    found = tl.moments(plane, cell_pitch=0.01, client=client, progress=kill)
    assert sum(done) == 2 * SAMPLES
    assert same_bits(found, tl.moments(plane, cell_pitch=0.01))
    client.wait_for_workers(2, timeout=60)
    assert set(client.run(os.getpid).values()) != set(before.values())


def test_a_worker_says_what_it_cannot_read(tmp_path, file, small, client):
    """Which path, on which host; a format's library that is not there, by name."""
    path = tmp_path / "gone.h5"
    path.write_bytes(file.read_bytes())
    plane = tl.read_plane(path, lazy=True)
    path.unlink()
    words = rf"worker on {re.escape(socket.gethostname())} .*: {path}: no such file"
    with pytest.raises(FileNotFoundError, match=words):
        tl.moments(plane, client=client)

    def source(begin, end):
        raise ImportError("this format needs zarr; pip install 'torchliner[xarray]'")

    frames = FrameVelocity(source, (40, SAMPLES), "plane.zarr")
    plane = tl.VelocityPlane(frames, sampling_rate=RATE, frequency=FREQUENCY)
    with pytest.raises(ImportError, match=r"worker on \S+ .*needs zarr"):
        tl.moments(plane, client=client)
    with pytest.raises(RuntimeError, match=r"worker on .* has torchliner .*, and 9\.9 asks"):
        on_worker("9.9", len, ())


def test_planes_of_commands_go_through_a_cluster(capsys, file, client):
    """educe and calibrate answer as without one."""
    found = []
    for words in (["educe"], ["calibrate", "--free", "porosity", "--reference", "0.5-0.2j",
                              "--draws", "0"]):  # fmt: skip
        for more in ([], ["--cluster", client.scheduler.address]):
            code, out, err = run(capsys, words[0], str(file), *words[1:], "--quiet", *more)
            assert code in (0, 1), err
            found.append(out.splitlines()[1].split()[:4])
    assert found[0] == found[1]
    assert float(found[2][1]) == pytest.approx(float(found[3][1]), rel=1e-3)


@pytest.mark.parametrize(
    ("where", "kind", "words"),
    [
        ("locl:2", ValueError, "write local:4, tcp://host:8786"),
        ("local:0", ValueError, "cannot be read"),
        ("tcp://127.0.0.1:1", OSError, "no scheduler of dask answers at tcp://127.0.0.1:1 within"),
        ("nowhere.json", FileNotFoundError, "the scheduler writes it when it starts"),
    ],
)
def test_a_cluster_that_is_not_there(monkeypatch, where, kind, words):
    """Said with what would be right; nothing waits for ever."""
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    with pytest.raises(kind, match=re.escape(words)), cluster.open_cluster(where):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    """And no cluster needs none."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with cluster.open_cluster(None) as none:
        assert none is None
    with (
        pytest.raises(ImportError, match=r"torchliner\[cluster\]"),
        cluster.open_cluster("local:1"),
    ):
        pass


def test_a_scheduler_without_workers_is_not_waited_for(monkeypatch):
    """For longer than a while."""
    import distributed

    monkeypatch.setattr(cluster, "PATIENCE", 1)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as none,
        pytest.raises(OSError, match="has no worker within 1 s"),
        cluster.open_cluster(none.scheduler_address),
    ):
        pass
