"""
Educed and reference, eleven cases
==================================

Every resolved liner at its lowest plane with the default rules and the presets as they are. Up to
130 dB the slit is right; the orifices above 115 dB are too low. The pages on the evidence say why.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import torchliner as tl

figure, panels = plt.subplots(1, 2, layout="constrained", figsize=(7, 3.4))
for path in sorted(Path("../../data").glob("[os][rl]i*_y0.5mm.h5")):
    plane = tl.read_plane(path)
    found = tl.educe(plane, tl.load_liner(plane.liner), allow_short=True, interval=None)
    true, educed = plane.reference["true"], complex(found.answer[0])
    marker = "o" if path.name.startswith("orifice") else "s"
    panels[0].plot(true.real, educed.real, f"C0{marker}")
    panels[1].plot(true.imag, educed.imag, f"C0{marker}")
for panel, part, letter, limits in zip(panels, "RX", "ab", ((0, 2.6), (-0.9, 0.05)), strict=True):
    panel.plot(limits, limits, color="0.5", linestyle="--")
    panel.set(xlabel=f"reference ${part}$", ylabel=f"educed ${part}$", title=f"({letter})")
panels[0].plot([], [], "C0o", label="orifices")
panels[0].plot([], [], "C0s", label="slits")
panels[0].legend()
