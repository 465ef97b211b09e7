"""
Fluctuations along the liner
============================

Rms of the wall-normal velocity (above) and, where it is stored, of the streamwise velocity (below)
at all heights: figure 16 of the paper. Slits under two flows stand in for its
simulation; over a hard wall, without a liner, at 0.52, 1.04 and 2.44 mm, nothing depends on x.
"""

from contextlib import suppress
from pathlib import Path

import matplotlib.pyplot as plt

import torchliner as tl

data, cases = Path("../../data"), ("slit_g01_145", "slit_g03_145", "channel")
heads = ("(a, d) Mach 0.1, 145 dB", "(b, e) Mach 0.3, 145 dB", "(c, f) hard wall")
heights = [0.5, 1.0, 1.5, 2.5]  # mm
figure, rows = plt.subplots(2, 3, figsize=(7, 4.4), sharex="col", layout="constrained")
for column, case, head in zip(rows.T, cases, heads, strict=True):
    for path in sorted(data.glob(f"{case}_y*.h5")):
        plane = tl.read_plane(path)
        near = round(2e3 * plane.height) / 2  # mm
        parts = [plane.velocity]
        with suppress(ValueError):  # of files without it
            parts.append(tl.read_plane(path, variable="streamwise_velocity").velocity)
        for axis, v in zip(column, parts, strict=False):
            rms = v.var(-1).reshape(-1, len(plane.x)).mean(0).sqrt()  # over z
            axis.plot(plane.x * 1e3, rms, f"C{heights.index(near)}", label=f"$y$ = {near:g} mm")
    column[0].set_title(head, loc="left")
    column[1].set_xlabel("$x$ (mm)")
    for axis in column:
        axis.set_ylim(0, None)
rows[0, 0].set_ylabel(r"$v'_{\mathrm{rms}}$ (m s$^{-1}$)")
rows[1, 0].set_ylabel(r"$u'_{\mathrm{rms}}$ (m s$^{-1}$)")
figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
