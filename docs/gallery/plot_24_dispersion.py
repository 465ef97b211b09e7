"""
Impedance and wavenumber
========================

The plane-like wave of a duct in uniform flow for resistances of its wall from 0.5 to 8:
decay over the reactance, downstream, at 1500 Hz.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

reactance = torch.linspace(-3, 3, 121, dtype=torch.float64)
for resistance in (0.5, 1.0, 2.0, 4.0, 8.0):
    z = torch.complex(torch.full_like(reactance, resistance), reactance)
    alpha = tl.wavenumber_from_impedance(z, 1500.0, height=0.05, mach=0.3)
    plt.plot(reactance, -8.686 * alpha.imag.flatten(), label=f"$R$ = {resistance:g}")
plt.xlabel("$X$")
plt.ylabel("decay (dB m$^{-1}$)")
plt.legend()
