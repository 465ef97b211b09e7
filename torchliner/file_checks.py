"""Files of the user's: regular, no larger than memory, text or TOML, and every error by the name of the file."""

import functools
import math
import os
import reprlib
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from torchliner.checks import require_choice
from torchliner.fluid import Fluid
from torchliner.names import did_you_mean

CELLS = 16  # bytes of memory that a byte of text takes as cells and numbers


class Unwritten(ValueError):
    """A file lacks samples, which may be written yet."""


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """A block that reads a file: whatever fails there is an OSError or a ValueError that names the file."""
    try:
        yield
    except Exception as error:  # libraries raise anything on damaged files
        if isinstance(error, OSError | ValueError | ImportError) and Path(path).name in str(error):
            raise
        kind = OSError if isinstance(error, OSError) else ValueError
        what = f"is damaged, or of another layout than it says: {type(error).__name__}: {error}"
        plain = isinstance(error, OSError | ValueError | TypeError)
        raise kind(f"{path}: {error}" if plain else f"{path} {what}") from error


def require_regular(path: str | Path) -> None:
    """Refuse what is no file of bytes: FileNotFoundError, or OSError for a folder, a device, a pipe."""
    if not Path(path).exists():
        raise FileNotFoundError(f"{path}: no such file")
    if not Path(path).is_file():
        kind = "folder" if Path(path).is_dir() else "device or a pipe"
        raise OSError(f"{path} is a {kind}; a regular file is needed")


@functools.cache
def machine_memory() -> float:
    """Bytes of memory of this machine; inf where nothing tells."""
    with suppress(ValueError, OSError, AttributeError):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return math.inf


def require_memory(size: float, label: str, remedy: str = "cut it, or use a larger machine") -> None:
    """Refuse before it is read what cannot fit into this machine: ``size`` bytes of what ``label`` names."""
    if size > (memory := machine_memory()):
        raise ValueError(f"{label} takes {size / 1e9:.4g} GB; this machine has {memory / 1e9:.4g} GB: {remedy}")


def read_bytes(path: str | Path, head: int | None = None) -> bytes:
    """A text file as it is stored, or its first ``head`` bytes; errors as of ``require_regular``, and ValueError for
    zero bytes and for more than fits into memory as cells."""
    require_regular(path)
    require_memory(CELLS * min(Path(path).stat().st_size, head or math.inf), f"{path} as cells of text")
    with Path(path).open("rb") as file:
        raw = file.read(-1 if head is None else head)
    if b"\0" in raw:
        raise ValueError(f"{path} holds zero bytes: it is no text file (UTF-8 or latin-1)")
    return raw


def read_text(path: Path) -> str:
    """A UTF-8 file; errors as ``read_bytes``, and ValueError where it is not UTF-8."""
    try:
        return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: {error}; save it as UTF-8") from error


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The content of a TOML text; ValueError where it is none, or nested too deep."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error


def preset_names(package: str) -> list[str]:
    """Names of the TOML files in the folder ``presets`` of a package."""
    entries = (resources.files(package) / "presets").iterdir()
    return sorted(entry.name[:-5] for entry in entries if entry.name.endswith(".toml"))


def preset_text(package: str, name: str, kind: str, endings: str) -> str:
    """The TOML text of a preset; ValueError if there is none, which says what ``kind`` of thing it is and how a user's
    own files end."""
    if name not in (known := preset_names(package)):
        near = did_you_mean(name, known)
        raise ValueError(f"unknown {kind} {name!r}{near}; presets: {', '.join(known)}; your own files end in {endings}")
    return (resources.files(package) / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def preset_or_file(package: str, name: str | Path, kind: str, endings: str) -> tuple[dict[str, Any], Path]:
    """Content of a preset, or of a file of the user's own, which ends in .toml; and its path. As ``preset_text``."""
    own = Path(name).suffix.lower() == ".toml"
    path = Path(name) if own else Path(f"{name}.toml")
    return parse_toml(read_text(path) if own else preset_text(package, str(name), kind, endings), path), path


class Strict(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


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
    return AfterValidator(lambda value: require_choice("name", value, known))


Table = TypeVar("Table", bound=Strict)


def validated(model: type[Table], content: Mapping[str, Any], path: Path) -> Table:
    """Content checked against a model; ValueError with all mistakes, mistyped keys with the nearest of any table."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        mistakes = [_explain(mistake) for mistake in error.errors()]
        raise ValueError(f"{path} has {len(mistakes)} mistake(s):\n  " + "\n  ".join(mistakes)) from None


def _explain(mistake: Any) -> str:
    """One line a user can act on."""
    kind, place = mistake["type"], ".".join(map(str, mistake["loc"]))
    if kind == "extra_forbidden":
        known = [name for table in Strict.__subclasses__() for name in table.model_fields]
        return f"{place}: no such key{did_you_mean(str(mistake['loc'][-1]), known)}"
    if kind == "missing":
        return f"{place}: missing"
    return f"{place} = {reprlib.repr(mistake['input'])}: {mistake['msg'].removeprefix('Value error, ')}"
