"""Liners from TOML files: the presets of the package and the user's own."""

from __future__ import annotations

import json
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from torchliner.fluid import Fluid
from torchliner.liners.sdof import SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.words import did_you_mean


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class FluidFile(_Strict):
    """Table ``[fluid]``: all of it explicit, or temperature (K) and pressure (Pa)."""

    temperature: float | None = Field(None, ge=150, le=1500)
    pressure: float | None = Field(None, gt=0)
    sound_speed: float | None = Field(None, gt=0)
    density: float | None = Field(None, gt=0)
    dynamic_viscosity: float | None = Field(None, gt=0)
    heat_capacity_ratio: float | None = Field(None, ge=1)
    prandtl: float | None = Field(None, gt=0)

    def build(self) -> Fluid:
        """The gas; explicit values win over those from temperature and pressure."""
        given = {k: v for k, v in self.model_dump().items() if v is not None}
        state = {k: given.pop(k) for k in ("temperature", "pressure") if k in given}
        base = vars(Fluid.from_temperature(**state)) if state else {}
        return Fluid(**{**base, **given})


class SDoFFile(_Strict):
    """Keys of a file with ``model = "sdof"``; lengths in m, fractions 0 to 1."""

    model: Literal["sdof"]
    name: str | None = None
    description: str = ""
    source: str = ""
    facesheet_thickness: float = Field(gt=0, lt=1)
    orifice_diameter: float = Field(gt=0, lt=0.1)
    porosity: float = Field(gt=0, le=1)
    cavity_depth: float = Field(gt=0, lt=10)
    cavity_hydraulic_radius: float = Field(gt=0, lt=10)
    cavity_porosity: float = Field(1.0, gt=0, le=1)
    open_area_fraction: float = Field(1.0, gt=0, le=1)
    vena_contracta: float = Field(0.8, gt=0, le=1)
    velocity_reading: Literal["as_measured", "conserved"] = "as_measured"
    velocity_gain: float = Field(1.0, gt=0)
    impedance_offset: tuple[float, float] = (0.0, 0.0)
    cell_pitch: float | None = Field(None, gt=0)
    flow_facing_porosity: float | None = Field(None, gt=0, le=1)
    fluid: FluidFile = FluidFile()

    def build(self, path: Path, name: str) -> SDoFLiner:
        """The liner."""
        values = self.model_dump(exclude={"model", "name", "description", "source", "fluid"})
        values["impedance_offset"] = complex(*self.impedance_offset)
        return SDoFLiner(**values, fluid=self.fluid.build(), name=self.name or name)


class TableFile(_Strict):
    """Keys of a file with ``model = "table"``: a CSV beside it."""

    model: Literal["table"]
    name: str | None = None
    description: str = ""
    source: str = ""
    file: str
    cell_pitch: float | None = Field(None, gt=0)

    def build(self, path: Path, name: str) -> TabulatedLiner:
        """The liner."""
        table = path.parent / self.file
        return TabulatedLiner.read_csv(table, name=self.name or name, cell_pitch=self.cell_pitch)


MODELS: dict[str, type[SDoFFile] | type[TableFile]] = {"sdof": SDoFFile, "table": TableFile}


def preset_names() -> list[str]:
    """Names of the liners shipped with the package."""
    folder = resources.files("torchliner.liners") / "presets"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit.

    Raises:
        ValueError: no such preset; the nearest is named.
    """
    known = preset_names()
    if name not in known:
        raise ValueError(
            f"unknown liner {name!r}{did_you_mean(name, known)}; presets are {', '.join(known)}; "
            "a file of your own ends in .toml or .csv"
        )
    folder = resources.files("torchliner.liners") / "presets"
    return (folder / f"{name}.toml").read_text(encoding="utf-8")


def load_liner(name: str | Path) -> SDoFLiner | TabulatedLiner:
    """A liner by preset name, or from a TOML or CSV file.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml or .csv.
    Raises:
        ValueError: no such preset (the nearest is named), or a file with mistakes: all of them are
            listed, each mistyped key with the nearest valid one.
        FileNotFoundError: no such file.
    """
    text, path = str(name), Path(name)
    if path.suffix.lower() == ".csv":
        return TabulatedLiner.read_csv(path)
    if path.suffix.lower() == ".toml":
        return _build(_read_text(path), path, path.stem)
    return _build(preset_text(text), Path(f"{text}.toml"), text)


def liner_text(liner: SDoFLiner, source: str, description: str = "") -> str:
    """TOML text that ``load_liner`` reads back as ``liner``.

    Args:
        liner: SDoF liner of plain numbers.
        source: where the numbers come from.
        description: one line.
    """
    facts = liner.describe()
    fluid = facts.pop("fluid")
    facts = {"model": facts.pop("model"), "name": facts.pop("name"), "description": description,
             "source": source, **facts}  # fmt: skip
    # A JSON string, number or list of these is a TOML one.
    lines = [f"{key} = {json.dumps(value)}" for key, value in facts.items() if value is not None]
    lines += ["", "[fluid]", *(f"{key} = {json.dumps(value)}" for key, value in fluid.items())]
    return "# SI units; lengths in m, impedances normalised by rho c.\n" + "\n".join(lines) + "\n"


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: {error}; save it as UTF-8") from error


def _build(text: str, path: Path, name: str) -> SDoFLiner | TabulatedLiner:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error
    kind = content.get("model")
    if not isinstance(kind, str) or kind not in MODELS:
        raise ValueError(
            f"{path}: model is {kind!r}{did_you_mean(str(kind), list(MODELS))}; "
            f"it is one of {', '.join(MODELS)}"
        )
    try:
        file = MODELS[kind].model_validate(content)
    except ValidationError as error:
        mistakes = [_explain(mistake, MODELS[kind]) for mistake in error.errors()]
        raise ValueError(
            f"{path} has {len(mistakes)} mistake(s):\n  " + "\n  ".join(mistakes)
        ) from None
    try:
        return file.build(path, name)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _explain(mistake: Any, model: type[BaseModel]) -> str:
    """One line a user can act on."""
    place = ".".join(str(part) for part in mistake["loc"])
    if mistake["type"] == "extra_forbidden":
        schema = FluidFile if mistake["loc"][0] == "fluid" else model
        key, known = str(mistake["loc"][-1]), list(schema.model_fields)
        return f"{place}: no such key{did_you_mean(key, known)}"
    if mistake["type"] == "missing":
        return f"{place}: missing"
    return f"{place} = {mistake['input']!r}: {mistake['msg'][0].lower()}{mistake['msg'][1:]}"
