"""Figure 3 of the paper: linear impedance of the ONERA and PoliTo samples, eq. (2.2).

python scripts/figure_03.py [FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from torchliner.liners.catalogue import load_liner
from torchliner.report.figures import draw_liner
from torchliner.report.numbers import impedance_over_band

ROOT = Path(__file__).resolve().parent.parent
SAMPLES = {"onera": "ONERA", "polito": "PoliTo"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    default = ROOT / "results" / "figure_03"
    parser.add_argument("folder", nargs="?", type=Path, default=default)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    curves = [impedance_over_band(load_liner(name), label=label) for name, label in SAMPLES.items()]
    draw_liner(curves, "linear impedance", folder / "figure_03.png")
    for name, curve in zip(SAMPLES, curves, strict=True):
        curve.write_csv(folder / f"figure_03_{name}.csv")
    print(f"picture and numbers are in {folder}")


if __name__ == "__main__":
    main()
