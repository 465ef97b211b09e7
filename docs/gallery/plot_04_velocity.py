"""
What the probes see
===================

Mean and fluctuating velocity along the slit liner in a flow at Mach 0.3, 1.5 mm above it.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_g03_145_y1.5mm.h5")
figure, axes = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
plane.plot(ax=axes)
for axis, letter in zip(axes, ("(a)", "(b)"), strict=True):
    axis.set_title(letter)
