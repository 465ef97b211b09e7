import torch

import torchliner as tl

plane: tl.VelocityPlane = tl.read_plane("data/slit_n130_y2.5mm.h5")  # m/s, away from the liner
found: tl.ImpedanceMap = tl.educe(plane, tl.load_liner("lbm_slit"))
best = found.liner["phase-locked"]
print(best.impedance, best.low, best.high, plane.reference["true"])
found.write("map.h5")
plane.plot("velocity.png")
assert torch.equal(tl.read_map("map.h5").answer, found.answer)

print(tl.VelocityGrid(5.0, levels=100).speeds[:3])  # |v| of the tables of kernels
arrivals = torch.rand(3000, dtype=torch.float64).sort().values  # s; random samples to a grid
signal = tl.onto_grid(arrivals, torch.sin(300 * arrivals), rate=10e3)
print(signal.values.shape, signal.mean_rate)
