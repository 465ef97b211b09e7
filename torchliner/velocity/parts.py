"""Moments of a record from parts that hold some of its blocks, each read by itself: for arrays of jobs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.engine.drives import phase_locked
from torchliner.engine.moments import Moments
from torchliner.engine.workers import Reduce
from torchliner.names import AVERAGINGS
from torchliner.records.same_case import require_same_probes
from torchliner.velocity.reading import Progress, Reading
from torchliner.velocity.review import require_sound, review_moments

ROWS = ("sums", "squares", "peaks", "gram")  # of a survey, whose first axis is the block


def measure_part(
    reading: Reading,
    blocks: Iterable[int],
    given: Moments | None,
    run: Reduce,
    progress: Progress | None = None,
) -> Moments:
    """Some blocks of a record.

    Args:
        reading, run, progress: as for ``reading.measure``.
        blocks: which.
        given: the join of the parts of the first reading, for the second.
    Raises:
        ValueError: blocks that the record has not, or twice; ``given`` is of another record or needs no second reading.
    """
    only, count = tuple(sorted(blocks)), reading.blocks.count
    if not only or len({*only}) < len(only) or not {*only} <= {*range(count)}:
        raise ValueError(f"blocks are {list(only)}; {reading.plane.name} has {count}, 0 to {count - 1}, each once")
    if reading.chosen.missing == "exclude":
        raise ValueError("a part does not know the faults of others; leave missing='exclude' out, or read all at once")
    jobs = reading.first_jobs()
    if given is not None:
        seen = given.survey
        _require_alike([given, reading.moments(seen, given.locked, {})], but=("data", "reading"))
        jobs = reading.second_jobs(seen, given.locked)
        if given.only is None or not jobs:
            raise ValueError(f"{given.plane.name} is complete: it needs no second reading")
    found = dict(zip(jobs, run(reading.record(progress), reading.blocks, list(jobs.values()), only), strict=True))
    if given is None:
        seen = reading.survey(found)
        seen = dataclasses.replace(seen, gram=seen.gram[list(only)])
        part = dataclasses.replace(reading.moments(seen, None, found), only=only)
    else:
        part = with_rows(given, lambda rows: rows[list(only)])
        part = dataclasses.replace(part, only=only, sums={**part.sums, **found}, notes=reading.notes)
    require_sound(reading.plane, part)  # the warnings are those of the whole, when it is joined
    return part


def join(parts: Sequence[Moments]) -> Moments:
    """See ``Moments.join``. Of a first reading that a second must follow: the ``given`` of its parts."""
    if not parts:
        raise ValueError("no part is given")
    first = parts[0]
    _require_alike(parts)
    held = [block for part in parts for block in part.only or range(first.survey.blocks.count)]
    twice = sorted({block for block in held if held.count(block) > 1})
    missing = sorted({*range(first.survey.blocks.count)} - {*held})
    for blocks, fault in ((twice, "are in several parts"), (missing, "are in no part")):
        if blocks:
            raise ValueError(f"blocks {', '.join(map(str, blocks))} of {first.plane.name} {fault}; each is in one")
    order = torch.tensor(held).argsort()
    columns = zip(*(_rows_of(part) for part in parts), strict=True)
    whole = iter([torch.cat(each)[order.to(each[0].device)] for each in columns])
    known = with_rows(first, lambda _: next(whole))
    known = dataclasses.replace(known, only=None if _complete(known) else tuple(range(len(held))))
    if known.locked is None and known.settings["averaging"] == "phase-locked":
        locked = phase_locked(known.survey, known.membership, known.settings["background_rms"])
        known = dataclasses.replace(known, locked=locked)
    require_sound(known.plane, known)
    notes = [*(note for part in parts for note in part.notes), *review_moments(known.plane, known, known.cells)]
    return dataclasses.replace(known, notes=tuple(dict.fromkeys(notes)))


def _rows_of(known: Moments) -> list[Tensor]:
    """All tensors whose first axis is the block."""
    return [*(getattr(known.survey, name) for name in ROWS), *known.sums.values()]


def with_rows(known: Moments, change: Callable[[Tensor], Tensor]) -> Moments:
    """The same with each of ``_rows_of`` changed, in that order."""
    changed: dict[str, Any] = {name: change(getattr(known.survey, name)) for name in ROWS}
    survey = dataclasses.replace(known.survey, **changed)
    return dataclasses.replace(known, survey=survey, sums={name: change(rows) for name, rows in known.sums.items()})


def _complete(known: Moments) -> bool:
    """Whether no second reading must follow."""
    averagings = tuple(AVERAGINGS) if known.settings["averaging"] == "phase-locked" else tuple(AVERAGINGS)[:2]
    return known.nodes is None or {*averagings} <= {*known.sums}


def _require_alike(several: Sequence[Moments], but: Sequence[str] = ()) -> None:
    """Refuse parts of other records, or by other choices; ``but`` facts that may differ.

    Raises:
        ValueError: they are; what differs is named.
    """
    first = several[0]
    for other in several[1:]:
        require_same_probes(first.plane, other.plane)
        for (name, mine), theirs in zip(_facts(first).items(), _facts(other).values(), strict=True):
            if mine != theirs and name not in but:
                raise ValueError(
                    f"{first.plane.name} and {other.plane.name} are not parts of one record: {name} is {mine} and "
                    f"{theirs}; reduce all of them alike"
                )


def _facts(known: Moments) -> dict[str, Any]:
    blocks, locked, inputs = known.survey.blocks, known.locked, known.plane.provenance.get("inputs", [])
    return {
        **known.settings,
        "samples": known.plane.samples,
        "precision": known.plane.velocity.dtype,
        "borders of blocks": blocks.borders,
        "sampling_rate": blocks.sampling_rate,
        "cell_pitch": known.cell_pitch,
        "nodes": None if known.nodes is None else known.nodes.describe(),
        "lines (Hz)": known.survey.lines.tolist(),
        "waves beside 1 (Hz)": known.turns.tolist(),
        "data": [each.get("hash") for each in inputs],
        "reading": list(known.sums),
        "phase-locked velocity": 0.0 if locked is None else float(locked.taken.abs().sum()),
    }
