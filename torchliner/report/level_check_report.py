"""Level checks of maps and lines as text, for JSON, as CSV and as a figure over height."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.level_check import DEGREES_PER_DB
from torchliner.report.figure import COLOURS, MARKERS, Figure, finish, label_axes, styled, subplots
from torchliner.report.numbers import case_title
from torchliner.report.table import Column, Table

LABELS = {"level": "implied less known level (dB)", "phase": "implied less known phase (degrees)"}


def level_check_lines(results: Sequence[ImpedanceMap | ImpedanceLine], where: Sequence[Column]) -> list[str]:
    """What the whole planes of maps or one line are compared with, a row each and frequency, placed
    by the columns ``where``; why the answer fails."""
    heading = "\n".join(dict.fromkeys(f"level check: {result.level_check_words}" for result in results))
    rows: list[dict[str, Any]] = []
    sentences: dict[str, None] = {}
    averagings: dict[str, None] = {}
    for result in sorted(results, key=lambda each: getattr(each, "height", None) or 0.0):
        if (check := result.level_check) is None:
            continue
        if check.confidence is not None and not rows:
            heading += f" ({100 * check.confidence:g} % statistical intervals)"
        averagings |= dict.fromkeys(check.averagings)
        for i, frequency in enumerate(result.frequency.tolist()):
            place = {"height": getattr(result, "height", None), "frequency": frequency}
            rows.append(place | {averaging: check.words(averaging, i) for averaging in check.averagings})
            sentences |= dict.fromkeys([check.sentence(check.averaging, frequency, i)])
    if not rows:
        return [heading]
    columns = [*where, *(Column(averaging, heading=averaging) for averaging in averagings)]
    return [
        f"\n{heading}",
        Table([dict.fromkeys(averagings, "-") | row for row in rows], columns).as_text(),
        *filter(None, sentences),
        "",
    ]


def plain_level_check(result: ImpedanceMap | ImpedanceLine) -> dict[str, Any]:
    """For JSON; ``checked`` is false where nothing is known, ``words`` say why."""
    words = result.level_check_words
    if result.level_check is None:
        return {"checked": False, "words": words}
    return {"checked": True, "words": words, **result.level_check.plain(result.frequency.tolist())}


def level_check_rows(results: Sequence[ImpedanceMap], frequency_index: int = 0) -> list[dict[str, Any]]:
    """One row a height and averaging: numbers of the whole plane, None where unknown."""
    rows = []
    for result in sorted(results, key=lambda each: each.height or 0.0):
        if (check := result.level_check) is None:
            continue
        for number, averaging in enumerate(check.averagings):
            rows.append({
                "height": result.height,
                "frequency": float(result.frequency[frequency_index]),
                "averaging": averaging,
                **check.liner.at(number, frequency_index),
                "verdict": check.verdict(averaging, frequency_index),
            })  # fmt: skip
    return rows


def level_check_table(results: Sequence[ImpedanceMap], frequency_index: int = 0) -> Table:
    """``level_check_rows`` as a table for CSV."""
    rows = level_check_rows(results, frequency_index)
    return Table(rows, [Column(name) for name in rows[0]] if rows else [], ".9g")


@styled
def draw_level_check(
    results: Sequence[ImpedanceMap], path: str | Path | None = None, frequency_index: int = 0
) -> Figure:
    """dB, and degrees where the phase is known, over height, with statistical bars.

    Planes without a height stand beside no axis of heights, or not at all where others have one.

    Raises:
        ValueError: no map has a level check.
    """
    rows = level_check_rows(results, frequency_index)
    checked = [result.level_check for result in results if result.level_check is not None]
    if not checked:
        raise ValueError(f"level check: {results[0].level_check_words}; nothing to draw")
    kinds = [kind for kind in LABELS if any(row[kind] is not None for row in rows)]
    placed = any(row["height"] is not None for row in rows)
    figure, axes = subplots(1, max(1, len(kinds)), 2.9)
    for axis, kind in zip(axes[0], kinds or ["level"], strict=True):
        limit = checked[0].limit * (1 if kind == "level" else DEGREES_PER_DB)
        axis.axhspan(-limit, limit, color="0.88", zorder=0, label="limit")
        axis.axhline(0, color="0.6", linewidth=0.6, zorder=1)
        for i, averaging in enumerate(dict.fromkeys(row["averaging"] for row in rows)):
            mine = [row for row in rows if row["averaging"] == averaging and row[kind] is not None
                    and (row["height"] is not None or not placed)]  # fmt: skip
            x = [1e3 * (row["height"] or 0.0) for row in mine]
            axis.plot(x, [row[kind] for row in mine], MARKERS[i] + "-", color=COLOURS[i],
                      label=averaging, zorder=3)  # fmt: skip
            barred = [row for row in mine if row[f"{kind}_low"] is not None]
            axis.vlines(
                [1e3 * (row["height"] or 0.0) for row in barred],
                [row[f"{kind}_low"] for row in barred],
                [row[f"{kind}_high"] for row in barred],
                color=COLOURS[i], zorder=2,
            )  # fmt: skip
        label_axes(axis, "$y$ (mm)" if placed else "height not stated", LABELS[kind])
        if not placed:
            axis.set_xticks([])
    frequency = float(results[0].frequency[frequency_index])
    title = f"{case_title(results[0])}, {frequency:g} Hz\noff {checked[0].known}"
    return finish(figure, path, title, legend=4)
