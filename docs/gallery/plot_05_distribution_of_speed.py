"""
The distribution of the speed
=============================

The impedance follows from the speed, whatever its sign: the response of the liner model at every
instant, averaged. The same liner at 130 dB, 145 dB and in a flow at Mach 0.3.
"""

import matplotlib.pyplot as plt

import torchliner as tl

for case, about in (("n130", "130 dB"), ("n145", "145 dB"), ("g03_145", "145 dB, Mach 0.3")):
    plane = tl.read_plane(f"../../data/slit_{case}_y0.5mm.h5")
    speed = plane.velocity.abs().flatten()
    plt.hist(speed.numpy(), bins=120, density=True, histtype="step", label=about)
plt.yscale("log")
plt.xlabel("$|v|$ (m s$^{-1}$)")
plt.ylabel("density (s m$^{-1}$)")
plt.legend()
