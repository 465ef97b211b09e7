"""The order ``coherent first`` on the resolved cases: its parts one by one, and what is open.

    python scripts/one_rule.py

Prints the table that docs/method.md quotes. Plane at 0.5 mm, phase averaged, vena contracta fitted
without flow.
"""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest import mock

import torch
from torch import Tensor

import torchliner as tl
from common import parser_of
from torchliner.names import ORDERS
from torchliner.records.cells import sort_into_cells
from torchliner.reduction import periodic
from truth_page import liner_of, planes_of

CASES = ("n130", "n145", "o130", "o145", "t03_130", "g03_145", "g01_145", "t015_145")
FITTED = {"n": 0.8, "g": 0.8, "o": 0.444, "t": 0.415}  # vena contracta, without flow
PHASES, SHARE = 8, 0.1  # bins of the tone's period; quantile that stands for the smallest


def liner_for(case: str) -> tl.SDoFLiner:
    """The liner of a case with the vena contracta of its kind."""
    return liner_of(case).replace(vena_contracta=FITTED[case[0]])


def educed(plane: tl.VelocityPlane, case: str, **choices: Any) -> tl.ImpedanceMap:
    """In double precision, without intervals."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        return tl.educe(plane, liner_for(case), interval=None, dtype="float64", **choices)


@contextmanager
def shares(change: Callable[[Tensor], Tensor]) -> Iterator[None]:
    """With other shares g."""
    own = periodic._shares
    with mock.patch.object(periodic, "_shares", lambda *sums: change(own(*sums))):
        yield


def without_mean(share: Tensor) -> Tensor:
    """The time mean stays where it is."""
    return torch.cat([torch.zeros_like(share[:1]), share[1:]])


def parts_of(velocity: Tensor, plane: tl.VelocityPlane, case: str) -> tuple[Tensor, Tensor]:
    """Coherent velocity of the cell at each probe, and the incoherent one, (P, n)."""
    cells = sort_into_cells(plane, liner_for(case).cell_pitch)
    assert plane.frequency is not None
    rows = periodic.Harmonics.of((plane.frequency,), plane.sampling_rate).rows(0, plane.samples)
    fit = torch.linalg.lstsq(rows.T, velocity.T).solution  # (K, P)
    held = cells.membership(cells.labels >= 0)
    of_cell = (fit @ held)[:, cells.labels.clamp(min=0)]
    mean = torch.where(cells.labels >= 0, of_cell, fit)
    return (rows.T @ mean).T, velocity - (rows.T @ fit).T


def oncoming(incoherent: Tensor, plane: tl.VelocityPlane) -> dict[str, Tensor]:
    """Guesses of the mean square of the oncoming turbulence: what never falls away."""
    assert plane.frequency is not None
    turns = plane.frequency * torch.arange(plane.samples) / plane.sampling_rate
    number = (PHASES * (turns % 1)).to(torch.int64)
    square = torch.stack([incoherent[:, number == k].square().mean(1) for k in range(PHASES)], dim=1)
    return {
        "incoherent part: smallest over phases": square.mean(0).min(),
        "smallest over places": square.mean(1).quantile(SHARE),
        "smallest over phases, by place": square.amin(1).mean(),
    }


def scaled(plane: tl.VelocityPlane, case: str) -> Iterator[tuple[str, complex]]:
    """R with the incoherent part of every probe brought to each guess."""
    velocity = plane.velocity.to(torch.float64).reshape(plane.probes, -1)
    cell, incoherent = parts_of(velocity, plane, case)
    own = incoherent.square().mean(1).clamp(min=1e-12)
    for name, target in oncoming(incoherent, plane).items():
        driven = cell + (target / own).sqrt().clamp(max=1)[:, None] * incoherent
        other = dataclasses.replace(plane, velocity=driven.reshape(plane.velocity.shape))
        yield name, complex(educed(other, case, order=ORDERS[0]).answer[0])


def rows_of(case: str) -> dict[str, complex]:
    """By name, all of one case."""
    plane = planes_of(case)[0]
    found = educed(plane, case)
    rows = {"true": plane.reference["true"]}
    rows |= {order: complex(found.of_liner(order)[0]) for order in ORDERS}
    for count in (1, 2, 4, 16):
        with mock.patch.object(periodic, "HARMONICS", count):
            rows[f"{count} harmonic{'s' * (count > 1)}"] = complex(educed(plane, case).answer[0])
    with shares(torch.ones_like):
        rows["g = 1"] = complex(educed(plane, case).answer[0])
    with shares(without_mean):
        rows["mean left in place"] = complex(educed(plane, case).answer[0])
    return rows | dict(scaled(plane, case))


def table(found: dict[str, dict[str, complex]]) -> str:
    """Markdown, a column a case."""
    lines = [f"| | {' | '.join(found)} |", "|" + "---|" * (len(found) + 1)]
    for name in next(iter(found.values())):
        cells = (f"{rows[name].real:.2f}{rows[name].imag:+.2f}j" for rows in found.values())
        lines.append(f"| {name} | {' | '.join(cells)} |".replace("-", "−"))
    lines[1] = lines[1].replace("−", "-")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """The table, printed."""
    parser_of(__doc__).parse_args(arguments)
    print(table({case: rows_of(case) for case in CASES}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
