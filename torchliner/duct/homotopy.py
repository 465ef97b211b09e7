"""From the modes of the rigid duct to those of the lined one, along a path of wall reflections."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.duct.pridmore_brown import PridmoreBrown, Solution

CONVERGED = 1e-11  # of a Newton step, in a = alpha H
SETTLED = 1e-8  # below this rounding may keep a correction from shrinking
ITERATIONS = 8
FAR = 0.3  # largest first correction after the prediction, modes being about pi apart
CONTRACTION = 0.5  # of each correction over the one before
LONGEST, SHORTEST = 0.25, 1e-7  # steps in s
STRIDE = 0.5  # largest predicted change of a in one step


@dataclass(eq=False)
class _Paths:
    """One mode each: where it stands on its way s = 0..1, at a; (M,)."""

    a: Tensor
    s: Tensor
    step: Tensor
    slope: Tensor  # da/ds


@dataclass(eq=False)
class _Root:
    """What Newton's method found: (M,), nan where it did not settle."""

    a: Tensor
    first: Tensor  # size of the first correction
    last: Tensor
    solution: Solution


def polish(equation: PridmoreBrown, a: Tensor, reflection: Tensor) -> Tensor:
    """Newton's method from estimates a, (M,), to the roots near them.

    Raises:
        RuntimeError: one does not settle; the message holds the last correction.
    """
    root = _newton(equation, a, reflection)
    failed = ~(root.last < SETTLED)
    if bool(failed.any()):
        i = int(torch.nonzero(failed)[0])
        raise RuntimeError(
            f"the wavenumber near alpha H = {complex(a[i]):.4g} at k H = "
            f"{float(equation.kappa[i]):.4g} does not settle (first correction "
            f"{float(root.first[i]):.2g}): a mode exactly at cut-on has no single wavenumber, and "
            "too few points resolve none"
        )
    return root.a


def follow(equation: PridmoreBrown, a: Tensor, reflection: Tensor) -> Tensor:
    r"""Modes of the lined duct that grow out of given modes of the rigid one.

    The wall's reflection runs straight from 1 to R, so that Z(s) + 1 = (Z + 1)/s for s = 0..1:
    every wall on the way is passive if the last one is, and Z = 0 is a point like others. Each mode
    takes its own steps: predicted along da/ds = -F_R (R - 1)/F_a, corrected by Newton's method,
    halved when the corrections do not shrink at once, since then another mode may be near.

    Of M waves: rigid wavenumbers a = alpha H and the wall's R, (M,), to the lined ones, (M,).

    Raises:
        RuntimeError: a path does not get on: two modes meet on it.
    """
    rigid = torch.ones_like(reflection)
    slope = _slope(equation.solve(a), rigid, reflection)
    paths = _Paths(a.clone(), torch.zeros_like(a.real), torch.full_like(a.real, 0.05), slope)
    open_ = torch.nonzero(reflection != 1)[:, 0]
    while open_.numel():
        _advance(equation.select(open_), paths, open_, reflection[open_])
        stuck = open_[paths.step[open_] < SHORTEST]
        if stuck.numel():
            i = int(stuck[0])
            raise RuntimeError(
                f"the mode at alpha H = {complex(paths.a[i]):.5g}, k H = "
                f"{float(equation.kappa[i]):.4g} cannot be followed beyond "
                f"{float(paths.s[i]):.4g} of the way to R = {complex(reflection[i]):.4g}: another "
                "mode meets it there; a slightly different impedance or frequency goes round"
            )
        open_ = open_[paths.s[open_] < 1]
    return paths.a


def _advance(equation: PridmoreBrown, paths: _Paths, at: Tensor, goal: Tensor) -> None:
    """One step of the paths ``at``, taken or halved; ``equation`` is theirs."""
    slope = paths.slope[at]
    stride = torch.minimum(paths.step[at].clamp(max=LONGEST), STRIDE / slope.abs().clamp(min=1e-9))
    stride = torch.minimum(stride, 1 - paths.s[at])
    s = paths.s[at] + stride
    wall = 1 + s * (goal - 1)
    root = _newton(equation, paths.a[at] + stride * slope, wall)
    good = (root.first < FAR) & (root.last < SETTLED)
    paths.a[at] = torch.where(good, root.a, paths.a[at])
    paths.s[at] = torch.where(good, s, paths.s[at])
    paths.slope[at] = torch.where(good, _slope(root.solution, wall, goal), slope)
    paths.step[at] = torch.where(good, 2 * stride, stride / 2)


def _newton(equation: PridmoreBrown, a: Tensor, reflection: Tensor) -> _Root:
    change, first = torch.full_like(a.real, torch.inf), None
    for _ in range(ITERATIONS):
        solution = equation.solve(a)
        step = solution.residual(reflection) / solution.residual_slope(reflection)
        # A root that is found stays as it is while others of the batch are still on their way.
        step = torch.where(change < CONVERGED, 0, step)
        size = step.abs()
        growing = (size > CONTRACTION * change) & (size > SETTLED)
        a = torch.where(growing, torch.nan, a - step)
        change = torch.where(growing, torch.nan, size)
        first = change if first is None else first
        if not bool((change >= CONVERGED).any()):
            break
    assert first is not None
    return _Root(a, first, change, solution)


def _slope(solution: Solution, wall: Tensor, goal: Tensor) -> Tensor:
    """da/ds where the wall reflects ``wall`` on its way from 1 to ``goal``."""
    return -solution.residual_by_reflection * (goal - 1) / solution.residual_slope(wall)
