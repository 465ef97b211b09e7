"""Kumaresan and Tufts' method on wall pressures of a known impedance: figures 14 and 19.

    python scripts/figure_14.py [-o FOLDER] [--draws 500]

Pressures at the microphones of B2A and of UFSC's rig by the linearised Euler equations in sheared flow, sources on both
sides, with errors of 0.1 dB and 0.1 degrees; educed with uniform flow, as in the paper, and by a fit of the equations.
B2A has the paper's local impedances; UFSC's is ASSUMED (the paper gives it as a picture). Its measured pressures are
not public: crosses are what it educed from them.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.conversions import pressure_amplitude_from_spl, spl_from_pressure_amplitude
from torchliner.report import figure as fig
from torchliner.report.table import table_of
from torchliner.studies.variants import Row

SIDES = ("upstream", "downstream")
FIRST = 145.0  # dB, where figure 19 lets its levels start


class Facility(NamedTuple):
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


@fig.styled
def draw(facility: Facility, sides: dict[str, Educed], path: Path) -> fig.Figure:
    """Impedances of all draws; levels of the microphones, of KT and of the range of its draws."""
    figure, axes = fig.subplots(1, 2, 3.7)
    plane, levels = axes[0]
    for i, (side, one) in enumerate(sides.items()):
        known, paper = facility.truth[side], facility.paper[side]
        for found, name, colour, marker in (
            (one.by_modes, "KT", fig.COLOURS[i], fig.MARKERS[i]),
            (one.by_field, "LEE fit", fig.COLOURS[2 + i], "D"),
        ):
            drawn, z = found.draws.impedance[:, 0], complex(found.impedance[0])  # type: ignore[union-attr]
            plane.plot(drawn.real, drawn.imag, ".", color=colour, markersize=1.5, alpha=0.4)
            plane.plot(z.real, z.imag, marker, color=colour, markeredgecolor="k", label=f"{name}, {side}")
        plane.plot(paper.real, paper.imag, "x", color=fig.COLOURS[i], markersize=7, label=f"paper, {side}")
        plane.plot(known.real, known.imag, "*", color="k", markersize=8, zorder=5, label=None if i else "true")
        (x, fitted), line = one.by_modes.fitted_along(), one.line
        level = spl_from_pressure_amplitude(fitted)
        heard = spl_from_pressure_amplitude(one.by_modes.draws.fitted_along()[1])[..., 0].numpy()  # type: ignore[union-attr]
        ends = np.nanmin(heard, 0), np.nanmax(heard, 0)
        fig.draw_values(levels, 1e3 * x, level[:, 0], ends, color=fig.COLOURS[i])
        look: Any = {"color": fig.COLOURS[i], "markerfacecolor": "none", "linestyle": "none"}
        levels.plot(1e3 * line.x, line.level[:, 0], fig.MARKERS[i], **look)
    plane.set(**fig.PLANE)
    levels.set(xlabel=fig.X_MM, ylabel=fig.SPL)
    fig.entry(plane, "pressures", "o", markerfacecolor="none")
    fig.entry(plane, "KT, range of the draws")
    fig.frame(plane, "xy")
    fig.legend_below(figure, plane, 4)
    one = next(iter(sides.values()))
    truths = " and ".join(dict.fromkeys(f"{z:.2f}" for z in facility.truth.values()))
    words = (
        f"{facility.name}, Mach 0.3, {float(one.line.frequency[0]):g} Hz; LEE pressures of "
        f"Z = {truths} ({facility.state}); {one.by_modes.choices['draws']} draws of 0.1 dB, 0.1 deg; lines: KT, "
        "rank 2, with the range of the draws"
    )
    return fig.finish(figure, path, words)


def impedances(facility: Facility, side: str, one: Educed) -> list[Row]:
    """A row a method."""
    rows = []
    for found in (one.by_modes, one.by_field):
        row = Row(facility=facility.name, source=side, method=found.method, impedance=complex(found.impedance[0]))
        drawn = found.drawn[:, 0]
        row |= {"mean": complex(drawn[torch.isfinite(drawn)].mean()), "std": complex(found.deviation[0])}  # type: ignore[index]
        row |= {"true": facility.truth[side], "paper": facility.paper[side], "draws": found.choices["draws"]}
        rows.append(Row(row))
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
    options = options_of(parser_of(__doc__, FIGURES, draws=500), arguments)
    found, heard = [], []
    for facility in FACILITIES:
        sides = {side: educed(facility, side, options.draws) for side in SIDES}
        draw(facility, sides, options.output / f"{facility.picture}.png")
        for side, one in sides.items():
            found += impedances(facility, side, one)
            heard += levels(facility, side, one)
    table = table_of(found, "facility,source,method,impedance,mean,std")
    table.write_csv(options.output / "figure_14_19.csv")
    table_of(heard).write_csv(options.output / "figure_14_19_levels.csv")
    print(table.as_text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
