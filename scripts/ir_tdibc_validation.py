"""IR-TDIBC beside the true impedances without flow: the tables and the picture of docs/ir_tdibc.md.

    python scripts/ir_tdibc_validation.py [--write]

The incident wave of each case, at the level its planes state, drives the model of its preset;
nothing else of the case is used. ``--write`` puts the tables into the page, but for that of speed,
and the picture, with its numbers, into docs/figures.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

import torch

import torchliner as tl
from common import FIGURES, ROOT, case_files, options_of, parser_of
from torchliner.conversions import REFERENCE_PRESSURE
from torchliner.engine.kernels import build_kernels
from torchliner.io.csv_rows import write_rows
from torchliner.names import STEP_KERNELS
from torchliner.report.figure import (
    COLOURS,
    INCIDENT,
    MARKERS,
    V_RMS,
    dots,
    draw_parts,
)
from torchliner.report.table import format_complex
from torchliner.velocity.ir_tdibc_wall import step_in_time
from validation_page import table, write_tables

PAGE, STEM = ROOT / "docs" / "ir_tdibc.md", "ir_tdibc"
TONE = 1400.0
CASES = {  # with the usual contraction coefficient, and that fitted without flow
    "slit": (("n115", "n130", "n145"), (0.8,)),
    "orifice": (("o115", "o130", "o145"), (0.8, 0.444)),
    "orifice, coarser lattice": (("t00_130",), (0.8, 0.415)),
}
CURVE = [float(level) for level in range(110, 151, 2)]
NARROW, WIDE = (300.0, 3500.0), (300.0, 8400.0)
DAMPINGS = ((1e-1, NARROW), (1e-2, NARROW), (1e-3, NARROW), (1e-4, NARROW), (1e-3, WIDE))
STEPS = ((28e3, 10e-3), (56e3, 10e-3), (112e3, 10e-3), (56e3, 5e-3), (56e3, 20e-3))  # Hz, s


def case_rows() -> list[dict[str, Any]]:
    """One per case and contraction coefficient."""
    rows = []
    for name, (cases, contractions) in CASES.items():
        for contraction in contractions:
            for case in cases:
                plane = tl.read_plane(case_files(case)[0])
                liner = tl.load_liner(plane.liner).replace(vena_contracta=contraction)
                level = plane.incident_level
                assert plane.source_side == "normal"
                assert level is not None
                found = {k: tl.ir_tdibc(liner, level, TONE, kernel=k) for k in STEP_KERNELS}
                roots = found["periodic"].fixed_points[0]
                assert len(roots) == 1
                rows.append(
                    {
                        "liner": name,
                        "case": case,
                        "vena_contracta": contraction,
                        "level": level,
                        "true": complex(plane.reference["true"]),
                        "fixed_point": complex(roots[0].impedance[0]),
                        **{k: complex(found[k].impedance[0, 0]) for k in STEP_KERNELS},
                        "frozen": complex(found["causal"].frozen[0, 0]),
                    }
                )
    return rows


def off(found: complex, true: complex) -> str:
    """Relative error of R, per cent."""
    return f"{100 * (found.real / true.real - 1):+.0f}"


def case_table(rows: Sequence[dict[str, Any]]) -> str:
    """Z of every way but the last, and how far each R is from the truth."""
    ways = ("fixed_point", "periodic", "least-squares", "causal")
    lines = [
        [
            row["case"],
            f"{row['vena_contracta']:g}",
            *(format_complex(row[way]) for way in ("true", *ways[:-1])),
            ", ".join(off(row[way], row["true"]) for way in ways),
        ]
        for row in rows
    ]
    return table("case | C_vc | reference Z | Z(rms v) | periodic | least-squares | R off, %", lines)


def convergence_table() -> str:
    """Z of the slit at 145 dB over rate and kernel length."""
    liner, lines = tl.load_liner("lbm_slit"), []
    for rate, after in STEPS:
        found = [tl.ir_tdibc(liner, 145, TONE, kernel=k, sampling_rate=rate, after=after) for k in STEP_KERNELS]
        lines.append(
            [f"{1e-3 * rate:g} kHz, {1e3 * after:g} ms", *(format_complex(complex(f.impedance[0, 0])) for f in found)]
        )
    return table("rate, kernel | " + " | ".join(STEP_KERNELS), lines)


def damping_table() -> str:
    """Fitted kernels of the orifice: error, gain, and what the wave of 145 dB makes of them."""
    liner, rate, lines = tl.load_liner("lbm_orifice"), 28e3, []
    turn = torch.arange(560, dtype=torch.float64) * 2 * torch.pi * TONE / rate
    peak = 2**0.5 * REFERENCE_PRESSURE * 10 ** (145 / 20) / (1.2 * 343.2)
    for damping, band in DAMPINGS:
        kernels = build_kernels(liner, rate, velocity_max=20.0, band=band, before=0.0, regularisation=damping)
        drift = float(step_in_time(peak * turn.cos()[None], kernels, repeats=True).drift[0])
        lines.append(
            [f"{damping:g}", f"{band[0]:g}–{band[1]:g}", f"{kernels.error:.1e}", f"{kernels.gain:.3g}", f"{drift:.1e}"]
        )
    return table("Tikhonov | band (Hz) | error in R | gain | drift", lines)


def noise_table() -> str:
    """The slit under noise: |v| of the moment against the rms of the band."""
    curve = tl.ir_tdibc(
        tl.load_liner("lbm_slit"),
        [115, 130, 145],
        tl.BandNoise(500, 3000),
        frequency=TONE,
        duration=0.1,
        kernel="periodic",
    )
    lines = [
        [
            f"{level:g}",
            format_complex(complex(roots[0].impedance[0])),
            format_complex(complex(z)),
        ]
        for level, roots, z in zip(curve.level.tolist(), curve.fixed_points, curve.impedance[:, 0], strict=True)
    ]
    return table("dB | Z(rms v) | periodic", lines)


def speed_table() -> str:
    """Seconds of processor time for 20 000 steps of 60 waves, from a tenth of them."""
    lines = []
    for taps in (300, 600, 1000):
        begin = time.process_time()
        tl.ir_tdibc(
            tl.load_liner("lbm_slit"),
            [140] * 60,
            tl.BandNoise(500, 3000),
            frequency=TONE,
            sampling_rate=48e3,
            duration=1000 / 48e3,
            after=(taps - 1) / 48e3,
        )
        lines.append([f"{taps}", f"{10 * (time.process_time() - begin):.0f}"])
    return table("taps | s", lines)


def draw(curves: dict[str, Any], rows: Sequence[dict[str, Any]], path: Any) -> None:
    """R and X of slit and orifice over level, with the true values."""
    drawn: list[dict[str, Any]] = []
    for i, (label, curve) in enumerate(curves.items()):
        style = {"x": CURVE, "color": COLOURS[i]}
        drawn.append(style | {"y": curve.impedance[:, 0], "label": f"{label}: instantaneous"})
        fixed = [complex(roots[0].impedance[0]) for roots in curve.fixed_points]
        drawn.append(style | {"y": fixed, "linestyle": "--", "label": f"{label}: $Z$ at {V_RMS}"})
    for marker, kind in zip(MARKERS, ("slit", "orifice"), strict=False):
        true = {row["level"]: row["true"] for row in rows if row["liner"] == kind}
        drawn.append({"x": [*true], "y": [*true.values()]} | dots("black", marker, f"{kind}: true"))
    draw_parts(drawn, INCIDENT, path, poles=None, height=3.4, legend=3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, print, draw."""
    parser = parser_of(__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/ as well")
    options = options_of(parser, arguments)
    torch.set_num_threads(1)
    rows = case_rows()
    tables = {
        "cases": case_table(rows),
        "convergence": convergence_table(),
        "damping": damping_table(),
        "noise": noise_table(),
        "speed": speed_table(),
    }
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    if options.write:
        fitted = tl.load_liner("lbm_orifice").replace(vena_contracta=0.444)
        liners = {"slit": tl.load_liner("lbm_slit"), "orifice, $C_c = 0.444$": fitted}
        curves = {name: tl.ir_tdibc(liner, CURVE, TONE, kernel="periodic") for name, liner in liners.items()}
        draw(curves, rows, FIGURES / f"{STEM}.png")
        plain = [{k: v for key, value in row.items() for k, v in _parts(key, value)} for row in rows]
        write_rows(plain, FIGURES / f"{STEM}.csv", ".5g")
        write_tables(PAGE, tables)
    return 0


def _parts(key: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, complex):
        return [(f"{key}_resistance", value.real), (f"{key}_reactance", value.imag)]
    return [(key, value)]


if __name__ == "__main__":
    sys.exit(main())
