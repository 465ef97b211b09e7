"""
What interpolation does to a tone
=================================

Random arrivals, as a laser Doppler system has them, drawn to a uniform grid by straight lines: the
share of a 1500 Hz tone that is left, against the mean rate.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

generator, rates = torch.Generator().manual_seed(1), (8e3, 15e3, 25e3, 50e3, 100e3)
for rate in rates:
    gaps = torch.empty(int(2.2 * rate), dtype=torch.float64).exponential_(rate, generator=generator)
    times = gaps.cumsum(0)
    factor = tl.tone_attenuation(tl.onto_grid(times, times, rate=200e3), 1500.0).factor
    plt.plot(rate / 1e3, factor.abs().mean(), "C0o")
plt.axvline(15, color="0.7", linestyle="--", label="of the paper")
plt.legend()
plt.xscale("log")
plt.xlabel("rate of bursts (kHz)")
plt.ylabel("share of the tone that is left")
