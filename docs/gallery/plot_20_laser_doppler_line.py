"""
A line of laser Doppler stations
================================

Simulated bursts, a tone in slow turbulence that grows along the liner, at six stations: resistance
and reactance with their intervals.
"""

import matplotlib.pyplot as plt
import numpy as np

import torchliner as tl

random, stations = np.random.default_rng(7), []
for n in range(6):
    seconds = np.cumsum(random.exponential(1 / 15e3, 60_000))
    slow = np.interp(seconds, np.arange(0, 8, 1 / 500), random.normal(size=4000))
    v = np.cos(2 * np.pi * 1500 * seconds) + (1 + 0.3 * n) * slow
    stations.append(tl.BurstRecord(seconds, wall_normal=v, x=0.02 * n, y=1e-3, z=0.0))
figure, axes = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
tl.educe_bursts(stations, tl.load_liner("onera"), 1500.0).plot(ax=axes)
for axis, letter in zip(axes, ("(a)", "(b)"), strict=True):
    axis.set_title(letter)
