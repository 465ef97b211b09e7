import torch

import torchliner as tl

setup = tl.load_duct("b2a", source_side="downstream")
field = tl.DuctSolver(setup.case, setup.frequency).solve(setup.impedance)
print(field.wall_level(setup.microphones))  # dB
settled = tl.solve_settled(setup.case, setup.frequency, setup.impedance, places=setup.microphones)
setup.line_of(settled).report("duct.html")  # loss, energy, levels along the wall, what a finer mesh changes

flow = tl.TanhProfile(0.3, 0.05)  # bulk Mach number, height of the duct in m
y = torch.linspace(0, 0.025, 201, dtype=torch.float64)  # to the middle of the duct
print(flow.displacement_thickness, tl.TabulatedProfile(y, flow.velocity(y), 0.05).displacement_thickness)
print(tl.duct_modes(flow, 1500.0, 2.33 - 0.30j, count=2).wavenumber)  # 1/m

alpha = tl.wavenumber_from_impedance(torch.tensor(2.33 - 0.30j), 1500.0, height=0.05, mach=0.3)
print(tl.impedance_from_wavenumber(alpha, 1500.0, height=0.05, mach=0.3))
