"""The sums behind error bars: compiled and by torch alone they are those of their definition."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchliner.compiled import library
from torchliner.signals import bars

BUILT = library.available()
needs_native = pytest.mark.skipif(not BUILT, reason=str(library.reason))
WAYS = ["torch", pytest.param("native", marks=needs_native)]
SIZES = {"rows": st.integers(1, 40), "columns": st.integers(1, 21), "seed": st.integers(0, 99)}


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.complex(*torch.randn(2, *shape, dtype=torch.float64, generator=generator))


def in_way(way: str, name: str, *given: torch.Tensor) -> torch.Tensor:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TORCHLINER_SUMS", way)
        return getattr(bars, name)(*given)


@pytest.mark.parametrize("way", WAYS)
@given(**SIZES)
def test_neighbours_by_definition(way, rows, columns, seed):
    d = noise(rows, columns, seed=seed)
    away = (d - d.mean(0)).numpy()
    power = (np.abs(away) ** 2).sum(0)
    cross = (away[1:] * away[:-1].conj()).real.sum(0)
    found = in_way(way, "neighbours", d)
    np.testing.assert_allclose(found, np.stack([power, cross]), rtol=0, atol=1e-13 * rows)


@pytest.mark.parametrize("way", WAYS)
@given(**SIZES)
def test_forms_by_definition(way, rows, columns, seed):
    d, kinds = noise(rows, columns, seed=seed), 3
    tables = noise(kinds, rows, rows, seed=seed + 1).real
    tables = tables + tables.mT  # covariances are symmetric
    which = torch.randint(kinds, (columns,), generator=torch.Generator().manual_seed(seed))
    want = [
        [float(a[:, n] @ tables[which[n]] @ b[:, n]) for n in range(columns)]
        for a, b in ((d.real, d.real), (d.imag, d.imag), (d.real, d.imag))
    ]
    found = in_way(way, "forms", d, tables, which)
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-12 * rows**2)


@pytest.mark.parametrize("way", WAYS)
@given(columns=st.integers(1, 21), seed=st.integers(0, 99))
def test_extremes_are_those_of_a_fine_walk_around_the_ellipse(way, columns, seed):
    ahead, share = noise(2, columns, seed=seed), 0.05 * noise(2, columns, seed=seed + 1)
    angle = torch.linspace(0, 2 * torch.pi, 4097, dtype=torch.float64)
    walk = torch.stack([angle.cos(), angle.sin()]).to(ahead).T
    change = (walk @ ahead) / (1 - walk @ share)
    want = torch.stack([end for part in (change.real, change.imag) for end in (part.amin(0), part.amax(0))])
    width = (want[1::2] - want[::2]).repeat_interleave(2, 0)
    found = in_way(way, "extremes", ahead, share)
    assert float(((found - want) / width).abs().max()) < 1e-3


@needs_native
def test_a_column_knows_neither_its_neighbours_nor_the_threads(set_threads):
    d, tables = noise(16, 1300), noise(2, 16, 16).real
    which = (torch.arange(1300) % 3 == 0).long()
    axes = noise(4, 1300) * 0.05
    chosen = torch.tensor([3, 640, 641, 1299])
    found = []
    for threads in (1, 2, 5):
        set_threads(threads)
        for some in (torch.arange(1300), chosen):
            one = [
                in_way("native", "neighbours", d[:, some]),
                in_way("native", "forms", d[:, some], tables, which[some]),
                in_way("native", "extremes", axes[:2, some], axes[2:, some]),
            ]
            found.append(torch.cat(one)[:, slice(None) if len(some) == 4 else chosen])
    assert all(torch.equal(each, found[0]) for each in found)


@needs_native
@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("neighbours", [torch.zeros(4, 3)], "float32 on cpu, but .*complex128"),
        ("forms", [noise(4, 3), torch.zeros(1, 5, 5).double(), torch.zeros(3).long()], r"\(-1, 4"),
        ("forms", [noise(4, 3), torch.zeros(1, 4, 4).double(), torch.zeros(2).long()], r"\(2,\)"),
        ("extremes", [noise(2, 3), noise(2, 4)], r"\(2, 3\)"),
    ],
)
def test_what_does_not_fit_is_refused(name, given, message):
    """The compiled function would read where nothing is."""
    with pytest.raises(ValueError, match=message):
        in_way("native", name, *given)
