"""Tables of a duct's TOML file, and the CSV of its wall."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from torchliner.checks import tell
from torchliner.duct.case import Z, impedance_along
from torchliner.file_checks import FluidTable, Strict, one_of
from torchliner.names import CONDITIONS, FLOW_PROFILES, SOURCES, WALLS
from torchliner.text_columns import read_lines, read_table

IMPEDANCE = {"x": "length", "resistance": "number", "reactance": "number"}
IMPEDANCE_EXAMPLE = "x [mm], resistance, reactance"
NEAR = 1e-6  # m


def _pair(value: Any) -> Any:
    """A number, or the two of a list, as a pair, as TOML has complex ones; an infinite one is a rigid wall."""
    if isinstance(value, list):
        return tuple(value)
    if not isinstance(value, (int, float, complex, np.number)):
        return value
    z = complex(value)
    return "rigid" if math.isinf(abs(z)) else (z.real, z.imag)


Pair = Annotated[tuple[float, float], BeforeValidator(_pair)]
Wall = Annotated[tuple[float, float] | Literal["rigid"], BeforeValidator(_pair)]


class DuctTable(Strict):
    """Table ``[duct]``, m."""

    height: float = Field(gt=0, lt=10)
    start: float
    end: float
    liner: list[Pair] = Field(default_factory=list)


class FlowTable(Strict):
    """Table ``[flow]``."""

    profile: Annotated[str, one_of(*FLOW_PROFILES, "table")] = "uniform"
    bulk_mach: float = Field(ge=0, lt=1)
    shear: float | None = Field(None, gt=0)
    allow_thin: bool = False
    file: str | None = None
    slip_condition: Annotated[str, one_of(*CONDITIONS)] | None = None


class SoundTable(Strict):
    """Table ``[sound]``."""

    frequency: list[Annotated[float, Field(gt=0, allow_inf_nan=False)]] = Field(min_length=1)
    level: float = Field(100.0, ge=0, le=200)
    source_side: Annotated[str, one_of(*SOURCES)] = "upstream"
    impedance: Annotated[list[Wall], BeforeValidator(lambda v: v if isinstance(v, list | tuple) else [v])] | None = None
    impedance_file: str | None = None
    end_reflection: Pair = (0.0, 0.0)
    source_reflection: Pair = (0.0, 0.0)


class MicrophoneTable(Strict):
    """Table ``[microphones]``: x one by one, or from first to last in steps, m."""

    wall: Annotated[str, one_of(*WALLS)] = "opposite"
    x: list[float] | None = None
    first: float | None = None
    last: float | None = None
    step: float | None = Field(None, gt=0)


class DuctFile(Strict):
    """A whole file."""

    name: str | None = None
    description: str = ""
    source: str = ""
    duct: DuctTable
    flow: FlowTable
    sound: SoundTable
    microphones: MicrophoneTable = MicrophoneTable()
    fluid: FluidTable = FluidTable()


TABLES: dict[str, Any] = {name: key.annotation for name, key in DuctFile.model_fields.items()}
TABLES = {name: table for name, table in TABLES.items() if isinstance(table, type) and issubclass(table, Strict)}


def wall_from_table(path: Path, duct: DuctTable) -> Z:
    """Z(x) of a CSV ``x [mm], resistance, reactance``, linear in the admittance; inf is rigid. Warns of stations that
    end within a lined patch: Z is constant beyond the last."""
    short, special = {"R": "resistance", "X": "reactance"}, ("resistance", "reactance")
    found = read_table(read_lines(path), IMPEDANCE, path, example=IMPEDANCE_EXAMPLE, short=short, special=special)
    walls = np.empty(len(found["resistance"]), np.complex128)  # a sum with 1j inf would be nan
    walls.real, walls.imag = found["resistance"], found["reactance"]
    try:
        between = impedance_along(found["x"], walls)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    low, high = float(found["x"][0]), float(found["x"][-1])
    stations = f"{path}: its stations, x = {low:g} to {high:g} m,"
    if low < duct.start - NEAR or high > duct.end + NEAR:
        raise ValueError(f"{stations} leave the duct, {duct.start:g} to {duct.end:g} m; is their unit right?")
    for first, last in duct.liner:
        if low > first + NEAR or high < last - NEAR:
            tell(f"{stations} do not span the lined patch, x = {first:g} to {last:g} m; Z is constant beyond them")
    return between
