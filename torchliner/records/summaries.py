"""Records in a line or two, as a terminal and a notebook show them."""

from __future__ import annotations

from html import escape
from typing import Any

from torch import Tensor

Facts = list[tuple[str, str]]
MOST = 12  # rows of a notebook's table


class Summarised:
    """A record that shows what it is and not its tensors."""

    def _heading(self) -> str:
        """What it is, in a line."""
        raise NotImplementedError

    def _facts(self) -> Facts:
        """What it holds, the most important first."""
        raise NotImplementedError

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


def heading_of(record: Any, *words: str) -> str:
    """'ImpedanceMap 'title': 2 x 3 probes, ...' of the words that say something."""
    name = getattr(getattr(record, "plane", record), "title", "")
    title = f" {name!r}" if name else ""
    return f"{type(record).__name__}{title}: {', '.join(filter(None, words))}"


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


def record_words(record: Any) -> tuple[str, ...]:
    """Probes, samples and height of a plane."""
    tone, height = record.frequency, record.height
    return (
        shape_words(record.probe_shape, "probe"),
        f"{record.samples} samples at {record.sampling_rate:g} Hz ({record.duration:.3g} s)",
        "" if height is None else f"y = {1e3 * height:.3g} mm",
        "" if tone is None else f"tone {tone:g} Hz",
    )


def case_facts(plane: Any) -> Facts:
    """What is stated of a plane: liner, source, flow, reference impedances."""
    level, mach = plane.incident_level, plane.mach
    found = [
        ("liner", plane.liner),
        ("source", plane.source_side),
        ("incident level", "" if level is None else f"{level:g} dB"),
        ("Mach", "" if mach is None else f"{mach:g}"),
        *((f"Z {name}", f"{complex(value):.3f}") for name, value in plane.reference.items()),
    ]
    return [(name, text) for name, text in found if text]
