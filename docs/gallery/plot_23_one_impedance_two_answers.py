"""
One impedance, two answers
==========================

Wall pressures computed with a single impedance in a sheared flow, processed as measured ones would
be. Kumaresan and Tufts' method gives one value for each side of the source; a fit of the whole
field gives the true one, since it holds the same equations.
"""

import matplotlib.pyplot as plt
import numpy as np

import torchliner as tl

x, true = np.arange(6, 145, 12) * 1e-3, 2.33 - 0.30j
for side, marker in (("upstream", ">"), ("downstream", "<")):
    setup = tl.load_duct("b2a", source_side=side)
    solver = tl.DuctSolver(setup.case, setup.frequency)
    pressure = solver.solve(true).wall_pressure(x).movedim(-1, -2)
    line = tl.MicrophoneLine(
        x,
        pressure,
        setup.frequency,
        duct_height=0.05,
        mach=0.3,
        source_side=side,
        liner_start=0.0,
        liner_end=0.15,
        fluid=setup.fluid,
    )
    for colour, name, z in (
        ("C0", "Kumaresan-Tufts", tl.kumaresan_tufts(line).impedance),
        ("C1", "two waves", tl.two_wave_fit(line).impedance),
        ("C2", "whole field", tl.fit_field(line, solver).impedance),
    ):
        plt.plot(z.real.flatten(), z.imag.flatten(), colour + marker, label=f"{name}, {side}")
plt.plot(true.real, true.imag, "k*", markersize=12, label="reference")
plt.xlabel("$R$")
plt.ylabel("$X$")
plt.legend()
