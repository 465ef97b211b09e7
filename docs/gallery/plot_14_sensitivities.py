"""
What one per cent of a dimension is worth
=========================================

Change of the resistance for 1 % of each parameter of the liner, from exact derivatives.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_n130_y2.5mm.h5")
lengths = ["facesheet_thickness", "orifice_diameter", "porosity", "cavity_depth", "vena_contracta"]
found = tl.sensitivities(plane, tl.load_liner(plane.liner), parameters=lengths).per_percent()
plt.barh(lengths, found.liner["velocity"][:, 0].real.numpy())
plt.xlabel("change of $R$ for +1 %")
plt.locator_params(axis="x", nbins=5)
