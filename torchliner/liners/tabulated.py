"""A liner known from a table: Z over frequency, or over frequency and |v|."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, plain_array, real_tensor
from torchliner.file_checks import naming
from torchliner.liners.model import LinerModel, Pitch
from torchliner.text_columns import LABEL, cells_of, header_line, read_lines, read_table, separator_of

COLUMNS: dict[str, str | None] = {
    "frequency": "frequency",
    "speed": "velocity",
    "resistance": "impedance",
    "reactance": "impedance",
}
UNITS = {"frequency": "Hz", "speed": "m/s", "resistance": "rho c", "reactance": "rho c"}  # where the header has none
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
    file_keys: ClassVar = ("file", "cell_pitch", *COLUMNS)

    frequency: Any
    values: Any
    speed: Any = None
    cell_pitch: Pitch = None
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        where, values = f"table {self.name!r}", self.values
        if not isinstance(values, Tensor):  # a list of complex would become complex64
            values = torch.from_numpy(np.array(plain_array(values, f"{where}: values"), dtype=np.complex128))
        axes = {"frequency": self.frequency} | ({} if self.speed is None else {"speed": self.speed})
        axes = {label: real_tensor(axis).reshape(-1) for label, axis in axes.items()}
        wanted = tuple(map(len, axes.values()))
        if tuple(values.shape) != wanted:
            raise ValueError(f"{where}: values have shape {tuple(values.shape)}, the axes {wanted}")
        if not bool(torch.isfinite(values).all()):
            raise ValueError(f"{where} holds values that are not finite")
        for (label, axis), fewest in zip(axes.items(), (1, 2), strict=False):
            if len(axis) < fewest or not bool((axis.diff() > 0).all()):
                raise ValueError(f"{where}: {label} must increase; values needed: {fewest} or more")
        slack = SAME_FREQUENCY if len(axes["frequency"]) == 1 else 0.0  # by as much as makes no difference
        low, high = axes["frequency"][0].item(), axes["frequency"][-1].item()
        self.settle(**axes, values=values.to(torch.complex128), frequency_range=((1 - slack) * low, (1 + slack) * high))
        if "speed" in axes:
            if axes["speed"][0] != 0:
                raise ValueError(f"{where}: speed starts at {float(axes['speed'][0]):g}, not at 0")
            self.settle(speed_max=axes["speed"][-1].item(), speed_kinks=tuple(axes["speed"].tolist()))

    @classmethod
    def read_csv(cls, path: str | Path, **options: Any) -> Self:
        """Read columns ``frequency, [speed,] resistance, reactance``, in Hz, m/s and rho c unless the header says
        otherwise, as in ``frequency [kHz]``; rows over frequency and speed are a full grid in any order.

        Raises:
            ValueError: a missing column, a value that is no number (with its line), a gap or a repetition in the grid.
        """
        options.setdefault("name", Path(path).stem)
        with naming(path):
            lines = read_lines(path)
            start = header_line(lines, path)
            separator = separator_of(lines[start])
            labels = cells_of(lines[start], separator)
            stated = [f"{label} [{UNITS[label.lower()]}]" if label.lower() in UNITS else label for label in labels]
            lines[start] = separator.join(stated)
            words = [(found[1] if (found := LABEL.fullmatch(label)) else label).lower() for label in labels]
            others = set(words) - set(COLUMNS)
            columns = read_table(lines, COLUMNS, path, example=EXAMPLE, optional=["speed"], others=others)
            frequency, row = np.unique(columns["frequency"], return_inverse=True)
            speed, column = np.unique(columns.get("speed", np.zeros(len(row))), return_inverse=True)
            values, times = np.zeros((2, len(frequency), len(speed)), dtype=complex)
            values[row, column] = columns["resistance"] + 1j * columns["reactance"]
            np.add.at(times, (row, column), 1)
            if (times.real > 1).any():
                raise ValueError(f"{len(row) - np.count_nonzero(times)} row(s) repeat a frequency and speed")
            for f, v in np.argwhere(times == 0)[:1]:
                raise ValueError(f"no row for {frequency[f]:g} Hz and {speed[v]:g} m/s; the grid is full")
            axes = (values[:, 0],) if "speed" not in columns else (values, speed)
            return cls(frequency, *axes, **options)

    @classmethod
    def from_file(cls, keys: Mapping[str, Any], folder: Path) -> Self:
        """See ``LinerModel``: a CSV beside the file, or the numbers as ``describe`` has them."""
        about: dict[str, Any] = {name: keys.get(name) for name in ("name", "cell_pitch")}
        file, frequency, speed, *parts = (keys.get(name) for name in ("file", *COLUMNS))
        if file is not None and not any((frequency, speed, *parts)):
            return cls.read_csv(folder / file, **about)
        if file is not None or frequency is None or None in parts:
            raise ValueError("a table is file, a .csv beside this one, or frequency, [speed,] resistance and reactance")
        real, imaginary = (real_tensor(part, name=name) for part, name in zip(parts, [*COLUMNS][2:], strict=True))
        if real.shape != imaginary.shape:
            raise ValueError(f"resistance has shape {tuple(real.shape)}, reactance {tuple(imaginary.shape)}")
        return cls(frequency, torch.complex(real, imaginary), speed, **about)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance, complex128, of the broadcast shape of frequency (Hz) and |v| (m/s); ValueError outside
        the table."""
        f, v = torch.broadcast_tensors(real_tensor(frequency), real_tensor(speed))
        assert self.frequency_range is not None
        self._require_inside(f, *self.frequency_range, "frequency", "Hz")
        if self.speed is not None:
            self._require_inside(v, 0.0, self.speed_max or 0.0, "|v|", "m/s")
        values = self.values.reshape(len(self.frequency), -1)
        column, beside, along = _bracket(torch.zeros(1) if self.speed is None else self.speed, v)
        row, above, across = _bracket(self.frequency, f)
        lower, upper = (values[i, column] * (1 - along) + values[i, beside] * along for i in (row, above))
        found: Tensor = lower * (1 - across) + upper * across
        return found

    def _require_inside(self, value: Tensor, low: float, high: float, name: str, unit: str) -> None:
        name = f"table {self.name!r}: {name}"
        if value.numel() == 0:
            raise ValueError(f"{name} is empty; give at least one, {low:g}-{high:g} {unit}")
        outside = value[~((value >= low - 1e-9 * high) & (value <= high * (1 + 1e-9)))]
        if len(outside):
            raise ValueError(f"{name} is {float(outside[0]):g} {unit}, outside the table's {low:g}-{high:g} {unit}")

    def describe(self) -> dict[str, Any]:
        """All of the table."""
        parts = {"resistance": self.values.real, "reactance": self.values.imag}
        axes = {"frequency": self.frequency, "speed": self.speed}
        numbers = {name: None if value is None else value.tolist() for name, value in (axes | parts).items()}
        return {"model": self.model, "name": self.name, "cell_pitch": self.cell_pitch, **numbers}


def _bracket(axis: Tensor, value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Both neighbours and the share of the step between them, clamped to the axis."""
    if len(axis) == 1:
        return 0 * value.long(), 0 * value.long(), 0 * value
    index = (torch.searchsorted(axis, value.contiguous(), right=True) - 1).clamp(0, len(axis) - 2)
    share = (value - axis[index]) / (axis[index + 1] - axis[index])
    return index, index + 1, share.clamp(0, 1)
