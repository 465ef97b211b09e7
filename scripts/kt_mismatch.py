"""How much of the upstream-downstream mismatch Kumaresan and Tufts' method makes by itself.

    python scripts/kt_mismatch.py [-o FOLDER] [--draws 500]

Wall pressures of a duct whose liner has ONE impedance, 2.33-0.30j, are computed by the linearised
Euler equations with the source upstream and downstream, and educed with uniform flow (Ingard-Myers)
as the paper does. What differs between the two sides is the method's own: figures 14 and 19 with a
known truth, then over flow, liner length, rank, order, noise, end reflection and Z varying along x.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.duct.case import impedance_along
from torchliner.duct.presets import DuctSetup, load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.io.csv_rows import write_rows
from torchliner.pressure.fit_field import fit_field
from torchliner.pressure.kumaresan_tufts import kumaresan_tufts
from torchliner.pressure.microphone_errors import draw_pressures
from torchliner.pressure.two_waves import two_wave_fit
from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    PARTS,
    Figure,
    entry,
    finish,
    legend_below,
    styled,
    subplots,
)

TRUE = 2.33 - 0.30j
PAPER = {"upstream": 1.28 + 0.06j, "downstream": 3.02 - 0.40j}
SIDES = ("upstream", "downstream")
FLOWS: dict[str, dict[str, Any]] = {
    "M = 0": {"bulk_mach": 0.0, "profile": "uniform", "shear": None},
    "uniform, Myers": {"profile": "uniform", "shear": None},
    "sheared": {},
}
LENGTHS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6)  # m
STEP, BEYOND = 0.012, 0.3  # m: between microphones; of rigid duct at either end
ERRORS = (0.02, 0.05, 0.1, 0.2, 0.5)  # dB and degrees
METHODS = ("KT", "two waves", "LEE fit")
FLOW_WORDS = {"M = 0": "$M = 0$"}
ACROSS = {"relative rise of R along x": r"$\Delta R/R$ along $x$"}
ANECHOIC = "LEE fit, end taken as anechoic"
DARK = {"upstream": COLOURS[0], "downstream": COLOURS[1]}


def setup_of(side: str, length: float = 0.15, **changes: Any) -> DuctSetup:
    """The B2A preset with another liner; microphones over the liner alone."""
    return load_duct(
        "b2a",
        source_side=side,
        liner=[(0.0, length)],
        start=-BEYOND,
        end=length + BEYOND,
        first=STEP / 2,
        last=length - STEP / 2,
        **changes,
    )


def row(study: str, value: Any, side: str, method: str, z: complex, **more: Any) -> dict[str, Any]:
    """One educed impedance."""
    return {
        "study": study,
        "value": value,
        "source": side,
        "method": method,
        "resistance": z.real,
        "reactance": z.imag,
        **more,
    }


def all_methods(
    study: str, value: Any, side: str, line: tl.MicrophoneLine, solver: DuctSolver | None
) -> list[dict[str, Any]]:
    """KT of rank 2, the two-wave fit and, with a solver, the fit of the field."""
    rows = [
        row(study, value, side, "KT", complex(kumaresan_tufts(line).impedance[0])),
        row(study, value, side, "two waves", complex(two_wave_fit(line).impedance[0])),
    ]
    if solver is not None:
        rows.append(row(study, value, side, "LEE fit", complex(fit_field(line, solver).impedance[0])))
    return rows


def flows_and_lengths() -> list[dict[str, Any]]:
    """Three flows over the liner's length."""
    rows = []
    for flow, changes in FLOWS.items():
        for length in LENGTHS:
            for side in SIDES:
                setup = setup_of(side, length, **changes)
                solver = DuctSolver(setup.case, setup.frequency)
                line = setup.line_of(solver.solve(setup.impedance))
                rows += all_methods(f"length, {flow}", length, side, line, solver)
        print(f"{flow}: done", flush=True)
    return rows


def ranks_and_orders(lines: dict[str, tl.MicrophoneLine]) -> list[dict[str, Any]]:
    """KT's two arguments, without noise."""
    rows = []
    for side, line in lines.items():
        most = line.microphones // 2
        for rank in (1, 2, 3, 4):
            for order in range(max(rank, 2), most + 1):
                found = kumaresan_tufts(line, rank=rank, order=order)
                rows.append(row(f"rank {rank}", order, side, "KT", complex(found.impedance[0])))
    return rows


def noise(lines: dict[str, tl.MicrophoneLine], solvers: dict[str, DuctSolver], draws: int) -> list[dict[str, Any]]:
    """Mean and standard deviation over draws of the microphones' errors."""
    rows = []
    for side, line in lines.items():
        for error in ERRORS:
            errors: Any = {"level_error": error, "phase_error": error}
            # As stated: draws= would raise them to what the residual of the model shows.
            random = torch.Generator().manual_seed(0)
            noisy = replace(line, pressure=draw_pressures(line.pressure, draws, random, **errors))
            found = {"KT": kumaresan_tufts(noisy).impedance, "two waves": two_wave_fit(noisy).impedance}
            if error == 0.1:
                fitted = fit_field(line, solvers[side], draws=draws, **errors).draws
                assert fitted is not None
                found["LEE fit"] = fitted.impedance
            for method, values in found.items():
                drawn = values[:, 0]
                spread = {"std resistance": float(drawn.real.std()), "std reactance": float(drawn.imag.std())}
                rows.append(row("noise", error, side, method, complex(drawn.mean()), draws=draws, **spread))
    return rows


def ends_and_gradients() -> list[dict[str, Any]]:
    """Reflections of the far end, as they are and unknown to the fit; Z varying along x."""
    rows = []
    for side in SIDES:
        anechoic = setup_of(side)
        blind = DuctSolver(anechoic.case, anechoic.frequency)
        for size in (0.0, 0.05, 0.1, 0.2, 0.3):
            setup = setup_of(side, end_reflection=(size, 0.0))
            solver = DuctSolver(setup.case, setup.frequency)
            line = setup.line_of(solver.solve(setup.impedance))
            rows += all_methods("end reflection", size, side, line, blind)
            z = complex(fit_field(line, blind, far_end="stated").impedance[0])
            rows.append(row("end reflection", size, side, ANECHOIC, z))
        for rise in (-0.5, -0.25, 0.0, 0.25, 0.5):
            along = impedance_along([0.0, 0.15], TRUE + np.array([-0.5, 0.5]) * rise * TRUE.real)
            line = anechoic.line_of(blind.solve(along))
            rows += all_methods("relative rise of R along x", rise, side, line, blind)
    return rows


def of(rows: Sequence[dict[str, Any]], study: str, side: str, method: str) -> tuple[Any, Any]:
    """Values and Z of one curve."""
    mine = [r for r in rows if (r["study"], r["source"], r["method"]) == (study, side, method)]
    z = np.array([complex(r["resistance"], r["reactance"]) for r in mine])
    return np.array([r["value"] for r in mine]), z


@styled
def draw_truth(rows: Sequence[dict[str, Any]], path: Path) -> Figure:
    """Figure 14a with a known truth: what each method makes of one impedance, by flow."""
    figure, axes = subplots(1, 2, 3.4)
    for axis, method in zip(axes[0], ("KT", "two waves"), strict=True):
        for i, flow in enumerate(FLOWS):
            points = [of(rows, f"length, {flow}", side, method)[1][LENGTHS.index(0.15)] for side in SIDES]
            axis.plot(np.real(points), np.imag(points), "-", color="0.6", linewidth=0.8, zorder=1)
            for side, z in zip(SIDES, points, strict=True):
                axis.plot(
                    z.real,
                    z.imag,
                    MARKERS[i],
                    color=DARK[side],
                    zorder=3,
                    label=f"{FLOW_WORDS.get(flow, flow)}, {side}",
                )
        for side, z in PAPER.items():
            axis.plot(z.real, z.imag, "x", color=DARK[side], markersize=7, label=f"paper, {side}")
        axis.plot(TRUE.real, TRUE.imag, "*", color="k", markersize=10, label="truth, and LEE fit", zorder=4)
        axis.set_xlabel(PARTS[0][1])
        axis.set_ylabel(PARTS[1][1])
        axis.set_title({"KT": "KT, rank 2", "two waves": "two-wave fit"}[method])
        axis.set_xlim(0.8, 3.4)
        axis.set_ylim(-0.8, 0.4)
    return finish(figure, path, "one impedance, 2.33-0.30j; B2A, Mach 0.3, 1500 Hz, liner 150 mm", legend=3)


@styled
def draw_length(rows: Sequence[dict[str, Any]], path: Path) -> Figure:
    """Mismatch of resistance and reactance over the liner's length."""
    figure, axes = subplots(1, 2, 3.2)
    for axis, (part, label) in zip(axes[0], (("real", "R"), ("imag", "X")), strict=True):
        for i, flow in enumerate(FLOWS):
            for method, style in (("KT", "-"), ("two waves", "--"), ("LEE fit", ":")):
                if method == "LEE fit" and flow != "sheared":
                    continue
                x, up = of(rows, f"length, {flow}", "upstream", method)
                _, down = of(rows, f"length, {flow}", "downstream", method)
                words = f"{FLOW_WORDS.get(flow, flow)}; {method}"
                axis.plot(
                    1e3 * x,
                    getattr(down - up, part),
                    style,
                    color=COLOURS[i],
                    marker=MARKERS[i],
                    markersize=3,
                    label=words,
                )
        axis.axhline(
            getattr(PAPER["downstream"] - PAPER["upstream"], part),
            color="k",
            linewidth=0.8,
            linestyle="-.",
            label="paper, 150 mm",
        )
        axis.set_xlabel("liner length (mm)")
        axis.set_ylabel(f"${label}$ downstream less upstream")
    return finish(figure, path, legend=3)


@styled
def draw_choices(rows: Sequence[dict[str, Any]], path: Path) -> Figure:
    """KT's rank and order, and the noise: lines and filled markers for the source upstream."""
    figure, axes = subplots(2, 2, 5.0)
    styles: dict[str, dict[str, Any]] = {
        f"KT, rank {rank}": {"color": COLOURS[rank], "marker": MARKERS[rank], "markersize": 3} for rank in (1, 2, 3, 4)
    }
    styles["two waves"] = {"color": "k", "marker": "o", "markersize": 3}
    sides: dict[str, dict[str, Any]] = {
        "upstream": {"linestyle": "-"},
        "downstream": {"linestyle": "--", "markerfacecolor": "none"},
    }
    for side, dashes in sides.items():
        for rank in (1, 2, 3, 4):
            x, z = of(rows, f"rank {rank}", side, "KT")
            for axis, part in zip(axes[0], ("real", "imag"), strict=True):
                axis.plot(x, getattr(z, part), **styles[f"KT, rank {rank}"] | dashes)
        for i, (method, name) in enumerate((("KT", "KT, rank 2"), ("two waves", "two waves"))):
            mine = [r for r in rows if r["study"] == "noise" and r["method"] == method and r["source"] == side]
            for axis, word in zip(axes[1], ("resistance", "reactance"), strict=True):
                place = np.array([r["value"] for r in mine]) * (1 + 0.06 * i)
                axis.errorbar(
                    place, [r[word] for r in mine], [r[f"std {word}"] for r in mine], capsize=2, **styles[name] | dashes
                )
    for column, (_, label) in enumerate(PARTS):
        for line in range(2):
            axes[line, column].axhline((TRUE.real, TRUE.imag)[column], color="0.6", linewidth=2, zorder=0)
            axes[line, column].set_ylabel(label)
        axes[0, column].set_xlabel("order of the prediction")
        axes[1, column].set_xlabel("error of the microphones (dB, degrees)")
        axes[1, column].set_xscale("log")
        axes[1, column].set_xticks(ERRORS, [f"{error:g}" for error in ERRORS])
        axes[1, column].minorticks_off()
    axes[0, 0].set_ylim(1.5, 3.0)
    axes[0, 1].set_ylim(-1.8, 0.6)
    for name, style in styles.items():
        entry(axes[0, 0], name, **style | {"linestyle": "none"})
    for side, dashes in sides.items():
        entry(axes[0, 0], f"source {side}", color="k", markersize=3, **{"marker": "o"} | dashes)
    entry(axes[0, 0], "truth", color="0.6", linewidth=2)
    return finish(figure, path, "sheared flow, liner 150 mm", legend=3)


@styled
def draw_ends(rows: Sequence[dict[str, Any]], path: Path) -> Figure:
    """End reflection and Z varying along x."""
    figure, axes = subplots(2, 2, 4.8)
    for line, study in enumerate(("end reflection", "relative rise of R along x")):
        for i, method in enumerate((*METHODS, ANECHOIC)):
            for side in SIDES:
                x, z = of(rows, study, side, method)
                for axis, part in zip(axes[line], ("real", "imag"), strict=True):
                    axis.plot(
                        x,
                        getattr(z, part),
                        ("-", "--", ":", "-.")[i],
                        color=DARK[side],
                        marker=MARKERS[i],
                        markersize=3,
                        label=f"{method}, {side}",
                    )
        for column, (_, label) in enumerate(PARTS):
            axes[line, column].axhline((TRUE.real, TRUE.imag)[column], color="k", linewidth=0.8)
            axes[line, column].set_xlabel(ACROSS.get(study, study))
            axes[line, column].set_ylabel(label)
    axes[0, 0].set_ylim(0.5, 3.5)
    axes[0, 1].set_ylim(-1.5, 0.5)
    legend_below(figure, axes[0, 0], 2)
    words = "sheared flow, liner 150 mm; one fit leaves the scale in (a), (b); line: (mean) truth"
    return finish(figure, path, words)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--draws", type=int, default=500)
    options = options_of(parser, arguments)
    rows = flows_and_lengths()
    solvers, lines = {}, {}
    for side in SIDES:
        setup = setup_of(side)
        solvers[side] = DuctSolver(setup.case, setup.frequency)
        lines[side] = setup.line_of(solvers[side].solve(setup.impedance))
    rows += ranks_and_orders(lines)
    rows += noise(lines, solvers, options.draws)
    rows += ends_and_gradients()
    keys = list(dict.fromkeys(key for each in rows for key in each))
    write_rows([{key: each.get(key) for key in keys} for each in rows], options.output / "kt_mismatch.csv")
    draw_truth(rows, options.output / "kt_truth.png")
    draw_length(rows, options.output / "kt_length.png")
    draw_choices(rows, options.output / "kt_choices.png")
    draw_ends(rows, options.output / "kt_ends.png")
    for flow in FLOWS:
        for method in METHODS:
            ends = [of(rows, f"length, {flow}", side, method)[1][LENGTHS.index(0.15)] for side in SIDES]
            print(f"{flow:16s} {method:10s} upstream {ends[0]:.3f} downstream {ends[1]:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
