"""The coherence-based wall filter of section 7.2: laws, files, refusals, a resolved case."""

from __future__ import annotations

import math

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def mixed():
    """Six probes: two with a tone above turbulence, four with turbulence alone."""
    time = torch.arange(1200, dtype=torch.float64) / RATE
    noise = turbulence((6, 1200), seed=4, rms=1.0)
    noise[[1, 4]] += 5.0 * torch.cos(2 * math.pi * FREQUENCY * time)
    return plane_of(noise, x=0.5e-3 + 1e-3 * torch.arange(6))


def test_threshold_0_changes_nothing(mixed, liner):
    """No coherence is below 0: bit for bit the map without a filter."""
    plain, found = (tl.educe(mixed, liner, wall_filter=limit) for limit in (None, 0.0))
    assert plain.wall is None
    assert not bool(found.wall.any())
    for averaging in found.averagings:
        for one, other in zip((plain.liner, plain.cells), (found.liner, found.cells), strict=True):
            assert torch.equal(one[averaging].reflection, other[averaging].reflection)


def test_threshold_1_without_a_tone_is_a_rigid_wall(liner):
    """Every probe is wall: zero admittance, infinite impedance, not nan; probes and cell velocities keep theirs."""
    plane = plane_of(turbulence((3, 1200), seed=1))
    plain, found = tl.educe(plane, liner), tl.educe(plane, liner, wall_filter=1.0)
    assert bool(found.wall.all())
    assert torch.equal(found.impedance, plain.impedance)
    assert bool(torch.isinf(found.liner["admittance"].resistance).all())
    assert not bool(torch.isnan(found.liner["admittance"].reactance).any())
    assert bool((found.cells["admittance"].reflection == 1).all())
    assert torch.equal(found.liner["velocity"].impedance, plain.liner["velocity"].impedance)


def test_walls_dilute_the_admittance(mixed, liner):
    """Y = (1 - share of wall) x mean of Y over the rest, for the liner and the cell; probes with nan take no part."""
    broken = mixed.velocity.clone()
    broken[0, 5] = torch.nan
    for plane, kept in ((mixed, 2 / 6), (plane_of(broken, x=mixed.x), 2 / 5)):
        found = tl.educe(plane, liner, wall_filter=0.7, missing="exclude")
        wanted = kept * found.probes["admittance"].admittance[[1, 4], 0].mean()
        for each in (found.liner["admittance"].admittance[0], found.cells["admittance"].admittance[0, 0]):
            assert abs(each - wanted) < 1e-12 * abs(wanted)
    assert "3 of 5 probes (60 %)" in next(note.text for note in found.notes if note.code == "wall-filter")


def test_n130_between_the_holes():
    """At 0.5 mm v between the slits is the wave's, and as coherent: without turbulence no probe is a wall."""
    plane = tl.read_plane(DATA / "slit_n130_y0.5mm.h5")
    found = tl.educe(plane, tl.load_liner("lbm_slit"), wall_filter=0.5)
    assert float(found.coherence.min()) > 0.5
    assert not bool(found.wall.any())
