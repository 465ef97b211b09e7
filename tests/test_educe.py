"""``educe``: laws of the whole chain through the public names."""

from __future__ import annotations

import os

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, frozen_plane, plane_of, relative_error, turbulence

import torchliner as tl
from torchliner.velocity import reading

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")

INTERPOLATED = 1e-9  # in R over |v|, of float64


def reflection(found):
    """R of each probe as measured."""
    return found.probes["admittance"].reflection


@pytest.mark.parametrize(("dtype", "error"), [(torch.float64, 3e-9), (torch.float32, 1e-5)])
@pytest.mark.parametrize("drive", ["instantaneous", "rms", "running-rms"])
def test_frozen_velocity_returns_the_model(dtype, error, drive, liner):
    """With |v| constant the replay is linear, so the educed impedance is the model's own."""
    found = tl.educe(frozen_plane(2.0, dtype=dtype), liner, frequency=FREQUENCY, drive=drive)
    wanted = liner.impedance(FREQUENCY, 2.0)
    assert relative_error(found.impedance, wanted) < error


def test_a_value_worked_by_hand():
    """R of z = 0.5 + 1j is (-0.5 + 1j)(1.5 - 1j)/3.25: sign and conjugation are right."""

    class Fixed:
        def impedance(self, frequency, speed):
            return (0.5 + 1j) * torch.ones_like(frequency * speed).to(torch.complex128)

    for phase, extra in (("averaged", {}), ("given", {"reference_phase": 0.7})):
        found = tl.educe(frozen_plane(1.0), Fixed(), phase=phase, **extra)
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
    resistance, reactance = found.resistance, found.reactance
    assert [float(resistance.min()), float(resistance.max())] == pytest.approx([0.82, 2.24], abs=0.01)
    assert [float(reactance.min()), float(reactance.max())] == pytest.approx([-0.95, 0.41], abs=0.05)
    averaged = tl.educe(plane, liner, 1500.0)
    assert 0.82 < float(averaged.resistance[0, 0]) < 2.24


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

    class Matched:
        def impedance(self, frequency, speed):
            return torch.ones_like(frequency * speed).to(torch.complex128)

    t = torch.arange(480, dtype=torch.float64) / RATE
    plane = plane_of(torch.cos(2 * torch.pi * FREQUENCY * t)[None])
    found = tl.educe(plane, Matched())
    pressure = 1.204 * 343.2
    level = 20 * np.log10(pressure / 2**0.5 / 20e-6)
    assert float(found.inferred_incident_level[0, 0]) == pytest.approx(level, abs=1e-6)
    # v along +y is out of the liner, so the wave has the opposite phase of v
    assert complex(found.velocity_amplitude[0, 0]) == pytest.approx(-1, rel=1e-9)


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
    """rms and running rms are what they say; a removed mean is a removed mean."""
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
    """Two cells: admittance averages, and the velocity averaged first, are what they say."""
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
    """Time-major memory, strided views and float32 give what a plain tensor gives."""
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
    """Between the two readings."""
    path = tmp_path / "plane.h5"
    plane_of(turbulence((3, 1920)), x=[0.0, 1e-3, 2e-3]).write(path)

    def change(_samples: int) -> None:
        os.utime(path, ns=(1, 1))

    with pytest.raises(OSError, match=r"plane\.h5.* was changed while it was read"):
        tl.educe(tl.read_plane(path, lazy=True), liner, progress=change)
