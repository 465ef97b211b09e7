"""Z in the complex plane: probes, cells, the whole liner in every averaging, and references."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report.alongside import alongside_surfaces
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    finish,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.table import Column, Table, plain_columns

MOST_PROBES = 1500


def plane_rows(result: ImpedanceMap, index: int) -> list[dict[str, Any]]:
    """Cells, averagings of the liner, references and other methods, with intervals where known."""
    rows: list[dict[str, Any]] = []

    def add(what: str, name: str, value: Any, bounds: Any = None) -> None:
        low, high = (None, None) if bounds is None else bounds
        rows.append({"what": what, "name": name, "impedance": complex(value), "low": low,
                     "high": high})  # fmt: skip

    for number, value in enumerate(result.cells[result.averaging].impedance[:, index].tolist()):
        add("cell", str(number), value)
    for name, liner in result.liner.items():
        add("liner", name, liner.impedance[index], result.bounds_of_liner(name, index))
    for name, value in known_of(result, index).items():
        add("known", name, value)
    return rows


def known_of(result: ImpedanceMap, index: int) -> dict[str, complex]:
    """References of the file, at its tone, other methods, Goodrich."""
    found = {name: complex(z) for name, z in result.reference_at(index).items()}
    found |= alongside_surfaces([result], index)
    if result.goodrich is not None:
        found["Goodrich (2.7), linear liner"] = complex(result.goodrich[index])
    return found


def plane_table(result: ImpedanceMap, index: int) -> Table:
    """For CSV."""
    columns = [Column("what"), Column("name"), *plain_columns("impedance* low* high*", None)]
    return Table(plane_rows(result, index), columns, "")


@styled
def draw_complex_plane(result: ImpedanceMap, index: int) -> Figure:
    """Grey dots: probes; crosses: statistical intervals."""
    figure, axes = subplots(1, 1, 3.6)
    axis, rows = axes[0, 0], plane_rows(result, index)
    probes = result.impedance[..., index].detach().cpu().numpy().reshape(-1)
    probes = probes[np.isfinite(probes)]
    probes = probes[:: -(-len(probes) // MOST_PROBES) or 1]
    axis.plot(probes.real, probes.imag, ".", color="#8c8c8c", markersize=2.5, zorder=1,
              label="probes")  # fmt: skip
    cells = np.array([row["impedance"] for row in rows if row["what"] == "cell"])
    if len(cells) > 1:
        axis.plot(cells.real, cells.imag, "o", markersize=4, markerfacecolor="#ffffff", color="k",
                  zorder=2, label=f"cells, {result.averaging}")  # fmt: skip
    liner = [row for row in rows if row["what"] == "liner"]
    for i, row in enumerate(liner):
        _draw(axis, row, MARKERS[i], COLOURS[i], f"liner, {row['name']}")
    known = [row for row in rows if row["what"] == "known"]
    for i, row in enumerate(known):
        _draw(axis, row, "*x+1234"[i % 7], "k", row["name"])
    ends = [row[end] for row in rows for end in ("impedance", "low", "high")]
    _limits(axis, probes, [end for end in ends if end is not None])
    label_axes(axis, PARTS[0][1], PARTS[1][1])
    figure.legend(loc="outside right upper")
    return finish(figure, None)


def _draw(axis: Any, row: dict[str, Any], marker: str, colour: str, label: str) -> None:
    value = row["impedance"]
    axis.plot(value.real, value.imag, marker, color=colour, markersize=7, linestyle="none",
              zorder=5, label=label)  # fmt: skip
    if row["low"] is not None:
        low, high = row["low"], row["high"]
        axis.plot([low.real, high.real], [value.imag] * 2, color=colour, linewidth=1.4, zorder=4)
        axis.plot([value.real] * 2, [low.imag, high.imag], color=colour, linewidth=1.4, zorder=4)


def _limits(axis: Any, probes: Any, shown: list[complex]) -> None:
    """Single probes over a hard spot reach extremes that would hide the rest."""
    for part, limit in (("real", axis.set_xlim), ("imag", axis.set_ylim)):
        ends = [getattr(value, part) for value in shown if np.isfinite(value)]
        if len(probes):
            ends += np.percentile(getattr(probes, part), [1, 99]).tolist()
        if ends:
            margin = 0.08 * (max(ends) - min(ends)) or 0.05
            limit(min(ends) - margin, max(ends) + margin)
