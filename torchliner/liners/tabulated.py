"""A liner known from a table: Z over frequency, or over frequency and |v|."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, plain_array, real_tensor, tell
from torchliner.file_checks import naming
from torchliner.liners.model import LinerModel
from torchliner.liners.parameters import Pitch
from torchliner.text_columns import Array, Column, cells_of, number_of, read_columns, read_lines, separator_of

COLUMNS = {"frequency": "frequency", "speed": "velocity", "resistance": "impedance", "reactance": "impedance"}


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
    file_keys: ClassVar = {
        "file": (str | None, None),
        "cell_pitch": (float | None, None),
        **dict.fromkeys(COLUMNS, (list[Any] | None, None)),
    }

    frequency: Any
    values: Any
    speed: Any = None
    cell_pitch: Pitch = None
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"table {self.name!r}"
        frequency = real_tensor(self.frequency).reshape(-1)
        speed = None if self.speed is None else real_tensor(self.speed).reshape(-1)
        values = self.values
        if not isinstance(values, Tensor):  # a list of complex would become complex64
            values = torch.from_numpy(np.array(plain_array(values, f"{where}: values"), dtype=np.complex128))
        values = values.to(torch.complex128)
        wanted = (len(frequency),) if speed is None else (len(frequency), len(speed))
        if tuple(values.shape) != wanted:
            raise ValueError(f"{where}: values have shape {tuple(values.shape)}, the axes {wanted}")
        if not bool(torch.isfinite(torch.view_as_real(values)).all()):
            raise ValueError(f"{where} holds values that are not finite")
        for label, axis, fewest in (("frequency", frequency, 1), ("speed", speed, 2)):
            if axis is not None and (len(axis) < fewest or not bool((axis.diff() > 0).all())):
                raise ValueError(f"{where}: {label} must increase; values needed: {fewest} or more")
        if speed is not None and float(speed[0]) != 0:
            raise ValueError(f"{where}: speed starts at {float(speed[0]):g}, not at 0")
        for name, value in (("frequency", frequency), ("values", values), ("speed", speed)):
            object.__setattr__(self, name, value)

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
    def read_csv(cls, path: str | Path, **options: Any) -> Self:
        """Read columns ``frequency, resistance, reactance`` or ``frequency, speed, ...``.

        One header row with these names in lower case, commas or semicolons between the cells, no remarks; other
        columns are passed over. Units Hz, m/s and rho c. Rows over frequency and speed form a full grid in any order.

        Raises:
            ValueError: a missing column, a value that is no number (with its line), a gap or a
                repetition in the grid.
        """
        options.setdefault("name", Path(path).stem)
        with naming(path):
            columns = _read_columns(Path(path))
            frequency, row = np.unique(columns["frequency"], return_inverse=True)
            speed, column = np.unique(columns.get("speed", np.zeros(len(row))), return_inverse=True)
            values = np.full((len(frequency), len(speed)), np.nan, dtype=complex)
            values[row, column] = columns["resistance"] + 1j * columns["reactance"]
            gaps = np.argwhere(np.isnan(values))
            if len(row) > values.size - len(gaps):
                raise ValueError(f"{len(row) - values.size + len(gaps)} row(s) repeat a frequency and speed")
            if len(gaps):
                f, v = frequency[gaps[0][0]], speed[gaps[0][1]]
                raise ValueError(f"no row for {f:g} Hz and {v:g} m/s; the grid is full")
            if "speed" not in columns:
                return cls(frequency, values[:, 0], **options)
            return cls(frequency, values, speed, **options)

    @classmethod
    def from_file(cls, keys: Mapping[str, Any], folder: Path) -> Self:
        """See ``LinerModel``: a CSV beside the file, or the numbers as ``describe`` has them."""
        about = {name: keys[name] for name in ("name", "cell_pitch")}
        frequency, speed, *parts = (keys[name] for name in COLUMNS)
        if keys["file"] is not None and not any((frequency, speed, *parts)):
            return cls.read_csv(folder / keys["file"], **about)
        if keys["file"] is not None or frequency is None or None in parts:
            raise ValueError(
                "a table is file, a .csv beside this one, or frequency, resistance "
                "and reactance, with speed where they depend on it"
            )
        arrays = [plain_array(part, name) for part, name in zip(parts, ("resistance", "reactance"), strict=True)]
        real, imaginary = (real_tensor(array).numpy() for array in arrays)
        if real.shape != imaginary.shape:
            raise ValueError(f"resistance has shape {real.shape}, reactance {imaginary.shape}; they are of one shape")
        return cls(frequency, real + 1j * imaginary, speed, **about)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance, complex128, of the broadcast shape.

        Args:
            frequency: Hz, within the table.  speed: |v| m/s, within the table.
        Raises:
            ValueError: outside the table; none is given.
        """
        f, v = real_tensor(frequency), real_tensor(speed)
        _require_inside(f, *self.frequency_range, f"table {self.name!r}: frequency", "Hz")
        row, above, across = _bracket(self.frequency, f)
        if self.speed is None:
            flat = self.values[row] * (1 - across) + self.values[above] * across
            return flat.broadcast_to(np.broadcast_shapes(f.shape, v.shape))
        _require_inside(v, 0.0, float(self.speed[-1]), f"table {self.name!r}: |v|", "m/s")
        column, beside, along = _bracket(self.speed, v)
        lower, upper = (self.values[i, column] * (1 - along) + self.values[i, beside] * along for i in (row, above))
        return lower * (1 - across) + upper * across

    def describe(self) -> dict[str, Any]:
        """All of the table, so that a result that holds it can be repeated without its file."""
        values = self.values.detach()
        return {
            "model": self.model,
            "name": self.name,
            "cell_pitch": self.cell_pitch,
            "frequency": self.frequency.tolist(),
            "speed": None if self.speed is None else self.speed.tolist(),
            "resistance": values.real.tolist(),
            "reactance": values.imag.tolist(),
        }

    def facts(self) -> dict[str, Any]:
        """See ``LinerModel``."""
        low, high = self.frequency_range
        return {"model": self.model, "name": self.name, "low": low, "high": high}


def _read_columns(path: Path) -> dict[str, Array]:
    """The columns of a table by name, finite numbers."""
    head, *lines = read_lines(path)
    separator = separator_of(head)
    labels = cells_of(head, separator)
    for name in COLUMNS:
        if labels.count(name) != 1 and (name != "speed" or name in labels):
            state = "named twice" if name in labels else f"missing; there are: {', '.join(labels)}"
            raise ValueError(
                f"column {name!r} is {state}; write frequency, [speed,] resistance, reactance (Hz, m/s, rho c)"
            )
    rows = {number: cells_of(line, separator) for number, line in enumerate(lines, 2) if line.strip()}
    if not rows:
        raise ValueError("it holds no values: the file ends at line 1")
    others = {i: label for i, label in enumerate(labels) if label not in COLUMNS}
    passed_over = [row[i] for row in rows.values() for i in others if i < len(row)]
    if separator == "," and any(number_of(cell) == number_of(cell) for cell in passed_over):
        # A decimal comma shifts the cells of a row by one, into a column that nobody reads.
        names = ", ".join(map(repr, others.values()))
        tell(
            f"{path}: numbers in the columns {names} are passed over; if they stem from decimal commas, part the cells "
            "by semicolons"
        )
    columns = [Column(name, labels.index(name), 1.0, kind) for name, kind in COLUMNS.items() if name in labels]
    return read_columns([*rows.values()], [*rows], columns, path, len(labels), special=(), comma=separator != ",")


def _require_inside(value: Tensor, low: float, high: float, name: str, unit: str) -> None:
    if value.numel() == 0:
        raise ValueError(f"{name} is empty; give at least one, {low:g}-{high:g} {unit}")
    small, large = float(value.min()), float(value.max())
    slack = 1e-9 * high
    if not (low - slack <= small and large <= high + slack):
        worst = small if small < low else large
        raise ValueError(f"{name} is {worst:g} {unit}, outside the table's {low:g}-{high:g} {unit}")


def _bracket(axis: Tensor, value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Both neighbours and the share of the step between them, clamped to the axis."""
    if len(axis) == 1:
        here = torch.zeros_like(value, dtype=torch.int64)
        return here, here, torch.zeros_like(value)
    index = (torch.searchsorted(axis, value.contiguous(), right=True) - 1).clamp(0, len(axis) - 2)
    share = (value - axis[index]) / (axis[index + 1] - axis[index])
    return index, index + 1, share.clamp(0, 1)
