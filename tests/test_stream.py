"""Planes read slab by slab: any layout, any memory limit, and what goes wrong on the way."""

from __future__ import annotations

import threading

import h5py
import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, frozen_plane, plane_of, turbulence

import torchliner as tl
from torchliner.records.slabs import WORK_BYTES, bounds_of, read_ahead, rows_per_slab
from torchliner.reduction import readings

ENGINES = ("spectral", "unfold")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def plane():
    v = turbulence((3, 5, 600), seed=5).to(torch.float32)
    return plane_of(v, x=np.arange(5) * 2e-3, z=np.arange(3) * 2e-3)


@pytest.fixture
def path(plane, tmp_path):
    plane.write(tmp_path / "plane.h5")
    return tmp_path / "plane.h5"


@pytest.fixture(scope="module")
def in_memory(plane, liner):
    """The map of the plane by each engine."""
    return {engine: tl.educe(plane, liner, engine=engine) for engine in ENGINES}


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


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "layout",
    ["contiguous", "chunked", "compressed", "time last", "time last compressed", "big endian"],
)
def test_every_layout_gives_the_same_map(liner, in_memory, path, engine, layout):
    """Streamed from a file as from memory, with slabs of a few samples."""
    relayout(path, layout)
    wanted = in_memory[engine]
    lazy = tl.read_plane(path, lazy=True)
    memory = WORK_BYTES + 2 * 4 * (15 + 1) * 37 + (0 if engine == "spectral" else 100_000)
    found = tl.educe(lazy, liner, engine=engine, memory=memory)
    assert float((found.reflection - wanted.reflection).abs().max()) < 1e-6
    assert float((found.velocity_rms - wanted.velocity_rms).abs().max()) < 1e-5
    assert found.choices["memory"] == memory


def test_a_memory_limit_cuts_the_slabs(plane):
    """Rows follow from the limit; one below a slab is refused."""
    assert rows_per_slab(1000, 4, WORK_BYTES + 8000 * 17, most=256) == 17
    assert rows_per_slab(1000, 4, 10**12, most=256) == 256
    with pytest.raises(ValueError, match=r"below one slab: one sample of 1000 probes.*67\.1\d MB"):
        rows_per_slab(1000, 4, WORK_BYTES + 7999)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("memory", [1, "1kB", "60MB"])
def test_a_limit_below_one_slab_is_refused(liner, plane, engine, memory):
    with pytest.raises(ValueError, match=r"below one slab.*raise memory"):
        tl.educe(plane, liner, engine=engine, memory=memory)


@pytest.mark.parametrize("memory", ["many", "-3GB", "2 XB", "1e9MB"])
def test_sizes_that_are_none(liner, plane, memory):
    with pytest.raises(ValueError, match=r"memory is .*; give bytes or a size such as '500MB'"):
        tl.educe(plane, liner, memory=memory)


def test_sizes():
    """kB to TB, binary prefixes, plain bytes."""
    from torchliner.tdibc.choices import Choices

    for text, wanted in (("1.5GB", 15 * 10**8), ("2GiB", 2**31), ("500 MB", 5 * 10**8), (7, 7)):
        assert Choices(memory=text).memory_bytes == wanted


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


def test_the_next_slab_is_read_while_this_one_is_used():
    """One other thread, one slab ahead, two buffers, everything once and in order."""
    file = Numbers()
    found, ahead, places = [], [], set()
    for slab in read_ahead(file, bounds_of(100, 7), torch.device("cpu")):
        found.append(slab.clone())
        ahead.append(len(file.seen) - len(found))
        places.add(slab.data_ptr())
    assert torch.equal(torch.cat(found)[:, 0], torch.arange(100, dtype=torch.float64))
    assert [seen[:2] for seen in file.seen] == bounds_of(100, 7)
    assert len(places) == 2
    assert max(ahead) <= 1
    names = {seen[2] for seen in file.seen}
    assert len(names) == 1
    assert next(iter(names)).startswith("read-ahead")
    assert list(read_ahead(file, [], torch.device("cpu"))) == []


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


@pytest.mark.parametrize("engine", ENGINES)
def test_a_file_that_shrinks_is_noticed(liner, path, engine):
    """HDF5 would fill what is gone with zeros; a shorter file is refused instead."""
    lazy = tl.read_plane(path, lazy=True)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 3000)
    with pytest.raises(OSError, match=r"plane\.h5.*shrank from \d+ to \d+ bytes.*nothing of it"):
        tl.educe(lazy, liner, engine=engine)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("gap", [None, 700])
def test_few_columns_in_long_slabs_are_as_in_short_ones(liner, engine, gap, monkeypatch):
    """The length of the slabs moves no result."""
    v = turbulence((3, 3000), seed=5)
    v += torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(3000)) + 0.4
    if gap is not None:
        v[1, gap] = torch.nan
    plane = plane_of(v)
    choices = {"engine": engine, "phase": "self-consistent", "missing": "exclude"}
    wanted = [FREQUENCY, 1337.0]  # the second does not repeat from segment to segment
    long = tl.educe(plane, liner, wanted, **choices)
    monkeypatch.setattr("torchliner.reduction.probe_velocity.NARROW", 1)
    short = tl.educe(plane, liner, wanted, **choices)
    kept = [0, 2] if gap else [0, 1, 2]
    for name in ("reflection", "coherence", "velocity_amplitude", "velocity_rms"):
        a, b = (getattr(found, name)[kept] for found in (long, short))
        assert float((a - b).abs().max()) < 1e-12, name
    assert torch.isnan(long.reflection.real).sum() == torch.isnan(short.reflection.real).sum()


@pytest.mark.parametrize("error", [torch.OutOfMemoryError, MemoryError, RuntimeError])
def test_a_device_out_of_memory_gets_smaller_slabs(liner, plane, in_memory, monkeypatch, error):
    """Slabs half as long, and a note that says so; other errors are not caught."""
    monkeypatch.setattr("torchliner.reduction.probe_velocity.NARROW", 1)  # slabs as of a wide plane
    real, rows = readings.first_pass, []

    def narrow(velocity, *others):
        first, last = velocity.bounds()[0]
        rows.append(last - first)
        if rows[-1] > 70:
            raise error("CUDA out of memory. Tried to allocate 20 GiB")
        return real(velocity, *others)

    wanted = in_memory["spectral"]
    monkeypatch.setattr(readings, "first_pass", narrow)
    with pytest.warns(tl.DataWarning, match="memory with slabs of 600 samples; slabs of 37"):
        found = tl.educe(plane, liner)
    assert rows == [600, 300, 150, 75, 37]
    assert sum("ran out of memory" in note for note in found.notes) == 1
    assert float((found.reflection - wanted.reflection).abs().max()) < 1e-6

    def hopeless(*_):
        raise error("DefaultCPUAllocator: can't allocate memory")

    monkeypatch.setattr(readings, "first_pass", hopeless)
    with pytest.raises(RuntimeError, match="out of memory even with slabs of one sample of 16"):
        tl.educe(plane, liner)

    def broken(*_):
        raise RuntimeError("something else")

    monkeypatch.setattr(readings, "first_pass", broken)
    with pytest.raises(RuntimeError, match="something else"):
        tl.educe(plane, liner)


@pytest.mark.parametrize("engine", [*ENGINES, "direct"])
def test_strides_do_not_matter(liner, engine):
    """Transposed, stepped and zero-stride tensors give what their copies give."""
    v = turbulence((6, 300), seed=8)
    options = {"engine": engine, "allow_short": True, "levels": 40, "interval": None}
    for view in (
        v.T.contiguous().T,
        v[::2],
        v[:, ::3],
        v[:1].expand(4, 300),
        v[0].expand(2, 2, 300),
    ):
        wanted = tl.educe(plane_of(view.clone(), sampling_rate=RATE), liner, **options)
        found = tl.educe(plane_of(view), liner, **options)
        assert float((found.reflection - wanted.reflection).abs().max()) < 1e-12
    still = torch.tensor(2.0, dtype=torch.float64).expand(2, 480)
    assert tl.educe(plane_of(still), liner, engine=engine).reflection.shape == (2, 1)


@pytest.mark.parametrize(
    "kind",
    [torch.complex64, torch.complex128, torch.int16, torch.int64, torch.bfloat16, torch.bool],
)
def test_kinds_that_are_no_velocity(kind):
    """Complex, integer and half-precision velocity is refused by name."""
    with pytest.raises(TypeError, match="float32 or float64"):
        plane_of(torch.ones(2, 480).to(kind))


def test_a_plane_in_memory_is_not_changed(liner, plane):
    """No engine writes into its input."""
    before = plane.velocity.clone()
    for engine in ENGINES:
        tl.educe(plane, liner, engine=engine, mean="removed")
    assert torch.equal(plane.velocity, before)


@pytest.mark.parametrize("engine", [*ENGINES, "direct"])
def test_several_planes_share_their_tables(liner, engine, monkeypatch):
    """One call for several heights: one table, if any, and each map as with the common levels."""
    planes = [plane_of(s * turbulence((2, 300), seed=i)) for i, s in enumerate((1.0, 0.2, 2.0))]
    from torchliner.tdibc import prepare

    built = []
    real = prepare.build_kernels
    monkeypatch.setattr(prepare, "build_kernels", lambda *a, **k: built.append(1) or real(*a, **k))
    maps = tl.educe(planes, liner, engine=engine)
    assert len(built) == (engine != "spectral")
    top = maps[0].choices["velocity_max"]
    assert all(found.choices["velocity_max"] == top for found in maps)
    for plane, found in zip(planes, maps, strict=True):
        alone = tl.educe(plane, liner, engine=engine, velocity_max=top)
        assert torch.equal(found.reflection, alone.reflection)
    with pytest.raises(ValueError, match="no plane"):
        tl.educe([], liner)
    with pytest.raises(TypeError, match="plane is int"):
        tl.educe([planes[0], 3], liner)


@pytest.mark.parametrize("engine", ["spectral", "unfold", "direct"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_frozen_velocity_returns_the_liner(liner, engine, dtype):
    """The law of all engines, through the public door: Z of the model, but for the kernel."""
    found = tl.educe(frozen_plane(2.0, dtype=dtype), liner, engine=engine)
    wanted = liner.impedance(FREQUENCY, 2.0)
    limit = {"spectral": 1e-9, "unfold": 3e-6, "direct": 3e-6}[engine]
    limit = max(limit, 2e-5) if dtype == torch.float32 else limit
    assert float((found.impedance / wanted - 1).abs().max()) < limit


def test_engines_agree_through_the_public_door(liner):
    """``unfold`` is ``direct``; ``spectral`` of the kernel's response too, in a periodic record."""
    plane = plane_of(turbulence((3, 600), seed=11))
    periodic = {"edge": "wrap", "window": "hann", "levels": 2000}
    wanted = tl.educe(plane, liner, [1400.0, 2100.0], engine="direct", **periodic).reflection
    for options, limit in (({"engine": "unfold"}, 1e-10), ({"response": "kernel"}, 3e-9)):
        found = tl.educe(plane, liner, [1400.0, 2100.0], **options, **periodic).reflection
        assert float((found - wanted).abs().max()) < limit
