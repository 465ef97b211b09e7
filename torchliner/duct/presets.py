"""Lined ducts from TOML files: the two facilities of the package and the user's own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner import file_checks
from torchliner.checks import noted, tell
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct import flow_profiles
from torchliner.duct.case import DuctCase, Z
from torchliner.duct.duct_file import (
    TABLES,
    DuctFile,
    DuctTable,
    FlowTable,
    MicrophoneTable,
    SoundTable,
    wall_from_table,
)
from torchliner.duct.field import DuctField
from torchliner.duct.flow_table import TabulatedProfile
from torchliner.file_checks import preset_or_file, validated
from torchliner.fluid import Fluid
from torchliner.names import __version__
from torchliner.records import MicrophoneLine
from torchliner.text_columns import read_lines, read_table

PACKAGE, KIND = "torchliner.duct", ("duct", ".toml")
MOST_MICROPHONES = 10_000
VELOCITY, VELOCITY_EXAMPLE = {"y": "length", "u": None}, "y [mm], U [m/s]"


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

    def line_of(self, field: DuctField, **known: Any) -> MicrophoneLine:
        """A solved field at the microphones, in the order of x, with its known Z; ``known``: what else its provenance
        states. Warns of several lined patches, of which it names none."""
        case, places = self.case, np.sort(self.places)
        one = len(case.liner) == 1
        start, end = case.liner[0] if one else (None, None)
        notes = (*self.notes, *field.notes)
        if len(case.liner) > 1:
            patches = f"{self.name} has {len(case.liner)} lined patches, a line of microphones names one"
            notes = (*notes, f"{patches}; it names none, and methods of one liner take all microphones")
            tell(notes[-1])
        walls = None
        if not callable(field.impedance):  # else Z varies along x
            z = field.impedance
            exact = z.detach().cpu() if isinstance(z, Tensor) else torch.as_tensor(np.asarray(z, np.complex128))
            walls = exact.to(torch.complex128).broadcast_to(len(field.frequency), len(case.liner))
        first = walls[:, 0] if one and walls is not None else None
        rows = [] if walls is None else walls.tolist()
        plain = [[[z.real, z.imag] if np.isfinite(z) else "rigid" for z in row] for row in rows] or None
        return MicrophoneLine(
            places,
            field.wall_pressure(places, self.wall).detach().movedim(-1, -2),
            self.frequency,
            duct_height=case.height,
            mach=case.profile.bulk_mach,
            source_side=field.source,
            liner_start=start,
            liner_end=end,
            wall_impedance=None if first is None else torch.where(first.isfinite(), first, complex(math.nan, math.nan)),
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
    return DuctSetup(
        file.name or path.stem,
        case,
        torch.tensor(sound.frequency, dtype=torch.float64),
        sound.level,
        impedance,
        _microphones(file.microphones, case),
        file.microphones.wall,
        file.model_dump(),
        fluid,
    )


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
    for i in outside[:1]:
        where = f"microphone {i} at x = {float(places[i]):g} m lies outside the duct"
        raise ValueError(f"{where}, {case.start:g} to {case.end:g} m")
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
        raise ValueError(f"flow profile 'table' needs file, a CSV of {VELOCITY_EXAMPLE} (any unit of U)")
    table = path.parent / flow.file
    found = read_table(read_lines(table), VELOCITY, table, example=VELOCITY_EXAMPLE, short={"velocity": "u"})
    try:
        return TabulatedProfile(found["y"], found["u"], height, bulk_mach=flow.bulk_mach, **about)
    except ValueError as error:
        raise ValueError(f"{flow.file}: {error}") from error


def _impedance(sound: SoundTable, duct: DuctTable, path: Path) -> Z:
    patches = len(duct.liner)
    if sound.impedance_file is not None:
        if sound.impedance is not None or not patches:
            raise ValueError("sound has an impedance_file, which needs a liner in duct and excludes impedance")
        return wall_from_table(path.parent / sound.impedance_file, duct)
    walls = sound.impedance or []
    if len(walls) != patches:
        raise ValueError(f"sound has {len(walls)} impedances for {patches} lined patches, and no impedance_file")
    return torch.tensor([math.inf if pair == "rigid" else complex(*pair) for pair in walls], dtype=torch.complex128)
