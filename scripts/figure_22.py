"""Figure 22: jet height over jet velocity and bulk Mach number, with the exponents that come out.

python scripts/figure_22.py [-o FOLDER]
"""

from __future__ import annotations

from collections.abc import Sequence

from common import RESULTS, options_of, parser_of
from studies.jet_figures import draw_jets, exponent_lines, height_over_mach, height_over_velocity
from studies.jet_scaling import jet_scaling

SHEARS = (0.05, 0.1)  # the paper's, and that of its duct computations


def main(arguments: Sequence[str] | None = None) -> None:
    folder = options_of(parser_of(__doc__, RESULTS / "figure_22"), arguments).output
    scalings = [jet_scaling(shear) for shear in SHEARS]
    draw_jets(scalings, folder / "figure_22.png")
    height_over_velocity(scalings).write_csv(folder / "figure_22a.csv")
    height_over_mach(scalings).write_csv(folder / "figure_22b.csv")
    print("\n".join(exponent_lines(scalings)))
    print(f"figure and numbers are in {folder}")


if __name__ == "__main__":
    main()
