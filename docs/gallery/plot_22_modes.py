"""
Modes of a lined duct
=====================

Axial wavenumbers of the first modes downstream, with a rigid wall and with a liner, at 1500 Hz and
Mach 0.3. Below the axis a wave decays.
"""

import matplotlib.pyplot as plt

import torchliner as tl

profile = tl.TanhProfile(0.3, 0.05)
for wall, marker, about in ((float("inf"), "o", "rigid"), (2.33 - 0.30j, "s", "$Z$ = 2.33−0.30j")):
    alpha = tl.duct_modes(profile, 1500.0, wall, count=4).wavenumber[0]
    plt.plot(alpha.real, alpha.imag, marker, label=about)
plt.xlabel(r"$\mathrm{Re}\,\alpha$ (m$^{-1}$)")
plt.ylabel(r"$\mathrm{Im}\,\alpha$ (m$^{-1}$)")
plt.legend()
