"""Several tones at once: the waves sent are found again, with what each makes of the others."""

import itertools
import warnings

import pytest
import torch
from conftest import RATE, plane_of, relative_error, turbulence

import torchliner as tl
from torchliner.checks import real_tensor
from torchliner.liners.model import LinerModel
from torchliner.liners.response import reflection_of
from torchliner.tdibc.several_tones import MOST_TONES

SAMPLES = 1680  # 40 ms: lines 25 Hz apart, so that all tones below are whole periods
QUIET = {"order": "probes first", "interval": None, "tolerance": 1e-13}
CASES = {
    "apart": ((1050.0, 1400.0), (3.0, 2.0)),
    "an octave": ((1400.0, 2800.0), (3.0, 1.0)),
    "one to three": ((1050.0, 3150.0), (2.0, 1.5)),  # 3f - f = 2f
    "close": ((1400.0, 1425.0), (2.0, 2.0)),
    "three": ((700.0, 1400.0, 2100.0), (2.0, 1.5, 1.0)),
}


def lines_of(liner, incident, speed, frequency):
    """Lines of the reflected wave, sum of x_k e^{-j omega k} R(f, |v_k|): method.md, retyped."""
    times = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    f = torch.as_tensor(frequency, dtype=torch.float64)[:, None]
    response = reflection_of(liner, f, speed)
    return (response * incident * torch.exp(-2j * torch.pi * f * times)).mean(-1)


def replayed(liner, tones, amplitudes, seed=0, noise=0.3):
    """v = x - y of a wave sent at a liner, y of |v| itself; half amplitudes X and lines Y."""
    generator = torch.Generator().manual_seed(seed)
    phase = 2 * torch.pi * torch.rand(len(tones), generator=generator, dtype=torch.float64)
    sent = torch.polar(torch.tensor(amplitudes, dtype=torch.float64), phase) / 2
    times = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    waves = torch.exp(2j * torch.pi * torch.tensor(tones, dtype=torch.float64)[:, None] * times)
    x = 2 * (sent[:, None] * waves).sum(0).real
    flow = turbulence((SAMPLES,), seed=seed, rms=noise) if noise else torch.zeros(SAMPLES)
    spectrum = torch.fft.rfft(flow)  # what is no sound has no part at the tones
    spectrum[[round(f * SAMPLES / RATE) for f in tones]] = 0
    flow = torch.fft.irfft(spectrum, n=SAMPLES)
    v = x.clone()
    for _ in range(400):
        y = lines_of(liner, x, v.abs(), tones)
        new = flow + 2 * ((sent - y)[:, None] * waves).sum(0).real
        if float((new - v).abs().max()) < 1e-14:
            break
        v = 0.5 * (v + new)
    return v, sent, lines_of(liner, x, v.abs(), tones)


def joint(velocity, tones, liner, **choices):
    plane = plane_of(-torch.atleast_2d(velocity), frequency=None)  # stored away from the liner
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        return tl.educe(plane, liner, list(tones), phase="joint", **QUIET | choices)


@pytest.mark.parametrize("name", CASES)
def test_the_wave_that_was_sent_is_found_again(name, liner):
    """R is Y/X of the replay that made v, and the wave is X."""
    tones, amplitudes = CASES[name]
    v, sent, y = replayed(liner, tones, amplitudes)
    found = joint(v, tones, liner)
    assert bool(found.phase_rule.all())
    assert relative_error(found.reflection[0], y / sent) < 1e-9
    wave = tl.Tones.of_map(found)
    assert relative_error(torch.polar(wave.amplitude, wave.phase), 2 * sent) < 1e-9


def test_each_tone_alone_would_be_wrong(liner):
    """What the other tone puts there matters: the rule for one tone at a time misses it."""
    tones, amplitudes = CASES["one to three"]
    v, sent, y = replayed(liner, tones, amplitudes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        alone = tl.educe(plane_of(-v[None]), liner, list(tones), phase="self-consistent",
                         minimum_coherence=0.0, **QUIET)  # fmt: skip
    assert float((alone.reflection[0] - y / sent).abs().max()) > 0.02


def test_permuted_tones_and_other_probes(liner):
    """The order of the tones does not matter, nor what stands in the next column."""
    tones, amplitudes = CASES["three"]
    v = torch.stack([replayed(liner, tones, amplitudes, seed)[0] for seed in range(3)])
    found = joint(v, tones, liner)
    for order in itertools.permutations(range(3)):
        other = joint(v, [tones[i] for i in order], liner)
        assert relative_error(other.reflection, found.reflection[:, list(order)]) < 1e-10
    assert relative_error(joint(v[1], tones, liner).reflection[0], found.reflection[1]) < 1e-12


@pytest.mark.parametrize("samples", [420, 840])
def test_one_tone_is_the_rule_for_one(samples, liner):
    """R, wave and error bars of a single tone are those of ``self-consistent``."""
    t = torch.arange(samples, dtype=torch.float64) / RATE
    v = turbulence((4, samples), rms=1.0) + 4 * torch.cos(2 * torch.pi * 1400 * t + 0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        one, other = (
            tl.educe(plane_of(v), liner, phase=rule, minimum_coherence=0.0) for rule in ("self-consistent", "joint")
        )
    assert relative_error(other.reflection, one.reflection) < 1e-12
    assert relative_error(other.velocity_amplitude, one.velocity_amplitude) < 1e-12
    for name in ("probes", "liner", "cells_coherent_first"):
        mine, theirs = (getattr(each.uncertainty, name) for each in (other, one))
        assert relative_error(mine.standard_error, theirs.standard_error) < 1e-9
        assert relative_error(mine.low, theirs.low) < 1e-9


def test_records_that_are_no_whole_periods(liner):
    """Amplitudes are exact in any record that tells the tones apart, mean and all."""
    tones = (1013.0, 1391.0)
    t = torch.arange(1111, dtype=torch.float64) / RATE
    v = 0.7 + 3 * torch.cos(2 * torch.pi * tones[0] * t) - 2 * torch.sin(2 * torch.pi * tones[1] * t)
    found = joint(-v, tones, liner)
    assert relative_error(found.velocity_amplitude[0], torch.tensor([-3.0, -2j])) < 1e-10
    assert float(found.coherence.min()) > 1 - 1e-9


def test_a_frozen_speed_gives_the_model(liner):
    """Where |v| never changes no tone reaches another: R is the model's at each."""
    tones = (1050.0, 1400.0)
    t = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    faint = sum(1e-9 * torch.cos(2 * torch.pi * f * t) for f in tones)
    found = joint(faint + 3.0, tones, liner)
    assert bool(found.phase_rule.all())
    wanted = reflection_of(liner, torch.tensor(tones, dtype=torch.float64), torch.tensor(3.0))
    assert relative_error(found.reflection[0], wanted.to(torch.complex128)) < 1e-7


class Weak(LinerModel):
    """Z = 1.5 + a |v|, a so small that the change of Z is of first order in it."""

    def impedance(self, frequency, speed=0.0):
        return torch.complex(1.5 + 1e-3 * real_tensor(speed) + 0 * real_tensor(frequency),
                             0 * real_tensor(speed) + 0 * real_tensor(frequency))  # fmt: skip


@pytest.mark.parametrize(
    ("tones", "peaks", "wanted"),
    [
        ((1400.0,), (3.0,), [8 / (3 * torch.pi) * 3]),  # of |v| v, against 2/pi of |v|
        ((1400.0, 2450.0), (3.0, 1e-4), [8 / (3 * torch.pi) * 3, 2 * 2 / torch.pi * 3]),
    ],
)
def test_the_law_of_squares(tones, peaks, wanted, liner):
    """For a small a |v| in Z the rule is harmonic balance of a |v| v: 8/(3 pi) of a tone's peak,
    and for a weak second tone, since d(|v| v) = 2 |v| dv, twice the mean |v|: worked by hand."""
    t = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    v = sum(peak * torch.cos(2 * torch.pi * f * t) for f, peak in zip(tones, peaks, strict=True))
    found = joint(v, tones, Weak(), minimum_coherence=0.0)
    change = (found.impedance[0] - 1.5) / 1e-3
    assert relative_error(change, torch.tensor(wanted)) < 3e-3


def test_the_time_domain_agrees(liner):
    """The wave that the rule finds, replayed tap by tap at the same v, has the same R."""
    tones, amplitudes = CASES["apart"]
    v, _, _ = replayed(liner, tones, amplitudes)
    found = joint(v, tones, liner)
    wave = tl.Tones.of_map(found, probe=0)
    plane = plane_of(-v[None], frequency=None)
    for engine in ("unfold", "direct"):
        again = tl.educe(plane, liner, incident=wave, engine=engine, edge="wrap", window="boxcar")
        assert relative_error(again.reflection, found.reflection) < 2e-6


def test_a_recorded_wave_agrees_with_its_tones(liner):
    """Measured samples of the incident wave do what its amplitudes and phases do."""
    tones, amplitudes = CASES["an octave"]
    v, _, _ = replayed(liner, tones, amplitudes)
    plane, wave = plane_of(-v[None], frequency=None), tl.Tones.of_map(joint(v, tones, liner))
    samples = tl.Recorded(wave.sampled(SAMPLES, RATE), RATE)
    how = {"edge": "wrap", "window": "boxcar"}
    one = tl.educe(plane, liner, incident=wave, **how)
    other = tl.educe(plane, liner, list(tones), incident=samples, **how)
    assert relative_error(other.reflection, one.reflection) < 1e-9


def test_error_bars_follow_the_scatter_of_draws(liner):
    """The stated standard error of R + jX is that of many draws of the turbulence."""
    tones = (1050.0, 1400.0)
    t = torch.arange(4 * SAMPLES, dtype=torch.float64) / RATE
    sound = 4 * torch.cos(2 * torch.pi * tones[0] * t) + 3 * torch.sin(2 * torch.pi * tones[1] * t)
    v = sound + turbulence((300, 4 * SAMPLES), rms=1.5)
    found = joint(v, tones, liner, interval=0.95)
    error, z = found.uncertainty.probes.standard_error, found.impedance
    for part in ("real", "imag"):
        stated = getattr(error, part).square().mean(0).sqrt()
        assert relative_error(stated, getattr(z, part).std(0)) < 0.25


def test_a_tone_that_is_not_there_is_no_part_of_the_wave(liner):
    """It falls back with a message, and the others are as without it."""
    v, sent, y = replayed(liner, (1400.0,), (3.0,))
    plane = plane_of(-v[None], frequency=None)
    with pytest.warns(tl.DataWarning, match="coherence below 0.5 with 2450 Hz at 1 of 1 probes"):
        found = tl.educe(plane, liner, [1400.0, 2450.0], phase="joint", **QUIET)
    assert found.phase_rule[0].tolist() == [True, False]
    assert relative_error(found.reflection[0, :1], y / sent) < 1e-9
    averaged = tl.educe(plane, liner, 2450.0, **QUIET)
    assert relative_error(found.reflection[0, 1:], averaged.reflection[0]) < 1e-9
    with pytest.raises(ValueError, match="not coherent with 2450 Hz"):
        tl.Tones.of_map(found)
    with pytest.raises(ValueError, match="phase 'averaged' knows no phase"):
        tl.Tones.of_map(averaged)


def test_what_other_tones_make_is_said(liner):
    """A weak tone where the strong one's distortion falls is none of the liner's R."""
    v, _, _ = replayed(liner, (1050.0, 3150.0), (6.0, 0.2), noise=0.0)
    with pytest.warns(tl.DataWarning, match=r"reflected at 3150 Hz a share of [\d.]+ .median of the probes"):
        tl.educe(plane_of(-v[None], frequency=None), liner, [1050.0, 3150.0], phase="joint", **QUIET)


@pytest.mark.parametrize(
    ("tones", "choices", "message"),
    [
        ((1400.0, 1410.0), {}, r"are 10 Hz apart, .* 40 ms .* 25 Hz apart; 100 ms of record"),
        ((1400.0, 1400.0), {}, "name it once"),
        (tuple(700.0 + 100 * i for i in range(MOST_TONES + 1)), {}, "takes 6 .* 5 are the most"),
        ((1400.0, 22000.0), {}, "22000 Hz is at or above Nyquist, 21000 Hz"),
        ((1050.0, 1400.0), {"engine": "unfold", "tolerance": None}, "leave engine and window out"),
        ((1050.0, 1400.0), {"window": "hann"}, "leave engine and window out"),
    ],
)
def test_tones_that_cannot_be(tones, choices, message, liner):
    with pytest.raises(ValueError, match=message):
        joint(turbulence((SAMPLES,)), tones, liner, **choices)


def test_moments_hold_it(liner):
    """Reduced with the rule, the data are not needed; reduced without, it says what lacks."""
    tones, amplitudes = CASES["apart"]
    v, sent, y = replayed(liner, tones, amplitudes)
    plane = plane_of(-v[None], frequency=None)
    kept = tl.moments(plane, liner, list(tones), phase="joint", interval=None, tolerance=1e-13)
    with pytest.warns(tl.DataWarning, match="of the other tones"):
        found = kept.educe(liner, list(tones), phase="joint", interval=None)
    assert relative_error(found.reflection[0], y / sent) < 1e-9
    bare = tl.moments(plane, liner, list(tones))
    with pytest.raises(ValueError, match="no sums of waves of 350 Hz"):
        bare.educe(liner, list(tones), phase="joint")
