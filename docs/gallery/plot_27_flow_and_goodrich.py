"""
Grazing flow: the profile, and M once or twice
==============================================

Eq. (2.7) of the paper prints the Mach number twice. Once, for its liner and a sheared profile,
gives nearly the shift from Mach 0.1 to 0.3 that the paper itself states (shaded); twice gives half.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

thickness = torch.linspace(0, 1.8e-3, 50, dtype=torch.float64)
liner = tl.load_liner("onera")
porosity, diameter = liner.surface_porosity, liner.hole_diameter
once = [tl.goodrich_resistance(m, porosity, thickness, diameter) for m in (0.1, 0.3)]
plt.plot(thickness * 1e3, once[1] - once[0], label="$M$ once")
plt.plot(thickness * 1e3, 0.3 * once[1] - 0.1 * once[0], label="$M$ twice, as printed")
plt.axhspan(0.94, 1.12, color="0.85", label="the paper's own shift")
plt.axvline(
    tl.TanhProfile(0.3, 0.05).displacement_thickness * 1e3,
    color="0.6",
    linestyle="--",
    label="tanh profile in a duct of 50 mm",
)
plt.xlabel("displacement thickness (mm)")
plt.ylabel("shift of $R$, Mach 0.1 to 0.3")
plt.legend()
