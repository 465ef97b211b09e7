"""Averages over cells."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from torchliner.records.cells import Cells


def cells_of(labels, count):
    centres = torch.arange(count, dtype=torch.float64)
    return Cells(torch.as_tensor(labels), centres, torch.zeros_like(centres))


@given(st.lists(st.tuples(st.integers(-1, 3), st.booleans()), min_size=1, max_size=12))
def test_an_average_is_the_product_with_the_averaging_matrix(probes):
    """Probes outside (-1) and left out count for nothing; a cell of which none is left is 0."""
    cells = cells_of([label for label, _ in probes], 4)
    used = torch.tensor([each for _, each in probes])
    values = torch.randn(2, len(probes), 3, generator=torch.Generator().manual_seed(1)).double()
    values = torch.complex(values, values.flip(0))
    matrix = ((cells.labels[:, None] == torch.arange(4)) & used[:, None]).double()
    wanted = torch.einsum("pc,apf->acf", (matrix / matrix.sum(0).clamp(min=1)).to(values), values)
    found = cells.average(values, used)
    torch.testing.assert_close(found, wanted, rtol=1e-14, atol=1e-15)
    last = cells.average(values.movedim(1, 2), used, axis=-1)
    torch.testing.assert_close(last, wanted.movedim(1, 2), rtol=1e-14, atol=1e-15)
