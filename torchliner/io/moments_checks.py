"""Whether a file of moments holds what sums over a record can be."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from torchliner.reduction.basis import Basis, Chebyshev, basis_of
from torchliner.reduction.moments import SETTINGS, PlaneSums
from torchliner.reduction.plan import PassPlan
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.signals.blocks import Blocks

MOST_ORDERS = 1 << 16  # K of tables with many kinks, at most
LARGEST_ERROR = 1e-4  # of a sum, in samples
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}


def checked_head(words: dict[str, Any], path: Path) -> tuple[PassPlan, Basis | None, float | None]:
    """Plan, basis and pitch of the cells, as the attributes say; ``cell_pitch`` leaves them."""
    said, velocity, settings = words["plan"], words["velocity"], words["settings"]
    with _attribute("plan", path):
        borders = tuple(int(n) for n in said["borders"])
        plan = PassPlan(
            int(said["samples"]), float(said["sampling_rate"]), int(said["begin"]),
            int(said["end"]), Blocks(borders, int(said["periods"])),
            tuple(float(line) for line in said["lines"]),
        )  # fmt: skip
        ends = [0, plan.begin, *borders, plan.samples]
        if not (
            borders
            and ends == sorted(ends)
            and len({*borders}) == len(borders)
            and plan.begin < plan.end <= plan.samples
            and borders[-1] <= plan.end
            and 0 < plan.sampling_rate < float("inf")
            and all(0 < f < float("inf") for f in plan.lines)
        ):
            raise ValueError(f"its samples, {said}, are those of no record")
    with _attribute("velocity", path):
        velocity["shape"] = [int(n) for n in velocity["shape"]]
        if velocity["precision"] not in PRECISIONS or velocity["shape"][-1:] != [plan.samples]:
            raise ValueError(f"{velocity} is no shape of {plan.samples} samples in {[*PRECISIONS]}")
    with _attribute("basis", path):
        basis = basis_of(words["basis"]) if words["basis"] else None
        if basis is not None:
            count, speeds = basis.count, basis.speeds
            if not (2 <= count <= MOST_ORDERS and bool(torch.isfinite(speeds).all() and (speeds >= 0).all())):
                raise ValueError(f"{words['basis']} are no functions of |v|")
    with _attribute("settings", path):
        pitch = settings.pop("cell_pitch")
        pitch = None if pitch is None else float(pitch)
        if {*settings} != {*SETTINGS}:
            raise ValueError(f"it holds {', '.join(settings)}; {', '.join(SETTINGS)} are needed")
    return plan, basis, pitch


@contextmanager
def _attribute(key: str, path: Path) -> Iterator[None]:
    """What is wrong in an attribute names it."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, IndexError) as error:
        text = f"has no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{path}: attribute {key!r}: {text}; reduce the data again") from error


def require_sums(group: GroupMoments, plan: PassPlan, basis: Basis, label: str) -> None:
    """The functions T_0, or all levels together, are 1 and sum to the samples; blocks to the whole.

    Raises:
        ValueError: they do not.
    """
    count, own = plan.end - plan.begin, group.totals[0]
    ones = own[0] if isinstance(basis, Chebyshev) else own.sum(0)
    wrong = (ones / count - 1).abs() > LARGEST_ERROR
    if group.of_blocks is not None:
        away = group.of_blocks.to(torch.float64).sum(0) - group.totals
        wrong |= (away.abs() > LARGEST_ERROR * count).any(0).any(0)
    if bool(wrong.any()):
        first = int(wrong.nonzero()[0])
        raise ValueError(
            f"{label} and its blocks are not the sums of {count} samples at {int(wrong.sum())} of "
            f"{len(wrong)} columns, the first {first} with {float(ones[first]):.9g}: the file is "
            "damaged; reduce the data again"
        )


def require_whole(sums: PlaneSums, probes: int, path: Path) -> None:
    """All parts are there and fit each other.

    Raises:
        ValueError: they do not.
    """
    star, count = sums.periodic is not None, sums.cells.count
    columns, wanted = len(sums.survey.mean), (1 + star) * probes + count
    # Without those of a second reading where it is still to come.
    groups = (0,) if sums.basis is None else (0, 2, 2 + star)
    labels = sums.cells.labels
    if columns != wanted:
        text = f"mean has {columns} columns; {probes} probes and {count} cells have {wanted}"
    elif len(sums.groups) not in groups:
        text = f"there are moments of {len(sums.groups)} groups of columns, not {groups[-1]}"
    elif not bool(((labels >= -1) & (labels < count)).all()):
        text = f"cell_of_probe names others than the {count} cells, or -1 for none"
    elif not (bool((sums.tones > 0).all()) and min(sums.survey.segments, default=1) > 0):
        text = "tones and segments are above 0"
    else:
        return
    raise ValueError(f"{path}:/{text}: the file is damaged; reduce the data again")
