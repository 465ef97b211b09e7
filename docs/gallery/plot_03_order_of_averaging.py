"""
Three orders of averaging against height
========================================

Strong sound in a flow at Mach 0.3. Probes first and coherent first are near the true value 0.5 mm
above the slit and far above it higher up; the velocity averaged first loses the turbulence.
"""

import matplotlib.pyplot as plt

import torchliner as tl

liner = tl.load_liner("lbm_slit")
heights = (0.5, 1.0, 1.5, 2.5)
maps = [tl.educe(tl.read_plane(f"../../data/slit_g03_145_y{y}mm.h5"), liner) for y in heights]
for order in maps[0].orders:
    plt.plot(heights, [m.of_liner(order)[0].real for m in maps], "o-", label=order)
plt.axhline(maps[0].reference["true"].real, color="0.5", linestyle="--", label="true")
plt.xlabel("$y$ (mm)")
plt.ylabel("$R$")
plt.legend()
