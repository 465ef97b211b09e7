"""Moments by slices: the cut, the bits, workers that end, that lack files, formats or versions."""

from __future__ import annotations

import os
import re
import signal
import socket
import sys
from itertools import pairwise
from types import SimpleNamespace

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from hypothesis import given
from hypothesis import strategies as st
from test_cli import run

import torchliner as tl
from torchliner.campaign import cluster
from torchliner.campaign.kept_parts import KeptParts
from torchliner.io.plane_format import FrameVelocity
from torchliner.tdibc import slices
from torchliner.tdibc.requested import Request
from torchliner.tdibc.slices import moments_in_slices, on_worker, spans_of

SAMPLES = 1500  # 50 periods


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(SAMPLES))
    path = tmp_path_factory.mktemp("slices") / "plane.h5"
    v = (turbulence((40, SAMPLES)) + tone).float()
    plane_of(v, x=1e-3 * torch.arange(40.0), liner="polito").write(path)
    return path


@pytest.fixture
def small(monkeypatch):
    """Five slices of the plane above."""
    monkeypatch.setattr(slices, "SLICE_VALUES", 40 * SAMPLES // 5)


@pytest.fixture(scope="module")
def client():
    with cluster.open_cluster("local:2") as found:
        yield found


@pytest.fixture
def often(small, monkeypatch):
    """What is known is kept after each slice."""
    monkeypatch.setattr(slices, "JOINED", 1)
    monkeypatch.setattr(KeptParts, "due", lambda _: True)


def same_bits(one, other) -> bool:
    """Of two records of moments, but for nothing."""
    pairs = [
        (getattr(a, key), getattr(b, key))
        for a, b in zip(one.sums.groups, other.sums.groups, strict=True)
        for key in ("totals", "of_blocks")
    ]
    seen, there = one.sums.survey, other.sums.survey
    pairs += [(getattr(seen, k), getattr(there, k)) for k in ("mean", "line", "coherence")]
    return all(a is b is None or torch.equal(a, b) for a, b in pairs)


def stored(samples: int, probes: int, tile_rows: int = 1):
    return SimpleNamespace(samples=samples, probes=probes, stored=SimpleNamespace(tile_rows=tile_rows))


@given(
    st.integers(1, 10**7),
    st.integers(1, 10**5),
    st.integers(0, 32),
    st.sampled_from([1, 256, 10**7]),
)
def test_a_cut_covers_the_record(samples, probes, blocks, tile):
    """Each sample once, in order; of no more than its share but for the distance of the places."""
    borders = [i * samples // max(1, blocks) for i in range(blocks + 1)]
    spans = spans_of(stored(samples, probes, tile), sorted(set(borders)))
    assert spans[0][0] == 0
    assert sum(spans[-1]) == samples
    assert all(sum(a) == b[0] for a, b in pairwise(spans))
    assert min(count for _, count in spans) > 0
    assert len(spans) <= max(1, min(samples // tile, -(-samples * probes // slices.SLICE_VALUES)))


def test_few_slices_are_whole_blocks_and_many_whole_sums():
    """So that slices share no block, or no sum in single precision."""
    plane = stored(10**6, 5 * slices.SLICE_VALUES // 10**6)
    assert [low for low, _ in spans_of(plane, range(0, 10**6 + 1, 31250))] == [
        0, 187500, 406250, 593750, 812500,
    ]  # fmt: skip
    assert all(low % 256 == 0 for low, _ in spans_of(plane, [0, 10**6]))


@pytest.mark.parametrize("order", ["probes first", "coherent first"])
def test_slices_answer_as_the_whole(file, small, liner, order):
    """Moments of |v| to the bit; what is periodic to rounding, so R of v* to 1e-7."""
    plane = tl.read_plane(file, lazy=True)
    found = moments_in_slices(plane, Request(cell_pitch=liner.cell_pitch, choices={"order": order}))
    whole = tl.moments(plane, cell_pitch=liner.cell_pitch, order=order)
    assert len(found.sums.groups) == len(whole.sums.groups)
    for mine, theirs in zip(found.sums.groups[:2], whole.sums.groups, strict=False):
        assert torch.equal(mine.totals, theirs.totals)
        assert torch.equal(mine.of_blocks, theirs.of_blocks)
    one, other = (each.educe(liner, order=order).answer for each in (found, whole))
    assert float((one - other).abs().max()) < 1e-7


def test_a_whole_record_of_parts_has_a_file(tmp_path, file, small, liner):
    """Whose rest is empty: 50 whole periods and nothing beyond them."""
    found = moments_in_slices(tl.read_plane(file, lazy=True), Request(cell_pitch=0.01))
    assert found.sums.plan.blocks.borders[-1] == SAMPLES
    found.write(tmp_path / "moments.h5")
    assert same_bits(tl.read_moments(tmp_path / "moments.h5"), found)


@pytest.mark.parametrize(
    "choices",
    [{"phase": "self-consistent"}, {"interval": None}, {"mean": "removed"}, {"window": "hann"},
     {"drive": "rms"}, {"order": "velocity first"}],
    ids=str,
)  # fmt: skip
def test_parts_are_kept_to_the_bit(tmp_path, file, often, monkeypatch, choices):
    """Of what a part may hold nothing is lost in its file; the last slice alone is read again."""
    plane, kept = tl.read_plane(file, lazy=True), KeptParts(tmp_path / "parts")
    request = Request(cell_pitch=0.01, choices=choices)
    seen = []
    first = moments_in_slices(plane, request, kept=kept, progress=seen.append)
    assert sum(seen) == 2 * SAMPLES
    for name in ("first_part", "second_part"):
        whole = getattr(slices, name)
        monkeypatch.setattr(
            slices,
            name,
            lambda plane, span, known, w=whole: seen.append(span) or w(plane, span, known),
        )
    seen.clear()
    assert same_bits(moments_in_slices(plane, request, kept=kept), first)
    assert len(seen) == first.readings
    assert len(list(kept.folder.iterdir())) == first.readings


def test_a_part_that_is_none_is_refused(tmp_path, file, often):
    """Other bytes, and pickles that would run something."""
    plane, kept = tl.read_plane(file, lazy=True), KeptParts(tmp_path)
    path = tmp_path / "reading1.part"
    for content in (b"nothing", torch.ones(2), {"run": os.system}):
        path.write_bytes(content) if isinstance(content, bytes) else torch.save(content, path)
        with pytest.raises(ValueError, match=r"(?s)reading1\.part.*delete it: it is summed again"):
            moments_in_slices(plane, Request(cell_pitch=0.01), kept=kept)


def test_keeping_takes_its_share_at_most(tmp_path, monkeypatch, file):
    """Once a minute, and after fifty times what it took."""
    clock = [0.0]
    monkeypatch.setattr("torchliner.campaign.kept_parts.time.monotonic", lambda: clock[0])
    kept, saved = KeptParts(tmp_path), []

    def save(part, path):
        saved.append(clock[0])
        clock[0] += 2.0
        path.touch()

    monkeypatch.setattr(torch, "save", save)
    for _ in range(400):
        clock[0] += 1.0
        kept.save(1, None)
    assert saved == [60.0, 162.0, 264.0, 366.0]


def test_data_do_not_travel(liner):
    """A plane in memory is refused, before any worker is asked."""
    with pytest.raises(ValueError, match="read that with lazy=True"):
        tl.moments(plane_of(turbulence((2, 600))), client=object())


def test_two_workers_give_the_bits_of_one_machine(file, small, client, liner):
    """In both readings, and through every door."""
    plane = tl.read_plane(file, lazy=True)
    here = moments_in_slices(plane, Request(cell_pitch=liner.cell_pitch))
    there = tl.moments(plane, cell_pitch=liner.cell_pitch, client=client)
    assert same_bits(here, there)
    found = tl.educe(plane, liner, client=client, order="probes first")
    assert torch.equal(found.answer, tl.educe(plane, liner, order="probes first").answer)
    excluded = tl.educe(plane, liner, client=client, missing="exclude")  # one task
    assert torch.equal(excluded.reflection, tl.educe(plane, liner, missing="exclude").reflection)


def test_a_lost_worker_changes_nothing(file, small, client):
    """Killed after the first slice, with others under way on it."""
    plane = tl.read_plane(file, lazy=True)
    before = client.run(os.getpid)
    done = []

    def kill(samples: int) -> None:
        if not done:
            os.kill(next(iter(before.values())), signal.SIGKILL)
        done.append(samples)

    found = tl.moments(plane, cell_pitch=0.01, client=client, progress=kill)
    assert sum(done) == 2 * SAMPLES
    assert same_bits(found, moments_in_slices(plane, Request(cell_pitch=0.01)))
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


def test_planes_of_commands_go_through_a_cluster(capsys, file, monkeypatch, client):
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
