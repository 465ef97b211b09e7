"""
Sound in a lined duct with flow
===============================

Levels on the wall opposite the liner in B2A at Mach 0.3, source upstream and downstream, from the
linearised Euler equations; the liner lies between the dashed lines.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

for side in ("upstream", "downstream"):
    setup = tl.load_duct("b2a", source_side=side)
    field = tl.DuctSolver(setup.case, setup.frequency).solve(setup.impedance)
    x = torch.linspace(-0.05, 0.2, 200, dtype=torch.float64)
    plt.plot(x * 1e3, field.wall_level(x).squeeze(), label=f"source {side}")
for edge in setup.case.liner[0]:
    plt.axvline(edge * 1e3, color="0.7", linestyle="--")
plt.xlabel("$x$ (mm)")
plt.ylabel("SPL (dB re 20 µPa)")
plt.legend()
