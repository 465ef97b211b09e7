"""
A sweep in place of a tone
==========================

The same plane with a sweep as the incident wave, whose reflected signal is formed sample by sample,
and by the mean response at each frequency. A sweep meets each frequency once, so it scatters.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import torchliner as tl

plane = tl.read_plane("../../data/slit_g01_145_y2.5mm.h5")
plane = replace(plane, velocity=plane.velocity[..., ::8], sampling_rate=plane.sampling_rate / 8)
liner = tl.load_liner("lbm_slit")
frequency = [n / plane.duration for n in range(6, 31, 2)]  # lines of the record
swept = tl.replay(plane, liner, tl.Sweep(300, 3400), frequency)
mean = tl.educe(plane, liner, frequency, interval=None)
for found, style, about in ((swept, "o", "sweep"), (mean, "-", "mean response")):
    resistance = found.liner["admittance"].impedance.real
    plt.plot(found.frequency / 1e3, resistance, "C0" + style, label=about)
plt.xlabel("$f$ (kHz)")
plt.ylabel("$R$")
plt.legend()
