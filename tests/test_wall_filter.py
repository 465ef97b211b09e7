"""The coherence-based wall filter of section 7.2: laws, files, refusals, resolved cases."""

from __future__ import annotations

import math

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, SHARED, plane_of, turbulence

import torchliner as tl
from torchliner.cli.main import main
from torchliner.conversions import admittance_from_reflection, impedance_from_admittance
from torchliner.io.resolved import read_resolved

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def tone(amplitude: float, samples: int = 1200) -> torch.Tensor:
    time = torch.arange(samples, dtype=torch.float64) / RATE
    return amplitude * torch.cos(2 * math.pi * FREQUENCY * time)


@pytest.fixture(scope="module")
def mixed():
    """Six probes: two with a tone above turbulence, four with turbulence alone."""
    noise = turbulence((6, 1200), seed=4, rms=1.0)
    noise[[1, 4]] += tone(5.0)
    return plane_of(noise, x=0.5e-3 + 1e-3 * torch.arange(6))


def test_threshold_0_changes_nothing(mixed, liner):
    """No coherence is below 0: bit for bit the map without a filter."""
    plain = tl.educe(mixed, liner)
    found = tl.educe(mixed, liner, wall_filter=0.0)
    assert plain.wall is None
    assert not bool(found.wall.any())
    assert torch.equal(found.reflection, plain.reflection)
    assert torch.equal(found.cell_reflection, plain.cell_reflection)
    assert torch.equal(found.liner_impedance, plain.liner_impedance)


def test_threshold_1_without_a_tone_is_a_rigid_wall(liner):
    """Every probe is wall: zero admittance, infinite impedance, not nan; probes keep theirs."""
    plane = plane_of(turbulence((3, 1200), seed=1))
    plain = tl.educe(plane, liner)
    found = tl.educe(plane, liner, wall_filter=1.0)
    assert bool(found.wall.all())
    assert torch.equal(found.reflection, plain.reflection)
    assert bool(torch.isinf(found.liner_impedance.real).all())
    assert not bool(torch.isnan(found.liner_impedance.imag).any())
    assert bool((found.cell_reflection == 1).all())
    first = plain.liner_impedance_velocity_first
    assert torch.equal(found.liner_impedance_velocity_first, first)


def test_walls_dilute_the_admittance(mixed, liner):
    """Y = (1 - share of wall) x mean of Y over the rest, for the liner and the cell."""
    found = tl.educe(mixed, liner, wall_filter=0.7)
    assert found.wall[:, 0].tolist() == [True, False, True, True, False, True]
    rest = found.admittance[[1, 4], 0].mean()
    wanted = (1 - 4 / 6) * rest
    assert abs(1 / found.liner_impedance[0] - wanted) < 1e-12 * abs(wanted)
    cell = admittance_from_reflection(found.cell_reflection)[0, 0]
    assert abs(cell - wanted) < 1e-12 * abs(wanted)


def test_left_out_probes_are_not_walls(mixed, liner):
    """A probe with nan takes no part; the share is over the others."""
    velocity = mixed.velocity.clone()
    velocity[0, 5] = torch.nan
    plane = plane_of(velocity, x=mixed.x)
    found = tl.educe(plane, liner, wall_filter=0.7, missing="exclude")
    wanted = (2 / 5) * found.admittance[[1, 4], 0].mean()
    assert abs(1 / found.liner_impedance[0] - wanted) < 1e-12 * abs(wanted)
    assert any("3 of 5 probes (60 %)" in note for note in found.notes)


def test_the_note_says_share_and_what_is_not_filtered(mixed, liner):
    """Share, threshold, chance; another frequency than the tone's is said."""
    (note,) = [n for n in tl.educe(mixed, liner, wall_filter=0.7).notes if "wall filter" in n]
    for text in ("4 of 6 probes (66.7 %)", "below 0.7", "velocity first are as without"):
        assert text in note
    other = tl.educe(mixed, liner, 1000.0, wall_filter=0.7)
    assert any("the tone of the data is 1400 Hz" in note for note in other.notes)


def test_a_map_file_keeps_the_walls(mixed, liner, tmp_path):
    """Written and read back; a file without the variable gives None."""
    found = tl.educe(mixed, liner, wall_filter=0.7)
    found.write(tmp_path / "map.h5")
    again = tl.read_map(tmp_path / "map.h5")
    assert torch.equal(again.wall, found.wall)
    assert torch.equal(again.liner_impedance, found.liner_impedance)
    assert again.choices["wall_filter"] == 0.7
    tl.educe(mixed, liner).write(tmp_path / "plain.h5")
    assert tl.read_map(tmp_path / "plain.h5").wall is None


def test_rigid_wall_admittance_is_infinite_impedance():
    """1/y, and inf at y = 0."""
    found = impedance_from_admittance(torch.tensor([0j, 2j, 0.5 + 0j]))
    assert bool(torch.isinf(found[0].real))
    assert found[1:].tolist() == [-0.5j, 2 + 0j]


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_thresholds_outside_0_to_1_are_refused(mixed, liner, value):
    with pytest.raises(ValueError, match=r"wall_filter is .*; it is a squared coherence, 0 to 1"):
        tl.educe(mixed, liner, wall_filter=value)


def test_an_incident_signal_has_no_tone_to_be_coherent_with(mixed, liner):
    with pytest.raises(ValueError, match="there is none"):
        tl.educe(mixed, liner, incident="noise:300:3000", wall_filter=0.5)


def test_command_line(capsys):
    """--wall-filter reaches the result."""
    plane = str(DATA / "slit_n130_y0.5mm.h5")
    assert main(["educe", plane, "--wall-filter", "0.5", "--json", "--quiet"]) == 0
    assert '"wall_filter": 0.5' in capsys.readouterr().out


@pytest.mark.skipif(not SHARED.exists(), reason="full simulation files are not here")
def test_full_n130_between_the_holes():
    """At 0.5 mm v between the slits is coherent too (it is the wave's): no probe is a wall.

    The premise of section 7.2, that low coherence marks the wall, does not hold without
    turbulence, and the filter then does nothing at all.
    """
    plane = read_resolved(SHARED / "data" / "resolved_liner_lbm.h5", "n130", 0, stride=2)
    found = tl.educe(plane, tl.load_liner("lbm_slit"), wall_filter=0.5)
    assert float(found.coherence.min()) > 0.5
    assert not bool(found.wall.any())
