"""Blocks shared out: to workers that end, that lack files, formats or versions; in steps that are kept."""

import dataclasses
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import distributed
import pytest
import torch
from conftest import EVERY, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.campaign import workers
from torchliner.campaign.workers import on_worker, open_cluster, share_out
from torchliner.engine.drives import Drive
from torchliner.engine.sums import Job, linear
from torchliner.io.plane_format import Stored
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of

SAMPLES, PITCH = 1500, 12.44e-3  # 50 periods


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
    with open_cluster("local:2") as found:
        yield found


@pytest.fixture
def read(monkeypatch):
    """Shares that are read, as they are."""
    seen = []
    whole = workers._rows
    monkeypatch.setattr(workers, "_rows", lambda sent, share: seen.append(share) or whole(sent, share))
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
    seen, run = [], share_out(kept=tmp_path)
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, run=run, progress=seen.append, **choices), whole)
    readings = len(read) // 5
    assert (sum(seen), len(read)) == (readings * SAMPLES, readings * 5)
    read.clear()
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, run=run, **choices), whole)
    assert read == []
    next(iter(tmp_path.iterdir())).write_bytes(b"nothing")
    assert same_bits(tl.moments(plane, cell_pitch=PITCH, run=run, **choices), whole)
    assert len(read) == 1
    assert not list(tmp_path.glob(".torchliner-*"))


def test_a_share_is_of_its_drive_and_probes(tmp_path, file, small, read):
    """A later reading with another drive, or without other probes, takes no share of this one."""
    run, plane = share_out(kept=tmp_path), tl.read_plane(file, lazy=True)
    reading = reading_of(plane, [], None, Choices(), cell_pitch=PITCH)
    without = reading.without(torch.arange(40) == 3)
    drives = [Drive(taken=torch.full((1, 40), taken)) for taken in (0.0, 1.0)]
    for number, each in enumerate([reading, without], 1):
        each.run(each.jobs(), run)
        assert len(read) == 5 * number
    for number, drive in enumerate([*drives, dataclasses.replace(drives[0], scale=torch.full((40,), 0.5))], 3):
        reading.run({"phase-locked": Job(drive, linear)}, run)
        assert len(read) == 5 * number


def test_data_do_not_travel(tmp_path):
    for run in (share_out(object()), share_out(kept=tmp_path)):
        with pytest.raises(ValueError, match="read its file with lazy=True"):
            tl.moments(plane_of(turbulence((2, 600))), run=run)


def test_two_workers_give_the_bits_of_one_machine(file, small, client, liner):
    plane = tl.read_plane(file, lazy=True)
    for choices in ({}, {"missing": "exclude"}):
        here = tl.moments(plane, cell_pitch=liner.cell_pitch, **choices)
        assert same_bits(tl.moments(plane, cell_pitch=liner.cell_pitch, run=share_out(client), **choices), here)


def test_a_lost_worker_changes_nothing(file, small, client):
    """Killed after the first share, with others under way on it."""
    plane = tl.read_plane(file, lazy=True)
    before = client.run(os.getpid)
    done = []

    def kill(samples: int) -> None:
        if not done:
            os.kill(next(iter(before.values())), signal.SIGKILL)
        done.append(samples)

    found = tl.moments(plane, cell_pitch=0.01, run=share_out(client), progress=kill)
    assert sum(done) == 2 * SAMPLES
    assert same_bits(found, tl.moments(plane, cell_pitch=0.01))
    client.wait_for_workers(2, timeout=60)
    assert set(client.run(os.getpid).values()) != set(before.values())


def test_a_worker_says_what_it_cannot_read(tmp_path, file, small, client):
    path = tmp_path / "gone.h5"
    path.write_bytes(file.read_bytes())
    plane = tl.read_plane(path, lazy=True)
    path.unlink()
    with pytest.raises(FileNotFoundError, match=re.escape(str(path))):
        tl.moments(plane, run=share_out(client))

    class Unreadable(Stored):
        shape, dtype, label = (40, SAMPLES), torch.float32, "plane.zarr"

        def fill(self, begin, end, out):
            raise ImportError("this format needs zarr; pip install 'torchliner[zarr]'")

    plane = tl.VelocityPlane(Unreadable(), sampling_rate=RATE, frequency=FREQUENCY)
    with pytest.raises(ImportError, match=rf"worker on {re.escape(socket.gethostname())} .*needs zarr"):
        tl.moments(plane, run=share_out(client))
    with pytest.raises(RuntimeError, match=r"worker on .* has torchliner .*, and 9\.9 asks"):
        on_worker("9.9", (), [])


@pytest.mark.parametrize(
    ("where", "kind", "words"),
    [
        ("locl:2", ValueError, "write local:4, tcp://host:8786"),
        ("local:0", ValueError, "write local:4"),
        ("tcp://127.0.0.1:1", OSError, "no scheduler of dask answers at tcp://127.0.0.1:1 within"),
        ("nowhere.json", OSError, "no scheduler of dask answers at nowhere.json within 1 s ([Errno 2] No such file"),
    ],
)
def test_a_cluster_that_is_not_there(where, kind, words):
    with pytest.raises(kind, match=re.escape(words)), open_cluster(where, wait=1):
        pass


def test_workers_come_when_there_is_work(file):
    """A cluster that adapts starts its first worker for tasks that wait; without any the wait ends."""
    plane = tl.read_plane(file, lazy=True)
    with distributed.LocalCluster(n_workers=0, threads_per_worker=1, dashboard_address=":0") as own:
        with (
            open_cluster(own.scheduler_address, wait=1) as client,
            pytest.raises(OSError, match=r"has no worker within 1 s.*--wait"),
        ):
            tl.moments(plane, run=share_out(client))
        own.adapt(maximum=2)
        with open_cluster(own.scheduler_address, wait=60) as client:
            found = tl.moments(plane, cell_pitch=PITCH, run=share_out(client))
            assert same_bits(found, tl.moments(plane, cell_pitch=PITCH))


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["scheduler", "worker"])
def test_what_is_lost_is_said_and_nothing_waits_for_ever(tmp_path, file, lost):
    """The scheduler between two shares; the only worker in the middle of one."""
    where = tmp_path / "scheduler.json"

    class Slow(Stored):
        shape, dtype, label = (40, SAMPLES), torch.float32, "plane.slow"

        def fill(self, begin, end, out):
            time.sleep(60)

    def started(kind: str, *words: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--scheduler-file", str(where)]
        return subprocess.Popen([*command, "--no-dashboard", *words], stderr=subprocess.DEVNULL)

    with (
        started("scheduler", "--host", "127.0.0.1", "--port", "0") as scheduler,
        started("worker", "--nthreads", "1", "--no-nanny") as worker,
    ):
        try:
            while not where.exists():
                assert scheduler.poll() is None
                time.sleep(0.05)
            with open_cluster(str(where), wait=5) as client:
                client.wait_for_workers(1, timeout=60)
                if lost == "scheduler":
                    plane, words = tl.read_plane(file, lazy=True), "the scheduler of dask is gone.*start it again"
                else:
                    plane = tl.VelocityPlane(Slow(), sampling_rate=RATE, frequency=FREQUENCY)
                    words = "has no worker within 5 s"
                    threading.Timer(2, worker.kill).start()
                with pytest.raises(OSError, match=words):
                    tl.moments(plane, run=share_out(client), progress=lambda _: scheduler.kill())
        finally:
            scheduler.kill()
            worker.kill()
