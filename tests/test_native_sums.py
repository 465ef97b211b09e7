"""Moments and lines of a slab: compiled and in torch, against float64 and against each other."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pytest
import torch
from conftest import in_fork
from hypothesis import given, settings
from hypothesis import strategies as st

from torchliner.compiled import library
from torchliner.reduction import eager, native
from torchliner.reduction.eager import Lines, Speeds
from torchliner.reduction.sources import Taken

CENTRE = 0.9375  # m/s, a float32
BUILT = library.available()
needs_native = pytest.mark.skipif(not BUILT, reason=str(library.reason))
WAYS = [eager, pytest.param(native, marks=needs_native)]


def plane(length, columns, dtype=torch.float32, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return 2 * torch.randn(length, columns, generator=generator, dtype=dtype)


def weight_rows(length, dtype=torch.float32):
    angle = 0.0879 * torch.arange(length, dtype=torch.float64)
    return torch.stack([angle.cos(), angle.sin()]).to(dtype)


def table(*pieces):
    """Low, high and block of each."""
    return np.array(pieces, dtype=np.int64).reshape(-1, 3)


def cut(length, rows=142):
    return table(*((low, min(low + rows, length), low // rows) for low in range(0, length, rows)))


def moments(way, v, pieces=None, count=24, rows=None, taken=None, columns=slice(None)):
    """(R, K, P) and (S, R, K, P) of a slab."""
    pieces = cut(len(v)) if pieces is None else pieces
    shape = (1 if rows is None else 1 + len(rows), count, v.shape[1])
    totals = torch.zeros(shape, dtype=torch.float64)
    of_blocks = torch.zeros((pieces[:, 2].max() + 1, *shape), dtype=v.dtype)
    way.add(v, (), Speeds(pieces, count, CENTRE, totals, of_blocks, rows), taken)
    return totals, of_blocks


def oracle(v, count, rows=None):
    """The definition, in numpy and float64."""
    s = np.abs(v.double().numpy())
    angle = np.arccos((s - CENTRE) / (s + CENTRE))
    w = np.ones((1, len(s)))
    if rows is not None:
        w = np.concatenate([w, rows.double().numpy()])
    return np.stack([w @ np.cos(k * angle) for k in range(count)], 1)


def lines(way, v, pieces, rows):
    blocks, columns = pieces[:, 2].max() + 1, v.shape[1]
    sums = torch.zeros(blocks, len(rows), columns, dtype=torch.float64)
    squares = torch.zeros(blocks, columns, dtype=torch.float64)
    smallest = torch.full((columns,), np.inf, dtype=torch.float64)
    largest = -smallest
    way.add(v, [Lines(pieces, rows, sums, squares, smallest, largest)])
    return sums, squares, smallest, largest


def same(one, other):
    """To the last bit."""
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float32, 2e-7), (torch.float64, 1e-10)])
@pytest.mark.parametrize("further", [0, 1, 2, 8])
def test_moments_are_their_definition(way, dtype, limit, further):
    v = plane(2280, 65, dtype)
    rows = weight_rows(2280, dtype).repeat(4, 1)[:further] if further else None
    totals, of_blocks = moments(way, v, rows=rows)
    np.testing.assert_allclose(totals / 2280, oracle(v, 24, rows) / 2280, atol=limit)
    np.testing.assert_allclose(of_blocks.double().sum(0) / 2280, totals / 2280, atol=limit)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float32, 2e-7), (torch.float64, 1e-14)])
def test_lines_are_their_definition(way, dtype, limit):
    v, rows = plane(600, 70, dtype), plane(19, 600, dtype, seed=1)
    pieces = table((3, 259, 1), (259, 300, 1), (310, 600 - 40, 0))
    sums, squares, smallest, largest = lines(way, v, pieces, rows)
    inside = [slice(310, 560), slice(3, 300)]
    w = v.double()
    for block, rows_of in enumerate(inside):
        scale = rows[:, rows_of].double().abs() @ w[rows_of].abs()
        error = (sums[block] - rows[:, rows_of].double() @ w[rows_of]) / scale
        assert error.abs().max() < limit
        energy = w[rows_of].square().sum(0)
        assert ((squares[block] - energy) / energy).abs().max() < limit
    used = torch.cat([w[each] for each in inside])
    assert torch.equal(smallest, used.amin(0))
    assert torch.equal(largest, used.amax(0))


@pytest.mark.parametrize("way", WAYS)
def test_what_is_not_asked_for_changes_nothing(way):
    v, rows, pieces = plane(300, 70), weight_rows(300), cut(300)
    totals = torch.zeros(3, 24, 70, dtype=torch.float64)
    way.add(v, (), Speeds(pieces, 24, CENTRE, totals, None, rows))
    assert torch.equal(totals, moments(way, v, rows=rows)[0])
    sums = torch.zeros(3, 2, 70, dtype=torch.float64)
    way.add(v, [Lines(pieces, rows, sums)])
    assert torch.equal(sums, lines(way, v, pieces, rows)[0])


@needs_native
@settings(max_examples=60)
@given(
    length=st.integers(1, 300),
    columns=st.integers(1, 200),
    count=st.integers(2, 70),
    further=st.integers(0, 4),
    taken=st.integers(0, 5),
    double=st.booleans(),
    transposed=st.booleans(),
    data=st.data(),
)
def test_both_ways_agree(length, columns, count, further, taken, double, transposed, data):
    dtype = torch.float64 if double else torch.float32
    v = plane(length, columns, dtype)
    if transposed:
        v = v.T.contiguous().T
    rows = weight_rows(length, dtype).repeat(2, 1)[:further] if further else None
    ends = data.draw(st.lists(st.integers(0, length), min_size=2, max_size=6, unique=True))
    ends = sorted({0, *ends})
    pieces = table(*((a, min(b, a + 256), i % 2) for i, (a, b) in enumerate(pairwise(ends))))
    off = Taken(
        rows=plane(length, taken, dtype, 2) / 4,
        coefficients=plane(taken, columns, dtype, 3) / 4,
        scale=data.draw(st.sampled_from([None, plane(1, columns, dtype, 4)[0]])),
    )
    off = off if taken else None
    both = [moments(way, v, pieces, count, rows, off) for way in (native, eager)]
    # float32: a rounding of x moves T_k by up to k^2 roundings, in mean over many samples by few.
    # What is taken off adds a rounding of v* each.
    rounding = 1e-8 if double else 6e-8 * count**2 * (1 + taken)
    limit = rounding * int((pieces[:, 1] - pieces[:, 0]).sum())
    assert (both[0][0] - both[1][0]).abs().max() <= limit
    assert (both[0][1] - both[1][1]).abs().max() <= limit
    if rows is not None:
        both = [lines(way, v, pieces, rows) for way in (native, eager)]
        for one, other in zip(*both, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-4)


@needs_native
@pytest.mark.parametrize("further", [0, 2])
def test_both_ways_agree_in_the_mean(further):
    v, rows = plane(2280, 100), weight_rows(2280) if further else None
    both = [moments(way, v, count=32, rows=rows)[0] / 2280 for way in (native, eager)]
    assert (both[0] - both[1]).abs().max() < 2e-7


@needs_native
@pytest.mark.parametrize("taken", [False, True])
@pytest.mark.parametrize("further", [0, 2, 3])
@pytest.mark.parametrize("columns", [1, 5, 63, 64, 65, 1000])
def test_a_column_knows_nothing_of_the_others(columns, further, taken):
    """Neither how many there are, nor where it stands, nor how it lies in memory."""
    v, pieces = plane(300, 1000), table((0, 142, 0), (142, 145, 0), (150, 300, 1))
    rows = weight_rows(300).repeat(2, 1)[:further] if further else None
    off = Taken(rows=plane(300, 3), coefficients=plane(3, 1000), scale=plane(1, 1000)[0])
    order = torch.randperm(1000, generator=torch.Generator().manual_seed(1))[:columns]
    some = Taken(rows=off.rows, coefficients=off.coefficients[:, order],
                           scale=off.scale[order])  # fmt: skip
    offs = (off, some) if taken else (None, None)
    whole = moments(native, v, pieces, 24, rows, offs[0])
    for part in (v[:, order], v[:, order].T.contiguous().T, v.double()[:, order].float()):
        picked = moments(native, part, pieces, 24, rows, offs[1])
        assert same(picked, (each[..., order] for each in whole))
    if further:
        whole = lines(native, v, pieces, rows)
        assert same(lines(native, v[:, order], pieces, rows), (each[..., order] for each in whole))


@needs_native
def test_threads_change_no_bit(set_threads):
    v, rows = plane(500, 1000), weight_rows(500)
    found = []
    for threads in (1, 2, 3, 64):
        set_threads(threads)
        found.append([*moments(native, v, rows=rows), *lines(native, v, cut(500), rows)])
    assert all(same(found[0], each) for each in found[1:])


@pytest.mark.parametrize("way", WAYS)
def test_slabs_cut_between_pieces_change_no_bit(way):
    v, rows, pieces = plane(1000, 70), weight_rows(1000), cut(1000)
    off = Taken(rows=plane(1000, 3), coefficients=plane(3, 70), scale=None)
    whole = moments(way, v, rows=rows, taken=off)
    whole_lines = lines(way, v, pieces, rows)
    parts, part_lines = [torch.zeros_like(each) for each in whole], []
    part_lines = [torch.zeros_like(each) for each in whole_lines[:2]]
    for low, high in ((426, 852), (852, 1000), (0, 426)):  # in any order
        here = pieces[(pieces[:, 0] >= low) & (pieces[:, 0] < high)] - (low, low, 0)
        part = Taken(rows=off.rows[low:high], coefficients=off.coefficients, scale=None)
        ends = [torch.zeros(70, dtype=torch.float64) for _ in range(2)]
        asked = [Lines(here, rows[:, low:high], *part_lines, *ends)]
        way.add(v[low:high], asked)
        way.add(v[low:high], (), Speeds(here, 24, CENTRE, *parts, rows[:, low:high]), part)
    assert same(parts, whole)
    assert same(part_lines, whole_lines[:2])


@pytest.mark.parametrize("way", WAYS)
def test_sums_of_pieces_are_exact(way):
    """Multiples of 2^-32: pieces taken in any order give the same bits."""
    v, pieces = plane(2000, 70, torch.float64), cut(2000, 37)
    forward, backward = (moments(way, v, order)[0] for order in (pieces, pieces[::-1]))
    assert torch.equal(forward * 2**32, (forward * 2**32).round())
    assert torch.equal(forward, backward)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("pieces", "columns"), [(table(), 5), (table((0, 9, 0)), 0)])
def test_nothing_adds_nothing(way, pieces, columns):
    totals = torch.ones(3, 24, columns, dtype=torch.float64)
    v, rows = plane(9, columns), weight_rows(9)
    way.add(v, (), Speeds(pieces, 24, CENTRE, totals, None, rows))
    way.add(v, [Lines(pieces, rows, totals[:1, :2].contiguous())])
    assert (totals == 1).all()


@pytest.mark.parametrize("way", WAYS)
def test_order_zero_is_the_sum_of_the_weights(way):
    totals, of_blocks = moments(way, plane(300, 70), rows=weight_rows(300))
    assert (totals[0, 0] == 300).all()
    assert (of_blocks[1, 0, 0] == 142).all()
    sums = weight_rows(300).double().sum(1)
    np.testing.assert_allclose(totals[1:, 0], sums[:, None].expand(2, 70), atol=1e-8)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 64, 69])
def test_bad_samples_spoil_their_own_column_alone(way, bad, where):
    v, rows, pieces = plane(300, 70), weight_rows(300), cut(300)
    spoilt = v.clone()
    spoilt[150, where] = bad
    others = torch.arange(70) != where
    clean = [*moments(way, v, rows=rows), *lines(way, v, pieces, rows)]
    dirty = [*moments(way, spoilt, rows=rows), *lines(way, spoilt, pieces, rows)]
    assert same([each[..., others] for each in dirty], [each[..., others] for each in clean])
    assert dirty[0][:, 1:, where].isnan().all()
    assert not dirty[2][1, :, where].isfinite().any()
    assert not dirty[3][1, where].isfinite()


@pytest.mark.parametrize("way", WAYS)
def test_taken_off(way):
    """v* = scale v - rows @ coefficients, whatever the layout of v."""
    v, rows = plane(2280, 65), weight_rows(2280)
    off = Taken(rows=plane(2280, 17, seed=1) / 2, coefficients=plane(17, 65, seed=2) / 20,
                          scale=1 + plane(1, 65, seed=3)[0] / 9)  # fmt: skip
    star = off.scale.double() * v.double() - off.rows.double() @ off.coefficients.double()
    want = oracle(star, 24, rows)
    for each in (v, v.T.contiguous().T):
        totals, _ = moments(way, each, rows=rows, taken=off)
        np.testing.assert_allclose(totals / 2280, want / 2280, atol=2e-7)


@needs_native
def test_loading_leaves_denormal_numbers_alone():
    """Libraries of -ffast-math set flush-to-zero for the whole process when they are loaded."""
    code = (
        "import numpy, torch\n"
        "from torchliner.compiled import library\nfrom torchliner.reduction import native\n"
        "assert library.available()\n"
        "v = torch.ones(4, 4)\n"
        "from torchliner.reduction.eager import Lines\n"
        "native.add(v, [Lines(numpy.array([[0, 4, 0]]), v, torch.zeros(1, 4, 4).double())])\n"
        "print((numpy.full(8, 1e-310) / 2 > 0).all(), (numpy.float32(1e-40) / 2) > 0,"
        " (torch.full((8,), 1e-40) / 2 > 0).all().item())"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["True"] * 3


@needs_native
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(set_threads):
    set_threads(2)
    want = moments(native, plane(100, 200))[0]
    assert in_fork(lambda: torch.equal(moments(native, plane(100, 200))[0], want)) == 0


@needs_native
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pieces": table((0, 257, 0))}, "1 to 256 of the 300 rows, not 0 to 257"),
        ({"pieces": table((200, 301, 0))}, "not 200 to 301"),
        ({"pieces": table((5, 5, 0))}, "not 5 to 5"),
        ({"pieces": table((0, 142, 2))}, "blocks 2 to 2, but room for 2"),
        ({"rows": torch.ones(2, 299)}, r"\(2, 299\) torch.float32 .* \(2, 300\)"),
        ({"rows": torch.ones(2, 300).double()}, "float64 on cpu, but .*float32 on a CPU"),
        ({"totals": torch.zeros(3, 23, 70).double()}, r"\(3, 24, 70\)"),
        ({"totals": torch.zeros(3, 24, 140).double()[..., ::2]}, "contiguous"),
        (
            {
                "slab": torch.ones(300, 70).half(),
                "of_blocks": None,
                "rows": None,
                "totals": torch.zeros(1, 24, 70).double(),
            },
            "float16",
        ),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    """The C++ file would write where nothing is."""
    given = {
        "pieces": table((0, 142, 1)), "count": 24, "centre": CENTRE,
        "rows": torch.ones(2, 300),
        "totals": torch.zeros(3, 24, 70, dtype=torch.float64),
        "of_blocks": torch.zeros(2, 3, 24, 70),
    }  # fmt: skip
    slab = change.pop("slab", plane(300, 70))
    with pytest.raises((ValueError, IndexError), match=message):
        native.add(slab, (), Speeds(**given | change))


# Building


@pytest.fixture
def build(monkeypatch, tmp_path):
    """Build into an empty cache, with nothing remembered before or after."""
    monkeypatch.setattr(library, "reason", None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return library._library.__wrapped__


def compiler(tmp_path, text):
    path = tmp_path / "c++"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@needs_native
def test_the_cache_is_filled_once(build, monkeypatch, tmp_path):
    monkeypatch.setattr(library, "FLAGS", ["-std=c++17", "-O0", "-fPIC"])
    assert build() is not None
    (first,) = (tmp_path / "cache" / "torchliner").iterdir()
    stamp = first.stat().st_mtime_ns
    assert build() is not None
    monkeypatch.setattr(library, "FLAGS", [*library.FLAGS, "-DOTHER"])
    assert build() is not None
    assert first.stat().st_mtime_ns == stamp
    assert len(list((tmp_path / "cache" / "torchliner").iterdir())) == 2


def test_without_a_compiler(build, monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert build() is None
    assert "neither g++ nor clang++ is on the path" in library.reason
    monkeypatch.setenv("CXX", "no-such-compiler -v")
    assert build() is None
    assert "no-such-compiler" in library.reason


def test_a_compiler_that_fails(build, monkeypatch, tmp_path):
    monkeypatch.setenv("CXX", compiler(tmp_path, "echo 'error: no vectors here' >&2; exit 3"))
    assert build() is None
    assert "failed with code 3: error: no vectors here" in library.reason


def test_a_compiler_that_makes_no_library(build, monkeypatch, tmp_path):
    monkeypatch.setenv(
        "CXX",
        compiler(tmp_path, "while [ $# -gt 0 ]; do [ $1 = -o ] && echo > $2; shift; done; true"),
    )
    assert build() is None
    assert library.reason


def test_a_compiler_that_hangs(build, monkeypatch, tmp_path):
    """Its children, too, are ended: they would hold the test up for a minute."""
    monkeypatch.setenv("CXX", compiler(tmp_path, f"sleep 60 & echo $! > {tmp_path}/child; wait"))
    monkeypatch.setattr(library, "SECONDS", 0.5)
    begin = time.monotonic()
    assert build() is None
    assert time.monotonic() - begin < 20
    assert "timed out after 0.5 seconds" in library.reason
    child = int((tmp_path / "child").read_text())
    for _ in range(100):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            break
        time.sleep(0.05)
    else:
        pytest.fail("the compiler's child still runs")


def test_a_cache_that_cannot_be_written(build, monkeypatch, tmp_path):
    (tmp_path / "cache").write_text("a file where the folder would be")
    monkeypatch.setenv("CXX", compiler(tmp_path, "exit 0"))
    assert build() is None
    assert str(tmp_path / "cache") in library.reason


def test_the_environment_chooses(monkeypatch):
    monkeypatch.setattr(library, "_library", lambda: None)
    monkeypatch.setattr(library, "reason", "no compiler")
    monkeypatch.delenv("TORCHLINER_SUMS", raising=False)
    assert not library.available()
    monkeypatch.setenv("TORCHLINER_SUMS", "native")
    with pytest.raises(RuntimeError, match="compiled sums failed: no compiler"):
        library.available()
    monkeypatch.setenv("TORCHLINER_SUMS", "fast")
    with pytest.raises(ValueError, match="'fast'; use 'torch', 'native'"):
        library.available()
    monkeypatch.setattr(library, "_library", lambda: "there")
    monkeypatch.setenv("TORCHLINER_SUMS", "torch")
    assert not library.available()
    monkeypatch.setenv("TORCHLINER_SUMS", "native")
    assert library.available()
