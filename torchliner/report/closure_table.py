"""Closure of maps and lines, as text and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.report.table import Column, Table


def closure_lines(
    results: Sequence[ImpedanceMap | ImpedanceLine], where: Sequence[Column]
) -> list[str]:
    """What the whole planes are compared with, a row each and frequency; why the answer fails.

    Args:
        results: maps, or one line.  where: columns that say which row it is.
    """
    heading = "\n".join(dict.fromkeys(f"closure: {result.closure_words}" for result in results))
    rows: list[dict[str, Any]] = []
    sentences: dict[str, None] = {}
    orders: dict[str, None] = {}
    for result in sorted(results, key=lambda each: getattr(each, "height", None) or 0.0):
        if (closure := result.closure) is None:
            continue
        if closure.confidence is not None and not rows:
            heading += f" ({100 * closure.confidence:g} % statistical intervals)"
        orders |= dict.fromkeys(closure.orders)
        for i, frequency in enumerate(result.frequency.tolist()):
            place = {"height": getattr(result, "height", None), "frequency": frequency}
            rows.append(place | {order: closure.words(order, i) for order in closure.orders})
            sentences |= dict.fromkeys([closure.sentence(closure.order, frequency, i)])
    if not rows:
        return [heading]
    columns = [*where, *(Column(order, heading=order) for order in orders)]
    return [
        f"\n{heading}",
        Table([dict.fromkeys(orders, "-") | row for row in rows], columns).as_text(),
        *filter(None, sentences),
        "",
    ]


def plain_closure(result: ImpedanceMap | ImpedanceLine) -> dict[str, Any]:
    """For JSON; ``checked`` is false where nothing is known, ``words`` say why."""
    words = result.closure_words
    if result.closure is None:
        return {"checked": False, "words": words}
    return {"checked": True, "words": words, **result.closure.plain(result.frequency.tolist())}
