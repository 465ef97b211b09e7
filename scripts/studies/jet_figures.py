"""Jet height against jet velocity and Mach number: figure 22 as numbers and as a drawing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from studies.jet_scaling import JetScaling, fit_exponent
from torchliner.report.figure import COLOURS, Figure, finish, styled, subplots
from torchliner.report.numbers import Array, Curves

PAPER_EXPONENTS = (0.4, -0.5)  # eq. (A4)
STYLES = ("-", "--", ":")


def height_over_velocity(scalings: Sequence[JetScaling]) -> Curves:
    """H_j/d over U_j, a column a Mach number and shear."""
    values = {
        f"H_j/d (M_b = {mach:g}, delta = {one.shear:g})": row
        for one in scalings
        for mach, row in zip(one.machs, one.height_over_velocity, strict=True)
    }
    return Curves(scalings[0].velocity, values, "jet height", "U_j (m/s)")


def height_over_mach(scalings: Sequence[JetScaling]) -> Curves:
    """H_j/d over M_b at one jet velocity, a column a shear."""
    values = {f"H_j/d (delta = {one.shear:g})": one.height_over_mach for one in scalings}
    return Curves(scalings[0].mach, values, "jet height", "M_b")


@styled
def draw_jets(scalings: Sequence[JetScaling], path: str | Path | None = None) -> Figure:
    """Both panels of figure 22 on logarithmic axes, fitted exponents in the legends."""
    figure, axes = subplots(1, 2, 3.3)
    left, right = axes[0]
    for one, line in zip(scalings, STYLES, strict=False):
        for i, mach in enumerate(one.machs):
            name = rf"$M_b={mach:g}$, $\delta={one.shear:g}$: $n={one.velocity_exponents[i]:.3f}$"
            colour = COLOURS[i % len(COLOURS)]
            left.plot(one.velocity, one.height_over_velocity[i], line, color=colour, label=name)
        name = rf"$\delta={one.shear:g}$: $n={one.mach_exponent:.3f}$"
        right.plot(one.mach, one.height_over_mach, line, color=COLOURS[0], label=name)
    first, last = scalings[0], scalings[-1]
    _guide(left, first.velocity, 0.75 * last.height_over_velocity.min(), PAPER_EXPONENTS[0])
    _guide(right, first.mach, 0.95 * first.height_over_mach[0], PAPER_EXPONENTS[1])
    left.set_xlabel("$U_j$ (m s$^{-1}$)")
    right.set_xlabel("$M_b$")
    fixed = f"$U_j={first.fixed_velocity:g}$ m s$^{{-1}}$"
    right.text(0.97, 0.95, fixed, transform=right.transAxes, ha="right", va="top", fontsize=8)
    for axis in (left, right):
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_ylabel("$H_j/d$")
    _plain_ticks(left, [1, 10, 100], [0.2, 0.5, 1, 2, 5])
    _plain_ticks(right, [0.1, 0.2, 0.3, 0.4], [0.4, 0.5, 0.6, 0.8, 1.0])
    left.legend(loc="upper left", fontsize=6, handlelength=1.8, labelspacing=0.25)
    right.legend(loc="lower left", fontsize=7)
    return finish(figure, path)


def _guide(axis: Figure, at: Array, start: float, exponent: float) -> None:
    """A straight line with the exponent of the paper's (A4)."""
    name = f"(A4): $n={exponent:g}$"
    axis.plot(at, start * (at / at[0]) ** exponent, "-.", color="0.4", label=name)


def _plain_ticks(axis: Figure, across: Sequence[float], up: Sequence[float]) -> None:
    from matplotlib.ticker import NullFormatter

    axis.set_xticks(across, [f"{tick:g}" for tick in across])
    axis.set_yticks(up, [f"{tick:g}" for tick in up])
    for side in (axis.xaxis, axis.yaxis):
        side.set_minor_formatter(NullFormatter())


def exponent_lines(scalings: Sequence[JetScaling]) -> list[str]:
    """What came out, in words."""
    lines = []
    for one in scalings:
        found = ", ".join(
            f"{n:.3f} (M_b {m:g})" for m, n in zip(one.machs, one.velocity_exponents, strict=True)
        )
        low, high = one.velocity[0], one.velocity[-1]
        lines.append(f"delta {one.shear:g}: H_j ~ U_j^n over {low:g}-{high:g} m/s, n = {found}")
        slope, _ = fit_exponent(one.mach, one.height_over_mach)
        lines.append(
            f"delta {one.shear:g}: H_j ~ M_b^n over {one.mach[0]:g}-{one.mach[-1]:g} at "
            f"{one.fixed_velocity:g} m/s, n = {slope:.3f}"
        )
    return lines
