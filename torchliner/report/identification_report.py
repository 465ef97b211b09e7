"""An identification as text, rows and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.io.csv_rows import write_rows
from torchliner.report.figure import (
    COLOURS,
    PARTS,
    Figure,
    draw_band,
    entry,
    finish,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.numbers import part_of
from torchliner.report.table import Column, Table, format_complex, format_pair, plain_columns
from torchliner.studies.curves import law_of
from torchliner.studies.identification import Identification
from torchliner.studies.leave_out import Candidate
from torchliner.studies.rows import Row

SHOWN = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the last knot, in text
DRAWN = 200  # speeds of a picture
MOST = 0.05, 0.95  # shares of a plane's weight between which its speeds are stated


def candidate_table(found: Identification) -> Table:
    """Models, the one that predicts best first."""

    def values(each: Candidate) -> str:
        if each.fitted.is_curve:
            return ""
        both = zip(each.fitted.values.items(), each.fitted.standard.values(), strict=True)
        return ", ".join(f"{name} {value:.4g} +- {u:.2g}" for (name, value), u in both)

    return Table(
        found.candidates,
        (
            Column("model", "label", "model"),
            Column("left_out_error", "error", "error left out", ".3f"),
            Column("misfit", lambda each: each.fitted.misfit, "misfit/noise", ".2f"),
            Column("least_resistance", "lowest", "least R", ".3f"),
            Column("values", values, "values"),
        ),
    )


def run_table(rows: Sequence[Row]) -> Table:
    """What the other runs predict of each."""

    def off(row: Row) -> float | None:
        return None if row.true is None else 100 * (row.predicted.real / row.true.real - 1)

    def across(row: Row) -> float | None:
        return None if row.true is None else row.predicted.imag - row.true.imag

    return Table(
        rows,
        (
            *plain_columns("label group frequency height true* fitted* predicted* standard*", None),
            Column("error", "off"), Column("level_check"), Column("outside"),
            Column("", "label", "left out"),
            Column("", "frequency", "f Hz", ".1f"),
            Column("", "height", "y mm", ".2f", 1e3),
            Column("", "true", "reference", format_complex),
            Column("", "fitted", "fitted with it", format_complex),
            Column("", "predicted", "predicted without it", format_complex),
            Column("", "standard", "u(R), u(X)", format_pair),
            Column("resistance_off_percent", off, "R off %", "+.0f"),
            Column("reactance_off", across, "X off", "+.3f"),
            Column("", "level_check", "level check dB", "+.2f"),
            Column("", "outside", "unseen %", ".0f", 100.0),
        ),
    )  # fmt: skip


def predicted_table(rows: Sequence[dict[str, Any]]) -> Table:
    """Planes predicted by what was found: label, frequency, impedance, standard, outside."""
    return Table(
        rows,
        (
            Column("", "label", "predicted"),
            Column("", "frequency", "f Hz", ".1f"),
            Column("", "impedance", "Z", format_complex),
            Column("", "standard", "u(R), u(X)", format_pair),
            Column("", "outside", "unseen %", ".0f", 100.0),
        ),
    )


def seen_table(found: Identification) -> Table:
    """Of each plane: rms |v|, and the |v| between which its Z is made."""
    rows = []
    speeds, places = found.knots.speeds, iter(found.seen)
    for run in found.runs:
        for frequency in run.frequency.tolist():
            below = next(places).cumsum(0)
            ends = [float(speeds[int((below < share).sum())]) for share in MOST]
            rows.append({"label": run.group, "frequency": frequency, "height": run.plane.height,
                         "rms": run.speed, "low": ends[0], "high": ends[1]})  # fmt: skip
    return Table(
        rows,
        (
            Column("label", "label", "run"), Column("frequency", "frequency", "f Hz", ".1f"),
            Column("height", "height", "y mm", ".2f", 1e3),
            Column("rms_speed", "rms", "rms |v| m/s", ".3g"),
            Column("low_speed", "low", "5 % below", ".3g"),
            Column("high_speed", "high", "95 % below", ".3g"),
        ),
    )  # fmt: skip


def curve_rows(found: Identification, frequency: float, speed: Tensor) -> list[dict[str, Any]]:
    """Z over |v| with its 95 % band."""
    best, low, high = found.curve(frequency, speed)
    seen = found.seen_speeds
    return [
        {
            "frequency": frequency, "speed": v, "impedance": complex(best[i]),
            "low": complex(low[i]), "high": complex(high[i]), "seen": seen[0] <= v <= seen[1],
        }
        for i, v in enumerate(speed.tolist())
    ]  # fmt: skip


def curve_table(found: Identification) -> Table:
    """The curve at a few speeds of every frequency."""
    speed = found.knots.top * torch.tensor(SHOWN, dtype=torch.float64)
    rows = [row for f in found.frequencies for row in curve_rows(found, f, speed)]
    half = [{**row, "half": (row["high"] - row["low"]) / 2} for row in rows]
    return Table(
        half,
        (
            *plain_columns("frequency speed impedance* low* high* seen", None),
            Column("", "frequency", "f Hz", ".1f"), Column("", "speed", "|v| m/s", ".3g"),
            Column("", "impedance", "Z", format_complex),
            Column("", "half", "+- 95 %", format_pair),
            Column("", lambda row: "" if row["seen"] else "not seen", "data"),
        ),
    )  # fmt: skip


def format_identification(found: Identification) -> str:
    """All tables."""
    fitted, low_high = found.best.fitted, found.seen_speeds
    parts = [
        candidate_table(found).as_text(),
        f"chosen, for it predicts best what it has not seen: {found.best.label}",
        curve_table(found).as_text(),
        seen_table(found).as_text(),
        f"seen: |v| of about {low_high[0]:.3g} to {low_high[1]:.3g} m/s",
    ]
    if fitted.is_curve:
        parts[-1] += "".join(
            f"; at {frequency:g} Hz the data determine {fit.determined:.1f} of {len(fit.values)} parameters"
            for frequency, fit in zip(fitted.frequencies, fitted.fits, strict=True)
        )  # fmt: skip
        parts[-1] += f"; lines of the table add {found.table_error:.1e} to R"
    parts.append(run_table(found.best.rows).as_text())
    return "\n\n".join(parts)


def plain_identification(found: Identification) -> dict[str, Any]:
    """For JSON."""
    fitted = found.best.fitted
    singular = (
        {f"{f:g}": fit.singular_values.tolist() for f, fit in zip(fitted.frequencies, fitted.fits, strict=True)}
        if fitted.is_curve
        else {"all": fitted.fits[0].singular_values.tolist()}
    )
    return {
        "model": found.best.label,
        "models": candidate_table(found).as_rows(),
        "parameters": None if fitted.is_curve else fitted.values,
        "curve": curve_table(found).as_rows(),
        "seen_speeds": list(found.seen_speeds),
        "seen": seen_table(found).as_rows(),
        "singular_values": singular,
        "left_out": {each.label: run_table(each.rows).as_rows() for each in found.candidates},
        "averaging": found.averaging,
        "notes": list(found.notes),
    }


def write_table(found: Identification, path: str | Path, reach: float | None = None) -> None:
    """The curve as the CSV of a table liner."""
    table = found.table(reach)
    write_rows(
        [
            {"frequency": f, "speed": v, "resistance": z.real, "reactance": z.imag}
            for f, row in zip(table.frequency.tolist(), table.values.tolist(), strict=True)
            for v, z in zip(table.speed.tolist(), row, strict=True)
        ],
        path,
        ".9g",
    )


@styled
def draw_identification(
    found: Identification, path: str | Path | None = None, frequency: float | None = None
) -> Figure:
    """R and X over |v| with bands, by the best model, the best of the other kind and the law as it
    was (all of the first plane), and which |v| each run weighs.

    Args:
        frequency: Hz; default the first.
    """
    at = found.frequencies[0] if frequency is None else frequency
    speed = torch.linspace(0, found.knots.top**0.5, DRAWN, dtype=torch.float64).square()
    figure, axes = subplots(1, 3, 3.0)
    across = "$|v|$ (m s$^{-1}$)"
    liner, curve = found.runs[0].liner, found.best.fitted.is_curve
    rival = next((each for each in found.candidates if each.fitted.is_curve != curve), None)
    law = law_of(liner, at, speed)
    for axis, (part, label) in zip(axes[0], PARTS, strict=False):
        for each, colour in zip((found.best, rival), COLOURS, strict=False):
            if each is not None:
                best, low, high = (part_of(z, part) for z in each.fitted.at(at).band(liner, at, speed))
                draw_band(axis, speed, low, high, colour)
                axis.plot(speed, best, color=colour, label=each.label.replace("_", " "))
        axis.plot(speed, part_of(law, part), "--", color="k", linewidth=0.9, label="the law as it was")
        axis.axvspan(*found.seen_speeds, color="0.93", zorder=0)
        label_axes(axis, across, label)
    groups = list(dict.fromkeys(run.group for run in found.runs))
    for i, name in enumerate(groups):
        colour = COLOURS[2 + i % 5]
        for run, weight in zip(_per_row(found), found.seen, strict=True):
            if run == name:
                axes[0, 2].plot(found.knots.speeds, weight, color=colour, linewidth=0.9)
        entry(axes[0, 0], name, color=colour)
    entry(axes[0, 0], "$|v|$ that the runs see", width=5, color="0.9")
    label_axes(axes[0, 2], across, "share of each spline in $Z$")
    return finish(figure, path, f"{at:g} Hz", legend=5)


def _per_row(found: Identification) -> list[str]:
    """Run of each row of ``found.seen``."""
    return [run.group for run in found.runs for _ in run.frequency]
