"""One law of lost mass for all resolved cases: the numbers and the picture of the page of that name.

    python scripts/mass_loss.py [-o FOLDER] [--check]

The contraction coefficient of each model is fitted to its resistance without flow, as in ``calibrate_without_flow.py``;
here the reactance alone is fitted, at y = 0.5 mm, with coefficients shared by slit and orifice. Every law is judged on
cases that it was not fitted to. Printed besides: fits to parts of the cases, other averagings and heights, and what the
wave alone gives.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import torchliner as tl
from calibrate_without_flow import FITS, RULE, calibrated, planes_of
from common import run_study
from torchliner.liners.sdof import EndLossSDoFLiner
from torchliner.names import AVERAGINGS
from torchliner.report.figure import COLOURS, MARKERS, Figure, finish, styled, subplots
from torchliner.studies.variants import Row

CASES = tuple(case for fit in FITS for case in (*fit.fitted, *fit.predicted))
FLOW = tuple(case for case in CASES if case[0] == "g" or case.startswith(("t03", "t015")))
SLITS = tuple(case for case in CASES if case[0] in "ng")
REACTANCE_ALONE = 1e3 + 0.05j  # standard uncertainty of R and X: R has no say
B, K, A = {"loss_displacement": (0.01, 10.0)}, {"mach_loss": (0.0, 3.0)}, {"end_loss": (0.0, 1.0)}
WITHIN = 0.1  # in X, that a law is asked for


@dataclass(frozen=True)
class Law:
    """A law of lost mass.

    Args:
        name: in tables.  free: bounds by name.  fixed: other parameters.
        width: whether a slit's length is its width, not its hydraulic diameter.
        goodrich: whether flow leaves 1/(1 + 305 M^3) of the ends (Rice & Heidelberg), in place of k M.
    """

    name: str
    free: Mapping[str, tuple[float, float]]
    fixed: Mapping[str, Any]
    width: bool = False
    goodrich: bool = False


LAWS = (
    Law("eq. (2.4b) of the paper", {}, {}),
    Law("in |v|: A, B", A | B, {"mach_loss": 0.0}),
    Law("in M: k", K, {"end_loss": 0.0}),
    Law("both, p = 2: B, k; A = 1/2", B | K, {}),
    Law("the same, p = 1", B | K, {"combination": 1.0}),
    Law("the same, p = 4", B | K, {"combination": 4.0}),
    Law("the same, p = 2, A free", A | B | K, {}),
    Law("the same, A = 1/2, width of the slit for D_h", B | K, {}, width=True),
    Law("the same, Goodrich's ends for k M", B, {}, goodrich=True),
)
CHOSEN = LAWS[3]
PARTS = {
    "all nine": CASES,
    "the slits": SLITS,
    "the orifices": [case for case in CASES if case not in SLITS],
    "no flow, and t03_130": [*(case for case in CASES if case not in FLOW), "t03_130"],
    "no flow, and g01_145": [*(case for case in CASES if case not in FLOW), "g01_145"],
}
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


def liner_of(case: str, law: Law) -> tl.SDoFLiner:
    """The law's liner of a case, before a fit."""
    base, mach = base_liners()[case], known_planes(case)[0].mach or 0.0
    if law is LAWS[0]:
        return base
    diameter = base.orifice_diameter * (2 if case in SLITS and not law.width else 1)
    flow = {"mach_loss": 305 * mach**2 / (1 + 305 * mach**3)} if law.goodrich else {}
    return EndLossSDoFLiner.of(base, hydraulic_diameter=diameter, **law.fixed, **flow)


def fitted(law: Law, cases: Sequence[str], averaging: str = RULE) -> Any:
    """The calibration of a law by the reactance of some cases, 0.5 mm above the plate; None without a parameter."""
    if not law.free:
        return None
    known, liners = [moments_of(case, averaging) for case in cases], [liner_of(case, law) for case in cases]
    about: Any = {"averaging": averaging, "noise": REACTANCE_ALONE, "allow_short": True}
    return tl.calibrate(known, liners, "true", dict(law.free), **about)


def predicted(law: Law, found: Any, case: str, averaging: str = RULE, height: int = 0) -> complex:
    """Z of a case by what was fitted."""
    liner = liner_of(case, law) if found is None else liner_of(case, law).with_numbers(found.numbers)
    known = moments_of(case, averaging, height)
    educed = known.educe(liner, interval=None, averaging=averaging, allow_short=True)
    return complex(educed.liner[averaging].impedance[0])


def reference(case: str) -> complex:
    """Z of the run itself."""
    return complex(known_planes(case)[0].reference["true"])


def left_out(law: Law, averaging: str = RULE) -> list[Row]:
    """Every case by a fit to all others."""
    rows = []
    for case in CASES:
        fit = fitted(law, [other for other in CASES if other != case], averaging)
        z = predicted(law, fit, case, averaging)
        rows.append(Row(law=law.name, case=case, impedance=z, true=reference(case)))
    return rows


def off(rows: Sequence[Row]) -> str:
    """What X is off by."""
    away = np.array([row.impedance.imag - row.true.imag for row in rows])
    return f"X off by {abs(away).max():.2f} at most, {np.sqrt(np.mean(away**2)):.3f} rms"


def rows_of() -> list[Row]:
    """Each law, fitted to all cases but the one that is predicted; the rest is printed."""
    rows = [row for law in LAWS for row in left_out(law)]
    for law in LAWS:
        print(f"{law.name}: {off([row for row in rows if row.law == law.name])}")
    for averaging in list(AVERAGINGS)[:2]:
        print(f"{CHOSEN.name}, {averaging}: {off(left_out(CHOSEN, averaging))}")
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
    for case in (case for case in CASES if case not in FLOW):
        level, liners = known_planes(case)[0].incident_level, (liner_of(case, LAWS[0]), liner_of(case, CHOSEN))
        for name, liner in zip(("(2.4b)", "this law"), (liners[0], liners[1].with_numbers(fit.numbers)), strict=True):
            curve = tl.ir_tdibc(liner, [level], 1400.0, kernel="periodic")
            print(f"{case}, wave alone, {name}: {complex(curve.fixed_points[0][0].impedance[0]):.3f}")
    return rows


@styled
def draw(rows: Sequence[Row], path: Path) -> Figure:
    """Predicted against reference X, the band that is asked for in grey, each case named once."""
    figure, axes = subplots(1, 1, 3.6)
    axis, laws, ends = axes[0, 0], [LAWS[0].name, LAWS[1].name, CHOSEN.name], np.array([-0.95, 0.0])
    axis.fill_between(ends, ends - WITHIN, ends + WITHIN, color="0.92", label=f"within {WITHIN:g}")
    axis.plot(ends, ends, color="k", linewidth=0.8, label="equal")
    for k, law in enumerate(laws):
        mine = [row for row in rows if row.law == law]
        face = COLOURS[k] if law == CHOSEN.name else "white"
        style: Any = {"color": COLOURS[k], "markerfacecolor": face, "markersize": 4.5, "label": law}
        axis.plot([row.true.imag for row in mine], [row.impedance.imag for row in mine], MARKERS[k], **style)
    named = sorted((row for row in rows if row.law == CHOSEN.name), key=lambda row: row.true.imag)
    for i, row in enumerate(named):
        place = (row.true.imag, ends[0] + 0.02 + 0.055 * (i % 3))
        top = max(one.impedance.imag for one in rows if one.case == row.case and one.law in laws)
        axis.plot([row.true.imag] * 2, [place[1] + 0.03, top], color="0.8", linewidth=0.5, zorder=0)
        box: Any = {"color": "w", "alpha": 0.7, "linewidth": 0, "pad": 0.5}
        axis.annotate(row.case, place, fontsize=7, ha="center", color="0.3", bbox=box)
    axis.set(xlabel=r"reference reactance, $\mathrm{Im}\,Z$", ylabel=r"$\mathrm{Im}\,Z$ of a fit without the case")
    axis.set(xlim=ends, ylim=ends)
    return finish(figure, path, legend=3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, leave out, print, draw."""
    return run_study(__doc__, "mass_loss", rows_of, draw, arguments)


if __name__ == "__main__":
    sys.exit(main())
