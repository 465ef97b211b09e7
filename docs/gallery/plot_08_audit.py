"""
Which choices move the result
=============================

One plane under every rule: which speed drives the liner, whether its mean is kept, the phase of the
wave, the averaging. The spread is what one has to justify.
"""

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_n130_y1.0mm.h5")
found = tl.audit(plane, tl.load_liner(plane.liner))
for row in found.rows:
    plt.plot(row.impedance.real, row.impedance.imag, "o", color="C0", alpha=0.5)
true = plane.reference["true"]
plt.plot(true.real, true.imag, "k*", markersize=12, label="reference")
plt.xlabel("$R$")
plt.ylabel("$X$")
plt.legend()
