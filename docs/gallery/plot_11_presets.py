"""
The presets at rest
===================

Absorption of the shipped presets for a wave at normal incidence, without velocity.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

frequency = torch.linspace(500, 3000, 200)
for name in tl.preset_names():
    z = tl.load_liner(name).impedance(frequency, 0.0)
    plt.plot(frequency, tl.absorption_from_reflection(tl.reflection_from_impedance(z)), label=name)
plt.xlabel("frequency (Hz)")
plt.ylabel("absorption")
plt.legend()
