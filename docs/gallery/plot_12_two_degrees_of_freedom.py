"""
A septum widens the band
========================

A perforated sheet over a mesh between two cavities, beside the same sheet over one cavity of the
same depth.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

plate = tl.sheet("goodrich", thickness=0.8e-3, orifice_diameter=1e-3, porosity=0.08)
mesh = tl.sheet("mesh", resistance_rayl=400.0, resistance_slope_rayl=60.0)
two = tl.LayeredLiner([plate, tl.Cavity(18e-3, 5e-3), mesh, tl.Cavity(22e-3, 5e-3)])
one = tl.LayeredLiner([plate, tl.Cavity(40e-3, 5e-3)])
frequency = torch.linspace(300, 4500, 400)
for liner, label in ((one, "one cavity, 40 mm"), (two, "18 + 22 mm with a mesh")):
    r = tl.reflection_from_impedance(liner.impedance(frequency, 1.0))
    plt.plot(frequency / 1e3, tl.absorption_from_reflection(r), label=label)
plt.xlabel("$f$ (kHz)")
plt.ylabel("absorption")
plt.legend()
