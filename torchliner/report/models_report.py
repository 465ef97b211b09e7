"""Models beside each other: as a table, as CSV, for JSON and as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    ONE_ROW,
    PARTS,
    REFERENCES,
    Figure,
    draw_curve,
    finish,
    impedance_panels,
    styled,
    subplots,
)
from torchliner.report.numbers import impedance_over_frequency, part_of
from torchliner.report.table import (
    Column,
    Table,
    format_bounds,
    format_complex,
    format_references,
    plain_columns,
)
from torchliner.studies.rows import Row, Study

STYLES = ("-", "--", ":", "-.") * 99


def _table(found: Study) -> Table:
    """Columns of text, CSV and JSON."""

    def under(name: str) -> Any:
        return lambda row: row.averagings[name]

    def distance(name: str) -> Any:
        return lambda row: row.distance.get(name)

    averagings = next(iter(found.maps.values())).averagings
    several = len({row.frequency for row in found.rows}) > 1
    shown = [Column("", "model", "model")]
    shown += [Column("", "frequency", "f Hz", ".1f")] if several else []
    shown += [Column("", "impedance", f"Z, {found.averaging}", format_complex)]
    if found.level is not None:
        shown.append(Column("", lambda row: _bounds(row), f"{100 * found.level:g} % interval",
                            format_bounds))  # fmt: skip
    shown += [Column("", under(name), f"Z, {name}", format_complex)
              for name in averagings if name != found.averaging]  # fmt: skip
    if any(row.level_check is not None for row in found.rows):
        shown += [Column("", lambda row: (row.level_check, row.verdict), "level check dB", _checked)]
    shown += [Column("", distance(name), f"|Z - {name}|", ".3f") for name in found.references]
    shown += [Column("", "model_error", "error in R", ".0e")]
    plain = [*plain_columns("model frequency impedance* low* high*")]
    for name in averagings:
        words = name.replace("-", "_")
        plain += [Column(f"{words}_{part}", _part_in(name, part)) for part, _ in PARTS]
    plain += plain_columns("level_check verdict")
    plain += [Column(f"distance to {name}", distance(name)) for name in found.references]
    return Table(found.rows, (*shown, *plain, Column("model_error")), ".9g")


def _part_in(averaging: str, part: str) -> Any:
    return lambda row: float(part_of(row.averagings[averaging], part))


def _checked(value: tuple[float | None, str]) -> str:
    return "-" if value[0] is None else f"{value[0]:+.2f} {value[1]}"


def _bounds(row: Row) -> Any:
    return None if row.low is None else (row.low, row.high)


def write_models(found: Study, path: str | Path) -> None:
    """One row a frequency and model."""
    _table(found).write_csv(path)


def plain_models(found: Study) -> dict[str, Any]:
    """For JSON."""
    names = ("title", "averaging", "level", "sorted_by", "references", "level_check_words", "notes")
    return {**{key: getattr(found, key) for key in names}, "rows": _table(found).as_rows()}


def format_models(found: Study) -> str:
    """The table, what it is sorted by, the references."""
    frequencies = dict.fromkeys(row.frequency for row in found.rows)
    at = f", {next(iter(frequencies)):g} Hz" if len(frequencies) == 1 else ""
    sorted_by = "models as given" if found.sorted_by == "as given" else f"by {found.sorted_by}"
    return "\n".join([
        f"{found.title}{at}, whole liner; {sorted_by}",
        _table(found).as_text(),
        *format_references(found.references),
        f"level check: {found.level_check_words}",
    ])  # fmt: skip


def draw_models(found: Study, path: str | Path | None = None) -> Figure:
    """R and X with their intervals: a line a model at one frequency, curves over several."""
    several = len(next(iter(found.maps.values())).frequency) > 1
    return (_draw_spectra if several else _draw_values)(found, path)


@styled
def _draw_values(found: Study, path: str | Path | None) -> Figure:
    rows = found.rows[::-1]
    figure, axes = subplots(1, 2, 1.1 + 0.25 * len(rows), beside=True)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        for place, row in enumerate(rows):
            value = part_of(row.impedance, part)
            words = "educed" if place == 0 else None
            if row.low is not None and row.high is not None:
                ends = [part_of(row.low, part), part_of(row.high, part)]
                axis.plot(ends, [place] * 2, color=COLOURS[0], linewidth=4, alpha=0.4,
                          solid_capstyle="butt")  # fmt: skip
            axis.plot(value, place, "o", color=COLOURS[0], label=words, zorder=3)
        for (name, value), style in zip(found.references.items(), REFERENCES * 9, strict=False):
            axis.axvline(part_of(value, part), label=name, **style)
        axis.set_xlabel(label)
        axis.set_ylim(-0.6, len(rows) - 0.4)
        names = [row.model for row in rows] if part == "resistance" else []
        axis.set_yticks(range(len(rows)), names)
        axis.tick_params(axis="y", length=0)
        axis.minorticks_off()
    return finish(figure, path, _title(found, f", {rows[0].frequency:g} Hz"), legend=ONE_ROW)


@styled
def _draw_spectra(found: Study, path: str | Path | None) -> Figure:
    figure, panels = impedance_panels(3.0, r"$f$ (kHz)")
    tone = next((row.frequency for row in found.rows if row.distance), None)
    for axis, part in panels:
        for i, (name, each) in enumerate(found.maps.items()):
            curve = impedance_over_frequency(each)
            draw_curve(axis, curve, part, COLOURS[i], 1e-3, linestyle=STYLES[i], label=name)
        for i, (name, value) in enumerate(found.references.items() if tone else ()):
            axis.plot(1e-3 * (tone or 0), part_of(value, part), MARKERS[i], color="k", label=name,
                      markersize=7, markerfacecolor="none", zorder=4)  # fmt: skip
    panels[1][0].axhline(0, color="0.6", linewidth=0.6, zorder=0)
    return finish(figure, path, _title(found), legend=4)


def _title(found: Study, at: str = "") -> str:
    bars = "" if found.level is None else f"; bands: {100 * found.level:g} % statistical interval"
    return f"{found.title}{at}, averaging {found.averaging}{bars}"
