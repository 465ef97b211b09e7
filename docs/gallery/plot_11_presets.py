"""
The presets at rest
===================

Absorption of four shipped presets for a wave at normal incidence, without velocity;
``tl.preset_names()`` lists all.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

frequency = torch.linspace(500, 3000, 200)
for name in ("onera", "polito", "lbm_slit", "lbm_orifice"):
    z = tl.load_liner(name).impedance(frequency, 0.0)
    absorption = tl.absorption_from_reflection(tl.reflection_from_impedance(z))
    plt.plot(frequency / 1e3, absorption, label=name)
plt.xlabel("$f$ (kHz)")
plt.ylabel("absorption")
plt.legend()
