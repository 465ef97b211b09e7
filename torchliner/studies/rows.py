"""What every study returns rows of."""

from __future__ import annotations

from typing import Any

from torchliner.names import resolve


class Row(dict[str, Any]):
    """Values of one place, choice, model or run by name; ``row.impedance`` is ``row["impedance"]``.

    Shared names: ``impedance``, ``low``, ``high`` (ends of its statistical interval; None without one), complex and
    normalised; ``frequency`` (Hz), ``height`` (m), ``level_check`` (dB off the known pressure; None where none is
    known).
    """

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"the row has no {name!r} (it has: {', '.join(self)})") from None


class Study(Row):
    """A result: ``rows``, and by name what they share."""

    def __repr__(self) -> str:
        return self._shown("screen_of") or dict.__repr__(self)

    def _repr_html_(self) -> str | None:
        """For notebooks: the answer and a table."""
        return self._shown("html_of")

    def _shown(self, outlet: str) -> str | None:
        """By the report; None of a kind that it does not know."""
        try:
            found: str = resolve(f"torchliner.report.answer:{outlet}")(self)
        except TypeError:
            return None
        return found

    def of(self, **labels: Any) -> list[Row]:
        """The rows that have these values, e.g. ``found.of(factor="height")``."""
        return [row for row in self.rows if all(getattr(row, name) == value for name, value in labels.items())]
