"""
A liner model over frequency and speed
======================================

Resistance and reactance of the preset ``onera`` for constant speeds above it.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

liner, frequency = tl.load_liner("onera"), torch.linspace(500, 3000, 200)
figure, (resistance, reactance) = plt.subplots(2, 1, sharex=True, layout="constrained")
for speed in (0.0, 1.0, 3.0, 6.0):
    z = liner.impedance(frequency, speed)
    resistance.plot(frequency / 1e3, z.real, label=f"$|v|$ = {speed:g} m s$^{{-1}}$")
    reactance.plot(frequency / 1e3, z.imag)
resistance.set(ylabel="$R$", title="(a)")
reactance.set(xlabel="$f$ (kHz)", ylabel="$X$", title="(b)")
figure.legend(loc="outside lower center", ncols=4)
