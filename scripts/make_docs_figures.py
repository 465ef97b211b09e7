"""The pictures of README.md and docs/, drawn from the shipped data into docs/figures.

python scripts/make_docs_figures.py
"""

from __future__ import annotations

import warnings

import b2a_line
import calibrate_resolved
import figure_13
import figure_14
import figure_20
import frequencies_page
import kt_mismatch
import ldv_interpolation
import side_by_side
import validation_page
from common import DATA, FIGURES, plane_files
from torchliner.checks import DataWarning
from torchliner.cli.main import main as torchliner
from torchliner.io.microphone_file import read_pressure
from torchliner.io.planes import read_plane
from torchliner.liners.catalogue import load_liner
from torchliner.pressure.dean import in_situ
from torchliner.report.curves import draw_along_x, draw_spectrum, draw_velocity
from torchliner.report.maps import draw_map
from torchliner.velocity.educe import educe


def main() -> None:
    warnings.simplefilter("ignore", DataWarning)
    FIGURES.mkdir(parents=True, exist_ok=True)
    for case in ("slit_n130", "slit_g03_145", "orifice_o145"):
        holes = DATA / f"holes_{case[: case.index('_') + 2]}.csv"  # by the first letter of the case
        planes = [read_plane(path, holes=holes) for path in plane_files(f"{case}_y*.h5")]
        maps = [educe(plane, load_liner(plane.liner)) for plane in planes]
        draw_along_x(maps, FIGURES / f"{case}_along_x.png")
        draw_velocity(planes, FIGURES / f"{case}_velocity.png")
        if case == "slit_g03_145":
            beside = in_situ(read_pressure(DATA / "pressure_g03_145.h5"))
            both = [found.with_alongside(beside) for found in maps]
            draw_along_x(both, FIGURES / f"{case}_in_situ.png")
    pressure = str(DATA / "pressure_n130.h5")
    torchliner(["insitu", pressure, "--figure", str(FIGURES / "in_situ_n130.png")])
    planes = [read_plane(DATA / f"slit_n130_y{height}mm.h5") for height in ("1.0", "2.5")]
    wide = [300 + 50.0 * i for i in range(115)]
    spectra = [educe(plane, load_liner(plane.liner), wide) for plane in planes]
    draw_spectrum(spectra, FIGURES / "slit_n130_spectrum.png")
    draw_map(maps[1], FIGURES / "orifice_o145_map.png")
    channel = read_plane(DATA / "channel_y1.04mm.h5")
    null_test = educe(channel, load_liner("polito"), 1400.0)
    draw_map(null_test, FIGURES / "channel_map.png")
    torchliner(["height", *map(str, plane_files("slit_n130_y*.h5")), "--figure", str(FIGURES)])
    for case, heights in (("slit_n130", ("2.5", "1.0")), ("orifice_o145", ("2.5", "1.0", "0.5"))):
        names = [str(DATA / f"{case}_y{height}mm.h5") for height in heights]
        picture = FIGURES / f"audit_{case.split('_')[1]}.png"
        torchliner(["audit", *names, "--quiet", "--figure", str(picture)])
    torchliner(["liner", "onera", "--figure", str(FIGURES / "liner_onera.png"), "--quiet"])
    torchliner(["duct", "solve", "b2a", "--quiet", "--field", str(FIGURES / "duct_field.png")])
    studies = (calibrate_resolved, figure_13, figure_14, figure_20, frequencies_page, kt_mismatch, ldv_interpolation)
    for script in (*studies, side_by_side, validation_page, b2a_line):  # an hour
        script.main(["-o", str(FIGURES)])
    print(f"pictures are in {FIGURES}")


if __name__ == "__main__":
    main()
