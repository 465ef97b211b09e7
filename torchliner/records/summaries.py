"""Records in a line or two, as a terminal and a notebook show them."""

from __future__ import annotations

from html import escape
from typing import Any

from torch import Tensor

from torchliner.records.declared import variables_of

Facts = list[tuple[str, str]]
MOST = 12  # rows of a notebook's table
UNSAID = ("frequency", "columns", "rows")  # dimensions


class Summarised:
    """A record that shows what it is and not its tensors."""

    def _answer(self) -> tuple[Tensor, Any, float | None] | None:
        """Its impedance, (F,), with a statistical interval and the level of that; None without."""
        return None

    def _heading(self) -> str:
        """'ImpedanceMap 'title': 2 x 3 probes, 1 cell, 1400 Hz'."""
        of: Any = getattr(self, "plane", self)
        title = f" {of.title!r}" if getattr(of, "title", "") else ""
        if hasattr(of, "probe_shape"):
            words = [shape_words(of.probe_shape, "probe"), f"{of.samples} samples at {of.sampling_rate:g} Hz"]
        else:
            rows = [(row.dims[0], getattr(of, row.field)) for row in variables_of(type(of)) if len(row.dims) == 1]
            sizes = {dim: tuple(each.shape) for dim, each in rows if isinstance(each, Tensor) and dim not in UNSAID}
            words = [shape_words(shape, dim.removesuffix("s")) for dim, shape in sizes.items()]
            words.append(frequency_words(of.frequency))
        return f"{type(self).__name__}{title}: {', '.join(words)}"

    def _facts(self) -> Facts:
        """Z at each frequency, or what is stated."""
        of: Any = getattr(self, "plane", self)
        if (known := self._answer()) is not None:
            return impedance_facts(of.frequency, *known)
        stated = [(row, getattr(of, row.field)) for row in variables_of(type(of)) if not row.dims]
        return [
            *((name, text) for name in ("liner", "source_side") if (text := getattr(of, name, ""))),
            *(
                (row.field, f"{float(value):g} {row.unit}".removesuffix(" 1"))
                for row, value in stated
                if value is not None
            ),
        ]

    def __repr__(self) -> str:
        facts = self._facts()
        more = f" ({len(facts) - 1} more)" if len(facts) > 1 else ""
        return "\n  ".join([self._heading(), *(": ".join(fact) + more for fact in facts[:1])])

    def _repr_html_(self) -> str:
        """For notebooks: the heading above a table."""
        facts = self._facts()
        rows = [*facts[:MOST], *([("...", f"{len(facts) - MOST} more")] if facts[MOST:] else [])]
        cells = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
        return f"<div><b>{escape(self._heading())}</b><table>{cells}</table></div>"


def shape_words(shape: tuple[int, ...], noun: str) -> str:
    """'2 x 3 probes'."""
    count = " x ".join(map(str, shape)) or "1"
    return f"{count} {noun}{'' if count == '1' else 's'}"


def frequency_words(frequency: Tensor) -> str:
    """'1400 Hz', or how many from where to where."""
    low, high = float(frequency.min()), float(frequency.max())
    return f"{low:g} Hz" if len(frequency) == 1 else (f"{len(frequency)} frequencies, {low:g} to {high:g} Hz")


def impedance_facts(frequency: Tensor, impedance: Tensor, interval: Any = None, level: float | None = None) -> Facts:
    """Z at each frequency, with the bounds of a statistical interval where there is one."""
    found = []
    for i, (f, z) in enumerate(zip(frequency.tolist(), impedance.tolist(), strict=True)):
        text = f"Z = {z:.3f}"
        if interval is not None and level is not None:
            low, high = interval.bounds(i)
            text += f", {100 * level:g} %: R {low.real:.3f} to {high.real:.3f}, X {low.imag:.3f} to {high.imag:.3f}"
        found.append((f"{f:g} Hz", text))
    return found
