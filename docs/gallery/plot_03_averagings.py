"""
Three averagings against height
===============================

Strong sound in a flow at Mach 0.3. Averaged by admittance and phase-locked, R is near the reference 0.5 mm
above the slit and far above it higher up; averaging the velocity loses the turbulence.
"""

import matplotlib.pyplot as plt

import torchliner as tl

liner = tl.load_liner("lbm_slit")
heights = (0.5, 1.0, 1.5, 2.5)
maps = [tl.educe(tl.read_plane(f"../../data/slit_g03_145_y{y}mm.h5"), liner) for y in heights]
for averaging in maps[0].averagings:
    plt.plot(heights, [m.liner[averaging].impedance[0].real for m in maps], "o-", label=averaging)
plt.axhline(maps[0].reference["true"].real, color="0.5", linestyle="--", label="reference")
plt.xlabel("$y$ (mm)")
plt.ylabel("$R$")
plt.legend()
