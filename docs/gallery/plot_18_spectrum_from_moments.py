"""
One reading, every frequency
============================

A plane reduced to moments of the speed, kilobytes instead of megabytes, from which the impedance
of any liner follows at any frequency.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_n130_y2.5mm.h5")
liner, frequency = tl.load_liner("lbm_slit"), list(range(500, 3001, 50))
known = tl.moments(plane, liner)
z = known.educe(liner, frequency, interval=None).liner["velocity"].impedance
kilohertz = [f / 1e3 for f in frequency]
plt.plot(kilohertz, z.real, label="$R$")
plt.plot(kilohertz, z.imag, "--", label="$X$")
plt.xlabel("$f$ (kHz)")
plt.ylabel("$R$, $X$")
plt.legend()
