from dataclasses import replace

import numpy as np

import torchliner as tl

liner, plane = tl.load_liner("lbm_slit"), tl.read_plane("data/slit_n130_y2.5mm.h5")
plane = replace(plane, velocity=plane.velocity[..., ::8], sampling_rate=plane.sampling_rate / 8)
frequency = [n / plane.duration for n in (10, 20)]  # lines of the record
for wave in (
    tl.Tones([1000.0, 1400.0]),
    tl.Sweep(300, 3400),
    tl.BandNoise(300, 3400, seed=1),
    tl.Recorded(np.random.default_rng(0).normal(size=plane.samples), plane.sampling_rate),
):
    print(wave.label, wave.band)
found = tl.replay(plane, liner, tl.Sweep(300, 3400), frequency, reflected="y.h5")
print(found.answer)
np.save("signal.npy", np.sin(np.arange(4800.0)))
print(tl.read_signal("signal.npy", sampling_rate=48e3).label)
kernels = tl.build_kernels(liner, 50e3, velocity_max=5.0, levels=20)
print(kernels.taps.shape, kernels.error, kernels.gain)
