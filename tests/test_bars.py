"""The sums behind error bars are those of their definition."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchliner.signals import bars

SIZES = {"rows": st.integers(1, 40), "columns": st.integers(1, 21), "seed": st.integers(0, 99)}


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.complex(*torch.randn(2, *shape, dtype=torch.float64, generator=generator))


@given(**SIZES)
def test_neighbours_by_definition(rows, columns, seed):
    d = noise(rows, columns, seed=seed)
    away = (d - d.mean(0)).numpy()
    power = (np.abs(away) ** 2).sum(0)
    cross = (away[1:] * away[:-1].conj()).real.sum(0)
    found = bars.neighbours(d)
    np.testing.assert_allclose(found, np.stack([power, cross]), rtol=0, atol=1e-13 * rows)


@given(**SIZES)
def test_forms_by_definition(rows, columns, seed):
    d, kinds = noise(rows, columns, seed=seed), 3
    tables = noise(kinds, rows, rows, seed=seed + 1).real
    tables = tables + tables.mT  # covariances are symmetric
    which = torch.randint(kinds, (columns,), generator=torch.Generator().manual_seed(seed))
    want = [
        [float(a[:, n] @ tables[which[n]] @ b[:, n]) for n in range(columns)]
        for a, b in ((d.real, d.real), (d.imag, d.imag), (d.real, d.imag))
    ]
    found = bars.forms(d, tables, which)
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-12 * rows**2)


@given(columns=st.integers(1, 21), seed=st.integers(0, 99))
def test_extremes_are_those_of_a_fine_walk_around_the_ellipse(columns, seed):
    ahead, share = noise(2, columns, seed=seed), 0.05 * noise(2, columns, seed=seed + 1)
    angle = torch.linspace(0, 2 * torch.pi, 4097, dtype=torch.float64)
    walk = torch.stack([angle.cos(), angle.sin()]).to(ahead).T
    change = (walk @ ahead) / (1 - walk @ share)
    want = torch.stack([end for part in (change.real, change.imag) for end in (part.amin(0), part.amax(0))])
    width = (want[1::2] - want[::2]).repeat_interleave(2, 0)
    found = bars.extremes(ahead, share)
    assert float(((found - want) / width).abs().max()) < 1e-3
