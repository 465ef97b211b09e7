"""The audit as a table, as CSV and as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchliner.audits.rows import Audit
from torchliner.report.figure import COLOURS, PARTS, Figure, finish, styled, subplots
from torchliner.report.table import format_complex, write_rows

ROW_HEIGHT = 0.17  # inches


def plain_audit(found: Audit) -> dict[str, Any]:
    """For JSON."""
    return {
        "title": found.title,
        "frequency": found.frequency,
        "order": found.order,
        "base": found.base,
        "interval": None if found.low is None else [found.low, found.high],
        "level": found.level,
        "rows": [vars(row) for row in found.rows],
        "not_applicable": dict(found.skipped),
        "readings": found.readings,
        "choices": found.choices,
        "notes": list(found.notes),
    }


def write_audit(found: Audit, path: str | Path) -> None:
    """One row a variant; the base and its interval are rows too, and what does not apply."""
    values: list[tuple[str, str, complex, complex]] = [("base", found.order, found.base, 0j)]
    if found.low is not None and found.high is not None:
        values.append(("interval", "low", found.low, found.low - found.base))
        values.append(("interval", "high", found.high, found.high - found.base))
    values += [(row.factor, row.variant, row.impedance, row.change) for row in found.rows]
    rows = [
        {
            "factor": factor, "variant": variant,
            "R (rho c)": f"{value.real:.9g}", "X (rho c)": f"{value.imag:.9g}",
            "change of R": f"{change.real:.9g}", "change of X": f"{change.imag:.9g}",
            "note": "",
        }
        for factor, variant, value, change in values
    ]  # fmt: skip
    write_rows(
        rows + [
            {"factor": factor, "variant": "does not apply", "note": reason}
            for factor, reason in found.skipped.items()
        ],
        path,
    )  # fmt: skip


def format_audit(found: Audit) -> str:
    """Factors by how far they move Z; the base and its interval on top."""
    lines = [
        f"{found.title}, {found.frequency:g} Hz, whole liner, {found.order}",
        f"base {format_complex(found.base)}",
    ]
    if found.low is not None and found.high is not None and found.level is not None:
        lines[-1] += (
            f"; {100 * found.level:g} % statistical interval R {found.low.real:.3f} to "
            f"{found.high.real:.3f}, X {found.low.imag:.3f} to {found.high.imag:.3f}"
        )
    lines += ["", f"{'choice':18s} {'changed to':48s} {'Z':>14s} {'dR':>8s} {'dX':>8s}"]
    for factor in found.factors:
        for i, row in enumerate(found.of(factor)):
            lines.append(
                f"{factor if i == 0 else '':18s} {row.variant[:48]:48s} "
                f"{format_complex(row.impedance):>14s} {row.change.real:+8.3f} "
                f"{row.change.imag:+8.3f}"
            )
    if found.skipped:
        lines += ["", "does not apply to these data:"]
        lines += [f"  {factor}: {reason}" for factor, reason in found.skipped.items()]
    lines += ["", f"the velocity was read through {found.readings} times for {len(found.rows)} "
              "variants"]  # fmt: skip
    return "\n".join(lines)


@styled
def draw_audit(found: Audit, path: str | Path | None = None) -> Figure:
    """A bar per factor from its smallest to its largest value, its variants as points."""
    factors = found.factors[::-1]
    figure, axes = subplots(1, 2, 1.3 + ROW_HEIGHT * 1.6 * len(factors))
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        name = "real" if part == "resistance" else "imag"
        base = getattr(found.base, name)
        if found.low is not None and found.high is not None:
            axis.axvspan(
                getattr(found.low, name), getattr(found.high, name), color="0.85", zorder=0,
                label=f"{100 * (found.level or 0):g} % statistical interval",
            )  # fmt: skip
        axis.axvline(base, color="k", linewidth=0.9, label="base", zorder=1)
        for place, factor in enumerate(factors):
            values = [getattr(row.impedance, name) for row in found.of(factor)]
            ends = [*values, base]
            axis.plot([min(ends), max(ends)], [place] * 2, color=COLOURS[0], linewidth=3.5,
                      alpha=0.45, solid_capstyle="butt", zorder=2)  # fmt: skip
            axis.plot(values, [place] * len(values), "o", color=COLOURS[0], markersize=3.2,
                      zorder=3, label="choice changed" if place == 0 else None)  # fmt: skip
        axis.set_xlabel(label)
        axis.set_ylim(-0.7, len(factors) - 0.3)
        axis.set_yticks(range(len(factors)), factors if part == "resistance" else [])
        axis.tick_params(axis="y", length=0)
        axis.minorticks_off()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.suptitle(f"{found.title}, {found.frequency:g} Hz, {found.order}", fontsize=9)
    return finish(figure, path)
