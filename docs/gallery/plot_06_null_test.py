"""
The null test: a hard wall
==========================

Turbulence over a hard wall, without sound and without a liner, educed with the model of a liner:
the method returns an "impedance" here too. It is the response of the model, not a measurement.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/channel_y1.04mm.h5")
figure, axes = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
tl.educe(plane, tl.load_liner("polito"), 1400.0).plot(ax=axes)
for axis, letter in zip(axes, ("(a)", "(b)"), strict=True):
    axis.set_title(letter)
