"""Correlation and spectrum of random samples by slots."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from test_arrivals import FREQUENCY, RATE, TIMES, normal, poisson, tone

from studies.slotting import slotted_correlation, slotted_spectrum


def brute_force(times: np.ndarray, values: np.ndarray, slot: float, count: int) -> list[float]:
    values = values - values.mean()
    sums = np.zeros((3, count))
    for i in range(len(times)):
        for j in range(i + 1, len(times)):
            k = math.floor((times[j] - times[i]) / slot + 0.5)
            if k < count:
                sums[:, k] += values[i] * values[j], values[i] ** 2, values[j] ** 2
    return list(sums[0] / np.sqrt(sums[1] * sums[2]))


def test_slotting_is_the_sum_over_pairs():
    times, values = poisson(RATE, 0.01), normal(1000)
    values = values[: len(times)]
    found = slotted_correlation(times, values, 1e-4, 2e-3)
    wanted = brute_force(times.numpy(), values.numpy(), 1e-4, 21)
    assert found.coefficient == pytest.approx(wanted, abs=1e-12)


def test_slotted_spectrum_of_an_exponential_correlation():
    """Ornstein-Uhlenbeck noise, exact at random times; uncorrelated noise on top does not enter."""
    scale, spread = 1e-3, 2.0
    times = poisson(20e3, 3.0)
    decay = torch.exp(-times.diff() / scale)
    kicks = spread * torch.sqrt(1 - decay**2) * normal(len(times))[1:]
    values = np.empty(len(times))
    values[0] = 0.0
    for i, (share, kick) in enumerate(zip(decay.tolist(), kicks.tolist(), strict=True)):
        values[i + 1] = share * values[i] + kick
    noisy = torch.tensor(values) + normal(len(times), 1)
    found = slotted_correlation(times, noisy, 5e-5, 20e-3)
    share = spread**2 / (spread**2 + 1)
    wanted = share * np.exp(-found.lag / scale)
    assert found.coefficient[1:] == pytest.approx(wanted[1:], abs=0.05)
    frequency, density = slotted_spectrum(found)
    closed = 4 * spread**2 * scale / (1 + (2 * np.pi * frequency * scale) ** 2)
    assert np.mean(density[:20] / closed[:20]) == pytest.approx(1, abs=0.1)
    integral = np.trapezoid(density, frequency)
    assert integral == pytest.approx(found.variance * found.coefficient[0], rel=1e-9)


def test_slotted_spectrum_of_a_tone():
    """The peak is at its frequency and, under the window's, holds its power 2|A|^2."""
    times = poisson(RATE, 2.0)
    found = slotted_correlation(times, tone(times, 0.5), 2e-5, 20e-3)
    frequency, density = slotted_spectrum(found)
    peak = int(density.argmax())
    assert frequency[peak] == pytest.approx(FREQUENCY, abs=1e-9)
    power = density[peak - 3 : peak + 4].sum() * frequency[1]
    assert power == pytest.approx(0.5, rel=0.03)
    assert found.coefficient[:51:25] == pytest.approx(np.cos(2 * np.pi * FREQUENCY * found.lag[:51:25]), abs=0.05)


def test_empty_slots_are_refused():
    found = slotted_correlation(TIMES, torch.sin(1e3 * TIMES), 3e-5, 1e-3)
    with pytest.raises(ValueError, match="slots hold no pair"):
        slotted_spectrum(found)
