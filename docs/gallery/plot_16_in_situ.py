"""
Beside the in situ method
=========================

Dean's method from the pressures on the facesheet and in the cavity of the same simulation, beside
the velocity-based values, in a flow at Mach 0.3.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_g03_145_y0.5mm.h5")
found = tl.educe(plane, tl.load_liner(plane.liner))
in_situ = tl.in_situ(tl.read_pressure("../../data/pressure_g03_145.h5"))
figure, axes = plt.subplots(1, 2, figsize=(10, 3.5), layout="constrained")
found.with_alongside(in_situ).plot(ax=axes)
