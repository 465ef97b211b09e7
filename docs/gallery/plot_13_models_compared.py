"""
Models compared on one plane
============================

One resolved orifice at 145 dB under four laws of the sheet, with the offset that makes each right
at rest. The plane is read once; the spread is that of the models.
"""

import matplotlib.pyplot as plt

import torchliner as tl

orifice = tl.load_liner("lbm_orifice")
names = ("thickness", "orifice_diameter", "porosity")
plate = dict(zip(names, (0.54e-3, 1.200231e-3, 0.057703748), strict=True))
cavity, models = tl.Cavity(38.124e-3, 1.782e-3, 0.647828673), {}
for law in ("perforate", "guess", "goodrich", "maa"):
    layers = [tl.sheet(law, **plate), cavity]
    bare = tl.LayeredLiner(layers, cell_pitch=orifice.cell_pitch, fluid=orifice.fluid)
    offset = orifice.impedance(1400.0, 0.0) - bare.impedance(1400.0, 0.0)
    models[law] = bare.replace(impedance_offset=complex(offset), name=law)
plane = tl.read_plane("../../data/orifice_o145_y0.5mm.h5")
for row in tl.compare_models(plane, models, interval=None).rows:
    plt.plot(row.impedance.real, row.impedance.imag, "o", label=row.model)
true = plane.reference["true"]
plt.plot(true.real, true.imag, "k*", markersize=12, label="reference")
plt.xlabel("$R$")
plt.ylabel("$X$")
plt.legend()
