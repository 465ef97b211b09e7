"""
Along the liner, near and far
=============================

The slit liner at 130 dB, one line of probes 0.5 mm and one 2.5 mm above it. Close to the facesheet
a probe sees the jet of the slit or the wall beside it; further up the probes agree.
"""

import matplotlib.pyplot as plt

import torchliner as tl

liner = tl.load_liner("lbm_slit")
figure, (resistance, reactance) = plt.subplots(2, 1, sharex=True, layout="constrained")
for height in ("0.5", "2.5"):
    found = tl.educe(tl.read_plane(f"../../data/slit_n130_y{height}mm.h5"), liner)
    resistance.plot(found.x * 1e3, found.impedance[:, 0].real, label=f"$y$ = {height} mm")
    reactance.plot(found.x * 1e3, found.impedance[:, 0].imag)
true = found.reference["true"]
resistance.axhline(true.real, color="0.5", linestyle="--", label="simulation itself")
reactance.axhline(true.imag, color="0.5", linestyle="--")
resistance.set(ylabel="$R$", title="(a)")
reactance.set(xlabel="$x$ (mm)", ylabel="$X$", title="(b)")
resistance.legend()
