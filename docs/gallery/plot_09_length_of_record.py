"""
Longer records, narrower intervals
==================================

The 95 % interval of the resistance in a flow at Mach 0.1 as the record grows. It says how far the
finite record may be off, and nothing about the model.
"""

import matplotlib.pyplot as plt

import torchliner as tl

path, liner = "../../data/slit_g01_145_y1.0mm.h5", tl.load_liner("lbm_slit")
duration = tl.read_plane(path).duration
for share in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
    plane = tl.read_plane(path, stop=share * duration if share < 1 else None)
    found = tl.educe(plane, liner)
    low, high = found.bounds_of_liner(found.averaging)
    plt.plot([plane.duration * 1e3] * 2, [low.real, high.real], "C0-")
    plt.plot(plane.duration * 1e3, found.answer[0].real, "C0o")
plt.xlabel("length of the record (ms)")
plt.ylabel("$R$")
