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
from torchliner.checks import noted, tell
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct.case import DuctCase, Z, complex_tensor, impedance_along
from torchliner.duct.field import DuctField
from torchliner.duct.flow_profiles import MeanFlow, ParabolicProfile, TabulatedProfile, TanhProfile, UniformProfile
from torchliner.file_checks import FluidTable, Strict, one_of, preset_or_file, validated
from torchliner.fluid import Fluid
from torchliner.names import CONDITIONS, FLOW_PROFILES, SOURCES, WALLS, __version__
from torchliner.records import MicrophoneLine
from torchliner.text_columns import read_lines, read_table

PACKAGE, KIND = "torchliner.duct", ("duct", ".toml")
MOST_MICROPHONES = 10_000
PARTS = ("resistance", "reactance")
NEAR = 1e-6  # m
VELOCITY, VELOCITY_EXAMPLE = {"y": "length", "u": None}, "y [mm], U [m/s]"
IMPEDANCE, IMPEDANCE_EXAMPLE = dict.fromkeys(("x", *PARTS), "number") | {"x": "length"}, "x [mm], resistance, reactance"
# What a change of a key takes out of the file: the other way to say it, and the parts of another.
REPLACES = {
    "impedance": ("impedance_file",),
    "impedance_file": ("impedance",),
    "profile": ("shear", "allow_thin", "file"),
}


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


TABLES: dict[str, Any] = {name: key.annotation for name, key in list(DuctFile.model_fields.items())[3:]}


@dataclass(frozen=True, eq=False)
class DuctSetup:
    """A duct with its sound, its wall and its microphones.

    Args:
        name: of the preset or file.  case: the duct.  frequency: Hz, (F,).
        impedance: Z of each patch, complex128, (S,) or (F, S), or a function of x and frequency.
        microphones: x, m, (N,); may be empty.  wall: of the microphones, ``opposite`` or ``lined``.
        facts: what the file says, for results.  fluid: gas.  notes: warnings, with numbers.
    """

    name: str
    case: DuctCase
    frequency: Tensor
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
        """Z of the first lined patch, () or (F,); inf without one; ValueError for a profile along x."""
        if callable(self.impedance):
            raise ValueError(f"{self.name} has an impedance that varies along x; modes need one: state impedance")
        return self.impedance[..., 0] if self.impedance.numel() else torch.inf

    def line_of(self, field: DuctField, **known: Any) -> MicrophoneLine:
        """A solved field at the microphones, in the order of x, with its known Z.

        Warns of several lined patches, of which the line names none. ``known``: what else its provenance states.
        """
        case, places, notes = self.case, np.sort(self.places), (*self.notes, *field.notes)
        one = len(case.liner) == 1
        start, end = case.liner[0] if one else (None, None)
        if len(case.liner) > 1:
            patches = f"{self.name} has {len(case.liner)} lined patches, a line of microphones names one"
            notes = (*notes, f"{patches}; it names none, and methods of one liner take all microphones")
            tell(notes[-1])
        first = plain = None
        if not callable(field.impedance):  # else Z varies along x
            walls = complex_tensor(field.impedance).detach().cpu().broadcast_to(len(self.frequency), len(case.liner))
            plain = [[[z.real, z.imag] if np.isfinite(z) else "rigid" for z in row] for row in walls.tolist()]
            if one:
                first = torch.where(walls[:, 0].isfinite(), walls[:, 0], complex(math.nan, math.nan))
        return MicrophoneLine(
            places,
            field.wall_pressure(places, self.wall).detach().movedim(-1, -2),
            self.frequency,
            duct_height=case.height,
            mach=case.profile.bulk_mach,
            source_side=field.source,
            liner_start=start,
            liner_end=end,
            wall_impedance=first,
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
            notes=notes,
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
        changes: values that replace those of the file, by its keys: ``bulk_mach``, ``frequency``, ``impedance``,
            ``profile``, ...; a new ``profile`` drops the parts of the old one, ``impedance`` the ``impedance_file``.
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
        value = value.tolist() if isinstance(value, (np.ndarray, Tensor)) else value
        table = content.setdefault(owners[key], {})
        if table.get(key) != value:
            for other in set(REPLACES.get(key, ())) - changes.keys():
                table.pop(other, None)
        table[key] = value
    file = validated(DuctFile, content, path, TABLES)
    fluid, sound, duct, flow = file.fluid.build(), file.sound, file.duct, file.flow
    try:
        with noted() as notes:
            profile = _profile(flow, duct.height, fluid, path.parent)
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
            impedance, microphones = _impedance(sound, duct, path.parent), _microphones(file.microphones, case)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    frequency = torch.tensor(sound.frequency, dtype=torch.float64)
    about = (impedance, microphones, file.microphones.wall, file.model_dump(), fluid, tuple(notes))
    return DuctSetup(file.name or path.stem, case, frequency, *about)


def _microphones(table: MicrophoneTable, case: DuctCase) -> Tensor:
    """x, m, (N,); none stated: (0,)."""
    row = [each for each in (table.first, table.last, table.step) if each is not None]
    if len(row) not in (0, 3) or (row and table.x is not None):
        raise ValueError("microphones need first, last and step, or x, not both")
    places = torch.tensor(table.x or [], dtype=torch.float64)
    if row:
        first, last, step = row
        count = round((last - first) / step) + 1
        if not 1 <= count <= MOST_MICROPHONES:
            made = f"microphones from {first:g} to {last:g} m in steps of {step:g} m are {count}"
            raise ValueError(f"{made}; 1 to {MOST_MICROPHONES} are possible")
        places = first + step * torch.arange(count, dtype=torch.float64)
    outside = ((places < case.start) | (places > case.end)).nonzero()[:, 0].tolist()
    if outside:
        where = f"microphone {outside[0]} at x = {float(places[outside[0]]):g} m lies outside the duct"
        raise ValueError(f"{where}, {case.start:g} to {case.end:g} m")
    return places


def _profile(flow: FlowTable, height: float, fluid: Fluid, folder: Path) -> MeanFlow:
    for kind, key in (("tanh", "shear"), ("tanh", "allow_thin"), ("table", "file")):
        if getattr(flow, key) and flow.profile != kind:
            raise ValueError(f"flow {key} is for profile {kind!r}, not {flow.profile!r}")
    mach, speed = flow.bulk_mach, fluid.sound_speed
    if mach == 0 or flow.profile == "uniform":
        return UniformProfile(mach, height, speed)
    if flow.profile == "parabolic":
        return ParabolicProfile(mach, height, speed)
    if flow.profile == "tanh":
        return TanhProfile(mach, height, flow.shear or 0.1, speed, flow.allow_thin)
    if flow.file is None:
        raise ValueError(f"flow profile 'table' needs file, a CSV of {VELOCITY_EXAMPLE} (any unit of U)")
    table = folder / flow.file
    found = read_table(read_lines(table), VELOCITY, table, example=VELOCITY_EXAMPLE)
    try:
        return TabulatedProfile(found["y"], found["u"], height, mach, speed)
    except ValueError as error:
        raise ValueError(f"{flow.file}: {error}") from error


def _impedance(sound: SoundTable, duct: DuctTable, folder: Path) -> Z:
    """Z of the patches, (S,), or Z(x) of a CSV ``x [mm], resistance, reactance``, linear in the admittance; inf is
    rigid. Warns of stations that end within a lined patch: Z is constant beyond the last."""
    if sound.impedance_file is None:
        walls = sound.impedance or []
        if len(walls) != len(duct.liner):
            patches = f"{len(walls)} impedances for {len(duct.liner)} lined patches"
            raise ValueError(f"sound has {patches}, and no impedance_file")
        return torch.tensor([math.inf if pair == "rigid" else complex(*pair) for pair in walls], dtype=torch.complex128)
    if sound.impedance is not None or not duct.liner:
        raise ValueError("sound has an impedance_file, which needs a liner in duct and excludes impedance")
    path = folder / sound.impedance_file
    found = read_table(read_lines(path), IMPEDANCE, path, special=PARTS, example=IMPEDANCE_EXAMPLE)
    values = np.empty(len(found["resistance"]), np.complex128)  # a sum with 1j inf would be nan
    values.real, values.imag = found["resistance"], found["reactance"]
    try:
        between = impedance_along(found["x"], values)
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
