"""
How far a jet of a hole reaches
===============================

Height of a jet, in diameters of 1 mm, in the sheared flow of a duct of 50 mm: figure 22 of the
paper. By eq. (A2) a jet of speed U from a hole of diameter d, 10 d downstream of it, is at the height
H with H^(3/2) times the flow's velocity at H equal to sqrt(pi/4) d U sqrt(10 d). The exponents of the
jet's speed and of the Mach number are those of each curve; the -0.5 of eq. (A4) does not come out
(dash-dotted: its 0.4 and -0.5).
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

import torchliner as tl

diameter, duct = 1e-3, 0.05
speed, machs = np.geomspace(1, 120, 25), np.geomspace(0.1, 0.4, 12)


def jet_height(jet, flow):
    """Height (m) of a jet (m/s); the left side rises with H, so there is one answer."""
    wanted = np.sqrt(np.pi / 4 * 10 * diameter) * diameter * jet
    return brentq(lambda h: h**1.5 * float(flow.velocity(h)) - wanted, 1e-9, duct / 2, xtol=1e-15)


def drawn(axis, x, height, style, name):
    """A curve in logarithms with its exponent."""
    slope = np.polyfit(np.log(x), np.log(height), 1)[0]
    text = f"{name}: {slope:.2f}".replace("-", "\N{MINUS SIGN}")
    axis.loglog(x, np.array(height) / diameter, style, label=text)


figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3), layout="constrained")
for shear, style in ((0.05, "-"), (0.1, "--")):
    for colour, mach in enumerate((0.1, 0.2, 0.4)):
        flow = tl.TanhProfile(mach, duct, shear)
        height = [jet_height(jet, flow) for jet in speed]
        drawn(left, speed, height, f"C{colour}{style}", rf"$M_b$ = {mach:g}, $\delta$ = {shear:g}")
    height = [jet_height(5.0, tl.TanhProfile(mach, duct, shear)) for mach in machs]
    drawn(right, machs, height, f"C0{style}", rf"$U_j$ = 5 m s$^{{-1}}$, $\delta$ = {shear:g}")
left.loglog(speed, 0.2 * speed**0.4, "-.", color="0.5")
right.loglog(machs, 0.27 * machs**-0.5, "-.", color="0.5")
left.set(xlabel="$U_j$ (m s$^{-1}$)", ylabel="$H_j/d$", title="(a)")
right.set(xlabel="$M_b$", ylabel="$H_j/d$", title="(b)")
for axis, across, up in (
    (left, (1, 10, 100), (0.2, 0.5, 1, 2, 5)),
    (right, (0.1, 0.2, 0.3, 0.4), (0.4, 0.5, 0.6, 0.8, 1)),
):
    axis.set_xticks(across, across)
    axis.set_yticks(up, up)
    axis.minorticks_off()
figure.legend(loc="outside lower center", ncols=3)
