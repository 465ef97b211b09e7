"""What ``educe`` refuses or doubts, and how it says so."""

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, frozen_plane, plane_of, turbulence

import torchliner as tl


def good(samples: int = 600) -> tl.VelocityPlane:
    return plane_of(turbulence((3, samples)))


OPTIONS = [
    ({"averaging": "velocty"}, r"unknown averaging 'velocty' \(did you mean 'velocity'\?\)"),
    ({"phase": "average"}, "phase 'average'.*'averaged'"),
    ({"device": "gpu"}, "unknown device 'gpu'; use 'cpu'"),
    ({"phase": "given", "reference_phase": float("nan")}, "reference_phase.*not finite"),
    ({"minimum_coherence": float("nan")}, "minimum_coherence is nan"),
    ({"dtype": "float16"}, "unknown dtype 'float16'"),
    ({"dtype": torch.float16}, "unknown dtype 'float16'"),
    ({"phase": "given"}, "reference_phase, in rad"),
    ({"reference_phase": 0.0}, "phase='given' and reference_phase"),
    ({"phase": "given", "reference_phase": torch.zeros(7)}, r"shape \(7,\).*\(3,\)"),
    ({"minimum_coherence": 2.0}, "minimum_coherence is 2"),
    ({"wall_filter": -0.1}, "wall_filter is -0.1"),
    ({"interval": 1.0}, "interval is 1; it is a level between 0 and 1"),
    ({"level_limit": -1.0}, "level_limit is -1 dB"),
    ({"background": 1.0, "averaging": "velocity"}, "background is only used with averaging='phase-locked'"),
    ({"running_window": 1e-3}, "running_window is only used with drive='running-rms'"),
    ({"frequency": 21000.0}, "21000 Hz is at or above Nyquist, 21000 Hz.*sampling rate of 42000"),
    ({"frequency": -1400.0}, "frequency.*-1400"),
    ({"frequency": []}, "no frequency"),
    ({"frequency": 100.0}, "holds 1.43 periods of 100 Hz, fewer than 4; pass allow_short=True"),
    ({"window": "hamn", "incident": 1400.0}, r"unknown window 'hamn' \(did you mean 'hann'"),
    ({"levels": 10**6, "incident": 1400.0}, "levels is 1000000; it must be 4 to 10000"),
    ({"velocity_max": 0.0, "incident": 1400.0}, "above velocity_max, 0 m/s; extend it"),
    ({"velocity_max": 2.0, "incident": 1400.0}, r"reaches \|v\| = .* m/s at probe \(\d,\), above velocity_max, 2 m/s"),
    ({"incident": "nois:300:3000"}, "nois:300:3000"),
    ({"incident": "noise:300:30000"}, "Nyquist"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS, ids=[str(o) for o, _ in OPTIONS])
def test_bad_options(liner, options, message):
    with pytest.raises(ValueError, match=message):
        (tl.replay if "incident" in options else tl.educe)(good(), liner, **options)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_cuda_asked_for_and_absent(liner):
    with pytest.raises(ValueError, match="sees 0 CUDA devices; use device='cpu'"):
        tl.educe(good(), liner, device="cuda")


def test_nan_and_inf_are_counted_and_placed(liner):
    v = turbulence((2, 3, 600))
    wanted = tl.educe(plane_of(v), liner)
    v[1, 2, 77] = torch.nan
    v[1, 2, 99] = torch.inf
    v[0, 1, 5] = -torch.inf
    with pytest.raises(
        ValueError, match=r"nan or inf at 2 of 6 probes, the first at probe \(0, 1\), sample 5.*exclude"
    ):
        tl.educe(plane_of(v), liner)
    with pytest.warns(tl.DataWarning, match="2 of 6 probes hold nan or inf; excluded"):
        found = tl.educe(plane_of(v), liner, missing="exclude")
    bad = torch.zeros(2, 3, dtype=torch.bool)
    bad[1, 2] = bad[0, 1] = True
    assert bool(torch.isnan(found.impedance[bad].real).all())
    kept = ~bad
    assert float((found.impedance[kept] - wanted.impedance[kept]).abs().max()) < 1e-12
    average = 1 / (1 / found.impedance[kept]).mean(0)
    assert float((found.liner["admittance"].impedance - average).abs().max()) < 1e-12
    assert float((found.cells["admittance"].impedance[0] - average).abs().max()) < 1e-12
    with pytest.raises(ValueError, match="every probe holds nan or inf"):
        tl.educe(plane_of(torch.full((2, 600), torch.nan)), liner, missing="exclude")


def test_dead_probes_are_doubted(liner):
    """Constant probes among live ones are counted, and a plane of zeros; a wholly frozen plane is not a fault."""
    v = turbulence((4, 600))
    for value in (0.0, 1.5):
        v[2] = value
        with pytest.warns(tl.DataWarning, match="1 of 4 probes are constant.*index 2"):
            tl.educe(plane_of(v), liner)
    assert tl.educe(frozen_plane(1.0, periods=20), liner).notes == ()
    with pytest.warns(tl.DataWarning, match="3 of 3 probes are constant"):
        found = tl.educe(frozen_plane(0.0, periods=20), liner)
    assert complex(found.impedance[0, 0]) == pytest.approx(complex(liner.impedance(1400.0)))


def test_speed_beyond_a_table():
    table = tl.TabulatedLiner([200.0, 4000.0], np.ones((2, 2)) * (0.5 + 0.1j), speed=[0.0, 4.0], name="measured")
    v = turbulence((2, 3, 600), rms=1.0)
    v[1, 1, 40] = -4.5
    with pytest.raises(ValueError, match=r"= 4.5 m/s at probe \(1, 1\).*above the liner's table, 4 m/s"):
        tl.educe(plane_of(v), table)
    v[1, 1, 40] = 0.0
    found = tl.educe(plane_of(v.clamp(-3.9, 3.9)), table)
    assert complex(found.answer[0]) == pytest.approx(0.5 + 0.1j, abs=1e-5)
    v = torch.stack([turbulence((600,), rms=1.0).clamp(-3, 3), torch.full((600,), 3.5)])
    v[1, ::2] = 3.4
    v += torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(600)) * torch.tensor([[2.0], [-0.4]])
    v = v.clamp(-3.99, 3.99)
    with pytest.raises(ValueError, match=r"averaging 'phase-locked'.*above the liner's table, 4 m/s"):
        tl.educe(plane_of(v), table)
    found = tl.educe(plane_of(v), table, averaging="admittance")
    assert complex(found.answer[0]) == pytest.approx(0.5 + 0.1j, abs=1e-5)


@pytest.mark.parametrize("choices", [{"drive": "rms"}, {"mean": "removed"}], ids=str)
def test_a_table_serves_the_speeds_that_drive(choices):
    """Peaks of 4.5 m/s around a mean of 1.5 m/s: neither the rms nor what is left without the
    mean reaches 4 m/s."""
    table = tl.TabulatedLiner([200.0, 4000.0], np.full((2, 2), 0.5 + 0.1j), speed=[0.0, 4.0])
    v = 1.5 + turbulence((3, 600), rms=0.8).clamp(-2.9, 2.9)
    v[1, 40] = 4.5
    assert complex(tl.educe(plane_of(v), table, **choices).answer[0]) == pytest.approx(0.5 + 0.1j)
    with pytest.raises(ValueError, match="above the liner's table"):
        tl.educe(plane_of(v), table)


def test_phases_of_probes_are_not_those_of_frequencies(liner):
    """Two values are of two probes; with a last axis they are of frequencies."""
    plane = plane_of(turbulence((2, 600)))
    asked = {"frequency": [1400.0, 2100.0], "phase": "given", "interval": None}
    by_probe = tl.educe(plane, liner, reference_phase=[0.0, 1.2], **asked)
    spelled = tl.educe(plane, liner, reference_phase=[[0.0, 0.0], [1.2, 1.2]], **asked)
    assert complex(by_probe.answer[0]) == complex(spelled.answer[0])
    by_frequency = tl.educe(plane, liner, reference_phase=[[0.0, 1.2]], **asked)
    alone = tl.educe(plane, liner, reference_phase=1.2, **{**asked, "frequency": 2100.0})
    assert complex(by_frequency.answer[1]) == pytest.approx(complex(alone.answer[0]), rel=1e-9)


def test_velocities_beyond_sound_are_a_unit_mistake(liner):
    with pytest.raises(ValueError, match=r"beyond the speed of sound, 343.2 m/s; check the unit"):
        tl.educe(plane_of(1000 * turbulence((2, 600))), liner)


@pytest.mark.parametrize("value", [complex("nan"), -1.0 + 0j])
def test_a_liner_without_a_reflection_is_named(value):

    class Broken:
        def impedance(self, frequency, speed):
            return value * torch.ones_like(frequency * speed)

    with pytest.raises(ValueError, match=r"Broken.impedance.*gave nan, inf or -1"):
        tl.educe(good(), Broken())


def test_what_is_no_plane_or_no_liner_is_said(liner):
    with pytest.raises(TypeError, match=r"'polito', without impedance.*load_liner"):
        tl.educe(good(), "polito")
    with pytest.raises(TypeError, match="plane is Tensor; make a VelocityPlane"):
        tl.educe(torch.ones(3, 600), liner)
