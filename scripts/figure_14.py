"""Kumaresan and Tufts' method on wall pressures of a known impedance: figures 14 and 19.

    python scripts/figure_14.py [-o FOLDER] [--draws 500]

Pressures at the microphones of B2A and of UFSC's rig by the linearised Euler equations in sheared
flow, sources on both sides, with errors of 0.1 dB and 0.1 degrees; educed with uniform flow, as in
the paper, and by a fit of the equations. B2A has the paper's local impedances; UFSC's is ASSUMED
(the paper gives it as a picture). Its measured pressures are not public: crosses are what it educed
from them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.conversions import pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.io.csv_rows import write_rows
from torchliner.report import figure as style
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, styled

SIDES = ("upstream", "downstream")
FIRST = 145.0  # dB, where figure 19 lets its levels start


@dataclass(frozen=True)
class Facility:
    """A preset, the impedances that its pressures are made with, and the paper's of its KT."""

    name: str
    preset: str
    picture: str
    state: str  # of the impedances
    truth: Mapping[str, complex]
    paper: Mapping[str, complex]


FACILITIES = (
    Facility(
        *("B2A", "b2a", "figure_14", "the paper's"),
        {"upstream": 2.33 - 0.30j, "downstream": 2.25 - 0.30j},
        {"upstream": 1.28 + 0.06j, "downstream": 3.02 - 0.40j},
    ),
    Facility(
        *("UFSC/PoliTo", "ufsc", "figure_19", "ASSUMED"),
        dict.fromkeys(SIDES, 1.36 - 0.67j),
        {"upstream": 1.04 - 0.36j, "downstream": 1.68 - 0.98j},
    ),
)


class Educed(NamedTuple):
    """One side of a facility: its microphones over the liner, and what two methods make of them."""

    line: tl.MicrophoneLine
    by_modes: tl.WallEduction
    by_field: tl.FieldFit


def educed(facility: Facility, side: str, draws: int) -> Educed:
    """Solve, then educe."""
    setup = tl.load_duct(facility.preset, source_side=side, impedance=facility.truth[side])
    solver = tl.DuctSolver(setup.case, setup.frequency)
    line = setup.line_of(solver.solve(setup.impedance)).over_liner()
    if facility.preset == "ufsc":
        nearest = line.pressure[..., 0 if side == "upstream" else -1, :].abs()
        line = replace(line, pressure=line.pressure * (pressure_amplitude_from_spl(FIRST) / nearest))
    return Educed(line, tl.kumaresan_tufts(line, draws=draws), tl.fit_field(line, solver, draws=draws))


def draw_cloud(axis: Any, one: Any, colour: str, marker: str, label: str) -> None:
    """Z in the plane of R and X, with its draws."""
    drawn = one.draws.impedance[:, 0].numpy()
    axis.plot(drawn.real, drawn.imag, ".", color=colour, markersize=1.5, alpha=0.4)
    style.draw_point(axis, complex(one.impedance[0]), marker=marker, color=colour, markeredgecolor="k", label=label)


def draw_levels(axis: Any, line: Any, one: Any, colour: str, marker: str) -> None:
    """Of the microphones, of the fit and of the range of its draws."""
    x, level = one.level_along()
    drawn = one.draws.level_along()[1][..., 0].numpy()
    style.draw_values(axis, 1e3 * x, level[:, 0], (np.nanmin(drawn, 0), np.nanmax(drawn, 0)), color=colour)
    axis.plot(1e3 * line.x, line.level[:, 0], marker, color=colour, markerfacecolor="none", linestyle="none")


@styled
def draw(facility: Facility, sides: dict[str, Educed], path: Path) -> Figure:
    """Impedances of all draws; levels with their range."""
    figure, axes = style.subplots(1, 2, 3.7)
    plane, levels = axes[0]
    for i, (side, one) in enumerate(sides.items()):
        draw_cloud(plane, one.by_modes, COLOURS[i], MARKERS[i], f"KT, {side}")
        draw_levels(levels, one.line, one.by_modes, COLOURS[i], MARKERS[i])
    for i, (side, one) in enumerate(sides.items()):
        draw_cloud(plane, one.by_field, COLOURS[2 + i], "D", f"LEE fit, {side}")
    for i, side in enumerate(sides):
        z = facility.paper[side]
        plane.plot(z.real, z.imag, "x", color=COLOURS[i], markersize=7, label=f"paper, {side}")
    for i, side in enumerate(sides):
        z = facility.truth[side]
        plane.plot(z.real, z.imag, "*", color="k", markersize=8, zorder=5, label=None if i else "true")
    plane.set(xlabel=PARTS[0][1], ylabel=PARTS[1][1])
    levels.set(xlabel="$x$ (mm)", ylabel=style.SPL)
    style.entry(plane, "pressures", "o", markerfacecolor="none")
    style.entry(plane, "KT, range of the draws")
    style.frame(plane, "xy")
    style.legend_below(figure, plane, 4)
    one = next(iter(sides.values()))
    truths = " and ".join(dict.fromkeys(f"{z:.2f}" for z in facility.truth.values()))
    words = (
        f"{facility.name}, Mach 0.3, {float(one.line.frequency[0]):g} Hz; LEE pressures of "
        f"Z = {truths} ({facility.state}); {one.by_modes.choices['draws']} draws of 0.1 dB, 0.1 deg; lines: KT, "
        "rank 2, with the range of the draws"
    )
    return style.finish(figure, path, words)


def impedances(facility: Facility, side: str, one: Educed) -> list[dict[str, Any]]:
    """A row a method."""
    rows = []
    for found in (one.by_modes, one.by_field):
        row: dict[str, Any] = {"facility": facility.name, "source": side, "method": found.method}
        values: dict[str, Any] = {
            "": found.impedance[0],
            "mean ": found.mean[0],
            "std ": found.standard_deviation[0],
            "true ": facility.truth[side],
            "paper's KT ": facility.paper[side],
        }
        for name, value in values.items():
            z = complex(value)
            row |= {f"{name}resistance": z.real, f"{name}reactance": z.imag}
        rows.append(row | {"draws": found.choices["draws"]})
    return rows


def levels(facility: Facility, side: str, one: Educed) -> list[dict[str, Any]]:
    """A row a microphone: as solved, as fitted by KT, and the range over its draws."""
    assert isinstance(one.by_modes.draws, tl.WallEduction)
    fitted = spl_from_pressure_amplitude(one.by_modes.pressure_at(one.line.x))[:, 0]
    drawn = spl_from_pressure_amplitude(one.by_modes.draws.pressure_at(one.line.x))[..., 0]
    rows = []
    for i, x in enumerate(one.line.x.tolist()):
        known = drawn[:, i][drawn[:, i].isfinite()]
        row = {"facility": facility.name, "source": side, "x (m)": x, "SPL (dB)": float(one.line.level[i, 0])}
        row |= {"KT (dB)": float(fitted[i]), "KT least (dB)": float(known.min()), "KT most (dB)": float(known.max())}
        rows.append(row)
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--draws", type=int, default=500)
    options = options_of(parser, arguments)
    found, heard = [], []
    for facility in FACILITIES:
        sides = {side: educed(facility, side, options.draws) for side in SIDES}
        draw(facility, sides, options.output / f"{facility.picture}.png")
        for side, one in sides.items():
            found += impedances(facility, side, one)
            heard += levels(facility, side, one)
    write_rows(found, options.output / "figure_14_19.csv")
    write_rows(heard, options.output / "figure_14_19_levels.csv")
    for row in found:
        print(
            f"{row['facility']:12s} {row['source']:10s} {row['method']:16s} "
            f"{row['resistance']:.3f}{row['reactance']:+.3f}j, draws "
            f"{row['std resistance']:.3f}, {row['std reactance']:.3f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
