"""The wall filter of section 7.2, and what |v| under one tone says of other frequencies."""

import math
import warnings

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, doubtful, plane_of, turbulence

import torchliner as tl


@pytest.fixture(scope="module")
def mixed():
    time = torch.arange(1200, dtype=torch.float64) / RATE
    noise = turbulence((6, 1200), seed=4, rms=1.0)
    noise[[1, 4]] += 5.0 * torch.cos(2 * math.pi * FREQUENCY * time)
    return plane_of(noise, x=0.5e-3 + 1e-3 * torch.arange(6))


@doubtful
def test_threshold_0_changes_nothing(mixed, liner):
    """No coherence is below 0: bit for bit the map without a filter."""
    plain, found = (tl.educe(mixed, liner, wall_filter=limit) for limit in (None, 0.0))
    assert plain.wall is None
    assert not bool(found.wall.any())
    for averaging in found.averagings:
        for one, other in zip((plain.liner, plain.cells), (found.liner, found.cells), strict=True):
            assert torch.equal(one[averaging].reflection, other[averaging].reflection)


@doubtful
def test_threshold_1_without_a_tone_is_a_rigid_wall(liner):
    """Every probe is wall: zero admittance, infinite impedance, not nan; probes and cell velocities keep theirs."""
    plane = plane_of(turbulence((3, 1200), seed=1))
    plain, found = tl.educe(plane, liner), tl.educe(plane, liner, wall_filter=1.0)
    assert bool(found.wall.all())
    assert torch.equal(found.impedance, plain.impedance)
    assert bool(torch.isinf(found.liner["admittance"].impedance.real).all())
    assert not bool(torch.isnan(found.liner["admittance"].impedance.imag).any())
    assert bool((found.cells["admittance"].reflection == 1).all())
    assert torch.equal(found.liner["velocity"].impedance, plain.liner["velocity"].impedance)


@doubtful
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


@doubtful
def test_n130_between_the_holes():
    """At 0.5 mm v between the slits is the wave's, and as coherent: without turbulence no probe is a wall."""
    plane = tl.read_plane(DATA / "slit_n130_y0.5mm.h5")
    found = tl.educe(plane, tl.load_liner("lbm_slit"), wall_filter=0.5)
    assert float(found.coherence.min()) > 0.5
    assert not bool(found.wall.any())


SAMPLES = 4200  # 100 ms
TIMES = torch.arange(SAMPLES, dtype=torch.float64) / RATE
TONE = torch.cos(2 * torch.pi * 1400 * TIMES)


def educed(velocity, liner, frequency, **choices):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        return tl.educe(plane_of(velocity), liner, frequency, interval=None, **choices)


@pytest.mark.parametrize(
    ("tone", "rms", "share"), [(3.0, 0.0, 1.0), (3.0, 0.5, 0.947), (2.0, 2.0, 1 / 3), (0.0, 2.0, 0.0)]
)
def test_share_is_that_of_the_variance(tone, rms, share, liner):
    v = tone * TONE + (turbulence((20, SAMPLES), rms=rms) if rms else torch.zeros(20, SAMPLES))
    found = educed(v, liner, 2100.0)
    assert found.choices["tone_share"] == pytest.approx(share, abs=0.01)
    assert [note.code for note in found.notes] == (["other-tone"] if share else ["no-tone"])


def test_a_tone_that_changes_little_is_no_warning(liner):
    flow = turbulence((40, SAMPLES), seed=3, rms=2.0)
    weak, none = (educed(flow + a * TONE, liner, 2100.0) for a in (0.4, 0.0))
    assert weak.choices["tone_share"] < 0.1
    assert not weak.notes
    moved = (weak.liner["admittance"].impedance / none.liner["admittance"].impedance - 1).abs()
    assert float(moved[0]) < 0.05
