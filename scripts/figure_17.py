"""Figure 17 of the paper on the resolved cases: Z along x at all heights, in situ values in black.

    python scripts/figure_17.py [FOLDER]

The cases are not the paper's LES (docs/in_situ.md): two-dimensional slits under a flow, where
vortices do not decay, and an orifice without flow.
"""

from __future__ import annotations

from pathlib import Path

from common import DATA, RESULTS, case_files, options_of, parser_of
from torchliner.in_situ_method.dean import in_situ
from torchliner.io.planes import read_plane
from torchliner.io.pressure_file import read_pressure
from torchliner.liners.catalogue import load_liner
from torchliner.report.figures import draw_along_x
from torchliner.report.numbers import impedance_along_x
from torchliner.tdibc.educe import educe

FOLDER = RESULTS / "figure_17"
CASES = ("g01_145", "g03_145", "o145")


def draw_case(case: str, folder: Path) -> None:
    """PNG, a CSV for each height, and one of the in situ points and cells."""
    planes = [read_plane(path) for path in case_files(case)]
    beside = in_situ(read_pressure(DATA / f"pressure_{case}.h5"))
    maps = [found.with_alongside(beside) for found in educe(planes, load_liner(planes[0].liner))]
    draw_along_x(maps, folder / f"figure_17_{case}.png")
    for found in maps:
        height = 1e3 * (found.height or 0.0)
        impedance_along_x(found).write_csv(folder / f"figure_17_{case}_y{height:.1f}mm.csv")
    beside.write(folder / f"figure_17_{case}_in_situ.csv")


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("output", metavar="FOLDER", nargs="?", type=Path, default=FOLDER)
    folder = options_of(parser).output
    for case in CASES:
        draw_case(case, folder)
    print(f"pictures and numbers are in {folder}")


if __name__ == "__main__":
    main()
