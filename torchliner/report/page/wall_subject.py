"""What a page of eductions from microphones is about: them, what tells them apart, the frequencies
that are drawn, and what is known of the wall."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from torchliner.checks import index_of_frequency
from torchliner.records import MicrophoneLine
from torchliner.report.page.blocks import shown
from torchliner.report.page.subject import MOST_DRAWN
from torchliner.report.wall_table import Educed, Row, _interval, wall_rows

LABELS = ((0,), (1,), (2,), (1, 0), (0, 2), (1, 0, 2))  # parts of a label, the fewest first


@dataclass(frozen=True)
class WallSubject:
    """Eductions, each of a line and a method, and the file they were read from.

    Raises:
        ValueError: an eduction without its line, or of several lines.
    """

    found: Sequence[Educed]
    path: Path | None = None

    @functools.cached_property
    def lines(self) -> list[MicrophoneLine]:
        """Microphones of each."""
        return [one.source_line for one in self.found]

    @functools.cached_property
    def labels(self) -> list[str]:
        """As few words as tell the eductions apart, the method among them if there are several."""
        parts = [
            (
                f"source {one.source_side}",
                shown(line.title or Path(line.name).stem),
                shown(one.method),
            )
            for one, line in zip(self.found, self.lines, strict=True)
        ]
        several = len({one.method for one in self.found}) > 1
        for chosen in LABELS:
            if several and 2 not in chosen:
                continue
            texts = [", ".join(each[i] for i in chosen) for each in parts]
            if len(set(texts)) == len(texts):
                return texts
        return [f"{text}, {number}" for number, text in enumerate(texts, 1)]

    @property
    def drawable(self) -> list[str]:
        """The labels as text, not as formulas of the drawing library."""
        return [label.replace("$", r"\$") for label in self.labels]

    @functools.cached_property
    def rows(self) -> list[list[Row]]:
        """Of the table of each, with its label; bounds that are not known are None."""
        return [
            [row | {"label": label} | dict(zip(("low", "high"), _interval(row) or (None, None),
                                               strict=True))
             for row in wall_rows(line, one)]
            for line, one, label in zip(self.lines, self.found, self.labels, strict=True)
        ]  # fmt: skip

    def at(self, frequency: float) -> list[int | None]:
        """Index of a frequency in each; None where it has none."""
        return [index_of_frequency(one.frequency, frequency) for one in self.found]

    @functools.cached_property
    def common(self) -> list[float]:
        """Frequencies of all, Hz; those of the first where they share none."""
        mine = self.found[0].frequency.tolist()
        return [f for f in mine if None not in self.at(f)] or mine

    @functools.cached_property
    def main(self) -> float:
        """The frequency, of those where all have an impedance, at which the worst fitted is fitted
        best, Hz."""

        def residual(frequency: float) -> float:
            there = [(self.found[i], f) for i, f in self.there(frequency)]
            if not all(bool(torch.isfinite(one.impedance[f])) for one, f in there):
                return torch.inf
            worst = max(float(one.residual[f]) for one, f in there)
            return worst if worst == worst else torch.inf

        return min(self.common, key=residual)

    @property
    def drawn(self) -> list[float]:
        """Frequencies with figures of their own, Hz."""
        return self.common if len(self.common) <= MOST_DRAWN else [self.main]

    def there(self, frequency: float) -> list[tuple[int, int]]:
        """Number of each eduction that has a frequency, and its index there."""
        return [(i, f) for i, f in enumerate(self.at(frequency)) if f is not None]

    def known(self, number: int, f: int) -> dict[str, complex]:
        """Impedances of the case of one eduction that are known from elsewhere.

        Those that a line names stand for its tone: they are taken where it has one alone.
        """
        line = self.lines[number]
        named = line.reference if len(line.frequency) == 1 else {}
        known = {shown(name): complex(z) for name, z in named.items()}
        wall = None if line.wall_impedance is None else complex(line.wall_impedance[f])
        return known if wall is None or wall != wall else known | {"the solved wall": wall}
