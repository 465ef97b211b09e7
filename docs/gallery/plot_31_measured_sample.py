"""
A measured sample
=================

The sample of the preset ``polito`` as measured (Quintino et al., AIAA J. 63(11), 2025; CC BY 4.0): Kumaresan-Tufts
without flow at 130 dB, against the model at rest with the cavity share of the geometry, and with that of the paper.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

measured = tl.load_liner("../../data/ufsc_measured.csv")
frequency = torch.linspace(500, 2500, 200, dtype=torch.float64)
figure, axes = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
points = measured.impedance(measured.frequency)
for axis, part in zip(axes, ("real", "imag"), strict=True):
    axis.plot(measured.frequency / 1e3, getattr(points, part), "o", label="measured")
    for name, style in (("polito", "-"), ("polito_as_printed", "--")):
        axis.plot(frequency / 1e3, getattr(tl.load_liner(name).impedance(frequency), part), style, label=name)
axes[0].set(xlabel="$f$ (kHz)", ylabel="$R$", title="(a)", ylim=(0, 0.3))
axes[1].set(xlabel="$f$ (kHz)", ylabel="$X$", title="(b)")
axes[1].legend()
