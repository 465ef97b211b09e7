"""Wall SPL and phase of the two facilities by the linearised Euler equations: figures 13 and 18.

    python scripts/figure_13.py [-o FOLDER]

B2A with the paper's 2.33-0.30j (source upstream) and 2.25-0.30j (downstream), and with the profile
Z(x) that scripts/b2a_line.py educes from simulated bursts. UFSC's rig with 1.36-0.67j, which is
ASSUMED (the paper gives its values as a picture), and with a resistance a quarter lower and higher,
as one impedance per height of the measuring plane would be. No measured pressures are public.
"""

import csv
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.case import impedance_along
from torchliner.io.result_writers import write_rows
from torchliner.report.fields import FINE, draw_pressures

SIDES = {"upstream": 2.33 - 0.30j, "downstream": 2.25 - 0.30j}
LINES = {"upstream": "4 growing", "downstream": "5 growing"}  # configurations of the simulated bursts
ASSUMED, HEIGHTS = 1.36 - 0.67j, {"R - 25 %": 0.75, "assumed Z": 1.0, "R + 25 %": 1.25}


def educed_profile(configuration: str) -> Any:
    """Z(x) along the line, cell by cell: 1 over the mean of 1/Z over 12.5 mm."""
    with (FIGURES / "b2a_stations.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["configuration"] == configuration]
    x = np.array([float(row["x (m)"]) for row in rows])
    z = np.array([complex(float(row["resistance"]), float(row["reactance"])) for row in rows])
    cells = [np.minimum((x / 12.5e-3).astype(int), 11) == cell for cell in range(12)]
    return impedance_along([x[one].mean() for one in cells], [1 / (1 / z[one]).mean() for one in cells])


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES), arguments)
    walls: dict[str, list[tuple[str, str, Any]]] = {"b2a": [], "ufsc": []}  # label, source, Z
    for side, z in SIDES.items():
        walls["b2a"].append((f"source {side}, Z = {z.real:g}{z.imag:+g}j", side, z))
        walls["b2a"].append((f"source {side}, Z(x) of simulated bursts", side, educed_profile(LINES[side])))
        for label, factor in HEIGHTS.items():
            walls["ufsc"].append((f"{side}, {label}", side, complex(factor * ASSUMED.real, ASSUMED.imag)))
    rows = []
    for name, picture, title in (
        ("b2a", "figure_13", "B2A, Mach 0.3, 1500 Hz, 145 dB incident at the liner; opposite wall"),
        ("ufsc", "figure_18", f"UFSC/PoliTo, Mach 0.3, 1400 Hz; Z = {ASSUMED:.2f} is ASSUMED"),
    ):
        waves = []
        for label, side, z in walls[name]:
            setup = tl.load_duct(name, source_side=side)
            field = tl.DuctSolver(setup.case, setup.frequency).solve(z)
            x, at = np.linspace(setup.case.start, setup.case.end, FINE), setup.microphones
            curve, pressure = (field.wall_pressure(each, setup.wall)[0].detach() for each in (x, at))
            waves.append((label, (x, curve), at, pressure))
            heard = zip(at, spl_from_pressure_amplitude(pressure), pressure.angle().rad2deg(), strict=True)
            about = {"case": f"{name}, {label}", "source": side}
            rows += [about | {"x (m)": float(x), "SPL (dB)": float(s), "phase (deg)": float(a)} for x, s, a in heard]
        path, liner = options.output / f"{picture}.png", setup.case.liner
        draw_pressures(waves, path, title, liner=liner, markers="at the microphones")
    write_rows(rows, options.output / "figure_13_18.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
