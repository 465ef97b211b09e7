"""The two inner sums of ``spectral`` as fused loops, compiled when a job is large enough.

Compilation takes seconds, so small jobs never see it. Where there is no compiler, or it fails, one
warning is given and the same numbers come from the eager path.
"""

from __future__ import annotations

import functools
import types
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.liners.nonlinear import inverse_parts, powers
from torchliner.replay.levels import VelocityGrid, lagrange_weights
from torchliner.replay.sources import speed_of

PAYS_FROM = 1.5e9  # velocity samples x lines: some ten seconds of eager work
# Samples that one iteration sums. Inductor unrolls sums of up to eight, and then runs along the
# contiguous columns; a longer sum it would run down the columns, one cache line a sample.
GROUP = 8
# Without these inductor writes full-size temporaries and the fused loop is four times slower.
OPTIONS: dict[str, str | int | bool | Callable[..., object]] = {
    "realize_reads_threshold": 64,
    "realize_opcount_threshold": 400,
    "realize_acc_reads_threshold": 200,
    "max_fusion_size": 400,
}

Loop = Callable[..., list[Tensor]]

failures: list[str] = []  # of compilations so far; only the first is warned of


def law_sums(
    velocity: Tensor, offset: Tensor | None, coefficients: Tensor, weights: Tensor
) -> list[Tensor]:
    """Sums over ``GROUP`` samples, and over the lines, of weight times (R - 1)/2.

    Args:
        velocity: m/s, (t, P), t a multiple of ``GROUP``.
        offset: m/s, (P,), or None.
        coefficients: of ``inverse_parts``, (lines, 6), in the precision of ``velocity``.
        weights: real and imaginary part per line and direction, (t, lines, 2 directions).
    Returns:
        Real and imaginary part per direction, each (t/GROUP, P).
    """
    speed = speed_of(velocity, offset)
    square, power = powers(speed)
    totals: list[Tensor | None] = [None] * weights.shape[2]
    for i in range(coefficients.shape[0]):
        real, imaginary = inverse_parts(coefficients[i], speed, square, power)
        for j in range(0, weights.shape[2], 2):
            a, b = weights[:, i, j, None], weights[:, i, j + 1, None]
            for k, part in ((j, a * real - b * imaginary), (j + 1, a * imaginary + b * real)):
                before = totals[k]
                totals[k] = part if before is None else before + part
    return [_by_groups(part) for part in totals if part is not None]


def table_sums(
    velocity: Tensor, offset: Tensor | None, rows: Tensor, scale: Tensor, grid: VelocityGrid
) -> list[Tensor]:
    """Sums over ``GROUP`` samples of a table over (time, level), interpolated at |v|.

    Args:
        velocity, offset: as for ``law_sums``.
        rows: (t, V, parts).
        scale: 1/top of the grid, 0-d: a constant would have each grid compiled anew.
        grid: its spacing, interpolation and number of levels.
    Returns:
        One (t/GROUP, P) per part.
    """
    speed = speed_of(velocity, offset)
    index, offset_in_cell = grid.position(speed * scale)
    levels, parts = rows.shape[1:]
    start = torch.arange(len(rows), dtype=torch.int32, device=rows.device) * levels
    index = index.to(torch.int32) + start[:, None]
    weights = lagrange_weights(grid.interpolation, offset_in_cell)
    flat = rows.reshape(-1)
    sums = []
    for part in range(parts):
        total: Tensor | None = None
        for node, weight in enumerate(weights):
            term = flat[(index + node) * parts + part] * weight
            total = term if total is None else total + term
        assert total is not None
        sums.append(_by_groups(total))
    return sums


def _by_groups(values: Tensor) -> Tensor:
    return values.reshape(-1, GROUP, values.shape[1]).sum(1)


@dataclass(frozen=True)
class Shape:
    """What a compiled loop is made for: one shape only, inductor gives up after eight."""

    device: torch.device
    dtype: torch.dtype
    rows: int
    columns: int
    has_offset: bool
    parts: int
    lines: int = 0  # of the formula; 0 for the table
    grid: VelocityGrid | None = None  # of the table, its top set to 1

    def arguments(self) -> list[Tensor | None]:
        """Harmless numbers to try the loop on."""

        def ones(*shape: int) -> Tensor:
            return torch.ones(shape, dtype=self.dtype, device=self.device)

        velocity, offset = ones(self.rows, self.columns) / 2, None
        if self.has_offset:
            offset = ones(self.columns) / 4
        if self.grid is None:
            return [velocity, offset, ones(self.lines, 6), ones(self.rows, self.lines, self.parts)]
        return [velocity, offset, ones(self.rows, self.grid.levels, self.parts), ones()]


@functools.lru_cache(maxsize=32)
def compile_loop(shape: Shape) -> Loop | None:
    """The loop for slabs of one shape; None, with a warning, if it cannot be compiled."""
    function = law_sums if shape.grid is None else table_sums
    # torch counts compilations by code object and gives up after eight: each shape has its own.
    own: Loop = types.FunctionType(function.__code__.replace(), function.__globals__)
    if shape.grid is not None:
        own = functools.partial(own, grid=shape.grid)
    try:
        compiled: Loop = torch.compile(own, dynamic=False, options=OPTIONS)
        compiled(*shape.arguments())
    except Exception as error:
        reason = str(error).strip().splitlines()[0][:120] if str(error).strip() else repr(error)
        if not failures:
            warnings.warn(
                f"torch.compile is not available ({type(error).__name__}: {reason}); the eager "
                "path gives the same numbers, some ten times slower on large planes",
                RuntimeWarning,
                stacklevel=2,
            )
        failures.append(reason)
        return None
    return compiled
