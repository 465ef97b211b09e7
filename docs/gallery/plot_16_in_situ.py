"""
Beside the in situ method
=========================

Impedance along the liner at all heights, and the cells by Dean's method from the pressures on the
facesheet and in the cavity of the same simulation (black): figure 17 of the paper on the resolved
cases. In a flow the vortices of these slits do not decay, so the curves part with the height.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import torchliner as tl

data, cases = Path("../../data"), ("slit_g01_145", "slit_g03_145", "orifice_o145")
heads = ("(a, d) slit, Mach 0.1", "(b, e) slit, Mach 0.3", "(c, f) orifice, no flow")
heights = [0.5, 1.0, 1.5, 2.5]  # mm
figure, rows = plt.subplots(2, 3, figsize=(7, 4.4), sharex="col", layout="constrained")
for column, case, head in zip(rows.T, cases, heads, strict=True):
    for path in sorted(data.glob(f"{case}_y*.h5")):
        plane = tl.read_plane(path)
        y = round(1e3 * plane.height, 1)
        found = tl.educe(plane, tl.load_liner(plane.liner), interval=None)
        z = 1 / found.probes["admittance"].admittance[..., 0].reshape(-1, len(plane.x)).mean(0)  # over z
        for axis, part in zip(column, (z.real, z.imag), strict=True):
            axis.plot(plane.x * 1e3, part, f"C{heights.index(y)}", label=f"$y$ = {y:g} mm")
    cells = tl.in_situ(tl.read_pressure(data / f"pressure_{case.split('_', 1)[1]}.h5"))
    for axis, part in zip(column, ("real", "imag"), strict=True):
        values = getattr(cells.cells["admittance"].impedance[:, 0], part)
        axis.plot(cells.cell_x * 1e3, values, "kX", label="in situ, cells")
    column[0].set_title(head, loc="left")
    column[1].set_xlabel("$x$ (mm)")
rows[0, 0].set_ylabel("$R$")
rows[1, 0].set_ylabel("$X$")
figure.legend(*rows[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
