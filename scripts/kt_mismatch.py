"""How much of the upstream-downstream mismatch Kumaresan and Tufts' method makes by itself.

    python scripts/kt_mismatch.py [-o FOLDER] [--check]

Wall pressures of a duct whose liner has ONE impedance, 2.33-0.30j, are computed by the linearised
Euler equations with the source upstream and downstream, and educed with uniform flow (Ingard-Myers)
as the paper does. What differs between the two sides is the method's own: figures 14 and 19 with a
known impedance, then over flow, liner length, rank, order, noise, end reflection and Z varying along x.
"""

import functools
import itertools
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import torchliner as tl
from common import run_study
from torchliner.duct.case import impedance_along
from torchliner.duct.presets import DuctSetup
from torchliner.pressure.microphone_errors import MicrophoneErrors
from torchliner.report import figure as fig
from torchliner.studies.variants import Row

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
RISE = "relative rise of R along x"
ACROSS = {"end reflection": "end reflection", RISE: r"$\Delta R/R$ along $x$"}
RANKS, DRAWS, DASHES = (1, 2, 3, 4), 500, ("-", "--", ":", "-.")
ANECHOIC = "LEE fit, end taken as anechoic"
DARK = dict(zip(SIDES, fig.COLOURS, strict=False))


def world(side: str, length: float = 0.15, **changes: Any) -> tuple[DuctSetup, tl.DuctSolver, tl.MicrophoneLine]:
    """The B2A preset with another liner, its solver, and its field at microphones over the liner alone."""
    x = STEP / 2 + STEP * np.arange(round((length - STEP / 2 - STEP / 2) / STEP) + 1)
    about = {"liner": [(0.0, length)], "start": -BEYOND, "end": length + BEYOND, "x": x}
    setup = tl.load_duct("b2a", source_side=side, **about, **changes)
    solver = tl.DuctSolver(setup.case, setup.frequency)
    return setup, solver, setup.line_of(solver.solve(setup.impedance))


def row(study: str, value: Any, side: str, method: str, z: Any, spread: complex | None = None) -> Row:
    """One educed impedance; ``spread``: standard deviation of draws."""
    return Row(study=study, value=value, source=side, method=method, impedance=complex(z), spread=spread)


def all_methods(study: str, value: Any, side: str, line: tl.MicrophoneLine, solver: tl.DuctSolver) -> list[Row]:
    """KT of rank 2, the two-wave fit and the fit of the field."""
    found = (tl.kumaresan_tufts(line), tl.two_wave_fit(line), tl.fit_field(line, solver))
    return [row(study, value, side, name, one.impedance[0]) for name, one in zip(METHODS, found, strict=True)]


def flows_and_lengths() -> list[Row]:
    """Three flows over the liner's length."""
    rows = []
    for flow, changes in FLOWS.items():
        for length, side in itertools.product(LENGTHS, SIDES):
            _, solver, line = world(side, length, **changes)
            rows += all_methods(f"length, {flow}", length, side, line, solver)
        print(f"{flow}: done", flush=True)
    return rows


def ranks_and_noise() -> list[Row]:
    """KT's two arguments without noise; mean and standard deviation over draws of the microphones' errors."""
    rows = []
    for side in SIDES:
        _, solver, line = world(side)
        for rank in RANKS:
            for order in range(max(rank, 2), line.microphones // 2 + 1):
                z = tl.kumaresan_tufts(line, rank=rank, order=order).impedance[0]
                rows.append(row(f"rank {rank}", order, side, "KT", z))
        for error in ERRORS:
            errors: Any = {"level_error": error, "phase_error": error}
            # As stated: draws= would raise them to what the residual of the model shows.
            noisy = replace(line, pressure=MicrophoneErrors(draws=DRAWS, **errors).drawn(line.pressure))
            found = {"KT": tl.kumaresan_tufts(noisy).impedance, "two waves": tl.two_wave_fit(noisy).impedance}
            if error == 0.1:
                found["LEE fit"] = tl.fit_field(line, solver, draws=DRAWS, **errors).drawn
            for method, values in found.items():
                drawn = values[:, 0]
                spread = complex(drawn.real.std(), drawn.imag.std())
                rows.append(row("noise", error, side, method, drawn.mean(), spread))
    return rows


def ends_and_gradients() -> list[Row]:
    """Reflections of the far end, as they are and unknown to the fit; Z varying along x."""
    rows = []
    for side in SIDES:
        anechoic, blind, _ = world(side)
        for size in (0.0, 0.05, 0.1, 0.2, 0.3):
            _, _, line = world(side, end_reflection=(size, 0.0))
            rows += all_methods("end reflection", size, side, line, blind)
            z = tl.fit_field(line, blind, far_end="stated").impedance[0]
            rows.append(row("end reflection", size, side, ANECHOIC, z))
        for rise in (-0.5, -0.25, 0.0, 0.25, 0.5):
            along = impedance_along([0.0, 0.15], TRUE + np.array([-0.5, 0.5]) * rise * TRUE.real)
            rows += all_methods(RISE, rise, side, anechoic.line_of(blind.solve(along)), blind)
    return rows


def of(rows: Sequence[Row], study: str, side: str, method: str) -> list[Row]:
    """Of one curve."""
    return [r for r in rows if (r.study, r.source, r.method) == (study, side, method)]


def draw(rows: Sequence[Row], path: Path) -> None:
    """Three pictures."""
    for picture in (draw_length, draw_choices, draw_ends):
        picture(rows, path.with_name(f"kt_{picture.__name__.removeprefix('draw_')}.png"))


def draw_length(rows: Sequence[Row], path: Path) -> fig.Figure:
    """Mismatch of resistance and reactance over the liner's length."""
    curves = []
    for (i, flow), (j, method) in itertools.product(enumerate(FLOWS), enumerate(METHODS)):
        if method != "LEE fit" or flow == "sheared":
            pairs = zip(*(of(rows, f"length, {flow}", side, method) for side in SIDES), strict=True)
            gaps = [Row(x=up["value"], impedance=down.impedance - up.impedance) for up, down in pairs]
            look: Any = {"marker": fig.MARKERS[i], "markersize": 3, "linestyle": DASHES[j]}
            curves.append(fig.curve_of(gaps, "x", **fig.colour_of(i, "", **look)))
            curves[-1]["label"] = f"{FLOW_WORDS.get(flow, flow)}; {method}"
    paper = {"paper, 150 mm": PAPER["downstream"] - PAPER["upstream"]}
    more: Any = {"more": lambda axis, part: axis.set_ylabel(f"{part}, downstream less upstream")}
    return fig.draw_parts(curves, "liner length (mm)", path, references=paper, poles=None, height=3.2, legend=3, **more)


@fig.styled
def draw_choices(rows: Sequence[Row], path: Path) -> fig.Figure:
    """KT's rank and order, and the noise: lines and filled markers for the source upstream."""
    figure, axes = fig.subplots(2, 2, 5.0)
    above, below = [], []
    for side, dash, face in (("upstream", "-", None), ("downstream", "--", "none")):
        for i, rank in enumerate(RANKS):
            look: Any = {"color": fig.COLOURS[rank], "marker": fig.MARKERS[rank], "markersize": 3, "linestyle": dash}
            look |= {"label": f"KT, rank {rank}; {side}"} | ({} if face is None else {"markerfacecolor": face})
            above.append(fig.curve_of(of(rows, f"rank {rank}", side, "KT"), "value", **look))
            if i == 1:
                ranks = look
        for k, (method, look) in enumerate((("KT", ranks), ("two waves", ranks | {"color": "k", "marker": "o"}))):
            mine = of(rows, "noise", side, method)
            ends = [[row.impedance + sign * row.spread for row in mine] for sign in (-1, 1)]
            curve = fig.curve_of(mine, "value", **look) | {"ends": ends, "bars": True}
            below.append(curve | {"x": curve["x"] * (1 + 0.06 * k), "label": f"{method}; {side}"})
    known = {"known Z": TRUE}
    fig.draw_parts(above, "order of the prediction", references=known, poles=None, axes=axes[0])
    fig.draw_parts(below, "error of the microphones (dB, degrees)", references=known, poles=None, axes=axes[1])
    for column, limits in enumerate(((1.5, 3.0), (-1.8, 0.6))):
        axes[0, column].set_ylim(*limits)
        axes[1, column].set_xscale("log")
        axes[1, column].set_xticks(ERRORS, [f"{error:g}" for error in ERRORS])
        axes[1, column].minorticks_off()
    fig.legend_below(figure, axes[:, 0], 3)
    return fig.finish(figure, path, "sheared flow, liner 150 mm")


@fig.styled
def draw_ends(rows: Sequence[Row], path: Path) -> fig.Figure:
    """End reflection and Z varying along x."""
    figure, axes = fig.subplots(2, 2, 4.8)
    for panels, (study, words) in zip(axes, ACROSS.items(), strict=True):
        curves = []
        for (i, method), side in itertools.product(enumerate((*METHODS, ANECHOIC)), SIDES):
            how: Any = {"linestyle": DASHES[i], "color": DARK[side], "marker": fig.MARKERS[i], "markersize": 3}
            if mine := of(rows, study, side, method):
                curves.append(fig.curve_of(mine, "value", label=f"{method}, {side}", **how))
        fig.draw_parts(curves, words, references={"known Z": TRUE}, poles=None, axes=panels)
    axes[0, 0].set_ylim(0.5, 3.5)
    axes[0, 1].set_ylim(-1.5, 0.5)
    fig.legend_below(figure, axes[0, 0], 2)
    return fig.finish(figure, path, "sheared flow, liner 150 mm; one fit leaves the scale in (a), (b)")


STUDIES = (flows_and_lengths, ranks_and_noise, ends_and_gradients)
main = functools.partial(run_study, __doc__, "kt_mismatch", lambda: [row for rows in STUDIES for row in rows()], draw)


if __name__ == "__main__":
    sys.exit(main())
