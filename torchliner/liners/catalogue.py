"""Liners from TOML files: the presets of the package and the user's own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from torchliner import toml_files
from torchliner.liners.model import LinerModel
from torchliner.liners.sdof import SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.names import LINER_MODELS, VELOCITY_READINGS, did_you_mean, resolve
from torchliner.toml_files import FluidTable, Strict, one_of, preset_or_file, validated


class LinerFile(Strict):
    """Keys that every liner file may have; a model adds ``model``, its own keys and ``build``."""

    name: str | None = None
    description: str = ""
    source: str = ""
    cell_pitch: float | None = Field(None, gt=0)

    def build(self, path: Path, name: str) -> LinerModel:
        """The liner.

        Args:
            path: of the file, beside which others are found.
            name: for labels, where the file states none.
        """
        raise NotImplementedError


class SDoFFile(LinerFile):
    """Keys of a file with ``model = "sdof"``; lengths in m, fractions 0 to 1."""

    model: Literal["sdof"]
    facesheet_thickness: float = Field(gt=0, lt=1)
    orifice_diameter: float = Field(gt=0, lt=0.1)
    porosity: float = Field(gt=0, le=1)
    cavity_depth: float = Field(gt=0, lt=10)
    cavity_hydraulic_radius: float = Field(gt=0, lt=10)
    cavity_porosity: float = Field(1.0, gt=0, le=1)
    open_area_fraction: float = Field(1.0, gt=0, le=1)
    vena_contracta: float = Field(0.8, gt=0, le=1)
    velocity_reading: Annotated[str, one_of(*VELOCITY_READINGS)] = "as_measured"
    velocity_gain: float = Field(1.0, gt=0)
    impedance_offset: tuple[float, float] = (0.0, 0.0)
    flow_facing_porosity: float | None = Field(None, gt=0, le=1)
    fluid: FluidTable = FluidTable()

    def build(self, path: Path, name: str) -> SDoFLiner:
        """See ``LinerFile``."""
        values = self.model_dump(exclude={"model", "name", "description", "source", "fluid"})
        values["impedance_offset"] = complex(*self.impedance_offset)
        return SDoFLiner(**values, fluid=self.fluid.build(), name=self.name or name)


class TableFile(LinerFile):
    """Keys of a file with ``model = "table"``: a CSV beside it."""

    model: Literal["table"]
    file: str

    def build(self, path: Path, name: str) -> TabulatedLiner:
        """See ``LinerFile``."""
        table = path.parent / self.file
        return TabulatedLiner.read_csv(table, name=self.name or name, cell_pitch=self.cell_pitch)


PACKAGE, KIND = "torchliner.liners", ("liner", ".toml or .csv")


def preset_names() -> list[str]:
    """Names of the liners shipped with the package.

    >>> tl.preset_names()
    ['lbm_orifice', 'lbm_orifice_coarse', 'lbm_slit', 'lbm_slit_coarse', 'onera', 'polito']
    """
    return toml_files.preset_names(PACKAGE)


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit.

    Raises:
        ValueError: no such preset; the nearest is named.
    """
    return toml_files.preset_text(PACKAGE, name, *KIND)


def load_liner(name: str | Path) -> LinerModel:
    """A liner by preset name, or from a TOML or CSV file.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml or .csv.
    Raises:
        ValueError: no such preset (the nearest is named), or a file with mistakes: all of them are
            listed, each mistyped key with the nearest valid one.
        FileNotFoundError: no such file.

    >>> liner = tl.load_liner("polito")
    >>> [f"{z:.2f}" for z in liner.impedance(1400.0, [0.0, 5.0]).tolist()]  # |v| = 0, 5 m/s
    ['0.07-0.01j', '4.61-0.27j']
    """
    if Path(name).suffix.lower() == ".csv":
        return TabulatedLiner.read_csv(name)
    return _build(*preset_or_file(PACKAGE, name, *KIND))


def liner_text(liner: LinerModel, source: str, description: str = "") -> str:
    """TOML text that ``load_liner`` reads back as ``liner``, of plain numbers and with a name;
    ``source`` says where the numbers come from."""
    facts = liner.describe()
    fluid = facts.pop("fluid", {})
    facts = {"model": facts.pop("model"), "name": facts.pop("name"), "description": description,
             "source": source, **facts}  # fmt: skip
    # A JSON string, number or list of these is a TOML one.
    lines = [f"{key} = {json.dumps(value)}" for key, value in facts.items() if value is not None]
    if fluid:
        lines += ["", "[fluid]", *(f"{key} = {json.dumps(value)}" for key, value in fluid.items())]
    return "# SI units; lengths in m, impedances normalised by rho c.\n" + "\n".join(lines) + "\n"


def _build(content: dict[str, Any], path: Path) -> LinerModel:
    kind = content.get("model")
    if not isinstance(kind, str) or kind not in LINER_MODELS:
        raise ValueError(
            f"{path}: model is {kind!r}{did_you_mean(str(kind), list(LINER_MODELS))}; "
            f"it is one of {', '.join(LINER_MODELS)}"
        )
    file = validated(resolve(LINER_MODELS[kind]), content, path, {"fluid": FluidTable})
    try:
        return file.build(path, path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
