import warnings

import torchliner as tl

plane, liner = tl.read_plane("data/slit_n130_y2.5mm.h5"), tl.load_liner("lbm_slit")
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always", tl.DataWarning)
    found = tl.educe(plane, liner)
print([str(each.message) for each in told])
for row in tl.audit(plane, liner, interval=None).rows[:3]:
    print(row)
print(tl.compare(found, tl.educe(plane, liner, phase="self-consistent")).rows[0])
models = {"preset": liner, "wider": liner.with_numbers({"vena_contracta": 0.9})}
print([(row.model, row.impedance) for row in tl.compare_models(plane, models).rows])
