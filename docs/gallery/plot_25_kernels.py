"""
Why the kernels are two-sided
=============================

Impulse responses of the preset ``polito_as_printed`` at two speeds. What its empirical terms imply
begins before zero; dropping that part, as eq. (3.2) does, loses a quarter of the resistance.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

liner, frequency = tl.load_liner("polito_as_printed"), torch.tensor([1400.0], dtype=torch.float64)
for kind in ("two-sided", "causal"):
    kernels = tl.build_kernels(liner, 50e3, velocity_max=5.0, kind=kind, levels=20)
    z = tl.impedance_from_reflection(kernels.response(frequency))[-1, 0]
    lags = torch.arange(kernels.taps.shape[1]) + kernels.first
    near = lags.abs() <= 40
    label = f"{kind}: ${z.real:.2f}{z.imag:+.2f}$j at 1400 Hz"
    plt.plot(lags[near] / 50, kernels.taps[-1, near], ".-", label=label)
model = complex(liner.impedance(1400.0, 5.0))
plt.plot([], [], " ", label=f"the model itself: ${model.real:.2f}{model.imag:+.2f}$j")
plt.xlabel("time (ms)")
plt.ylabel("tap")
plt.legend()
