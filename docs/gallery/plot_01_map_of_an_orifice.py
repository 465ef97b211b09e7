"""
A map over one orifice
======================

Resistance and reactance at every probe 2.5 mm above a resolved orifice at 145 dB without flow. A
probe sees the vortices that pass it, not the liner: the value of the whole cell is an average.
"""

import matplotlib.pyplot as plt

import torchliner as tl

data = "../../data/"
plane = tl.read_plane(f"{data}orifice_o145_y2.5mm.h5")
found = tl.educe(plane, tl.load_liner(plane.liner))
figure, axes = plt.subplots(1, 2, figsize=(7, 3.4), layout="constrained")
found.plot(ax=axes)
for axis, letter in zip(axes, ("(a)", "(b)"), strict=True):
    axis.set_title(letter)
