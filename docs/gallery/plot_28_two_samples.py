"""
Two samples at rest
===================

Linear impedance of the samples of ONERA and of Polito by eq. (2.2): figure 3 of the paper.
"""

import matplotlib.pyplot as plt
import torch

import torchliner as tl

frequency = torch.linspace(300, 3500, 400)
figure, (resistance, reactance) = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
for name, style in (("onera", "-"), ("polito_as_printed", "--")):
    z = tl.load_liner(name).impedance(frequency)
    resistance.plot(frequency / 1e3, z.real, style, label=name)
    reactance.plot(frequency / 1e3, z.imag, style)
resistance.set(xlabel="$f$ (kHz)", ylabel="$R$", title="(a)", ylim=(0, None))
reactance.set(xlabel="$f$ (kHz)", ylabel="$X$", title="(b)", ylim=(-6, 6))
resistance.legend()
