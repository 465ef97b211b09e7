"""Calibrate without flow, predict with flow: the numbers and the picture of the page of that name.

    python scripts/calibrate_without_flow.py [-o FOLDER] [--check]

The contraction coefficient alone is fitted, to the resistance of cases without flow at the lowest height (their
reactance counts with the error of the model); the linear part is that of each preset, a run at 115 dB on the same
lattice. Then every case is predicted in every averaging at every height.
"""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torchliner as tl
from common import planes_of, run_study
from torchliner.names import AVERAGINGS
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, part_of, styled, subplots
from torchliner.studies.variants import Row

NOISE = 0.002 + 0.1j  # two ways of measuring one case differ by 0.002; X is the model's error
FREE = {"vena_contracta": (0.2, 1.0)}
RULE = "phase-locked"


class Fit(NamedTuple):
    """Cases without flow that one contraction coefficient is fitted to, and those it predicts."""

    name: str
    fitted: tuple[str, ...]
    predicted: tuple[str, ...]


FITS = (
    Fit("orifice", ("o130",), ("o145",)),
    Fit("orifice, coarser lattice", ("t00_130",), ("t03_130", "t015_145")),
    Fit("slit", ("n130",), ("n145", "g01_145", "g03_145")),
)


def calibrated(fit: Fit) -> Any:
    """The calibration at the lowest height, in the averaging whose predictions are asked for."""
    planes = [planes_of(case)[0] for case in fit.fitted]
    liner = tl.load_liner(planes[0].liner)
    return tl.calibrate(planes, liner, "true", FREE, averaging=RULE, noise=NOISE, allow_short=True)


def rows_of(fit: Fit) -> list[Row]:
    """Every case of a fit, averaging and height, before and after."""
    rows, found = [], calibrated(fit)
    print(f"{fit.name}: {float(found.values[0]):.3f} +- {float(found.standard[0]):.3f}")
    for case in (*fit.fitted, *fit.predicted):
        for plane in planes_of(case):
            liners = tl.load_liner(plane.liner), found.liner
            before, after = (tl.educe(plane, liner, interval=None, allow_short=True) for liner in liners)
            check = after.level_check
            for i, name in enumerate(after.averagings):
                level = float("nan") if check is None else float(check.liner.level[i, 0])
                row = Row(model=fit.name, case=case, averaging=name, fitted=int(case in fit.fitted))
                row |= {"height": plane.height or 0.0, "level_check": level}
                row |= {"before": complex(before.liner[name].impedance[0])}
                row |= {"after": complex(after.liner[name].impedance[0]), "true": complex(plane.reference["true"])}
                rows.append(row)
    return rows


@styled
def draw(rows: Sequence[Row], path: Path) -> Figure:
    """R and X by case: the reference as a bar, a column an averaging, its heights from left to right."""
    cases = list(dict.fromkeys(row.case for row in rows))
    figure, axes = subplots(1, 2, 3.4)
    for axis, (part, label) in zip(axes[0], PARTS, strict=True):
        for i, case in enumerate(cases):
            mine = [row for row in rows if row.case == case]
            axis.hlines(part_of(mine[0].true, part), i - 0.4, i + 0.4, color="k", linewidth=1.6)
            if mine[0].fitted:
                axis.axvspan(i - 0.5, i + 0.5, color="0.93", zorder=0)
            for k, averaging in enumerate(AVERAGINGS):
                shown = sorted((row for row in mine if row.averaging == averaging), key=lambda r: r.height)
                places = [i + 0.27 * (k - 1) + 0.05 * j for j in range(len(shown))]
                style: Any = {"color": COLOURS[k], "markersize": 3.6, "linewidth": 0.7, "markerfacecolor": "white"}
                axis.plot(places, [part_of(row.after, part) for row in shown], MARKERS[k] + "-", **style)
        axis.set_xticks(range(len(cases)), cases, rotation=40, ha="right")
        axis.set_ylabel(label)
    first = axes[0, 0]
    first.set_yscale("log")
    first.yaxis.set_major_formatter("{x:g}")
    for k, averaging in enumerate(AVERAGINGS):
        first.plot([], [], MARKERS[k] + "-", color=COLOURS[k], markerfacecolor="white", label=averaging)
    first.plot([], [], color="k", linewidth=1.6, label="reference")
    first.fill_between([], [], color="0.93", label="fitted")
    return finish(figure, path, "contraction coefficient fitted without flow; heights rise to the right, 1400 Hz", 5)


main = functools.partial(
    run_study, __doc__, "calibrate_without_flow", lambda: [row for fit in FITS for row in rows_of(fit)], draw
)


if __name__ == "__main__":
    sys.exit(main())
