"""Lined ducts from TOML files: the two facilities of the package and the user's own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import BeforeValidator, Field
from torch import Tensor

from torchliner import toml_files
from torchliner.checks import noted
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct import flow_profiles
from torchliner.duct.case import DuctCase
from torchliner.duct.doubts import doubt_sound
from torchliner.duct.tables import TabulatedProfile, Z, tabulated_wall, velocity_table
from torchliner.fluid import Fluid
from torchliner.names import CONDITIONS, FLOW_PROFILES, SOURCES, WALLS
from torchliner.toml_files import FluidTable, Strict, one_of, preset_or_file, validated

PACKAGE, KIND = "torchliner.duct", ("duct", ".toml")
MOST_MICROPHONES = 10_000


@dataclass(frozen=True, eq=False)
class DuctSetup:
    """A duct with its sound, its wall and its microphones.

    Args:
        name: of the preset or file.  case: the duct.  frequency: Hz, (F,).
        level: of the incident wave, dB re 20 uPa rms.
        impedance: Z of each patch, complex128, (S,) or (F, S), or a function of x and frequency.
        microphones: x, m, (N,); may be empty.  wall: of the microphones, ``opposite`` or ``lined``.
        facts: what the file says, for results.  fluid: gas.  notes: warnings, with numbers.
    """

    name: str
    case: DuctCase
    frequency: Tensor
    level: float
    impedance: Z
    microphones: Tensor
    wall: str
    facts: dict[str, Any]
    fluid: Fluid
    notes: tuple[str, ...] = ()

    @property
    def places(self) -> np.ndarray:
        """x of the microphones, or of 50 places along the duct where the file states none, m."""
        return self.microphones.numpy() if len(self.microphones) else np.linspace(self.case.start, self.case.end, 50)

    @property
    def first_wall(self) -> Any:
        """Z of the first lined patch, () or (F,); inf without one.

        Raises:
            ValueError: the impedance is a profile along x.
        """
        if callable(self.impedance):
            raise ValueError(f"{self.name} has an impedance that varies along x; modes need one: state impedance")
        return self.impedance[..., 0] if self.impedance.numel() else torch.inf


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
    width: float | None = Field(None, gt=0, lt=10)
    start: float
    end: float
    liner: list[Pair] = Field(default_factory=list)


def _subsonic(value: Any) -> Any:
    if isinstance(value, (int, float)) and not 0 <= value < 1:
        raise ValueError("it must be at least 0 and below 1 (a Mach number, not m/s)")
    return value


class FlowTable(Strict):
    """Table ``[flow]``."""

    profile: Annotated[str, one_of(*FLOW_PROFILES, "table")] = "uniform"
    bulk_mach: Annotated[float, BeforeValidator(_subsonic)]
    shear: float | None = Field(None, gt=0)
    allow_thin: bool = False
    file: str | None = None
    slip_condition: Annotated[str, one_of(*CONDITIONS)] | None = None


class SoundTable(Strict):
    """Table ``[sound]``."""

    frequency: list[float] = Field(min_length=1)
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


TABLES: dict[str, Any] = {
    "duct": DuctTable, "flow": FlowTable, "sound": SoundTable, "microphones": MicrophoneTable, "fluid": FluidTable
}  # fmt: skip
PROFILES: dict[str, Callable[..., flow_profiles.MeanFlow]] = {
    "uniform": flow_profiles.UniformProfile,
    "parabolic": flow_profiles.ParabolicProfile,
    "tanh": flow_profiles.TanhProfile,
    "law-of-the-wall": flow_profiles.LawOfTheWallProfile,
}
# What a change of a key takes out of the file: the other way to say it, and the parts of another.
REPLACES = {
    "impedance": ("impedance_file",),
    "impedance_file": ("impedance",),
    "profile": ("shear", "allow_thin", "file"),
}


def duct_names() -> list[str]:
    """Names of the ducts shipped with the package."""
    return toml_files.preset_names(PACKAGE)


def duct_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit.

    Raises:
        ValueError: no such preset; the nearest is named.
    """
    return toml_files.preset_text(PACKAGE, name, *KIND)


def load_duct(name: str | Path, **changes: Any) -> DuctSetup:
    """A duct by preset name, or from a TOML file.

    Args:
        name: one of ``duct_names()``, or a path that ends in .toml.
        changes: values that replace those of the file, by the names of its keys: ``bulk_mach``,
            ``frequency``, ``level``, ``source_side``, ``impedance``, ``shear``, ``profile``, ...;
            complex numbers may be such, one impedance stands for that of the only patch. A new
            ``profile`` drops the parts of the old one, ``impedance`` the ``impedance_file``.
    Raises:
        ValueError: no such preset (the nearest is named), or a file with mistakes: all of them are
            listed; a duct that cannot be.
        FileNotFoundError: no such file.
    """
    content, path = preset_or_file(PACKAGE, name, *KIND)
    owners = {key: table for table, model in TABLES.items() for key in model.model_fields}
    for key, value in changes.items():
        if key not in owners:
            raise ValueError(f"{path}: no key {key!r} to change; there are {', '.join(owners)}")
        value = value.tolist() if isinstance(value, (np.ndarray, Tensor)) else value
        table = content.setdefault(owners[key], {})
        if table.get(key) != value:
            for other in REPLACES.get(key, ()):
                if other not in changes:  # else both were asked for, which is refused further on
                    table.pop(other, None)
        table[key] = value
    file = validated(DuctFile, content, path, TABLES)
    try:
        with noted() as notes:
            setup = _build(file, path)
        return replace(setup, notes=tuple(notes))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _build(file: DuctFile, path: Path) -> DuctSetup:
    fluid, sound, duct = file.fluid.build(), file.sound, file.duct
    profile = _profile(file.flow, duct.height, fluid, path)
    impedance = _impedance(sound, duct, path)
    case = DuctCase(
        profile,
        duct.start,
        duct.end,
        duct.liner,
        source=sound.source_side,
        incident=pressure_amplitude_from_spl(sound.level),
        end_reflection=complex(*sound.end_reflection),
        source_reflection=complex(*sound.source_reflection),
        density=fluid.density,
        slip_condition=file.flow.slip_condition or ("ingard-myers" if float(profile.mach(0.0)) > 0 else None),
    )
    doubt_sound(case, sound.frequency, impedance, duct.width)
    wanted = torch.tensor(sound.frequency, dtype=torch.float64)
    places, facts = _microphones(file.microphones, case), file.model_dump()
    name, wall = file.name or path.stem, file.microphones.wall
    return DuctSetup(name, case, wanted, sound.level, impedance, places, wall, facts, fluid)


def _microphones(table: MicrophoneTable, case: DuctCase) -> Tensor:
    """x, m, (N,); none stated: (0,)."""
    first, last, step = table.first, table.last, table.step
    stated = sum(value is not None for value in (first, last, step))
    if stated not in (0, 3) or (stated and table.x is not None):
        raise ValueError("microphones need first, last and step, or x, not both")
    places = torch.tensor(table.x or [], dtype=torch.float64)
    if first is not None and last is not None and step is not None:
        count = round((last - first) / step) + 1
        if not 1 <= count <= MOST_MICROPHONES:
            raise ValueError(
                f"microphones from {first:g} to {last:g} m in steps of {step:g} m are {count}; 1 to {MOST_MICROPHONES} "
                "are possible"
            )
        places = first + step * torch.arange(count, dtype=torch.float64)
    outside = ((places < case.start) | (places > case.end)).nonzero()[:, 0]
    if len(outside):
        raise ValueError(
            f"microphone {int(outside[0])} at x = {float(places[outside[0]]):g} m lies outside the duct, "
            f"{case.start:g} to {case.end:g} m; move it, or the duct's ends (start, end)"
        )
    return places


def _profile(flow: FlowTable, height: float, fluid: Fluid, path: Path) -> flow_profiles.MeanFlow:
    for kind, key in (("tanh", "shear"), ("tanh", "allow_thin"), ("table", "file")):
        if getattr(flow, key) and flow.profile != kind:
            raise ValueError(f"flow {key} is for profile {kind!r}, not {flow.profile!r}")
    kind = "uniform" if flow.bulk_mach == 0 else flow.profile
    about: dict[str, Any] = {"sound_speed": fluid.sound_speed}
    if kind == "tanh":
        about |= {"shear": flow.shear or 0.1, "allow_thin": flow.allow_thin}
    if kind == "law-of-the-wall":
        about["kinematic_viscosity"] = fluid.kinematic_viscosity
    if kind != "table":
        return PROFILES[kind](flow.bulk_mach, height, **about)
    if flow.file is None:
        raise ValueError("flow profile 'table' needs file, a CSV of y [m] and U (any unit)")
    y, speed = velocity_table(path.parent / flow.file)
    try:
        return TabulatedProfile(y, speed, height, bulk_mach=flow.bulk_mach, **about)
    except ValueError as error:
        raise ValueError(f"{flow.file}: {error}") from error


def _impedance(sound: SoundTable, duct: DuctTable, path: Path) -> Z:
    walls, file, patches = sound.impedance, sound.impedance_file, len(duct.liner)
    if (walls is None) == (file is None) and (patches or file):
        raise ValueError("sound needs either impedance or impedance_file")
    if file is not None:
        if patches == 0:
            raise ValueError("sound has an impedance_file, the duct no liner; state one or leave it out")
        return tabulated_wall(path.parent / file, duct.liner, duct.start, duct.end, sound.frequency)
    values = [math.inf if pair == "rigid" else complex(*pair) for pair in walls or []]
    if len(values) != patches:
        raise ValueError(f"sound has {len(values)} impedances for {patches} lined patches")
    return torch.tensor(values, dtype=torch.complex128)
