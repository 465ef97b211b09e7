"""Lined ducts from TOML files: the two facilities of the package and the user's own."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import BeforeValidator, Field
from torch import Tensor

from torchliner import file_checks
from torchliner.checks import noted
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct.case import DuctCase, complex_tensor
from torchliner.duct.field import DuctField
from torchliner.duct.flow_profiles import MeanFlow, ParabolicProfile, TabulatedProfile, TanhProfile, UniformProfile
from torchliner.file_checks import FluidTable, Strict, one_of, preset_or_file, validated
from torchliner.fluid import Fluid
from torchliner.names import CONDITIONS, FLOW_PROFILES, SOURCES, WALLS, __version__
from torchliner.records import MicrophoneLine
from torchliner.text_columns import read_lines, read_table

PACKAGE, KIND = "torchliner.duct", ("duct", ".toml")
VELOCITY, VELOCITY_EXAMPLE = {"y": "length", "u": None}, "y [mm], U [m/s]"


def _pair(value: Any) -> Any:
    """A number, or the two of a list, as a pair, as TOML has complex ones; an infinite one is a rigid wall."""
    if isinstance(value, list):
        return tuple(value)
    if not isinstance(value, (int, float, complex)):
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
    """Table ``[flow]``: ``shear`` of a ``tanh`` profile, ``file`` of a ``table``."""

    profile: Annotated[str, one_of(*FLOW_PROFILES, "table")] = "uniform"
    bulk_mach: float = Field(ge=0, lt=1)
    shear: float | None = Field(None, gt=0)
    file: str | None = None
    slip_condition: Annotated[str, one_of(*CONDITIONS)] | None = None


class SoundTable(Strict):
    """Table ``[sound]``: an impedance a lined patch."""

    frequency: list[Annotated[float, Field(gt=0, allow_inf_nan=False)]] = Field(min_length=1)
    level: float = Field(100.0, ge=0, le=200)
    source_side: Annotated[str, one_of(*SOURCES)] = "upstream"
    impedance: Annotated[list[Wall], BeforeValidator(lambda v: v if isinstance(v, list) else [v])] = Field([])
    end_reflection: Pair = (0.0, 0.0)
    source_reflection: Pair = (0.0, 0.0)


class MicrophoneTable(Strict):
    """Table ``[microphones]``: x, m; by default 50 along the duct."""

    wall: Annotated[str, one_of(*WALLS)] = "opposite"
    x: list[float] = Field([])


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


TABLES: dict[str, Any] = {name: key.annotation for name, key in list(DuctFile.model_fields.items())[3:]}


@dataclass(frozen=True, eq=False)
class DuctSetup:
    """A duct with its sound, its wall and its microphones.

    Args:
        name: of the preset or file.  case: the duct.  frequency: Hz, (F,).
        impedance: Z of each patch, complex128, (S,) or (F, S).
        microphones: x, m, increasing, (N,).  wall: of the microphones, ``opposite`` or ``lined``.
        facts: what the file says, for results.  fluid: gas.  notes: warnings, with numbers.
    """

    name: str
    case: DuctCase
    frequency: Tensor
    impedance: Tensor
    microphones: Tensor
    wall: str
    facts: dict[str, Any]
    fluid: Fluid
    notes: tuple[str, ...] = ()

    def line_of(self, field: DuctField, **known: Any) -> MicrophoneLine:
        """A solved field at the microphones, with its known Z; of several lined patches the line names none.
        ``known``: what else its provenance states."""
        case, wall, plain = self.case, None, None
        start, end = case.liner[0] if len(case.liner) == 1 else (None, None)
        if not callable(field.impedance):  # else Z varies along x
            walls = complex_tensor(field.impedance).detach().cpu().broadcast_to(len(self.frequency), len(case.liner))
            plain = [[[z.real, z.imag] if np.isfinite(z) else "rigid" for z in row] for row in walls.tolist()]
            if start is not None:
                wall = torch.where(walls[:, 0].isfinite(), walls[:, 0], complex(math.nan, math.nan))
        return MicrophoneLine(
            self.microphones,
            field.wall_pressure(self.microphones, self.wall).detach().movedim(-1, -2),
            self.frequency,
            duct_height=case.height,
            mach=case.profile.bulk_mach,
            source_side=field.source,
            liner_start=start,
            liner_end=end,
            wall_impedance=wall,
            fluid=self.fluid,
            title=f"{self.name}, linearised Euler equations",
            provenance={
                "solved": self.facts,
                "plane_mode": field.rows(),
                "impedance": plain,
                "wall": self.wall,
                "unknowns": field.mesh.unknowns,
                "finer_unknowns": field.finer_unknowns,
                "version": __version__,
                **known,
            },
            notes=(*self.notes, *field.notes),
            name=self.name,
        )


def duct_names() -> list[str]:
    """Names of the ducts shipped with the package."""
    return file_checks.preset_names(PACKAGE)


def duct_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit; ValueError if there is none, with the nearest."""
    return file_checks.preset_text(PACKAGE, name, *KIND)


def load_duct(name: str | Path, **changes: Any) -> DuctSetup:
    """A duct by preset name, or from a TOML file.

    Args:
        name: one of ``duct_names()``, or a path that ends in .toml.
        changes: values that replace those of the file, by its keys: ``bulk_mach``, ``frequency``, ``impedance``, ...
    Raises:
        ValueError: no such preset (the nearest is named), a file with mistakes, all of them listed, a duct that cannot
            be.
        FileNotFoundError: no such file.
    """
    content, path = preset_or_file(PACKAGE, name, *KIND)
    owners = {key: table for table, model in TABLES.items() for key in model.model_fields}
    for key, value in changes.items():
        if key not in owners:
            raise ValueError(f"{path}: no key {key!r} to change; there are {', '.join(owners)}")
        content.setdefault(owners[key], {})[key] = value.tolist() if hasattr(value, "tolist") else value
    file = validated(DuctFile, content, path)
    fluid, sound, duct, flow = file.fluid.build(), file.sound, file.duct, file.flow
    try:
        if len(sound.impedance) != len(duct.liner):
            raise ValueError(f"sound has {len(sound.impedance)} impedances for {len(duct.liner)} lined patches")
        with noted() as notes:
            profile = _profile(flow, duct.height, fluid.sound_speed, path.parent)
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
                slip_condition=flow.slip_condition or ("ingard-myers" if float(profile.mach(0.0)) > 0 else None),
            )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    x = torch.tensor(sorted(file.microphones.x), dtype=torch.float64)
    if not len(x):
        x = torch.linspace(case.start, case.end, 50, dtype=torch.float64)
    walls = complex_tensor([math.inf if pair == "rigid" else complex(*pair) for pair in sound.impedance])
    frequency = torch.tensor(sound.frequency, dtype=torch.float64)
    about = (walls, x, file.microphones.wall, file.model_dump(), fluid, tuple(notes))
    return DuctSetup(file.name or path.stem, case, frequency, *about)


def _profile(flow: FlowTable, height: float, sound_speed: float, folder: Path) -> MeanFlow:
    about = (flow.bulk_mach, height)
    if flow.bulk_mach == 0 or flow.profile == "uniform":
        return UniformProfile(*about, sound_speed)
    if flow.profile == "parabolic":
        return ParabolicProfile(*about, sound_speed)
    if flow.profile == "tanh":
        return TanhProfile(*about, flow.shear or 0.1, sound_speed)
    if flow.file is None:
        raise ValueError(f"flow profile 'table' needs file, a CSV of {VELOCITY_EXAMPLE} (any unit of U)")
    table = folder / flow.file
    found = read_table(read_lines(table), VELOCITY, table, example=VELOCITY_EXAMPLE)
    return TabulatedProfile(found["y"], found["u"], height, flow.bulk_mach, sound_speed)
