"""Files of the user's in TOML: all mistakes at once, each with what would be right."""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from torchliner.file_checks import read_bytes
from torchliner.fluid import Fluid
from torchliner.names import did_you_mean

LONGEST = 1 << 20  # letters of a TOML file
MISTAKES = 20  # that a message lists


class Strict(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


Table = TypeVar("Table", bound=Strict)


class FluidTable(Strict):
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
        stated = self.model_dump(exclude_none=True)
        state = {k: stated.pop(k) for k in ("temperature", "pressure") if k in stated}
        return Fluid(**{**(vars(Fluid.from_temperature(**state)) if state else {}), **stated})


def one_of(*known: str) -> AfterValidator:
    """That a key is one of some names, for ``Annotated[str, ...]``."""

    def check(value: str) -> str:
        if value not in known:
            *others, last = map(repr, known)
            raise ValueError(f"input should be {', '.join(others)} or {last}")
        return value

    return AfterValidator(check)


def preset_names(package: str) -> list[str]:
    """Names of the TOML files in the folder ``presets`` of a package."""
    folder = resources.files(package) / "presets"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def preset_text(package: str, name: str, kind: str, endings: str) -> str:
    """The TOML text of a preset of a package.

    Args:
        package, name: whose preset it is, without ending.
        kind, endings: what it is and how a user's own files end, for the message.
    Raises:
        ValueError: no such preset; the nearest is named.
    """
    known = preset_names(package)
    if name not in known:
        raise ValueError(
            f"unknown {kind} {name!r}{did_you_mean(name, known)}; presets are {', '.join(known)}; "
            f"a file of your own ends in {endings}"
        )
    return (resources.files(package) / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def read_text(path: Path) -> str:
    """A UTF-8 file.

    Raises:
        FileNotFoundError, OSError, ValueError: as ``read_bytes``; not UTF-8.
    """
    try:
        return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: {error}; save it as UTF-8") from error


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The content of a TOML text; a ValueError where it is none, is nested too deep, or longer than ``LONGEST``."""
    if len(text) > LONGEST:
        raise ValueError(f"{path} has {len(text)} letters; a TOML file of ours has {LONGEST} at most")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error


def preset_or_file(package: str, name: str | Path, kind: str, endings: str) -> tuple[dict[str, Any], Path]:
    """Content of a preset, or of a file of the user's own, which ends in .toml; and its path. As ``preset_text``."""
    own = Path(name).suffix.lower() == ".toml"
    path = Path(name) if own else Path(f"{name}.toml")
    return parse_toml(read_text(path) if own else preset_text(package, str(name), kind, endings), path), path


def validated(model: type[Table], content: Mapping[str, Any], path: Path, tables: Mapping[str, type[Strict]]) -> Table:
    """Content checked against a model.

    Args:
        model: keys and their ranges.
        content: of the file.
        path: for messages.
        tables: models of its tables by name, whose keys are suggested for a slip inside them.
    Raises:
        ValueError: mistakes, all of them listed, each mistyped key with the nearest valid one.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        found = error.errors()
        mistakes = [_explain(mistake, model, tables) for mistake in found[:MISTAKES]]
        raise ValueError(f"{path} has {len(found)} mistake(s):\n  " + "\n  ".join(mistakes)) from None


def _explain(mistake: Any, model: type[Strict], tables: Mapping[str, type[Strict]]) -> str:
    """One line a user can act on."""
    kind, place = mistake["type"], ".".join(map(str, mistake["loc"]))
    if kind == "extra_forbidden":
        inside = [tables[str(part)] for part in mistake["loc"][:-1] if str(part) in tables] or [model]
        return f"{place}: no such key{did_you_mean(str(mistake['loc'][-1]), list(inside[-1].model_fields))}"
    if kind == "missing":
        return f"{place}: missing"
    if kind == "list_type" and isinstance(mistake["input"], Mapping):
        return f"{place}: write [[{place}]], with two brackets, for each of its tables"
    message = mistake["msg"].removeprefix("Value error, ")
    message = message.replace("a valid dictionary or object to extract fields from", "a table")
    return f"{place} = {reprlib.repr(mistake['input'])}: {message[0].lower()}{message[1:]}"
