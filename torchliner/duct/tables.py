"""Tables beside a duct's TOML file: its velocity profile, its impedance along x or over frequency."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import tell
from torchliner.text_columns import Array, read_lines, read_table

VELOCITY, VELOCITY_EXAMPLE = {"y": "length", "u": None}, "y [mm], U [m/s]"
IMPEDANCE = {"x": "length", "frequency": "frequency", "resistance": "number", "reactance": "number"}
IMPEDANCE_EXAMPLE = "x [mm], resistance, reactance"  # or frequency [Hz] in place of x
NEAR = 1e-6  # m; of the frequency

Z = Tensor | Callable[[Tensor, Tensor], Tensor]  # a value each, or a function of x and frequency


def velocity_table(path: Path) -> tuple[Array, Array]:
    """y, m, and U, in any unit, (N,), from a CSV with the columns ``y [mm], U [m/s]``.

    Raises:
        FileNotFoundError: no such file.
        ValueError: other columns, y without a unit, a cell that is no finite number.
    """
    found = read_table(read_lines(path), VELOCITY, path, example=VELOCITY_EXAMPLE, short={"velocity": "u"})
    return found["y"], found["u"]


def tabulated_wall(
    path: Path, liner: Sequence[tuple[float, float]], start: float, end: float, frequencies: Sequence[float]
) -> Z:
    """Z(x) of a CSV with the columns ``x [mm], resistance, reactance``, or Z at frequencies of one over ``frequency``.

    ``R`` and ``X`` are short for the latter two, in capitals; inf is rigid. Between its rows Z is linear in the
    admittance.

    Args:
        liner: edges of the lined patches, m.  start, end: of the duct, m.  frequencies: Hz, (F,).
    Returns:
        A function of x and frequency, or (F, S) for S patches.
    Raises:
        FileNotFoundError: no such file.
        ValueError: other columns, x without a unit, a cell that is no number, stations outside the
            duct, or all of them before or behind a lined patch; as ``impedance_along``; a frequency outside the table.
    Warns:
        DataWarning: stations that end within a lined patch: Z is constant beyond the last.
    """
    found = read_table(
        read_lines(path),
        IMPEDANCE,
        path,
        example=IMPEDANCE_EXAMPLE,
        short={"R": "resistance", "X": "reactance"},
        special=("resistance", "reactance"),
        optional=("x", "frequency"),
    )
    if ("x" in found) == ("frequency" in found):
        raise ValueError(f"{path} needs x or frequency, one of them; write {IMPEDANCE_EXAMPLE}")
    walls = np.empty(len(found["resistance"]), np.complex128)  # a sum with 1j inf would be nan
    walls.real, walls.imag = found["resistance"], found["reactance"]
    places = found.get("x", found.get("frequency"))
    try:
        between = impedance_along(places, walls)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    low, high = float(places[0]), float(places[-1])
    if "frequency" in found:
        for f in frequencies:
            if not low * (1 - NEAR) <= f <= high * (1 + NEAR):
                raise ValueError(f"{path.name}: {f:g} Hz lies outside its table, {low:g} to {high:g} Hz")
        wanted = torch.tensor(frequencies, dtype=torch.float64)
        return between(wanted, wanted[:1]).mT.expand(-1, len(liner))
    stations = f"{path}: its stations, x = {low:g} to {high:g} m,"
    if low < start - NEAR or high > end + NEAR:
        raise ValueError(f"{stations} leave the duct, {start:g} to {end:g} m; is their unit right?")
    for first, last in liner:
        where = f"the lined patch, x = {first:g} to {last:g} m"
        if low > last or high < first:
            raise ValueError(f"{stations} do not reach {where}; is their unit right?")
        if low > first + NEAR or high < last - NEAR:
            tell(f"{stations} do not span {where}; beyond them Z is taken as at the last one")
    return between


def impedance_along(x: Any, impedance: Any) -> Callable[[Tensor, Tensor], Tensor]:
    """Z(x) at all frequencies: linear in the admittance between stations, constant beyond them.

    Args:
        x: m, increasing, (N,).
        impedance: Z there, (N,); inf is a rigid station, between two of which the wall is rigid.
    Raises:
        ValueError: x does not increase, lengths differ, or a Z is nan or 0, whose admittance has no
            bound to interpolate from.
    """
    places, values = np.asarray(x, np.float64), np.asarray(impedance, np.complex128)
    if places.ndim != 1 or places.shape != values.shape or len(places) < 1:
        raise ValueError(f"x has shape {places.shape}, impedance {values.shape}; both are (N,)")
    if (np.diff(places) <= 0).any():
        raise ValueError("the stations of an impedance profile must increase along x")
    faulty = (values == 0) | np.isnan(values)
    if faulty.any():
        raise ValueError(
            f"the impedance profile is {values[faulty][0].real:g} at x = {places[faulty][0]:g} m, which has no "
            "admittance to interpolate; write a small resistance, as 0.001, for a soft wall and inf for a rigid one"
        )
    rigid = np.isinf(values)
    admittance = np.where(rigid, 0, 1 / np.where(rigid, 1, values))

    def along(at: Tensor, frequency: Tensor) -> Tensor:
        wanted = at.detach().cpu().numpy()
        found = np.interp(wanted, places, admittance)
        hard = found == 0
        z = np.where(hard, np.inf, 1 / np.where(hard, 1, found))
        return torch.as_tensor(z).expand(len(frequency), len(wanted))

    return along
