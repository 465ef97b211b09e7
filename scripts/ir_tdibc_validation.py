"""IR-TDIBC beside the true impedances without flow: the table and the picture of docs/ir_tdibc.md.

    python scripts/ir_tdibc_validation.py [-o FOLDER] [--check]

The incident wave of each case, at the level its planes state, drives the model of its preset;
nothing else of the case is used.
"""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torchliner as tl
from common import case_files, page_table, run_study
from oracles.periodic_wall import driven_impedance, fixed_impedance
from torchliner.names import STEP_KERNELS
from torchliner.report.figure import COLOURS, INCIDENT, MARKERS, V_RMS, Figure, dots, draw_parts
from torchliner.report.table import format_complex
from torchliner.studies.variants import Row

TONE = 1400.0
FITTED = 0.444  # contraction coefficient of the orifice, from runs without flow
CASES = {  # with the usual contraction coefficient, and that fitted without flow
    "slit": (("n115", "n130", "n145"), (0.8,)),
    "orifice": (("o115", "o130", "o145"), (0.8, FITTED)),
    "orifice, coarser lattice": (("t00_130",), (0.8, 0.415)),
}
LEVELS = [float(level) for level in range(110, 151, 2)]
WAYS = ("fixed_point", "periodic", "least-squares", "causal")


def rows_of() -> list[Row]:
    """One per case and contraction coefficient."""
    return [row_of(name, case, value) for name, (cases, values) in CASES.items() for value in values for case in cases]


def row_of(name: str, case: str, contraction: float) -> Row:
    """Z of a case by every way."""
    plane = tl.read_plane(case_files(case)[0])
    liner = tl.load_liner(plane.liner).replace(vena_contracta=contraction)
    found = {kernel: tl.ir_tdibc(liner, plane.incident_level, TONE, kernel=kernel) for kernel in STEP_KERNELS}
    return Row(
        liner=name,
        case=case,
        vena_contracta=contraction,
        level=plane.incident_level,
        true=complex(plane.reference["true"]),
        fixed_point=fixed_impedance(liner, float(plane.incident_level or 0), TONE),
        periodic=driven_impedance(liner, float(plane.incident_level or 0), TONE),
        **{kernel: complex(found[kernel].impedance[0, 0]) for kernel in STEP_KERNELS},
    )


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Z of every way but the last, and by how many per cent each R is off."""
    lines = [
        [
            row.case,
            f"{row.vena_contracta:g}",
            *(format_complex(row[way]) for way in ("true", *WAYS[:-1])),
            ", ".join(f"{100 * (row[way].real / row.true.real - 1):+.0f}" for way in WAYS),
        ]
        for row in rows
    ]
    return {"cases": page_table("case | C_vc | reference Z | Z(rms v) | periodic | least-squares | R off, %", lines)}


def draw(rows: Sequence[Row], path: Path) -> Figure:
    """R and X of slit and orifice over level, with the true values."""
    orifice = tl.load_liner("lbm_orifice").replace(vena_contracta=FITTED)
    liners = {"slit": tl.load_liner("lbm_slit"), f"orifice, $C_c = {FITTED}$": orifice}
    drawn: list[dict[str, Any]] = []
    for i, (label, liner) in enumerate(liners.items()):
        style, found = {"x": LEVELS, "color": COLOURS[i]}, [driven_impedance(liner, level, TONE) for level in LEVELS]
        drawn.append(style | {"y": found, "label": f"{label}: instantaneous"})
        fixed = [fixed_impedance(liner, level, TONE) for level in LEVELS]
        drawn.append(style | {"y": fixed, "linestyle": "--", "label": f"{label}: $Z$ at {V_RMS}"})
    for marker, kind in zip(MARKERS, ("slit", "orifice"), strict=False):
        true = {row.level: row.true for row in rows if row.liner == kind}
        drawn.append({"x": [*true], "y": [*true.values()]} | dots("black", marker, f"{kind}: true"))
    return draw_parts(drawn, INCIDENT, path, poles=None, height=3.4, legend=3)


main = functools.partial(run_study, __doc__, "ir_tdibc", rows_of, draw, tables=tables)


if __name__ == "__main__":
    sys.exit(main())
