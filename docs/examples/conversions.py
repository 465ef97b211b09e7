import torch

import torchliner as tl

air = tl.Fluid.from_temperature(293.15)  # K
print(air.sound_speed, air.characteristic_impedance)
reflection = tl.reflection_from_impedance(torch.tensor(2.33 - 0.30j))
print(tl.impedance_from_reflection(reflection), tl.absorption_from_reflection(reflection))
