"""
One parameter fitted without flow
=================================

The contraction coefficient of the resolved orifice, fitted at 130 dB, and what it then predicts at 145 dB.
"""

import matplotlib.pyplot as plt

import torchliner as tl

planes = [tl.read_plane(f"../../data/orifice_{case}_y0.5mm.h5") for case in ("o130", "o145")]
preset = tl.load_liner("lbm_orifice")
fitted = tl.calibrate(planes[0], preset, "true", {"vena_contracta": (0.3, 1.0)}, noise=0.002)
for liner, marker, about in ((preset, "o", "preset"), (fitted.liner, "s", "fitted at 130 dB")):
    z = [complex(tl.educe(plane, liner, interval=None).answer[0]) for plane in planes]
    plt.plot([130, 145], [value.real for value in z], marker, label=about)
plt.plot([130, 145], [plane.reference["true"].real for plane in planes], "k*", label="reference")
plt.xlabel("incident level (dB re 20 µPa)")
plt.ylabel("$R$")
plt.legend()
