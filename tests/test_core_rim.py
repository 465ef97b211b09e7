"""What stands at the rim of an eduction: units, kinds of numbers, gaps, tables at their limits."""

from __future__ import annotations

import warnings

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl

X = (torch.arange(15) + 0.5) * 12.44e-3 / 5  # three cells of five probes


def notes_of(plane, liner, *wanted, **choices) -> str:
    """All warnings of an eduction."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return "\n".join(map(str, tl.educe(plane, liner, *wanted, interval=None, **choices).notes))


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize(
    ("about", "frequency", "text"),
    [
        ({"sampling_rate": 42.0}, 1.4, "frequency is 1.4 Hz, below 20 Hz; are these kHz"),
        ({"sampling_rate": 42.0}, 1.4, "sampling rate is 42 Hz, below 500 Hz; are these kHz"),
        ({"x": [0.0, 68.0, 137.0]}, FREQUENCY, "x spans 137 m, above 20 m; are these mm"),
        ({"sampling_rate": 3.0 * FREQUENCY}, FREQUENCY, "3 samples a period of 1400 Hz, below 4"),
        ({"height": 0.03}, FREQUENCY, "lies 30 mm above the liner, more than its cell pitch of"),
        ({"height": 0.5}, FREQUENCY, "height is 0.5 m, above 0.05 m; are these mm"),
        ({"displacement_thickness": 1.7}, FREQUENCY, "displacement_thickness is 1.7 m"),
        ({"incident_level": 0.6}, FREQUENCY, "incident level is 0.6 dB, below 20 dB; .* pascals"),
    ],
)
def test_units_that_cannot_be_meant_are_said(liner, about, frequency, text):
    """kHz given as Hz and mm given as m keep every ratio; only their size tells."""
    plane = plane_of(turbulence((3, 600)), frequency=frequency, **about)
    with pytest.warns(tl.DataWarning, match=text):
        tl.educe(plane, liner, interval=None)
    with pytest.warns(tl.DataWarning) as told:
        tl.educe(plane_of(turbulence((3, 400)), height=1e-3, x=[0, 0.06, 0.137]), liner)
    assert not any("are these" in str(each.message) for each in told)


KINDS = [
    ({"allow_short": "no"}, TypeError, "allow_short is 'no'; True or False is needed"),
    ({"device": "mps"}, ValueError, "unknown device 'mps'; use 'cpu', 'cuda'"),
    ({"device": 1.5}, ValueError, "unknown device 1.5; use 'cpu', 'cuda'"),
]


@pytest.mark.parametrize(("choice", "error", "text"), KINDS, ids=[str(k[0])[:30] for k in KINDS])
def test_choices_of_a_wrong_kind(liner, choice, error, text):
    """Refused by name, with what is needed; nothing is rounded, nothing is true by being text."""
    with pytest.raises(error, match=text):
        tl.educe(plane_of(turbulence((2, 600))), liner, **choice)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_a_cell_in_a_gap_counts_in_no_average(liner):
    """The averages are those of a plane without it, under either order, intervals too."""
    v = turbulence((15, 480), seed=4)
    v[5:10] = torch.nan
    found = tl.educe(plane_of(v, x=X), liner, missing="exclude")
    left = [*range(5), *range(10, 15)]
    wanted = tl.educe(plane_of(v[left], x=X[left]), liner)
    assert torch.allclose(found.cell_x, wanted.cell_x, rtol=1e-12, atol=0)
    for averaging in wanted.averagings:
        for kind in ("liner", "cells"):
            mine, other = (getattr(each, kind)[averaging] for each in (found, wanted))
            assert torch.allclose(mine.impedance, other.impedance, rtol=1e-12, atol=0)
            assert torch.allclose(mine.interval.low, other.interval.low, rtol=1e-11, atol=0)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_a_cell_partly_in_a_gap_weighs_what_it_has(liner, tmp_path):
    """Four of five probes gone: a fifth of the weight, in value, interval and file."""
    v = turbulence((15, 480), seed=4)
    v[6:10] = torch.nan
    found = tl.educe(plane_of(v, x=X), liner, missing="exclude")
    assert found.cell_weight.tolist() == [1.0, 0.2, 1.0]
    y = 1 / found.cells["velocity"].impedance[:, 0]
    wanted = complex(2.2 / (y[0] + 0.2 * y[1] + y[2]))
    assert complex(found.liner["velocity"].impedance[0]) == pytest.approx(wanted, rel=1e-12)
    interval = found.liner["velocity"].interval
    assert float(interval.low[0].real) < wanted.real < float(interval.high[0].real)
    assert any(note.code == "lost-cells" and "the least 0.2" in note.text for note in found.notes)
    found.write(tmp_path / "m.nc")
    again = tl.read_map(tmp_path / "m.nc")
    assert torch.equal(again.cell_weight, found.cell_weight)
    assert torch.equal(again.liner["velocity"].impedance, found.liner["velocity"].impedance)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_columns_without_probes_have_no_interval(liner):
    """Admittance 0 over no probes would be a rigid wall with an interval."""
    v = turbulence((4, 3, 480))
    v[:, 1] = torch.nan
    found = tl.educe(plane_of(v), liner, missing="exclude").along_x["admittance"].interval
    assert torch.isnan(found.low[:, 0].real).tolist() == [False, True, False]


@pytest.mark.parametrize("shape", [(5, 3000), (4200, 130)])
def test_coherence_does_not_know_other_frequencies(liner, shape):
    """The same alone and beside a low and a high one, and with it what falls back."""
    v = turbulence((5, shape[1])).repeat(shape[0] // 5, 1)
    v += 3 * torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(shape[1]))
    choices = {"phase": "self-consistent", "interval": None, "allow_short": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        alone = tl.educe(plane_of(v), liner, FREQUENCY, **choices)
        beside = tl.educe(plane_of(v), liner, [200.0, FREQUENCY, 1410.0, 5000.0], **choices)
    assert float((alone.coherence[:, 0] - beside.coherence[:, 1]).abs().max()) < 1e-12
    assert torch.equal(alone.phase_rule[:, 0], beside.phase_rule[:, 1])


def test_autocast_around_an_eduction_has_no_effect(liner):
    """A network's lower precision is not the data's."""
    plane = plane_of(turbulence((12, 600)).float())
    wanted = tl.educe(plane, liner)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = tl.educe(plane, liner)
    assert torch.equal(found.coherence, wanted.coherence)
    for averaging in wanted.averagings:
        assert torch.equal(found.cells[averaging].reflection, wanted.cells[averaging].reflection)


def test_a_velocity_along_the_flow_is_refused_or_noted():
    """v is nearly all mean there; a v that does not fluctuate at all is the model at one |v|."""
    liner = tl.load_liner("polito").replace(cell_pitch=None)
    v = turbulence((2, 600))
    v = (v - v.mean(1, keepdim=True)) / v.std(1, keepdim=True)
    with pytest.raises(ValueError, match=r"mean of v is \d+(\.\d)? times its rms \(limit 10\).*--mean removed"):
        tl.educe(plane_of(v + 20), liner, 1400.0)
    assert "large-mean" not in {note.code for note in tl.educe(plane_of(v + 20), liner, 1400.0, mean="removed").notes}
    with pytest.warns(tl.DataWarning, match=r"mean of v is [45]\.?\d* times its rms"):
        found = tl.educe(plane_of(v + 5), liner, 1400.0)
    assert "large-mean" in {note.code for note in found.notes}
    assert tl.educe(plane_of(torch.full_like(v, 20.0)), liner, 1400.0).notes == ()
