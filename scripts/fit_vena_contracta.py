"""Fit the vena contracta coefficient of a liner to a known impedance, by derivatives.

    python scripts/fit_vena_contracta.py [PLANE ...]

The default is the resolved slit n130 at its highest plane, whose true impedance the file holds. One
number cannot fit two: the coefficient acts on the resistance alone, so the resistance is fitted and
what is left of the reactance is shown.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import torch

import torchliner as tl
from common import DATA, options_of, parser_of
from torchliner.liners.model import LinerModel

TOLERANCE, MOST_STEPS = 1e-7, 30


def resistance(plane: tl.VelocityPlane, liner: LinerModel) -> torch.Tensor:
    """Resistance of the liner, velocity averaged over each cell before it is replayed."""
    return tl.educe(plane, liner, dtype="float64").liner_impedance_velocity_first[0].real


def fit(plane: tl.VelocityPlane, liner: LinerModel, wanted: torch.Tensor) -> float:
    """The coefficient at which the educed resistance is ``wanted``, by Newton's method.

    Raises:
        RuntimeError: no coefficient between 0.3 and 1 gives it.
    """
    coefficient = torch.tensor(0.8, dtype=torch.float64)
    for _ in range(MOST_STEPS):
        value = coefficient.clone().requires_grad_()
        found = resistance(plane, liner.replace(vena_contracta=value))
        (slope,) = torch.autograd.grad(found, value)
        step = ((wanted - found) / slope).detach()
        if abs(float(step)) < TOLERANCE:
            return float(coefficient)
        coefficient = (coefficient + step.clamp(-0.1, 0.1)).clamp(0.3, 1.0)
    raise RuntimeError(
        f"no coefficient between 0.3 and 1 gives a resistance of {float(wanted):.4g}; at "
        f"{float(coefficient):.3g} it is {float(found.detach()):.4g}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a row for each plane."""
    parser = parser_of(__doc__)
    parser.add_argument("planes", nargs="*", type=Path, default=[DATA / "slit_n130_y2.5mm.h5"])
    options = options_of(parser, arguments)
    print(f"{'plane':26s} {'true Z':>14s} {'at 0.8':>14s} {'fitted C':>9s} {'Z fitted':>14s}")
    for path in options.planes:
        plane = tl.read_plane(path)
        liner = tl.load_liner(plane.liner)
        if "true" not in plane.reference:
            print(f"{path}: states no true impedance", file=sys.stderr)
            return 2
        true = plane.reference["true"]
        try:
            coefficient = fit(plane, liner, torch.tensor(true.real, dtype=torch.float64))
        except RuntimeError as error:
            print(f"{path.name}: {error}")
            continue
        row = [true]
        for value in (0.8, coefficient):
            found = tl.educe(plane, liner.replace(vena_contracta=value))
            row.append(complex(found.liner_impedance_velocity_first[0]))
        shown = [f"{z.real:.4f}{z.imag:+.4f}j" for z in row]
        print(f"{path.name:26s} {shown[0]:>14s} {shown[1]:>14s} {coefficient:9.4f} {shown[2]:>14s}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
