"""A liner known from a table: Z over frequency, or over frequency and |v|."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, make_plain, plain_array, real_tensor, tell
from torchliner.file_checks import naming
from torchliner.liners.model import LinerModel
from torchliner.text_columns import Array, Column, number_of, read_columns
from torchliner.toml_files import read_text

COLUMNS = {"frequency": "frequency", "speed": "velocity", "resistance": "impedance",
           "reactance": "impedance"}  # fmt: skip
EXAMPLE = "frequency, [speed,] resistance, reactance (Hz, m/s, rho c)"


@dataclass(frozen=True, eq=False)
class TabulatedLiner(LinerModel):
    """Impedance by linear interpolation in a table; nothing is extrapolated.

    Args:
        frequency: Hz, increasing, (N,); a single one stands for itself alone.
        values: Z normalised, complex, (N,) if Z does not depend on |v|, else (N, M).
        speed: |v| m/s, increasing from 0, (M,); None for a table over frequency alone.
        cell_pitch: m, for averages over cells.  name: for labels.
    Raises:
        ValueError: shapes disagree, an axis does not increase, values are not finite.
    """

    model = "table"

    frequency: Any
    values: Any
    speed: Any = None
    cell_pitch: float | None = None
    name: str = "table"

    def __post_init__(self) -> None:
        make_plain(self)
        frequency = real_tensor(self.frequency).reshape(-1)
        values = self.values
        if not isinstance(values, Tensor):  # a list of complex would become complex64
            values = torch.from_numpy(
                np.array(plain_array(values, f"table {self.name!r}: values"), dtype=np.complex128)
            )
        values = values.to(torch.complex128)
        speed = None if self.speed is None else real_tensor(self.speed).reshape(-1)
        wanted = (len(frequency),) if speed is None else (len(frequency), len(speed))
        if tuple(values.shape) != wanted:
            raise ValueError(f"table {self.name!r}: values have shape {tuple(values.shape)}, the axes {wanted}")
        if not bool(torch.isfinite(values.real).all() and torch.isfinite(values.imag).all()):
            raise ValueError(f"table {self.name!r} holds values that are not finite")
        for label, axis in (("frequency", frequency), ("speed", speed)):
            fewest = 1 if label == "frequency" else 2
            if axis is not None and (len(axis) < fewest or not bool((axis.diff() > 0).all())):
                least = f" and have at least {fewest} value{'s' * (fewest > 1)}"
                raise ValueError(f"table {self.name!r}: {label} must increase{least}")
        if speed is not None and float(speed[0]) != 0:
            raise ValueError(f"table {self.name!r}: speed starts at {float(speed[0]):g}, not at 0")
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "speed", speed)

    @property
    def frequency_range(self) -> tuple[float, float]:
        """First and last frequency, Hz; about a single one by as much as makes no difference."""
        slack = SAME_FREQUENCY if len(self.frequency) == 1 else 0.0
        return (1 - slack) * float(self.frequency[0]), (1 + slack) * float(self.frequency[-1])

    @property
    def speed_max(self) -> float | None:
        """Last speed, m/s; None if Z does not depend on it."""
        return None if self.speed is None else float(self.speed[-1])

    @property
    def speed_kinks(self) -> tuple[float, ...]:
        """All speeds of the table, m/s."""
        return () if self.speed is None else tuple(self.speed.tolist())

    @classmethod
    def read_csv(cls, path: str | Path, **options: Any) -> TabulatedLiner:
        """Read columns ``frequency, resistance, reactance`` or ``frequency, speed, ...``.

        One header row with these names in lower case, commas or semicolons between the cells,
        decimal points, no remarks; other columns are passed over. Units Hz, m/s and rho c. Rows
        over frequency and speed form a full grid in any order.

        Raises:
            ValueError: a missing column, a value that is no number (with its line), a gap or a
                repetition in the grid.
        """
        options.setdefault("name", Path(path).stem)
        with naming(path):
            return cls._from_columns(_read_columns(Path(path)), path, **options)

    @classmethod
    def _from_columns(cls, columns: dict[str, Array], path: str | Path, **options: Any) -> TabulatedLiner:
        wall = columns["resistance"] + 1j * columns["reactance"]
        if "speed" not in columns:
            order = columns["frequency"].argsort(kind="stable")
            return cls(columns["frequency"][order], wall[order], **options)
        rows = list(zip(columns["frequency"].tolist(), columns["speed"].tolist(), strict=True))
        frequency, speed = (sorted(set(axis)) for axis in zip(*rows, strict=True))
        found = dict(zip(rows, wall.tolist(), strict=True))
        if len(found) < len(rows):
            raise ValueError(f"{path}: {len(rows) - len(found)} row(s) repeat a frequency and speed")
        for f in frequency:
            for v in speed:
                if (f, v) not in found:
                    raise ValueError(f"{path}: no row for {f:g} Hz and {v:g} m/s; the grid is full")
        return cls(frequency, [[found[f, v] for v in speed] for f in frequency], speed, **options)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance, complex128, of the broadcast shape.

        Args:
            frequency: Hz, within the table.  speed: |v| m/s, within the table.
        Raises:
            ValueError: outside the table; none is given.
        """
        f, v = real_tensor(frequency), real_tensor(speed)
        low, high = self.frequency_range
        _require_inside(f, low, high, f"table {self.name!r}: frequency", "Hz")
        row, across = _bracket(self.frequency, f)
        above = (row + 1).clamp(max=len(self.frequency) - 1)
        if self.speed is None:
            flat = self.values[row] * (1 - across) + self.values[above] * across
            return flat.broadcast_to(np.broadcast_shapes(f.shape, v.shape))
        _require_inside(v, 0.0, float(self.speed[-1]), f"table {self.name!r}: |v|", "m/s")
        column, along = _bracket(self.speed, v)
        lower, upper = (self.values[i, column] * (1 - along) + self.values[i, column + 1] * along for i in (row, above))
        return lower * (1 - across) + upper * across

    def describe(self) -> dict[str, Any]:
        """All of the table, so that a result that holds it can be repeated without its file."""
        values = self.values.detach()
        return {
            "model": self.model, "name": self.name, "cell_pitch": self.cell_pitch,
            "frequency": self.frequency.tolist(),
            "speed": None if self.speed is None else self.speed.tolist(),
            "resistance": values.real.tolist(), "reactance": values.imag.tolist(),
        }  # fmt: skip

    def facts(self) -> dict[str, Any]:
        """See ``LinerModel``."""
        low, high = self.frequency_range
        return {"model": self.model, "name": self.name, "low": low, "high": high}


def _read_columns(path: Path) -> dict[str, Array]:
    """The columns of a table by name, finite numbers."""
    text = read_text(path)
    separator = ";" if ";" in text.partition("\n")[0] else ","
    reader = csv.reader(StringIO(text), delimiter=separator, skipinitialspace=True)
    with naming(path):
        labels = [label.strip() for label in next(reader, [])]
        rows = [([cell.strip() for cell in row], reader.line_num) for row in reader if row]
    for name in COLUMNS:
        if labels.count(name) != 1 and (name != "speed" or name in labels):
            state = "named twice" if name in labels else f"missing; there are: {', '.join(labels)}"
            raise ValueError(f"{path}: column {name!r} is {state}; write {EXAMPLE}")
    if not rows:
        raise ValueError(f"{path} holds no values: the file ends at line 1")
    others = {i: label for i, label in enumerate(labels) if label not in COLUMNS}
    if separator == "," and any(
        number_of(cell) == number_of(cell) for row, _ in rows for i, cell in enumerate(row) if i in others
    ):
        # A decimal comma shifts the cells of a row by one, into a column that nobody reads.
        tell(
            f"{path}: numbers in the columns {', '.join(map(repr, others.values()))} are passed "
            "over; if they stem from decimal commas, part the cells by semicolons and write points"
        )
    cells, numbers = zip(*rows, strict=True)
    columns = [Column(name, labels.index(name), 1.0, COLUMNS[name]) for name in COLUMNS
               if name in labels]  # fmt: skip
    return read_columns(cells, numbers, columns, path, len(labels), special=(), comma=False)


def _require_inside(value: Tensor, low: float, high: float, name: str, unit: str) -> None:
    if value.numel() == 0:
        raise ValueError(f"{name} is empty; give at least one, {low:g}-{high:g} {unit}")
    small, large = float(value.min()), float(value.max())
    slack = 1e-9 * high
    if not (low - slack <= small and large <= high + slack):
        worst = small if small < low else large
        raise ValueError(f"{name} is {worst:g} {unit}, outside the table's {low:g}-{high:g} {unit}")


def _bracket(axis: Tensor, value: Tensor) -> tuple[Tensor, Tensor]:
    """Lower neighbour and share of the step, clamped to the axis."""
    if len(axis) == 1:
        return torch.zeros_like(value, dtype=torch.int64), torch.zeros_like(value)
    index = (torch.searchsorted(axis, value.contiguous(), right=True) - 1).clamp(0, len(axis) - 2)
    share = (value - axis[index]) / (axis[index + 1] - axis[index])
    return index, share.clamp(0, 1)
