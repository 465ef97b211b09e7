"""Impedance over the level of the incident wave: rows, text, curves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

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
from torchliner.velocity.level_curve import LevelCurve

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
    *plain_columns("impedance* spread* fixed_point* frozen* fixed_points reflected_energy several_solutions"),
    *plain_columns("kernel drive incident realisations kernel_error"),
)


def level_table(curve: LevelCurve) -> Table:
    """One row per level and frequency. ``fixed_point`` is that of the lowest speed."""
    rows = []
    impedance, spread = curve.impedance, curve.spread
    for i, (level, roots) in enumerate(zip(curve.level.tolist(), curve.fixed_points, strict=True)):
        of_level = {
            "level": level,
            "rms_speed": float(curve.rms_speed[i].square().mean().sqrt()),
            "peak_speed": float(curve.peak_speed[i].max()),
            "drift": float(curve.drift[i].max()),
            "residual": float(curve.residual[i].max()),
            "fixed_points": len(roots),
            "reflected_energy": float(curve.reflected_energy[i].mean()),
            "several_solutions": int(curve.several[i].max()),
            "realisations": curve.reflection.shape[1],
            **{name: curve.choices[name] for name in ("kernel", "drive", "incident", "kernel_error")},
        }
        for j, frequency in enumerate(curve.frequency.tolist()):
            values = {"impedance": impedance, "spread": spread, "frozen": curve.frozen}
            of_frequency = {name: complex(value[i, j]) for name, value in values.items()}
            fixed = complex(roots[0].impedance[j]) if roots else None
            rows.append(of_level | of_frequency | {"frequency": frequency, "fixed_point": fixed})
    return Table(rows, ROWS)


def level_text(curve: LevelCurve) -> str:
    """The table and what it rests on."""
    chosen = curve.choices
    kernel = ": the model's response, no kernel"
    if chosen["kernel"] != "periodic":
        low, high = chosen["kernel_band"]
        kernel = (
            f", error in R {chosen['kernel_error']:.1e} on {low:g}-{high:g} Hz, gain {chosen['kernel_gain']:.3g}; "
            "kernel's part: what it changes with |v| frozen at its rms"
        )
    lines = [
        f"{chosen['liner']}: {chosen['incident']}; drive {chosen['drive']}, {curve.reflection.shape[1]} "
        f"realisation(s) of {1e3 * chosen['duration']:.4g} ms at {chosen['sampling_rate']:g} Hz",
        level_table(curve).as_text(),
        f"Z by rho c; kernel {chosen['kernel']}{kernel}",
    ]
    for level, roots in zip(curve.level.tolist(), curve.fixed_points, strict=True):
        if len(roots) != 1:
            speeds = ", ".join(f"{root.speed:.4g} m/s" for root in roots) or "none"
            lines.append(f"at {level:g} dB the fixed point Z(rms v) has {len(roots)}: {speeds}")
    return "\n".join(lines)


def level_facts(curve: LevelCurve) -> dict[str, Any]:
    """For JSON."""
    roots = [[{"speed": speed, "impedance": z.tolist()} for speed, z in each] for each in curve.fixed_points]
    return curve.choices | {"fixed_points": roots, "rows": level_table(curve).as_rows()}


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
    title = "{liner}, {kernel}, {drive}".format(**curve.choices)
    return finish(figure, path, title, ONE_ROW)
