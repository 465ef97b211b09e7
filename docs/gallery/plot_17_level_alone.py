"""
No velocity at all: a wave of a stated level
============================================

The wave alone drives the liner (IR-TDIBC): resistance and reactance against the incident level;
stars: the resolved slit.
"""

import matplotlib.pyplot as plt

import torchliner as tl

level = [110, 115, 120, 125, 130, 135, 140, 145]
curve = tl.ir_tdibc(tl.load_liner("lbm_slit"), level, 1400.0)
plt.plot(level, curve.impedance[:, 0].real, "C0o-", label="$R$")
plt.plot(level, curve.impedance[:, 0].imag, "C1s-", label="$X$")
for case in ("n115", "n130", "n145"):
    true = tl.read_plane(f"../../data/slit_{case}_y0.5mm.h5", lazy=True).reference["true"]
    plt.plot([int(case[1:])] * 2, [true.real, true.imag], "k*")
plt.xlabel("incident level (dB re 20 µPa)")
plt.ylabel("$R$, $X$")
plt.legend()
