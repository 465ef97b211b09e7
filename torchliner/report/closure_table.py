"""Closure of maps and lines, as text and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.names import ORDERS
from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.report.table import Column, Table


def closure_lines(
    results: Sequence[ImpedanceMap | ImpedanceLine], where: Sequence[Column]
) -> list[str]:
    """What the whole planes are compared with, a row each and frequency; why the answer fails.

    Args:
        results: maps, or one line.
        where: columns that say which row it is.
    """
    heading = dict.fromkeys(f"closure: {result.closure_words}" for result in results)
    unknown = dict.fromkeys(ORDERS, "-")
    rows: list[dict[str, Any]] = []
    sentences: list[str] = []
    for result in sorted(results, key=lambda each: getattr(each, "height", None) or 0.0):
        closure = result.closure
        if closure is None:
            continue
        for i, frequency in enumerate(result.frequency.tolist()):
            height = getattr(result, "height", None)
            cells = {order: closure.words(order, i) for order in closure.orders}
            rows.append({"height": height, "frequency": frequency, **unknown, **cells})
            sentences += filter(None, [closure.sentence(closure.order, frequency, i)])
    if not rows:
        return list(heading)
    orders = dict.fromkeys(order for result in results if result.closure is not None
                           for order in result.closure.orders)  # fmt: skip
    level = next(result.closure.confidence for result in results if result.closure is not None)
    words = "" if level is None else f" ({100 * level:g} % statistical intervals)"
    columns = [*where, *(Column("", order, order)
                         for order in orders)]  # fmt: skip
    lines = ["\n" + "\n".join(heading) + words, Table(rows, columns).as_text()]
    return [*lines, *dict.fromkeys(sentences), ""]


def plain_closure(result: ImpedanceMap | ImpedanceLine) -> dict[str, Any]:
    """For JSON; ``checked`` is false where nothing is known, ``words`` say why."""
    words = result.closure_words
    if result.closure is None:
        return {"checked": False, "words": words}
    return {"checked": True, "words": words, **result.closure.plain(result.frequency.tolist())}
