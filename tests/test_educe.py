"""Laws of the whole chain through the public names, and what stands at the rim: units, kinds, gaps."""

import os
import warnings
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, codes, doubtful, frozen_plane, plane_of, relative_error, turbulence
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.records.cells import Cells
from torchliner.velocity import reading

INTERPOLATED = 1e-9  # in R over |v|, of float64


def reflection(found):
    return found.probes["admittance"].reflection


@dataclass
class Constant:
    z: complex

    def impedance(self, frequency, speed):
        return self.z * torch.ones_like(frequency * speed).to(torch.complex128)


@pytest.mark.parametrize(("dtype", "error"), [(torch.float64, 3e-9), (torch.float32, 1e-5)])
@pytest.mark.parametrize("drive", ["instantaneous", "rms", "running-rms"])
def test_frozen_velocity_returns_the_model(dtype, error, drive, liner):
    """With |v| constant the replay is linear, so the educed impedance is the model's own."""
    found = tl.educe(frozen_plane(2.0, dtype=dtype), liner, frequency=FREQUENCY, drive=drive)
    wanted = liner.impedance(FREQUENCY, 2.0)
    assert relative_error(found.impedance, wanted) < error


def test_a_value_worked_by_hand():
    """R of z = 0.5 + 1j is (-0.5 + 1j)(1.5 - 1j)/3.25: sign and conjugation are right."""
    for phase, extra in (("averaged", {}), ("given", {"reference_phase": 0.7})):
        found = tl.educe(frozen_plane(1.0), Constant(0.5 + 1j), phase=phase, **extra)
        assert complex(reflection(found)[0, 0]) == pytest.approx((-0.5 + 1j) * (1.5 - 1j) / 3.25, abs=1e-12)
        assert complex(found.liner["admittance"].impedance[0]) == pytest.approx(0.5 + 1j, abs=1e-12)


@pytest.mark.parametrize("psi", [0.0, 0.9, -2.0])
def test_given_phase_is_the_exact_identity(liner, psi):
    """The line of the reflected tone x = cos(omega t + psi) over whole periods, written out."""
    velocity = turbulence((3, 480))
    found = tl.educe(plane_of(velocity), liner, frequency=1400.0, phase="given", reference_phase=psi)
    z = liner.impedance(FREQUENCY, velocity.abs())
    angle = 2 * np.pi * FREQUENCY / RATE * torch.arange(480, dtype=torch.float64)
    emitted = torch.cos(angle + psi) * torch.exp(-1j * angle)
    wanted = ((z - 1) / (z + 1) * emitted).sum(-1) / emitted.sum()
    assert float((reflection(found)[:, 0] - wanted).abs().max()) < INTERPOLATED


def test_phase_decides_for_tonal_velocity():
    """ONERA, v tonal of 3 m/s peak at 1500 Hz: R from 0.82 to 2.24 and X from -0.95 to +0.41."""
    liner = tl.load_liner("onera")
    rate = 60 * 1500.0
    t = torch.arange(60 * 16, dtype=torch.float64) / rate
    v = 3 * torch.cos(2 * torch.pi * 1500.0 * t).expand(72, -1)
    psi = torch.arange(72, dtype=torch.float64) * (torch.pi / 72)
    plane = tl.VelocityPlane(v, sampling_rate=rate)
    found = tl.educe(plane, liner, 1500.0, phase="given", reference_phase=psi)
    z = found.impedance
    for part, wanted, limit in ((z.real, [0.82, 2.24], 0.01), (z.imag, [-0.95, 0.41], 0.05)):
        assert [float(part.min()), float(part.max())] == pytest.approx(wanted, abs=limit)
    assert 0.82 < float(tl.educe(plane, liner, 1500.0).impedance[0, 0].real) < 2.24


def test_self_consistent_wave_reproduces_the_velocity(liner):
    """Its reflection is a + b X*/X, and X - Y is v_in's own part at f: checked on direct's a, b."""
    t = torch.arange(480, dtype=torch.float64) / RATE
    v = -1.3 * torch.cos(2 * torch.pi * FREQUENCY * t + 0.4)
    found = tl.educe(plane_of(v.expand(2, -1)), liner, phase="self-consistent")
    wave = found.velocity_amplitude / (1 - reflection(found)) / liner.fluid.sound_speed
    psi = float(wave[0, 0].angle())
    stated = tl.educe(plane_of(v.expand(2, -1)), liner, phase="given", reference_phase=psi)
    assert float((reflection(found) - reflection(stated)).abs().max()) < 1e-12
    # v_in = c (x - y): amplitude and phase of the velocity come back
    velocity = liner.fluid.sound_speed * wave * (1 - reflection(found))
    assert complex(velocity[0, 0]) == pytest.approx(1.3 * np.exp(0.4j), abs=1e-10)


def test_incident_level_by_hand(liner):
    """A rigid-like reflection R and V give |p| = rho c |V|/|1 - R|; 1 m/s on z = 1 is 413 Pa."""
    t = torch.arange(480, dtype=torch.float64) / RATE
    plane = plane_of(torch.cos(2 * torch.pi * FREQUENCY * t)[None])
    found = tl.educe(plane, Constant(1.0))
    pressure = 1.204 * 343.2
    level = 20 * np.log10(pressure / 2**0.5 / 20e-6)
    assert float(found.inferred_incident_level[0, 0]) == pytest.approx(level, abs=1e-6)
    # v along +y is out of the liner, so the wave has the opposite phase of v
    assert complex(found.velocity_amplitude[0, 0]) == pytest.approx(-1, rel=1e-9)


@doubtful
def test_incoherent_velocity_falls_back_and_says_so(liner):
    """Where v hardly holds the tone 'self-consistent' is 'averaged', marked per probe and noted."""
    v = turbulence((6, 960), seed=9) + 0.7 * torch.cos(2 * torch.pi * FREQUENCY * torch.arange(960) / RATE)
    averaged = tl.educe(plane_of(v), liner)
    found = tl.educe(plane_of(v), liner, phase="self-consistent")
    off = ~found.phase_rule[:, 0]
    assert int(off.sum()) >= 4
    assert float((reflection(found) - reflection(averaged))[off].abs().max()) < 1e-9
    assert "phase-fell-back" in [note.code for note in found.notes]


def test_drives(liner):
    v = turbulence((2, 960), seed=11) + 2.0
    rms = (v**2).mean(1).sqrt()
    found = tl.educe(plane_of(v), liner, drive="rms")
    assert relative_error(found.impedance[:, 0], liner.impedance(FREQUENCY, rms)) < INTERPOLATED
    removed = tl.educe(plane_of(v), liner, drive="rms", mean="removed")
    wanted = liner.impedance(FREQUENCY, v.std(dim=1, correction=0))
    assert relative_error(removed.impedance[:, 0], wanted) < 1e-9
    shifted = tl.educe(plane_of(v - v.mean(1, keepdim=True)), liner)
    without = reflection(tl.educe(plane_of(v), liner, mean="removed"))
    assert float((without - reflection(shifted)).abs().max()) < 1e-9
    # a running window longer than twice the record is the rms
    long = tl.educe(plane_of(v), liner, drive="running-rms", running_window=1.0)
    assert relative_error(long.impedance, found.impedance) < 1e-9


def test_both_orders_of_averaging(liner):
    pitch = liner.cell_pitch
    x = np.linspace(0.1, 1.9, 10) * pitch
    v = turbulence((2, 10, 480), seed=15)
    plane = plane_of(v, x=x, z=np.array([0.0, 1e-3]))
    found = tl.educe(plane, liner)
    assert len(found.cell_x) == 2
    assert found.cell_x.tolist() == pytest.approx([0.5 * pitch, 1.5 * pitch])
    admittance = (1 / found.impedance[..., 0])[:, :5].mean()
    assert complex(found.cells["admittance"].impedance[0, 0]) == pytest.approx(complex(1 / admittance))
    first = tl.educe(plane_of(v[:, 5:].mean((0, 1))), liner)
    assert complex(found.cells["velocity"].impedance[1, 0]) == pytest.approx(complex(first.impedance[0]), abs=1e-10)
    assert complex(found.liner["admittance"].impedance[0]) == pytest.approx(
        complex(1 / (1 / found.impedance[..., 0]).mean())
    )


def test_float32_and_views(liner):
    v = turbulence((3, 4, 480), seed=17)
    wanted = reflection(tl.educe(plane_of(v), liner))
    major = v.movedim(-1, 0).contiguous().movedim(0, -1)
    padded = torch.zeros(3, 8, 960, dtype=torch.float64)
    padded[:, ::2, ::2] = v
    for view in (major, padded[:, ::2, ::2]):
        assert float((reflection(tl.educe(plane_of(view), liner)) - wanted).abs().max()) < 1e-13
    single = reflection(tl.educe(plane_of(v.to(torch.float32)), liner))
    assert float((single - wanted).abs().max()) < 1e-6
    same = plane_of(v[:1, :1].expand(3, 4, 480))
    still = reflection(tl.educe(same, liner))
    assert float((still - wanted[:1, :1]).abs().max()) < 1e-13


@doubtful
def test_lines_beside_the_tone_are_measured_as_far_as_memory_is_bounded(monkeypatch, liner):
    """Else coherence and amplitude are nan there, and Z, its interval and all at the tone stay."""
    plane, asked = plane_of(turbulence((3, 900))), [1000.0, FREQUENCY, 1700.0]
    whole = tl.educe(plane, liner, asked)
    assert bool(torch.isfinite(whole.coherence).all())
    monkeypatch.setattr(reading, "MOST_OF_LINES", 0)
    bounded = tl.educe(plane, liner, asked)
    for name in ("coherence", "velocity_amplitude"):
        one, other = getattr(whole, name), getattr(bounded, name)
        assert torch.equal(one[..., 1], other[..., 1])
        assert bool(other[..., [0, 2]].isnan().all())
    for averaging in whole.averagings:
        torch.testing.assert_close(whole.liner[averaging].impedance, bounded.liner[averaging].impedance)
        torch.testing.assert_close(whole.liner[averaging].low, bounded.liner[averaging].low)
    filtered = tl.educe(plane, liner, asked, averaging="admittance", wall_filter=0.1)
    assert bool(torch.isfinite(filtered.coherence).all())  # which rests on them


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path, liner):
    path = tmp_path / "plane.h5"
    plane_of(turbulence((3, 1920)), x=[0.0, 1e-3, 2e-3]).write(path)

    def change(_samples: int) -> None:
        os.utime(path, ns=(1, 1))

    with pytest.raises(OSError, match=r"plane\.h5.* was changed while it was read"):
        tl.educe(tl.read_plane(path, lazy=True), liner, progress=change)


X = (torch.arange(15) + 0.5) * 12.44e-3 / 5  # three cells of five probes


@doubtful
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


@pytest.mark.parametrize(
    ("choice", "error", "text"),
    [
        ({"allow_short": "no"}, TypeError, "allow_short is 'no'; True or False is needed"),
        ({"device": "mps"}, ValueError, "unknown device 'mps'; use 'cpu', 'cuda'"),
        ({"device": 1.5}, ValueError, "unknown device 1.5; use 'cpu', 'cuda'"),
    ],
)
def test_choices_of_a_wrong_kind(liner, choice, error, text):
    with pytest.raises(error, match=text):
        tl.educe(plane_of(turbulence((2, 600))), liner, **choice)


@doubtful
def test_a_cell_in_a_gap_counts_in_no_average(liner):
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


@doubtful
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
    assert any(note.code == "lost-cells" and "at least 0.2" in note.text for note in found.notes)
    found.write(tmp_path / "m.nc")
    again = tl.read_map(tmp_path / "m.nc")
    assert torch.equal(again.cell_weight, found.cell_weight)
    assert torch.equal(again.liner["velocity"].impedance, found.liner["velocity"].impedance)


@doubtful
def test_columns_without_probes_have_no_interval(liner):
    """Admittance 0 over no probes would be a rigid wall with an interval."""
    v = turbulence((4, 3, 480))
    v[:, 1] = torch.nan
    found = tl.educe(plane_of(v), liner, missing="exclude").along_x["admittance"].interval
    assert torch.isnan(found.low[:, 0].real).tolist() == [False, True, False]


@pytest.mark.parametrize("shape", [(5, 3000), (4200, 130)])
def test_coherence_does_not_know_other_frequencies(liner, shape):
    v = turbulence((5, shape[1])).repeat(shape[0] // 5, 1)
    v += 3 * torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(shape[1]))
    choices = {"phase": "self-consistent", "interval": None, "allow_short": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        alone = tl.educe(plane_of(v), liner, FREQUENCY, **choices)
        beside = tl.educe(plane_of(v), liner, [200.0, FREQUENCY, 1410.0, 5000.0], **choices)
    assert float((alone.coherence[:, 0] - beside.coherence[:, 1]).abs().max()) < 1e-12
    assert torch.equal(alone.phase_rule[:, 0], beside.phase_rule[:, 1])


def test_one_cell_as_long_as_a_wave_is_said(liner):
    """Its phase-locked velocity would be averaged over a wave that turns along it."""
    plane = plane_of(
        turbulence((4, 480)) + torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(480)), x=[0, 0.03, 0.06, 0.09]
    )
    with pytest.warns(tl.DataWarning, match=r"0\.37 wavelengths long; state cell_pitch"):
        found = tl.educe(plane, liner.replace(cell_pitch=None))
    assert "no-cell-pitch" in codes(found)


@doubtful
def test_a_mean_velocity_is_no_tone(liner):
    """Amplitude and coherence are those without it, where no whole number of samples is a period, and between lines."""
    rate, asked = 41111.0, [FREQUENCY, 900.0]
    v = turbulence((3, 1500), rms=0.02) + 0.1 * torch.cos(2 * torch.pi * FREQUENCY / rate * torch.arange(1500))
    still, moved = (
        tl.educe(plane_of(each, sampling_rate=rate), liner, asked, mean="removed") for each in (v, v + 10.0)
    )
    assert float((moved.velocity_amplitude - still.velocity_amplitude).abs().max()) < 1e-9
    assert float((moved.coherence - still.coherence).abs().max()) < 1e-9


def test_autocast_around_an_eduction_has_no_effect(liner):
    plane = plane_of(turbulence((12, 600)).float())
    wanted = tl.educe(plane, liner)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = tl.educe(plane, liner)
    assert torch.equal(found.coherence, wanted.coherence)
    for averaging in wanted.averagings:
        assert torch.equal(found.cells[averaging].reflection, wanted.cells[averaging].reflection)


def test_a_velocity_along_the_flow_is_refused_or_noted():
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


@given(st.lists(st.tuples(st.integers(-1, 3), st.booleans()), min_size=1, max_size=12))
def test_an_average_is_the_product_with_the_averaging_matrix(probes):
    """Probes outside (-1) and left out count for nothing; a cell of which none is left is 0."""
    centres = torch.arange(4, dtype=torch.float64)
    cells = Cells(torch.tensor([label for label, _ in probes]), centres, torch.zeros_like(centres))
    used = torch.tensor([each for _, each in probes])
    values = torch.randn(2, len(probes), 3, generator=torch.Generator().manual_seed(1)).double()
    values = torch.complex(values, values.flip(0))
    matrix = ((cells.labels[:, None] == torch.arange(4)) & used[:, None]).double()
    wanted = torch.einsum("pc,apf->acf", (matrix / matrix.sum(0).clamp(min=1)).to(values), values)
    found = cells.average(values, used)
    torch.testing.assert_close(found, wanted, rtol=1e-14, atol=1e-15)
    last = cells.average(values.movedim(1, 2), used, axis=-1)
    torch.testing.assert_close(last, wanted.movedim(1, 2), rtol=1e-14, atol=1e-15)
