"""Random samples onto a grid: what is reproduced, what is damped, and what can be taken back."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.signal import lombscargle

import torchliner as tl
from torchliner.bursts.arrivals import corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.names import GRID_METHODS

FREQUENCY, RATE = 1500.0, 15e3
quiet = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def poisson(rate: float, seconds: float, seed: int = 0) -> torch.Tensor:
    """Arrival times, s, float64."""
    generator = torch.Generator().manual_seed(seed)
    steps = torch.empty(int(1.2 * rate * seconds) + 20, dtype=torch.float64)
    times = steps.exponential_(rate, generator=generator).cumsum(0)
    return times[times < seconds]


def poisson_attenuation(rate, method="linear"):
    """Mean factor on the tone of Poisson arrivals, x = omega/rate; derived in scripts/ldv_interpolation.py."""
    x = 2 * math.pi * FREQUENCY / rate
    return math.log1p(x**2) / x**2 if method == "linear" else 1 / (1 + 1j * x)


def normal(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(10_000 + seed)  # not that of the arrivals
    return torch.randn(count, generator=generator, dtype=torch.float64)


def tone(times: torch.Tensor, amplitude: complex, frequency: float = FREQUENCY) -> torch.Tensor:
    """A e^{j omega t} + A* e^{-j omega t}."""
    turns = 2 * math.pi * frequency * times
    return 2 * (amplitude.real * turns.cos() - amplitude.imag * turns.sin())


def test_band_limited_fit_keeps_what_lies_in_its_band():
    """A tone at a quarter of the band: to the penalty's 5e-4 from uniform arrivals, and ten times
    better than linear interpolation from random ones."""
    errors = {}
    uniform = torch.arange(3000, dtype=torch.float64) / RATE
    for kind, times in (("uniform", uniform), ("random", poisson(RATE, 0.2))):
        for method in GRID_METHODS:
            found = onto_grid(times, tone(times, 0.5, RATE / 16), 40e3, method)
            miss = found.values - tone(found.times, 0.5, RATE / 16)
            errors[kind, method] = float(miss[200:-200].square().mean().sqrt())
    assert errors["uniform", "band-limited"] < 5e-4
    assert errors["random", "band-limited"] < 0.1 * errors["random", "linear"]
    assert errors["random", "linear"] < errors["random", "hold"]


@pytest.mark.parametrize("method", ["linear", "band-limited"])
def test_straight_lines_are_kept(method):
    times = poisson(RATE, 0.05)
    found = onto_grid(times, 3.0 - 40.0 * times, 31e3, method)
    assert float((found.values - 3.0 + 40.0 * found.times).abs().max()) < 1e-10


def test_linear_is_numpys():
    times = poisson(RATE, 0.05)
    found = onto_grid(times, normal(len(times)), 31e3)
    wanted = np.interp(found.times.numpy(), times.numpy(), normal(len(times)).numpy())
    assert found.values.numpy() == pytest.approx(wanted, abs=1e-9)


def test_published_attenuation():
    """0.84, 0.94, 0.98 for 1500 Hz at 15, 25, 50 kHz: numbers of the project's notes."""
    found = [poisson_attenuation(rate) for rate in (15e3, 25e3, 50e3)]
    assert found == pytest.approx([0.84, 0.94, 0.98], abs=5.1e-3)


@pytest.mark.parametrize("method", ["linear", "hold"])
@pytest.mark.parametrize("rate", [6e3, 15e3, 40e3])
@quiet
def test_actual_arrivals_average_to_the_closed_form(method, rate):
    """Over 80 draws, to four standard errors."""
    factors = []
    for seed in range(80):
        times = poisson(rate, 0.05, seed)
        found = tone_attenuation(onto_grid(times, times, 60e3, method), FREQUENCY, "boxcar")
        factors.append(complex(found.factor[0]))
    closed = complex(poisson_attenuation(rate, method))
    for drawn, wanted in (
        (np.real(factors), closed.real),
        (np.imag(factors), closed.imag),
    ):
        error = drawn.std(ddof=1) / math.sqrt(len(drawn))
        assert abs(drawn.mean() - wanted) < 4 * error + 1e-9
        assert error < 0.01


@pytest.mark.parametrize("method", GRID_METHODS)
@pytest.mark.parametrize("window", ["hann", "boxcar"])
@quiet
def test_factor_and_image_say_what_becomes_of_any_tone(method, window):
    """A tone of any phase and a mean, over 75.4 periods: A comes back to rounding."""
    times = poisson(RATE, 75.4 / FREQUENCY)
    amplitude = 0.8 - 0.3j
    found = onto_grid(times, 2.5 + tone(times, amplitude), 47e3, method)
    factors = tone_attenuation(found, FREQUENCY, window=window)
    phase = np.exp(2j * np.pi * FREQUENCY * found.start)
    line = factors.line(found)
    assert complex(factors.true_amplitude(line)[0]) == pytest.approx(amplitude * phase, abs=1e-12)
    again = factors.line(corrected_coherent_part(found, factors))
    assert complex(again[0]) == pytest.approx(amplitude * phase, abs=1e-12)
    back = corrected_coherent_part(found, factors, noise=True)
    wanted = 2.5 + tone(found.times, amplitude)
    assert float((back.values - wanted).abs().max()) < 1e-10
    limit = 0.1 if method != GRID_METHODS[2] else 1e-3
    assert abs(complex(line[0]) - amplitude * phase) > limit


@quiet
def test_corrected_line_is_lomb_and_scargles():
    """Without noise both are A; lombscargle sees the arrivals alone, and no grid."""
    times = poisson(RATE, 0.1)
    signal = tone(times, 0.7 - 0.2j) + 1.0
    found = onto_grid(times, signal, 30e3)
    factors = tone_attenuation(found, FREQUENCY)
    back = factors.true_amplitude(factors.line(found))
    seen = lombscargle(
        times.numpy(),
        signal.numpy(),
        [2 * np.pi * FREQUENCY],
        floating_mean=True,
        normalize="amplitude",
    )
    assert abs(complex(back[0])) == pytest.approx(abs(complex(seen)) / 2, rel=1e-9)


def gapped() -> torch.Tensor:
    times = torch.arange(1000, dtype=torch.float64) / 10e3
    return torch.cat([times[:400], times[400:] + 0.03])


def test_long_gaps_are_warned_of():
    times = gapped()
    with pytest.warns(tl.DataWarning, match=r"longest gap between arrivals is 30.1 ms at 0.0399 s"):
        found = onto_grid(times, torch.zeros(1000), 10e3)
    assert found.longest_gap == pytest.approx((0.0301, 0.0399))


TIMES = torch.arange(100, dtype=torch.float64) / 10e3
ZEROS = torch.zeros(100)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: onto_grid([0.0, 2.0, 1.0], [1.0, 1.0, 1.0]), "1 times do not increase, first 2 s"),
        (lambda: onto_grid([0.0], [1.0]), "two samples at least"),
        (lambda: onto_grid(TIMES, ZEROS, 0.0), "rate of the grid .* is 0"),
        (lambda: onto_grid(TIMES, ZEROS, 50.0), r"has 1\.\d+ points"),
        (lambda: onto_grid([TIMES, TIMES], [ZEROS, ZEROS]), r"shape \(2, 100\)"),
        (lambda: onto_grid(TIMES, ZEROS + math.nan), "100 samples are nan or inf"),
        (lambda: onto_grid(TIMES, ZEROS[1:]), r"\(100,\), values \(99,\)"),
        (lambda: onto_grid(TIMES, ZEROS, method="lineal"), "did you mean 'linear'"),
        (lambda: onto_grid(TIMES, ZEROS, method="band-limited", band=-1.0), "band .* is -1"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS), 5001.0), "fewer than two a period of 5001 Hz"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS, 30e3, "band-limited"), 3000.0), "band of the fit, 2500"),
        (lambda: tone_attenuation(onto_grid(TIMES, ZEROS, 2e3), 1500.0), "at or above Nyquist, 1000 Hz"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
