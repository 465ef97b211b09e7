"""Impedance over the level of the incident wave: rows, text, curves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from torchliner.ir_tdibc_method.level_curve import LevelCurve
from torchliner.report.figure import (
    COLOURS,
    INCIDENT,
    MARKERS,
    ONE_ROW,
    Figure,
    draw_band,
    entry,
    finish,
    impedance_panels,
    styled,
)
from torchliner.report.table import Column, Table, format_complex, format_pair, plain_columns

ROWS = (
    Column("level", heading="dB", text=".1f"),
    Column("frequency", heading="f Hz", text=".1f"),
    Column("", "impedance", "Z", format_complex),
    Column("", "spread", "spread R, X", format_pair),
    Column("rms_speed", heading="rms v m/s", text=".4g"),
    Column("peak_speed", heading="peak v", text=".4g"),
    Column("", "fixed_point", "Z(rms v)", format_complex),
    Column("", "frozen", "kernel's part", format_complex),
    Column("drift", heading="drift", text=".1e"),
    Column("residual", heading="residual", text=".1e"),
    *plain_columns("impedance* spread* fixed_point* frozen*"),
    *(Column(name) for name in ("fixed_points", "reflected_energy", "several_solutions")),
    *(Column(name) for name in ("kernel", "drive", "incident", "realisations", "kernel_error")),
)


def level_table(curve: LevelCurve) -> Table:
    """One row per level and frequency. ``fixed_point`` is that of the lowest speed."""
    rows = []
    for i, level in enumerate(curve.level.tolist()):
        roots = curve.fixed_points[i]
        for j, frequency in enumerate(curve.frequency.tolist()):
            rows.append({
                "level": level, "frequency": frequency,
                "impedance": complex(curve.impedance[i, j]), "spread": complex(curve.spread[i, j]),
                "rms_speed": float(curve.rms_speed[i].square().mean().sqrt()),
                "peak_speed": float(curve.peak_speed[i].max()),
                "fixed_point": complex(roots[0].impedance[j]) if roots else None,
                "frozen": complex(curve.frozen[i, j]), "drift": float(curve.drift[i].max()),
                "residual": float(curve.residual[i].max()), "fixed_points": len(roots),
                "reflected_energy": float(curve.reflected_energy[i].mean()),
                "several_solutions": int(curve.several[i].max()), "kernel": curve.kernel,
                "drive": curve.drive, "incident": curve.incident,
                "realisations": curve.reflection.shape[1], "kernel_error": curve.kernel_error,
            })  # fmt: skip
    return Table(rows, ROWS)


def level_text(curve: LevelCurve) -> str:
    """The table and what it rests on."""
    low, high = curve.kernel_band
    lines = [
        f"{curve.liner}: {curve.incident}; drive {curve.drive}, {curve.reflection.shape[1]} "
        f"realisation(s) of {1e3 * curve.seconds:.4g} ms at {curve.sampling_rate:g} Hz",
        level_table(curve).as_text(),
        f"Z by rho c; kernel {curve.kernel}"
        + (
            f", error in R {curve.kernel_error:.1e} on {low:g}-{high:g} Hz, gain "
            f"{curve.kernel_gain:.3g}; kernel's part: what it changes with |v| frozen at its rms"
            if curve.kernel != "periodic"
            else ": the model's response, no kernel"
        ),
    ]
    for level, roots in zip(curve.level.tolist(), curve.fixed_points, strict=True):
        if len(roots) != 1:
            speeds = ", ".join(f"{root.speed:.4g} m/s" for root in roots) or "none"
            lines.append(f"at {level:g} dB the fixed point Z(rms v) has {len(roots)}: {speeds}")
    return "\n".join(lines)


def level_facts(curve: LevelCurve) -> dict[str, Any]:
    """For JSON."""
    return {
        "liner": curve.liner, "incident": curve.incident, "drive": curve.drive,
        "kernel": {"name": curve.kernel, "error": curve.kernel_error, "gain": curve.kernel_gain,
                   "band": list(curve.kernel_band)},
        "sampling_rate": curve.sampling_rate, "duration": curve.seconds,
        "slope_of_implicit_step": curve.slope,
        "fixed_points": [
            [{"speed": root.speed, "impedance": root.impedance.tolist()} for root in roots]
            for roots in curve.fixed_points
        ],
        "rows": level_table(curve).as_rows(),
    }  # fmt: skip


@styled
def draw_levels(curve: LevelCurve, path: str | Path | None = None) -> Figure:
    """Resistance and reactance over level; dashed: the fixed point of the frequency domain."""
    figure, panels = impedance_panels(3.2, INCIDENT)
    order = curve.level.argsort()
    level = curve.level[order].numpy()
    lowest = [roots[0].impedance if roots else None for roots in curve.fixed_points]
    for axis, part in panels:
        name = {"resistance": "real", "reactance": "imag"}[part]
        for j, frequency in enumerate(curve.frequency.tolist()):
            colour = COLOURS[j]
            z = getattr(curve.impedance, name)[order, j].numpy()
            u = getattr(curve.spread, name)[order, j].numpy()
            if curve.reflection.shape[1] > 1:
                draw_band(axis, level, z - u, z + u, colour)
            axis.plot(level, z, color=colour, marker=MARKERS[j], label=f"{frequency:g} Hz")
            dashed = [math.nan if lowest[i] is None else float(getattr(lowest[i][j], name)) for i in order.tolist()]
            axis.plot(level, dashed, color=colour, linestyle="--")
    entry(panels[0][0], "$Z$ of the rms $v$", linestyle="--")
    title = f"{curve.liner}, {curve.kernel}, {curve.drive}"
    return finish(figure, path, title, ONE_ROW)
