"""Figure 16: rms of v and u along x at all heights, for the shipped cases with flow.

python scripts/figure_16.py [-o FOLDER]

The resolved slits g01 and g03 stand in for the paper's simulation; the channel has no liner at all.
"""

from __future__ import annotations

from collections.abc import Sequence

from common import RESULTS, options_of, parser_of, plane_files
from studies.rms_figures import draw_rms_along_x
from torchliner.io.planes import read_plane
from torchliner.liners.catalogue import load_liner
from torchliner.records import VelocityPlane
from torchliner.report.numbers import velocity_along_x

CASES = (
    ("slit_g01_145", "slit, Mach 0.1, 145 dB"),
    ("slit_g03_145", "slit, Mach 0.3, 145 dB"),
    ("channel", "no liner: hard wall\n(0.52, 1.04, 2.44 mm)"),
)


def pitch_below(plane: VelocityPlane) -> float | None:
    """Cell pitch of the liner below a plane, m."""
    return None if plane.liner == "hard wall" else load_liner(plane.liner).cell_pitch


def main(arguments: Sequence[str] | None = None) -> None:
    folder = options_of(parser_of(__doc__, RESULTS / "figure_16"), arguments).output
    cases = []
    for name, title in CASES:
        paths = plane_files(f"{name}_y*.h5")
        planes = [read_plane(path, lazy=True) for path in paths]
        for path, plane in zip(paths, planes, strict=True):
            velocity_along_x(plane).write_csv(folder / f"figure_16_{path.stem}.csv")
        cases.append((title, planes, pitch_below(planes[0])))
    draw_rms_along_x(cases, folder / "figure_16.png")
    print(f"figure and numbers are in {folder}")


if __name__ == "__main__":
    main()
