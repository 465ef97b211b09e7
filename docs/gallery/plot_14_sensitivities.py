"""
What one per cent of a dimension is worth
=========================================

Change of the resistance for 1 % of each parameter of the liner, from exact derivatives.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_n130_y2.5mm.h5")
lengths = ["facesheet_thickness", "orifice_diameter", "porosity", "cavity_depth", "vena_contracta"]
found = tl.sensitivities(plane, tl.load_liner(plane.liner), parameters=lengths)
rows = found.of(averaging="velocity")
plt.barh([row.parameter for row in rows], [row.step.real for row in rows])
plt.xlabel("change of $R$ for +1 %")
plt.locator_params(axis="x", nbins=5)
