import warnings

import torch

import torchliner as tl

warnings.simplefilter("ignore", tl.DataWarning)
print(tl.preset_names())
slit = tl.load_liner("lbm_slit")
plate = {"facesheet_thickness": 0.6e-3, "orifice_diameter": 1e-3, "porosity": 0.05}  # m
single = tl.SDoFLiner(**plate, cavity_depth=38e-3, cavity_hydraulic_radius=5e-3)
print(single.impedance([1000.0, 1400.0], 3.0), single.resonance())  # Hz, |v| in m/s
print(tl.EndLossSDoFLiner.of(single).impedance(1400.0, 3.0))
print(tl.AdjustedSDoFLiner.of(single, mass_loss=0.3).impedance(1400.0, 3.0))
sheet = tl.sheet("goodrich", thickness=0.8e-3, orifice_diameter=1e-3, porosity=0.08)
print(tl.LayeredLiner([sheet, tl.Cavity(40e-3, 5e-3)]).impedance(1400.0, 3.0))
table = tl.TabulatedLiner([1000.0, 2000.0], torch.tensor([0.5 - 1j, 0.6 + 0.2j]))
print(table.impedance(1400.0, 0.0))
print(tl.goodrich_resistance(0.3, 0.05, 1.7e-3, 0.8e-3))

planes = [tl.read_plane(f"data/slit_{case}_y2.5mm.h5") for case in ("n115", "n130")]
print(tl.sensitivities(planes[1], slit, parameters=["porosity"]).rows[0].step)
print(tl.calibrate(planes, slit, "true", {"vena_contracta": (0.4, 1)}, noise=0.002).values)
print(tl.identify(planes, slit, models=[("vena_contracta",)], noise=0.002).fit.law.label)
