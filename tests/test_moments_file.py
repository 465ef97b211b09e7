"""Files of moments: an eduction from one is that from memory to the bit; what is wrong is told."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from conftest import plane_of, turbulence

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
CHOICES = [
    {},
    {"averaging": "velocity"},
    {"phase": "self-consistent"},
    {"drive": "rms"},
    {"drive": "running-rms"},
    {"mean": "removed"},
    {"background": 1.0},
]


def grid_plane(dtype=torch.float32, **about):
    """(z, x) probes with all that a plane may state."""
    facts = {
        "x": 0.01 * torch.arange(4.0),
        "z": 0.02 * torch.arange(2.0),
        "height": 1e-3,
        "incident_level": 130.0,
        "mach": 0.1,
        "source_side": "upstream",
        "liner": "polito",
        "reference": {"true": 1 - 0.5j},
        "title": "two rows",
        "provenance": {"run": 7},
        "start": 0.25,
        "area": torch.linspace(1e-6, 8e-6, 8),
        "holes": tl.records.Holes(x=(0.01,), diameter=(1e-3,), z=(0.01,)),
    }
    time = torch.arange(900, dtype=torch.float64) / 42e3
    v = turbulence((2, 4, 900)) + 2 + 3 * torch.cos(2 * torch.pi * 1400 * time)
    return plane_of(v.to(dtype), **facts | about)


def same_bits(one, two):
    """Whether all tensors and values within are the same; names of files and what they say of themselves aside."""
    if isinstance(one, torch.Tensor):
        parts = [torch.view_as_real(each) if each.is_complex() else each for each in (one, two)]
        return one.dtype == two.dtype and torch.equal(*(each.double().nan_to_num(-7e77) for each in parts))
    if dataclasses.is_dataclass(one):
        names = [each.name for each in dataclasses.fields(one) if each.name not in ("velocity", "name", "text")]
        return type(one) is type(two) and all(same_bits(getattr(one, name), getattr(two, name)) for name in names)
    if isinstance(one, dict):
        return list(one) == list(two) and all(same_bits(one[k], two[k]) for k in one if k not in ("source", "inputs"))
    if isinstance(one, tuple):
        return len(one) == len(two) and all(map(same_bits, one, two))
    return one == two


@pytest.mark.parametrize("choices", CHOICES, ids=str)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_file_answers_as_memory_does(choices, dtype, liner, tmp_path):
    """Sums, map, intervals and level check to the bit, and all that is known of the plane."""
    path = tmp_path / "m.h5"
    known = tl.moments(grid_plane(dtype), cell_pitch=liner.cell_pitch, **choices)
    known.write(path)
    found = tl.read_moments(path)
    assert same_bits(found, known)
    assert found.notes == known.notes
    assert (found.plane.velocity.shape, found.plane.velocity.dtype) == ((2, 4, 900), dtype)
    assert same_bits(found.educe(liner, **choices), known.educe(liner, **choices))
    with pytest.raises(ValueError, match=r"m\.h5 holds moments.* 900 time samples are gone"):
        found.plane.read(0, 1)


def test_other_moments_and_planes(tmp_path):
    """A table's levels, no coordinates, several lines, probes left out."""
    v = turbulence((8, 900))
    v[3, ::7] = torch.nan
    table = tl.TabulatedLiner([1000.0, 2000.0], np.full((2, 3), 2 + 1j), [0.0, 5.0, 40.0])
    cases = {
        "levels": tl.moments(plane_of(v.nan_to_num(), title="t"), table),
        "lines": tl.moments(plane_of(v.nan_to_num(), title="t"), frequency=[1400.0, 1000.0]),
        "left out": tl.moments(plane_of(v, title="t"), missing="exclude"),
        "one probe": tl.moments(plane_of(v[0], title="t")),
    }
    for name, known in cases.items():
        known.write(tmp_path / "m.h5")
        assert same_bits(tl.read_moments(tmp_path / "m.h5"), known), name
