"""
What the probes see
===================

Mean and fluctuating velocity along the slit liner in a flow at Mach 0.3, 1.5 mm above it; grey:
the slits.
"""

import matplotlib.pyplot as plt

import torchliner as tl

holes = tl.read_holes("../../data/holes_slit_g.csv")
plane = tl.read_plane("../../data/slit_g03_145_y1.5mm.h5", holes=holes)
figure, axes = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
plane.plot(ax=axes)
for axis, letter in zip(axes, ("(a)", "(b)"), strict=True):
    axis.set_title(letter)
