"""Planes read slab by slab: any layout, and what goes wrong on the way."""

import threading
import time

import h5py
import numpy as np
import pytest
import torch
from conftest import FREQUENCY, plane_of, turbulence

import torchliner as tl
from torchliner.engine import sums
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import Drive
from torchliner.engine.sums import PlaneRecord
from torchliner.records.slabs import bounds_of, read_ahead

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def plane():
    v = turbulence((3, 5, 600), seed=5).to(torch.float32)
    return plane_of(v, x=np.arange(5) * 2e-3, z=np.arange(3) * 2e-3)


@pytest.fixture
def path(plane, tmp_path):
    plane.write(tmp_path / "plane.h5")
    return tmp_path / "plane.h5"


@pytest.fixture(scope="module", params=["educe", "replay"])
def mapped(request, liner):
    """A map by either way, as a function of the plane."""
    if request.param == "educe":
        return lambda plane, **choices: tl.educe(plane, liner, **choices)
    return lambda plane, **choices: tl.replay(plane, liner, FREQUENCY, levels=60, **choices)


def relayout(path, layout):
    """The same plane with the velocity stored in another way."""
    with h5py.File(path, "r+") as file:
        values = file["wall_normal_velocity"][()]
        scales = [file[name] for name in ("time", "z", "x")]
        del file["wall_normal_velocity"]
        extra = {"chunks": (100, 2, 3)} if "chunked" in layout else {}
        if "compressed" in layout:
            extra = {"chunks": (64, 3, 5), "compression": "gzip"}
        if "time last" in layout:
            values, scales = values.transpose(1, 2, 0), [scales[1], scales[2], scales[0]]
            if extra:
                extra["chunks"] = (3, 5, 64)
        if "big endian" in layout:
            values = values.astype(">f4")
        data = file.create_dataset("wall_normal_velocity", data=values, **extra)
        data.attrs["units"] = "cm/s" if "cm" in layout else "m/s"
        for axis, scale in enumerate(scales):
            data.dims[axis].attach_scale(scale)


@pytest.mark.parametrize(
    "layout", ["contiguous", "chunked", "compressed", "time last", "time last compressed", "big endian"]
)
def test_every_layout_gives_the_same_map(mapped, plane, path, layout, monkeypatch):
    """Streamed from a file as from memory, with batches of few samples."""
    relayout(path, layout)
    wanted = mapped(plane)
    monkeypatch.setattr(sums, "ON_CPU", 1000)
    found = mapped(tl.read_plane(path, lazy=True))
    for name in ("admittance", "velocity"):
        away = (found.cells[name].reflection - wanted.cells[name].reflection).abs().max()
        assert float(away) < 3e-7  # float32, in another order in memory
    assert float((found.velocity_rms - wanted.velocity_rms).abs().max()) < 1e-6


class Numbers:
    """A file of running numbers that notes who reads what."""

    shape, dtype = (2, 100), torch.float64

    def __init__(self, fail_at=None):
        self.seen, self.fail_at = [], fail_at

    def read(self, begin, end, out=None):
        self.seen.append((begin, end, threading.current_thread().name))
        if self.fail_at is not None and end > self.fail_at:
            raise OSError("the disk is gone")
        out = out[: end - begin]
        out[:] = torch.arange(begin, end, dtype=self.dtype)[:, None]
        return out


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_slab_lives_while_it_is_worked_on(threads, set_threads, monkeypatch):
    """However slow the work: no buffer is read into before all jobs have seen it."""
    monkeypatch.setattr(sums, "ON_CPU", 0)
    set_threads(threads)
    file = Numbers()
    file.shape, file.load = (2, 3000), lambda: None
    record = PlaneRecord(tl.VelocityPlane(file, sampling_rate=100.0), torch.float64, torch.device("cpu"))

    def slow(weights, columns):
        time.sleep(0.005)
        return sums.linear(weights, columns)

    job = sums.Job(Drive(), slow)
    (found,) = sums.reduce(record, Blocks(tuple(range(0, 3001, 100)), 100.0, 30), [job])
    assert found[:, 0, 0, 0].tolist() == [sum(range(first, first + 100)) for first in range(0, 3000, 100)]


def test_a_reader_that_fails_is_heard():
    """The error of the reading thread comes out where the slab was wanted; no thread is left."""
    file = Numbers(fail_at=50)
    with pytest.raises(OSError, match="the disk is gone"):
        for _ in read_ahead(file, bounds_of(100, 10), torch.device("cpu")):
            pass
    assert not [t for t in threading.enumerate() if t.name.startswith("read-ahead")]
    ahead = read_ahead(Numbers(), bounds_of(100, 10), torch.device("cpu"))
    next(ahead)
    ahead.close()
    assert not [t for t in threading.enumerate() if t.name.startswith("read-ahead")]


def test_a_file_that_shrinks_is_noticed(mapped, path):
    """HDF5 would fill what is gone with zeros; a shorter file is refused instead."""
    lazy = tl.read_plane(path, lazy=True)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 3000)
    with pytest.raises(OSError, match=r"plane\.h5.*shrank from \d+ to \d+ bytes.*nothing of it"):
        mapped(lazy)
