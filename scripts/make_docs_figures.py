"""The pictures of README.md and docs/, drawn from the shipped data into docs/figures.

python scripts/make_docs_figures.py
"""

from matplotlib.patches import Circle

import b2a_line
import figure_13
import figure_14
import figure_20
import frequencies_page
import kt_mismatch
import ldv_interpolation
import side_by_side
import torchliner as tl
import validation_page
from common import DATA, FIGURES, options_of, parser_of, plane_files
from torchliner.cli.main import main as torchliner
from torchliner.report.curves import draw_along_x
from torchliner.report.maps import draw_map


def maps_of(case: str) -> list[tl.ImpedanceMap]:
    """Of all heights, the lowest first."""
    planes = [tl.read_plane(path) for path in plane_files(f"{case}_y*.h5")]
    return [tl.educe(plane, tl.load_liner(plane.liner)) for plane in planes]


def main() -> None:
    options_of(parser_of(__doc__))
    draw_along_x(maps_of("slit_n130"), FIGURES / "slit_n130_along_x.png")
    beside = tl.in_situ(tl.read_pressure(DATA / "pressure_g03_145.h5"))
    both = [found.with_alongside(beside) for found in maps_of("slit_g03_145")]
    draw_along_x(both, FIGURES / "slit_g03_145_in_situ.png")
    figure = draw_map(maps_of("orifice_o145")[1])
    for axis in figure.axes[:2]:
        axis.add_patch(Circle((2.214, 2.214), 0.6, fill=False, color="tab:orange"))  # the hole, mm
    figure.savefig(FIGURES / "orifice_o145_map.png")
    n130 = [str(DATA / f"slit_n130_y{height}mm.h5") for height in ("2.5", "1.0")]
    o145 = [str(DATA / f"orifice_o145_y{height}mm.h5") for height in ("2.5", "1.0", "0.5")]
    for words, picture in (
        (["insitu", str(DATA / "pressure_n130.h5"), "--figure"], "in_situ_n130.png"),
        (["height", *map(str, plane_files("slit_n130_y*.h5")), "--figure"], ""),
        (["audit", *n130, "--quiet", "--figure"], "audit_n130.png"),
        (["audit", *o145, "--quiet", "--figure"], "audit_o145.png"),
    ):
        torchliner([*words, str(FIGURES / picture)])
    studies = (figure_13, figure_14, figure_20, frequencies_page, kt_mismatch, ldv_interpolation)
    for script in (*studies, side_by_side, validation_page, b2a_line):  # an hour
        script.main(["-o", str(FIGURES)])


if __name__ == "__main__":
    main()
