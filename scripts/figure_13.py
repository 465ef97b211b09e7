"""Wall SPL and phase of the two facilities by the linearised Euler equations: figures 13 and 18.

    python scripts/figure_13.py [-o FOLDER]

B2A with the paper's 2.33-0.30j (source upstream) and 2.25-0.30j (downstream), and with the profile
Z(x) that scripts/b2a_line.py educes from simulated bursts. UFSC's rig with 1.36-0.67j, which is
ASSUMED (the paper gives its values as a picture), and with a resistance a quarter lower and higher,
as one impedance per height of the measuring plane would be. No measured pressures are public.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.case import impedance_along
from torchliner.duct.field import DuctField
from torchliner.duct.presets import DuctSetup, load_duct
from torchliner.io.csv_rows import write_rows
from torchliner.report.fields import FINE, draw_pressures

SIDES = {"upstream": (2.33, -0.30), "downstream": (2.25, -0.30)}
ASSUMED, HEIGHTS = 1.36 - 0.67j, {"R - 25 %": 0.75, "assumed Z": 1.0, "R + 25 %": 1.25}
STATIONS = FIGURES / "b2a_stations.csv"
Solved = tuple[DuctSetup, DuctField]


def solved(name: str, side: str, impedance: Any) -> Solved:
    """A facility with one impedance, (R, X), or with a function of x."""
    varies = callable(impedance)
    setup = load_duct(name, source_side=side, **({} if varies else {"impedance": [impedance]}))
    solver = tl.DuctSolver(setup.case, setup.frequency)
    return setup, solver.solve(impedance if varies else setup.impedance)


def educed_profile(configuration: str) -> Any:
    """Z(x) along the line, cell by cell: 1 over the mean of 1/Z over 12.5 mm."""
    with STATIONS.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["configuration"] == configuration]
    x = np.array([float(row["x (m)"]) for row in rows])
    z = np.array([complex(float(row["resistance"]), float(row["reactance"])) for row in rows])
    cells = np.minimum((x / 12.5e-3).astype(int), 11)
    middle = [x[cells == cell].mean() for cell in range(12)]
    return impedance_along(middle, [1 / (1 / z[cells == cell]).mean() for cell in range(12)])


def rows_of(label: str, one: Solved) -> list[dict[str, Any]]:
    """SPL and phase at the microphones."""
    setup, field = one
    places = setup.places
    pressure = field.wall_pressure(places, setup.wall)[0].detach()
    level, phase = spl_from_pressure_amplitude(pressure), torch.rad2deg(torch.angle(pressure))
    return [
        {"case": label, "source": field.source, "x (m)": float(x), "SPL (dB)": float(s), "phase (deg)": float(a)}
        for x, s, a in zip(places, level, phase, strict=True)
    ]


def draw(cases: dict[str, Solved], path: Path, title: str) -> None:
    waves = []
    for label, (setup, field) in cases.items():
        x, at = np.linspace(setup.case.start, setup.case.end, FINE), np.asarray(setup.places)
        curve, points = (field.wall_pressure(each, setup.wall)[0].detach() for each in (x, at))
        waves.append((label, (x, curve), at, points))
    draw_pressures(waves, path, title, liner=setup.case.liner, markers="at the microphones")


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES), arguments)
    cases: dict[str, Solved] = {}
    for side, pair in SIDES.items():
        cases[f"source {side}, Z = {pair[0]:g}{pair[1]:+g}j"] = solved("b2a", side, pair)
        configuration = {"upstream": "4 growing", "downstream": "5 growing"}[side]
        profile = educed_profile(configuration)
        cases[f"source {side}, Z(x) of simulated bursts"] = solved("b2a", side, profile)
    rows = [row for label, one in cases.items() for row in rows_of(f"b2a, {label}", one)]
    draw(cases, options.output / "figure_13.png", "B2A, Mach 0.3, 1500 Hz, 145 dB incident at the liner; opposite wall")
    others: dict[str, Solved] = {}
    for side in SIDES:
        for label, factor in HEIGHTS.items():
            pair = (factor * ASSUMED.real, ASSUMED.imag)
            others[f"{side}, {label}"] = solved("ufsc", side, pair)
    rows += [row for label, one in others.items() for row in rows_of(f"ufsc, {label}", one)]
    draw(others, options.output / "figure_18.png", f"UFSC/PoliTo, Mach 0.3, 1400 Hz; Z = {ASSUMED:.2f} is ASSUMED")
    write_rows(rows, options.output / "figure_13_18.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
