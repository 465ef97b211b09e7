"""Liners from TOML files: the presets of the package and the user's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from torchliner import toml_files
from torchliner.liners.cell import DEPTH, PLATE
from torchliner.liners.model import LinerModel
from torchliner.liners.python_file import read_liner
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

    @classmethod
    def tables(cls) -> dict[str, type[Strict]]:
        """Keys of the tables in the file, by name."""
        return {"fluid": FluidTable}

    def build(self, path: Path, name: str) -> LinerModel:
        """The liner.

        Args:
            path: of the file, beside which others are found.
            name: for labels, where the file states none.
        """
        raise NotImplementedError


class CellFile(LinerFile):
    """Keys of all models that derive from ``CellLiner``; fractions 0 to 1."""

    open_area_fraction: float = Field(1.0, gt=0, le=1)
    velocity_reading: Annotated[str, one_of(*VELOCITY_READINGS)] = "as_measured"
    velocity_gain: float = Field(1.0, gt=0)
    impedance_offset: tuple[float, float] = (0.0, 0.0)
    flow_facing_porosity: float | None = Field(None, gt=0, le=1)
    fluid: FluidTable = FluidTable()

    def arguments(self, name: str) -> dict[str, Any]:
        """Of the liner, with those of the model as the file has them."""
        given = {key: getattr(self, key) for key in type(self).model_fields}
        for key in ("model", "description", "source"):
            del given[key]
        return given | {
            "impedance_offset": complex(*self.impedance_offset),
            "fluid": self.fluid.build(),
            "name": self.name or name,
        }


class SDoFFile(CellFile):
    """Keys of a file with ``model = "sdof"``; lengths in m, fractions 0 to 1."""

    model: Literal["sdof"]
    facesheet_thickness: float = Field(gt=0, lt=PLATE[1])
    orifice_diameter: float = Field(gt=0, lt=PLATE[1])
    porosity: float = Field(gt=0, le=1)
    cavity_depth: float = Field(gt=0, lt=DEPTH[1])
    cavity_hydraulic_radius: float = Field(gt=0, lt=DEPTH[1])
    cavity_porosity: float = Field(1.0, gt=0, le=1)
    vena_contracta: float = Field(0.8, gt=0, le=1)

    def build(self, path: Path, name: str) -> SDoFLiner:
        """See ``LinerFile``."""
        return SDoFLiner(**self.arguments(name))


class TableFile(LinerFile):
    """Keys of a file with ``model = "table"``: a CSV beside it, or the numbers themselves, as
    ``TabulatedLiner.describe`` has them."""

    model: Literal["table"]
    file: str | None = None
    frequency: list[float] | None = None
    speed: list[float] | None = None
    resistance: list[Any] | None = None
    reactance: list[Any] | None = None

    def build(self, path: Path, name: str) -> TabulatedLiner:
        """See ``LinerFile``."""
        about: Any = {"name": self.name or name, "cell_pitch": self.cell_pitch}
        numbers = (self.frequency, self.resistance, self.reactance)
        if self.file is not None and not any((*numbers, self.speed)):
            return TabulatedLiner.read_csv(path.parent / self.file, **about)
        if self.file is not None or not all(numbers):
            raise ValueError("a table is file, a .csv beside this one, or frequency, resistance "
                             "and reactance, with speed where they depend on it")  # fmt: skip
        shape = (len(self.frequency or ()), *(() if self.speed is None else (len(self.speed),)))
        real, imaginary = (
            _grid(part, key, shape) for part, key in ((self.resistance, "resistance"), (self.reactance, "reactance"))
        )
        return TabulatedLiner(self.frequency, real + 1j * imaginary, self.speed, **about)


def _grid(values: Any, key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of a table in its file, (frequency,) or (frequency, speed).

    Raises:
        ValueError: lists of other lengths, or what is no number.
    """
    rows = values if len(shape) == 2 else [values]
    wanted = " lists of ".join(str(count) for count in shape)
    for row in [values, *rows]:
        count = shape[0] if row is values else shape[-1]
        if not isinstance(row, list) or len(row) != count:
            have = f"{len(row)} values" if isinstance(row, list) else repr(row)
            raise ValueError(f"{key} has {have} where {count} are needed; it is {wanted} numbers, "
                             "of the lengths of frequency and speed")  # fmt: skip
    for each in (each for row in rows for each in row):
        if isinstance(each, bool) or not isinstance(each, (int, float)):
            raise ValueError(f"{key} holds {each!r}; it is {wanted} numbers")
    return np.array(values, dtype=float)


ENDINGS = (".toml", ".csv", ".py")
PACKAGE, KIND = "torchliner.liners", ("liner", ".toml, .csv or .py")


def preset_names() -> list[str]:
    """Names of the liners shipped with the package.

    >>> [name for name in tl.preset_names() if not name.startswith("lbm") and not name.endswith("_example")]
    ['onera', 'polito', 'polito_as_printed']
    """
    return toml_files.preset_names(PACKAGE)


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit.

    Raises:
        ValueError: no such preset; the nearest is named.
    """
    return toml_files.preset_text(PACKAGE, name, *KIND)


def load_liner(name: str | Path | Mapping[str, Any]) -> LinerModel:
    """A liner by preset name, from a TOML, CSV or Python file, or from what a map holds of it.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml, .csv or .py. A Python
            file is run; it has ``impedance(frequency, speed)`` or an object ``liner``. Or what
            ``describe`` of a model from a preset, TOML or CSV gives, as ``choices["liner"]`` of a
            map: the same liner, from its numbers alone.
    Raises:
        ValueError: no such preset (the nearest is named), or a file with mistakes: all of them are
            listed, each mistyped key with the nearest valid one; of a Python file the line. A
            description without the numbers of its model.
        FileNotFoundError: no such file.

    >>> liner = tl.load_liner("polito")
    >>> [f"{z:.2f}" for z in liner.impedance(1400.0, [0.0, 5.0]).tolist()]  # |v| = 0, 5 m/s
    ['0.08-0.40j', '4.62-0.65j']
    """
    found: LinerModel
    if isinstance(name, Mapping):
        if "file" in name:  # whoever wrote a map does not choose what is read here
            raise ValueError(
                f"the liner is described by the file {name['file']!r} and not by its numbers; load that file"
            )
        found = _build(_stated(name), Path(str(name.get("name", "liner"))))
        missing = _missing(name, found.describe())
        if missing:
            raise ValueError(
                f"the description of liner {name.get('name')!r} lacks {', '.join(missing)}; "
                "describe() of a model, and so a map, states them"
            )
        return found
    suffix = Path(name).suffix.lower()
    beside: list[str] = []
    if suffix == ".csv":
        found = TabulatedLiner.read_csv(name)
    elif suffix == ".py":
        found = read_liner(Path(name))
    else:
        content, path = preset_or_file(PACKAGE, name, *KIND)
        found = _build(content, path)
        beside = [str(path.parent / content["file"])] if "file" in content else []
    if suffix in ENDINGS:
        object.__setattr__(found, "files", (str(name), *beside))
    return found


def _missing(stated: Mapping[str, Any], whole: Mapping[str, Any], within: str = "") -> list[str]:
    """Keys that a whole description has and this one leaves to a default."""
    found = []
    for key, value in whole.items():
        mine = stated.get(key)
        if mine is None and value is not None:
            found.append(within + key)
        elif isinstance(value, Mapping) and isinstance(mine, Mapping):
            found += _missing(mine, value, f"{within}{key}.")
    return found


def _stated(facts: Any) -> Any:
    """A description without what it leaves to the defaults, as a TOML file has none of it."""
    if isinstance(facts, Mapping):
        return {key: _stated(value) for key, value in facts.items() if value is not None}
    return [_stated(each) for each in facts] if isinstance(facts, (list, tuple)) else facts


def liner_text(liner: LinerModel, source: str, description: str = "") -> str:
    """TOML text that ``load_liner`` reads back as ``liner``, of plain numbers and with a name;
    ``source`` says where the numbers come from."""
    facts = liner.describe()
    tables = [("[[layers]]", layer) for layer in facts.pop("layers", [])]
    tables += [("[fluid]", facts.pop("fluid"))] if facts.get("fluid") else []
    facts = {"model": facts.pop("model"), "name": facts.pop("name"), "description": description,
             "source": source, **facts}  # fmt: skip
    # A JSON string, number or list of these is a TOML one.
    lines: list[str] = []
    for heading, table in (("", facts), *tables):
        lines += ["", heading] if heading else []
        lines += [f"{key} = {json.dumps(value)}" for key, value in table.items()
                  if value is not None]  # fmt: skip
    return "# SI units; lengths in m, impedances normalised by rho c.\n" + "\n".join(lines) + "\n"


def _build(content: dict[str, Any], path: Path) -> LinerModel:
    kind = content.get("model")
    if not isinstance(kind, str) or kind not in LINER_MODELS:
        raise ValueError(
            f"{path}: model is {kind!r}{did_you_mean(str(kind), list(LINER_MODELS))}; "
            f"it is one of {', '.join(LINER_MODELS)}"
        )
    keys = resolve(LINER_MODELS[kind])
    file = validated(keys, content, path, keys.tables())
    try:
        return file.build(path, path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
