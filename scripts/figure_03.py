"""Figure 3 of the paper: linear impedance of the ONERA and PoliTo samples, eq. (2.2).

python scripts/figure_03.py [FOLDER]
"""

from __future__ import annotations

from pathlib import Path

from common import RESULTS, options_of, parser_of
from torchliner.liners.catalogue import load_liner
from torchliner.report.figures import draw_liner
from torchliner.report.numbers import impedance_over_band

FOLDER = RESULTS / "figure_03"
SAMPLES = {"onera": "ONERA", "polito": "PoliTo"}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("output", metavar="FOLDER", nargs="?", type=Path, default=FOLDER)
    folder = options_of(parser).output
    curves = [impedance_over_band(load_liner(name), label=label) for name, label in SAMPLES.items()]
    draw_liner(curves, "linear impedance", folder / "figure_03.png")
    for name, curve in zip(SAMPLES, curves, strict=True):
        curve.write_csv(folder / f"figure_03_{name}.csv")
    print(f"picture and numbers are in {folder}")


if __name__ == "__main__":
    main()
