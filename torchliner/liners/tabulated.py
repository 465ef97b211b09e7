"""A liner known from a table: Z over frequency, or over frequency and |v|."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, plain_array, real_tensor
from torchliner.file_checks import naming
from torchliner.liners.model import LinerModel, Pitch
from torchliner.text_columns import header_line, read_lines, read_table

COLUMNS = {"frequency": "frequency", "speed": "velocity", "resistance": "impedance", "reactance": "impedance"}
EXAMPLE = "frequency, [speed,] resistance, reactance (Hz, m/s, rho c)"


@dataclass(frozen=True, eq=False)
class TabulatedLiner(LinerModel):
    """Impedance by linear interpolation in a table; nothing is extrapolated.

    Args:
        frequency: Hz, increasing, (N,); a single one stands for itself alone.
        values: Z normalised, complex or pairs (R, X), (N,) if Z does not depend on |v|, else (N, M).
        speed: |v| m/s, increasing from 0, (M,); None for a table over frequency alone.
        cell_pitch: m, for averages over cells.  name: for labels.
    Raises:
        ValueError: shapes disagree, an axis does not increase, values are not finite.
    """

    model = "table"

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
        if tuple(values.shape) == (*wanted, 2):
            values = values[..., 0] + 1j * values[..., 1]
        if tuple(values.shape) != wanted or not bool(torch.isfinite(values).all()):
            raise ValueError(f"{where}: values have shape {tuple(values.shape)}, the axes {wanted}; all are finite")
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
            header = lines[header_line(lines, path)].lower()
            known = {name: kind if re.search(rf"{name}\s*[\[(]", header) else None for name, kind in COLUMNS.items()}
            columns = read_table(lines, known, path, example=EXAMPLE, optional=["speed"])
            frequency, row = np.unique(columns["frequency"], return_inverse=True)
            speed, column = np.unique(columns.get("speed", np.zeros(len(row))), return_inverse=True)
            values = np.full((len(frequency), len(speed)), np.nan, dtype=complex)
            values[row, column] = columns["resistance"] + 1j * columns["reactance"]
            if len(row) != values.size or np.isnan(values).any():
                raise ValueError("each frequency needs one row for each speed")
            axes = (values[:, 0],) if "speed" not in columns else (values, speed)
            return cls(frequency, *axes, **options)

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
        outside = value[~((value >= low - 1e-9 * high) & (value <= high * (1 + 1e-9)))]
        if len(outside):
            asked = f"table {self.name!r}: {name} is {float(outside[0]):g} {unit}"
            raise ValueError(f"{asked}, outside the table's {low:g}-{high:g} {unit}")


def _bracket(axis: Tensor, value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Both neighbours and the share of the step between them, clamped to the axis."""
    if len(axis) == 1:
        return 0 * value.long(), 0 * value.long(), 0 * value
    index = (torch.searchsorted(axis, value.contiguous(), right=True) - 1).clamp(0, len(axis) - 2)
    share = (value - axis[index]) / (axis[index + 1] - axis[index])
    return index, index + 1, share.clamp(0, 1)
