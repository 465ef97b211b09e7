"""
Why the kernels are two-sided
=============================

Impulse responses of the preset ``polito`` at two speeds. What its empirical terms imply
begins before zero; dropping that part, as eq. (3.2) does, loses a quarter of the resistance.
"""

import matplotlib.pyplot as plt

import torchliner as tl

liner, grid = tl.load_liner("polito"), tl.VelocityGrid(5.0, levels=20)
for kind in ("two-sided", "causal"):
    kernels = tl.build_kernels(liner, grid, 50e3, kind=kind)
    z = tl.impedance_from_reflection(kernels.response(kernels.lags.new_tensor([1400.0])))[-1, 0]
    near = kernels.lags.abs() <= 40
    label = f"{kind}: ${z.real:.2f}{z.imag:+.2f}$j at 1400 Hz"
    plt.plot(kernels.lags[near] / 50, kernels.taps[-1, near], ".-", label=label)
model = complex(liner.impedance(1400.0, 5.0))
plt.plot([], [], " ", label=f"the model itself: ${model.real:.2f}{model.imag:+.2f}$j")
plt.xlabel("time (ms)")
plt.ylabel("tap")
plt.legend()
