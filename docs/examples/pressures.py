import warnings

import torchliner as tl

warnings.simplefilter("ignore", tl.DataWarning)
record: tl.PressureRecord = tl.read_pressure("data/pressure_n130.h5")
found: tl.PointImpedances = tl.in_situ(record)
print(found.liner["pressure-first"].impedance, tl.decompose_waves(record).impedance)
found.write("points.h5")
print(tl.read_points("points.h5").frequency)

setup = tl.load_duct("b2a")
solver = tl.DuctSolver(setup.case, setup.frequency)
x = [-0.027 + 0.012 * n for n in range(18)]
pressure = solver.solve(2.33 - 0.30j).wall_pressure(x).movedim(-1, -2)
line = tl.MicrophoneLine(
    x,
    pressure,
    setup.frequency,
    duct_height=0.05,
    mach=0.3,
    source_side="upstream",
    liner_start=0.0,
    liner_end=0.15,
    fluid=setup.fluid,
)
line.write("line.h5")
line = tl.read_microphones("line.h5")
one: tl.WallEduction = tl.kumaresan_tufts(line, rank=2)
fit: tl.FieldFit = tl.fit_field(line, solver)
print(one.impedance, tl.two_wave_fit(line).impedance, fit.impedance)
one.write("found.h5", fit)  # both, with the line; torchliner report found.h5 -o page.html
print([each.method for each in tl.read_wall("found.h5")])
one.report("page.html", fit)
print(tl.sort_waves(line).incident_level)
