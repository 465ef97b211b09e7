"""What ``torchliner verify`` prints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any


def format_verification(rows: Sequence[dict[str, Any]], found: Sequence[dict[str, Any]]) -> str:
    """Two tables."""
    lines = [
        f"{'flow':>8s} {'p':>2s} {'mesh':>8s} {'unknowns':>9s} {'error of p':>11s} {'order':>6s}"
    ]
    for row in rows:
        order = "" if math.isnan(row["order"]) else f"{row['order']:.2f}"
        mesh = f"{row['columns']} x {row['rows']}"
        lines.append(f"{row['flow']:>8s} {row['degree']:2d} {mesh:>8s} {row['unknowns']:9d} "
                     f"{row['error']:11.2e} {order:>6s}")  # fmt: skip
    lines.append("")
    for check in found:
        word = "holds" if check["passed"] else "FAILS"
        lines.append(f"{word}: {check['check']} {check['value']:.2e} (limit {check['limit']:.0e})")
    return "\n".join(lines)
