"""The audit as a table, as CSV and as a figure."""

from __future__ import annotations

from pathlib import Path

from torchliner.report.figure import COLOURS, ONE_ROW, PARTS, Figure, finish, styled, subplots
from torchliner.report.numbers import part_of
from torchliner.report.table import Column, Table, format_bounds, format_complex, real_and_imaginary
from torchliner.studies.rows import Row, Study

ROW_HEIGHT = 0.17  # inches
SHOWN = (
    Column("", "factor", "choice"),
    Column("", "variant", "changed to"),
    Column("", "impedance", "Z", format_complex),
    Column("", "change.real", "dR", "+.3f"),
    Column("", "change.imag", "dX", "+.3f"),
)
LEVEL_CHECK = Column("", "level_check", "level check dB", "+.2f")
WRITTEN = (
    Column("factor"),
    Column("variant"),
    *real_and_imaginary("R (rho c)", "X (rho c)", "impedance", None),
    *real_and_imaginary("change of R", "change of X", "change", None),
    Column("note", lambda row: row.get("note", "")),
    Column("level check (dB)", lambda row: row.get("level_check")),
)


def write_audit(found: Study, path: str | Path) -> None:
    """One row per variant; the base and its interval are rows too, and what does not apply."""
    ends = {"base": found.base, "low": found.low, "high": found.high}
    rows = [
        Row(factor="base" if name == "base" else "interval", variant=found.averaging if name == "base" else name,
            impedance=z, change=z - found.base, level_check=found.level_check if name == "base" else None)
        for name, z in ends.items() if z is not None
    ]  # fmt: skip
    rows += found.rows
    rows += [
        Row(factor=key, note=why, variant="does not apply", impedance=None, change=None)
        for key, why in found.skipped.items()
    ]
    Table(rows, WRITTEN, ".9g").write_csv(path)


def format_audit(found: Study) -> str:
    """Factors by how far they move Z; the base and its interval on top."""
    base = f"base {format_complex(found.base)}"
    if found.low is not None and found.high is not None and found.level is not None:
        bounds = format_bounds((found.low, found.high))
        base += f"; {100 * found.level:g} % statistical interval {bounds}"
    skipped = [f"  {factor}: {reason}" for factor, reason in found.skipped.items()]
    level = "" if found.level_check is None else f" {found.level_check:+.2f} dB"
    return "\n".join([
        f"{found.title}, {found.frequency:g} Hz, whole liner, averaging {found.averaging}",
        base,
        f"level check{level or ':'} {found.level_check_words}\n",
        Table(found.rows, (*SHOWN, LEVEL_CHECK) if level else SHOWN).as_text(),
        *(["\ndoes not apply to these data:", *skipped] if skipped else []),
        *([f"\n{found.nearest_case}"] if found.nearest_case else []),
        f"\nthe velocity was read through {found.readings} times for {len(found.rows)} variants",
    ])  # fmt: skip


@styled
def draw_audit(found: Study, path: str | Path | None = None) -> Figure:
    """A bar per factor from its smallest to its largest value, its variants as points."""
    factors = list(dict.fromkeys(row.factor for row in found.rows))[::-1]
    figure, axes = subplots(1, 2, 1.0 + ROW_HEIGHT * 1.5 * len(factors), beside=True)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        base = part_of(found.base, part)
        if found.low is not None and found.high is not None:
            axis.axvspan(
                part_of(found.low, part), part_of(found.high, part), color="0.85", zorder=0,
                label=f"{100 * (found.level or 0):g} % statistical interval",
            )  # fmt: skip
        axis.axvline(base, color="k", linewidth=0.9, label="base", zorder=1)
        for place, factor in enumerate(factors):
            values = [part_of(row.impedance, part) for row in found.of(factor=factor)]
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
    return finish(figure, path, f"{found.title}, {found.frequency:g} Hz, averaging {found.averaging}", legend=ONE_ROW)
