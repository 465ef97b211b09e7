import warnings
from pathlib import Path

import numpy as np

import torchliner as tl

warnings.simplefilter("ignore", tl.DataWarning)
random, folder = np.random.default_rng(7), Path("line")
folder.mkdir()
for n in range(2):
    seconds = np.cumsum(random.exponential(1 / 12e3, 72_000))
    v = np.cos(2 * np.pi * 1500 * seconds) + random.normal(size=1)
    station = tl.BurstRecord(seconds, wall_normal=v, x=0.01 * n, y=1e-3, z=0.0, frequency=1500.0)
    station.write(folder / f"{n}.h5")
print(tl.list_stations("line"))  # what is there, unread
stations = tl.read_bursts("line")
kept = tl.validate_bursts(stations[0], ["zero-runs"])
print(kept.received, kept.bursts, tl.burst_moments(kept).components["wall_normal"])
print(tl.tone_attenuation(tl.onto_grid(kept.arrival_time, kept.wall_normal), 1500.0).factor.abs())

line: tl.ImpedanceLine = tl.educe_bursts(stations, tl.load_liner("onera"), 1500.0)
line.write("line.h5")
print(tl.read_line("line.h5").average.impedance)
