"""Fit the slit's model where there is no flow, and see what it says where there is.

    python scripts/calibrate_resolved.py

Offset and vena contracta are fitted to the true impedances of n115 and n130 and predict g01_145 and
g03_145; the offset of the orifice is fitted to o115 and predicts o145. Two variants, the highest
plane and all planes, each in all averagings. Table, CSV and picture go to results/calibration.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torchliner as tl
from common import RESULTS, case_files, options_of, parser_of
from torchliner.io.csv_rows import write_rows
from torchliner.names import AVERAGINGS
from torchliner.report.of_fits import of_fit, parameter_table, prediction_table
from torchliner.report.planes import draw_predictions
from torchliner.studies.rows import Row

FOLDER = RESULTS / "calibration"
OFFSET = {"offset_resistance": (-0.2, 0.2), "offset_reactance": (0.0, 0.6)}
FREE = {"vena_contracta": (0.4, 1.0), **OFFSET}
# Wave decomposition and in-situ value of the same run differ by up to 0.0021 (n115, n130, o115).
NOISE = 0.002
# Scatter of the truth over blocks of the record (slit), difference of its two ways (orifice).
SCATTER = {"g01_145": 0.029 + 0.007j, "g03_145": 0.162 + 0.135j, "o145": 0.0075 + 0.0013j}
HIGHEST, ALL = "highest plane", "all planes"


def planes_of(case: str, variant: str) -> list[tl.VelocityPlane]:
    """Shipped planes of a case."""
    files = case_files(case)
    return [tl.read_plane(path) for path in (files if variant == ALL else files[-1:])]


def fitted(cases: Sequence[str], free: Any, variant: str, averaging: str) -> Any:
    """The calibration, and the liner as it was."""
    planes = [plane for case in cases for plane in planes_of(case, variant)]
    liner = tl.load_liner(planes[0].liner)
    # Planes of one run share one reference: used k times, it weighs as one with noise sqrt(k).
    noise = NOISE * (len(planes) / len(cases)) ** 0.5
    found = tl.calibrate(planes, liner, "true", free, averaging=averaging, noise=noise)
    return found, liner


def predicted(
    cases: Sequence[str], free: Any, targets: Sequence[str], variant: str, averaging: str
) -> tuple[Any, list[Row]]:
    """Calibration on ``cases`` and the rows of ``targets``."""
    found, liner = fitted(cases, free, variant, averaging)
    rows = []
    for target in targets:
        for plane in planes_of(target, variant):
            rows += [Row(row, label=target) for row in found.predict(plane, liner, noise=SCATTER[target])]
    return found, rows


def study(variant: str, averaging: str) -> tuple[list[Any], list[Row]]:
    """Slit and orifice."""
    slit, rows = predicted(("n115", "n130"), FREE, ("g01_145", "g03_145"), variant, averaging)
    orifice, more = predicted(("o115",), OFFSET, ("o145",), variant, averaging)
    return [slit, orifice], rows + more


def draw(panels: dict[str, list[Row]], path: Path) -> None:
    """Averagings side by side."""
    draw_predictions(panels, "fitted without flow (n115, n130; o115), 1400 Hz, y = 2.5 mm", path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Everything, printed and written."""
    parser = parser_of(__doc__)
    options_of(parser, arguments)
    FOLDER.mkdir(parents=True, exist_ok=True)
    parameters: list[dict[str, Any]] = []
    predictions: list[dict[str, Any]] = []
    panels = {}
    for variant in (HIGHEST, ALL):
        for averaging in AVERAGINGS:
            fits, rows = study(variant, averaging)
            about = {"variant": variant, "averaging": averaging}
            print(f"\n== {variant}, {averaging}")
            for name, found in zip(("slit", "orifice"), fits, strict=True):
                print(of_fit([found]).screen(verbose=True))
                parameters += [{**about, "fit": name, **row} for row in parameter_table(found).as_rows()]
            shown = [Row(row, label=f"{row.label} {1e3 * (row.height or 0):.1f} mm") for row in rows]
            print(prediction_table(shown).as_text())
            predictions += [{**about, **row} for row in prediction_table(rows).as_rows()]
            if variant == HIGHEST:
                panels[averaging] = rows
    write_rows(parameters, FOLDER / "parameters.csv")
    write_rows(predictions, FOLDER / "predictions.csv")
    draw(panels, FOLDER / "predictions.png")
    print(f"\nNumbers and picture are in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
