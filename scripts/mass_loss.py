"""One law of lost mass for all resolved cases: the numbers and the picture of the page of that name.

    python scripts/mass_loss.py [-o FOLDER] [--check]

The contraction coefficient of each model is fitted to its resistance without flow, as in ``calibrate_without_flow.py``;
here the reactance alone is fitted, at y = 0.5 mm, with coefficients shared by slit and orifice. Every law is judged on
cases that it was not fitted to. Printed besides: fits to parts of the cases, other averagings and heights, and what the
wave alone gives.
"""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import torchliner as tl
from calibrate_without_flow import FITS, RULE, calibrated
from common import planes_of, run_study
from oracles.periodic_wall import fixed_impedance
from torchliner.liners.sdof import EndLossSDoFLiner
from torchliner.names import AVERAGINGS
from torchliner.report.figure import COLOURS, MARKERS, Figure, finish, panels_of, styled
from torchliner.studies.variants import Row

CASES = tuple(case for fit in FITS for case in (*fit.fitted, *fit.predicted))
FLOW = tuple(case for case in CASES if case[0] == "g" or case.startswith(("t03", "t015")))
STILL = tuple(case for case in CASES if case not in FLOW)
SLITS = tuple(case for case in CASES if case[0] in "ng")
REACTANCE_ALONE = 1e3 + 0.05j  # standard uncertainty of R and X: R has no say
B, K, A = {"loss_displacement": (0.01, 10.0)}, {"mach_loss": (0.0, 3.0)}, {"end_loss": (0.0, 1.0)}
PAPER, CHOSEN = "eq. (2.4b) of the paper", "both, p = 2: B, k; A = 1/2"
WIDTH = "the same, A = 1/2, width of the slit for D_h"  # not the hydraulic diameter, twice as much
GOODRICH = "the same, Goodrich's ends for k M"  # of which flow leaves 1/(1 + 305 M^3) (Rice & Heidelberg)
LAWS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # bounds of what is free, and other parameters
    PAPER: ({}, {}),
    "in |v|: A, B": (A | B, {"mach_loss": 0.0}),
    "in M: k": (K, {"end_loss": 0.0}),
    CHOSEN: (B | K, {}),
    "the same, p = 1": (B | K, {"combination": 1.0}),
    "the same, p = 4": (B | K, {"combination": 4.0}),
    "the same, p = 2, A free": (A | B | K, {}),
    WIDTH: (B | K, {}),
    GOODRICH: (B, {}),
}
PARTS = {
    "all nine": CASES,
    "the slits": SLITS,
    "the orifices": tuple(case for case in CASES if case not in SLITS),
    "no flow, and t03_130": (*STILL, "t03_130"),
    "no flow, and g01_145": (*STILL, "g01_145"),
}
WITHIN = 0.1  # in X, that a law is asked for
known_planes = functools.cache(planes_of)


@functools.cache
def base_liners() -> dict[str, tl.SDoFLiner]:
    """By case: the preset with the contraction coefficient of a case without flow."""
    return {case: liner for fit in FITS for liner in (calibrated(fit).liner,) for case in (*fit.fitted, *fit.predicted)}


@functools.cache
def moments_of(case: str, averaging: str, height: int = 0) -> tl.Moments:
    """Of a case at one of its heights, the lowest first."""
    pitch = base_liners()[case].cell_pitch
    return tl.moments(known_planes(case)[height], averaging=averaging, cell_pitch=pitch, allow_short=True)


def liner_of(case: str, law: str) -> tl.SDoFLiner:
    """The law's liner of a case, before a fit."""
    base, mach = base_liners()[case], known_planes(case)[0].mach or 0.0
    if law == PAPER:
        return base
    diameter = base.orifice_diameter * (2 if case in SLITS and law != WIDTH else 1)
    flow = {"mach_loss": 305 * mach**2 / (1 + 305 * mach**3)} if law == GOODRICH else {}
    return EndLossSDoFLiner.of(base, hydraulic_diameter=diameter, **LAWS[law][1], **flow)


def fitted(law: str, cases: Sequence[str], averaging: str = RULE) -> Any:
    """The calibration of a law by the reactance of some cases, 0.5 mm above the plate; None without a parameter."""
    if not LAWS[law][0]:
        return None
    known, liners = [moments_of(case, averaging) for case in cases], [liner_of(case, law) for case in cases]
    about: Any = {"averaging": averaging, "noise": REACTANCE_ALONE, "allow_short": True}
    return tl.calibrate(known, liners, "true", LAWS[law][0], **about)


def predicted(law: str, found: Any, case: str, averaging: str = RULE, height: int = 0) -> complex:
    """Z of a case by what was fitted."""
    liner = liner_of(case, law) if found is None else liner_of(case, law).with_numbers(found.numbers)
    known = moments_of(case, averaging, height)
    educed = known.educe(liner, interval=None, averaging=averaging, allow_short=True)
    return complex(educed.liner[averaging].impedance[0])


def reference(case: str) -> complex:
    """Z of the run itself."""
    return complex(known_planes(case)[0].reference["true"])


def left_out(law: str, averaging: str = RULE) -> list[Row]:
    """Every case by a fit to all others; what X is off by is printed."""
    rows = []
    for case in CASES:
        fit = fitted(law, [other for other in CASES if other != case], averaging)
        rows.append(Row(law=law, case=case, impedance=predicted(law, fit, case, averaging), true=reference(case)))
    away = np.array([row.impedance.imag - row.true.imag for row in rows])
    off = f"X off by {abs(away).max():.2f} at most, {np.sqrt(np.mean(away**2)):.3f} rms"
    print(f"{law}{'' if averaging == RULE else f', {averaging}'}: {off}")
    return rows


def rows_of() -> list[Row]:
    """Each law, fitted to all cases but the one that is predicted; the rest is printed."""
    rows = [row for law in LAWS for row in left_out(law)]
    for averaging in list(AVERAGINGS)[:2]:
        left_out(CHOSEN, averaging)
    for name, cases in PARTS.items():
        fit, others = fitted(CHOSEN, cases), [case for case in CASES if case not in cases]
        away = [abs(predicted(CHOSEN, fit, case).imag - reference(case).imag) for case in others]
        values = ", ".join(f"{v:.2f} +- {s:.2f}" for v, s in zip(fit.values, fit.standard, strict=True))
        print(f"fitted to {name}: B, k {values}; X of the others off by {max(away, default=0):.2f} at most")
    fit = fitted(CHOSEN, CASES)
    for case in FLOW:
        diameter = float(liner_of(case, CHOSEN).numbers()["hydraulic_diameter"].value)
        for i, plane in enumerate(known_planes(case)):
            z, true = predicted(CHOSEN, fit, case, height=i), reference(case)
            place = f"{1e3 * (plane.height or 0):g} mm, {(plane.height or 0) / diameter:.2f} D_h"
            print(f"{case}, {place}: R {100 * (z.real / true.real - 1):+.0f} %, X {z.imag - true.imag:+.2f}")
    for case in STILL:
        own = {"(2.4b)": liner_of(case, PAPER), "this law": liner_of(case, CHOSEN).with_numbers(fit.numbers)}
        for name, liner in own.items():
            level = float(known_planes(case)[0].incident_level or 0)
            print(f"{case}, wave alone, {name}: {fixed_impedance(liner, level, 1400.0):.3f}")
    return rows


@styled
def draw(rows: Sequence[Row], path: Path) -> Figure:
    """Predicted against reference X, the band that is asked for in grey, each case named once."""
    figure, (axis,) = panels_of(1, 3.6)
    laws, ends = [PAPER, "in |v|: A, B", CHOSEN], np.array([-0.95, 0.0])
    axis.fill_between(ends, ends - WITHIN, ends + WITHIN, color="0.92", label=f"within {WITHIN:g}")
    axis.plot(ends, ends, color="k", linewidth=0.8, label="equal")
    for k, law in enumerate(laws):
        mine = [row for row in rows if row.law == law]
        face = COLOURS[k] if law == CHOSEN else "white"
        style: Any = {"color": COLOURS[k], "markerfacecolor": face, "markersize": 4.5, "label": law}
        axis.plot([row.true.imag for row in mine], [row.impedance.imag for row in mine], MARKERS[k], **style)
    named = sorted((row for row in rows if row.law == CHOSEN), key=lambda row: row.true.imag)
    for i, row in enumerate(named):
        place = (row.true.imag, ends[0] + 0.02 + 0.055 * (i % 3))
        top = max(one.impedance.imag for one in rows if one.case == row.case and one.law in laws)
        axis.plot([row.true.imag] * 2, [place[1] + 0.03, top], color="0.8", linewidth=0.5, zorder=0)
        box: Any = {"color": "w", "alpha": 0.7, "linewidth": 0, "pad": 0.5}
        axis.annotate(row.case, place, fontsize=7, ha="center", color="0.3", bbox=box)
    axis.set(xlabel=r"reference reactance, $\mathrm{Im}\,Z$", ylabel=r"$\mathrm{Im}\,Z$ of a fit without the case")
    axis.set(xlim=ends, ylim=ends)
    return finish(figure, path, legend=3)


main = functools.partial(run_study, __doc__, "mass_loss", rows_of, draw)


if __name__ == "__main__":
    sys.exit(main())
