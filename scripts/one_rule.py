"""Averaging ``phase-locked`` on the resolved cases: its parts one by one, and what is open.

    python scripts/one_rule.py

Prints the table that docs/method.md quotes. Plane at 0.5 mm, phase averaged, contraction coefficient fitted without
flow.
"""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any
from unittest import mock

import torch
from torch import Tensor

import torchliner as tl
from common import parser_of
from torchliner.engine.blocks import waves
from torchliner.engine.drives import Drive, phase_locked
from torchliner.engine.survey import Membership, harmonics_of
from torchliner.names import AVERAGINGS
from torchliner.records.cells import sort_into_cells
from truth_page import liner_of, page_table, planes_of

CASES = ("n130", "n145", "o130", "o145", "t03_130", "g03_145", "g01_145", "t015_145")
FITTED = {"n": 0.8, "g": 0.8, "o": 0.444, "t": 0.415}  # contraction coefficient, without flow
PHASES, SHARE = 8, 0.1  # bins of the tone's period; quantile that stands for the smallest


def liner_for(case: str) -> tl.SDoFLiner:
    """The liner of a case with the contraction coefficient of its kind."""
    return liner_of(case).replace(vena_contracta=FITTED[case[0]])


def educed(plane: tl.VelocityPlane, case: str, **choices: Any) -> tl.ImpedanceMap:
    """In double precision, without intervals."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        return tl.educe(plane, liner_for(case), interval=None, dtype="float64", **choices)


def without_mean(*given: Any) -> Drive:
    """The drive that leaves the time mean where it is."""
    drive = phase_locked(*given)
    assert drive.taken is not None
    return dataclasses.replace(drive, taken=torch.cat([0 * drive.taken[:1], drive.taken[1:]]))


def parts_of(velocity: Tensor, plane: tl.VelocityPlane, case: str) -> tuple[Tensor, Tensor]:
    """Phase-locked velocity of the cell at each probe, and the incoherent one, (P, n)."""
    cells = sort_into_cells(plane, liner_for(case).cell_pitch)
    members = Membership.of(cells.labels, cells.count, velocity.device)
    lines = torch.tensor(harmonics_of(plane.frequency, plane.sampling_rate), dtype=torch.float64)
    rows = waves(lines, plane.sampling_rate, 0, plane.samples)
    fit = torch.linalg.lstsq(rows.T, velocity.T).solution  # (K, P)
    mean = torch.where(cells.labels >= 0, members.spread(members.mean(fit)), fit)
    return (rows.T @ mean).T, velocity - (rows.T @ fit).T


def background(incoherent: Tensor, plane: tl.VelocityPlane) -> dict[str, Tensor]:
    """Guesses of the mean square of the background turbulence: what never falls away."""
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
    for name, target in background(incoherent, plane).items():
        driven = cell + (target / own).sqrt().clamp(max=1)[:, None] * incoherent
        other = dataclasses.replace(plane, velocity=driven.reshape(plane.velocity.shape))
        yield name, complex(educed(other, case, averaging="admittance").answer[0])


def rows_of(case: str) -> dict[str, complex]:
    """By name, all of one case."""
    plane = planes_of(case)[0]
    found = educed(plane, case)
    rows = {"reference": plane.reference["true"]}
    rows |= {averaging: complex(found.liner[averaging].impedance[0]) for averaging in AVERAGINGS}
    reading = "torchliner.velocity.reading"
    changes: dict[str, tuple[str, Any]] = {
        f"{count} harmonic{'s' * (count > 1)}": (f"{reading}.harmonics_of", partial(harmonics_of, count=count))
        for count in (1, 2, 4, 16)
    }
    changes["g = 1"] = ("torchliner.engine.drives.FEWEST_BLOCKS", torch.inf)
    changes["mean left in place"] = (f"{reading}.phase_locked", without_mean)
    for name, (place, other) in changes.items():
        with mock.patch(place, other):
            rows[name] = complex(educed(plane, case).answer[0])
    return rows | dict(scaled(plane, case))


def table(found: dict[str, dict[str, complex]]) -> str:
    """Markdown, a column a case."""
    names = next(iter(found.values()))
    lines = [[name, *(f"{rows[name].real:.2f}{rows[name].imag:+.2f}j" for rows in found.values())] for name in names]
    return page_table(f" | {' | '.join(found)}", lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """The table, printed."""
    parser_of(__doc__).parse_args(arguments)
    print(table({case: rows_of(case) for case in CASES}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
