"""Fit the slit's model where there is no flow, and see what it says where there is.

    python scripts/calibrate_resolved.py [-o FOLDER] [--check]

Offset and contraction coefficient are fitted to the reference impedances of n115 and n130 and predict g01_145 and
g03_145; the offset of the orifice is fitted to o115 and predicts o145: at the highest plane, in all averagings.
"""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path

import torchliner as tl
from common import case_files, run_study
from torchliner.names import AVERAGINGS
from torchliner.report.studies import draw_predictions
from torchliner.studies.variants import Row

OFFSET = {"offset_resistance": (-0.2, 0.2), "offset_reactance": (0.0, 0.6)}
FREE = {"vena_contracta": (0.4, 1.0), **OFFSET}
FITS = ((("n115", "n130"), FREE, ("g01_145", "g03_145")), (("o115",), OFFSET, ("o145",)))
NOISE = 0.002  # wave decomposition and in situ value of the same run differ by up to 0.0021 (n115, n130, o115)
# Scatter of the reference over blocks of the record (slit), difference of its two ways (orifice).
SCATTER = {"g01_145": 0.029 + 0.007j, "g03_145": 0.162 + 0.135j, "o145": 0.0075 + 0.0013j}


def rows_of() -> list[Row]:
    """Predictions of every averaging."""
    rows = []
    for averaging in AVERAGINGS:
        for cases, free, targets in FITS:
            planes = {case: tl.read_plane(case_files(case)[-1]) for case in (*cases, *targets)}
            liner = tl.load_liner(planes[cases[0]].liner)
            fitted = [planes[case] for case in cases]
            found = tl.calibrate(fitted, liner, "true", free, averaging=averaging, noise=NOISE)
            for target in targets:
                (row,) = found.predict(planes[target], noise=SCATTER[target])
                rows.append(Row(row, averaging=averaging, label=target))
    return rows


def draw(rows: Sequence[Row], path: Path) -> None:
    """A line a prediction."""
    labelled = [Row(row, label=f"{row.label}, {row.averaging}") for row in rows]
    draw_predictions(labelled, "fitted without flow (n115, n130; o115), 1400 Hz", path)


main = functools.partial(run_study, __doc__, "calibration_resolved", rows_of, draw)


if __name__ == "__main__":
    sys.exit(main())
