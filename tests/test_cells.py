"""Averages over cells."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
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
    wanted = torch.einsum("pc,apf->acf", cells.membership(used).to(values), values)
    found = cells.average(values, used)
    torch.testing.assert_close(found, wanted, rtol=1e-14, atol=1e-15)
    last = cells.average(values.movedim(1, 2), used, axis=-1)
    torch.testing.assert_close(last, wanted.movedim(1, 2), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("order", ["admittance", "velocity", "phase-locked"])
def test_half_as_many_cells_as_probes_need_no_matrix_of_both(order):
    """60 800 probes x 30 400 cells would be 15 GB."""
    liner, along, across = tl.load_liner("polito"), 304, 200
    steps = torch.arange(along * across)
    x = (steps % along + 0.5) * liner.cell_pitch / 2
    z = (torch.div(steps, along, rounding_mode="floor") + 0.5) * liner.cell_pitch
    v = 2 * torch.randn(8, 1000, generator=torch.Generator().manual_seed(0))
    v = v.repeat(len(steps) // 8, 1)
    plane = tl.VelocityPlane(v, sampling_rate=200e3, frequency=1400.0, x=x, z=z)
    found = tl.educe(plane, liner, averaging=order, interval=None)
    impedance = found.cells[order].impedance.squeeze()
    assert len(impedance) == len(steps) // 2
    # The same eight probes over and over again.
    spread = (impedance.reshape(-1, 4) - impedance[:4]).abs().max()
    assert float(spread) < 1e-6 * float(impedance.abs().max())
