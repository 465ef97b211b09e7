"""Files of the user's: regular, no larger than memory, text or TOML, and every error by the name of the file."""

import csv
import functools
import math
import os
import reprlib
import stat
import struct
import tokenize
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from torchliner.fluid import Fluid
from torchliner.names import did_you_mean

LONGEST_LINE = 1 << 20  # bytes
LONGEST_TOML = 1 << 20  # letters
MISTAKES = 20  # that a message lists
CELLS = 16  # bytes of memory that a byte of text takes as cells and numbers
# What libraries raise on damaged files, beside ValueError, TypeError and OSError.
DAMAGE = (
    *(LookupError, AttributeError, ArithmeticError, NameError, EOFError, RuntimeError, AssertionError, SystemError),
    *(SyntaxError, struct.error, zlib.error, csv.Error, tokenize.TokenError),
)


class Unwritten(ValueError):
    """A file lacks samples, which may be written yet."""


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """A block that reads a file: whatever fails there is an OSError or a ValueError that names the file."""
    try:
        yield
    except (OSError, ValueError, TypeError) as error:
        if Path(path).name in str(error):
            raise
        kind = OSError if isinstance(error, OSError) else ValueError
        raise kind(f"{path}: {error}") from error
    except MemoryError as error:
        raise ValueError(f"{path} does not fit into memory ({error})") from error
    except DAMAGE as error:
        what = f"{type(error).__name__}: {error}"
        raise ValueError(f"{path} is damaged, or of another layout than it says: {what}") from error


def require_regular(path: str | Path) -> None:
    """Refuse what is no file of bytes.

    Raises:
        FileNotFoundError: no such file.
        OSError: a folder, a device, a pipe; a link that leads round in a circle.
    """
    try:
        mode = Path(path).stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise OSError(f"{path} cannot be read: {error}") from error
    if stat.S_ISDIR(mode):
        raise OSError(f"{path} is a folder, not a file")
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} is a device or a pipe; a regular file is needed")


@functools.cache
def machine_memory() -> float:
    """Bytes of memory that this process may use at most; inf where nothing tells."""
    found = [math.inf]
    with suppress(ValueError, OSError, AttributeError):
        found.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    for name in ("memory.max", "memory/memory.limit_in_bytes"):  # of a container
        with suppress(ValueError, OSError):
            found.append(float(Path("/sys/fs/cgroup", name).read_text()))
    return min(found)


def require_memory(size: float, label: str, remedy: str = "cut it, or use a larger machine") -> None:
    """Refuse before it is read what cannot fit into this machine: ``size`` bytes of what ``label`` names."""
    if size > (memory := machine_memory()):
        raise ValueError(f"{label} takes {size / 1e9:.4g} GB; this machine has {memory / 1e9:.4g} GB: {remedy}")


def read_bytes(path: str | Path, head: int | None = None) -> bytes:
    """A text file as it is stored, or its first ``head`` bytes.

    Raises:
        FileNotFoundError, OSError: as ``require_regular``; it cannot be read.
        ValueError: a line above ``LONGEST_LINE``; zero bytes; more than fits into memory as cells.
    """
    require_regular(path)
    require_memory(CELLS * min(Path(path).stat().st_size, head or math.inf), f"{path} as cells of text")
    with Path(path).open("rb") as file:
        raw = file.read(-1 if head is None else head)
    if b"\0" in raw:
        raise ValueError(f"{path} holds zero bytes: it is no text file (UTF-8 or latin-1)")
    for begin in range(0, len(raw) - LONGEST_LINE, LONGEST_LINE):
        part = raw[begin : begin + LONGEST_LINE]
        if b"\n" not in part and b"\r" not in part:
            raise ValueError(f"{path} has a line of more than {LONGEST_LINE} bytes; it is no table of text")
    return raw


def read_text(path: Path) -> str:
    """A UTF-8 file; errors as ``read_bytes``, and ValueError where it is not UTF-8."""
    try:
        return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: {error}; save it as UTF-8") from error


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The content of a TOML text; ValueError where it is none, is nested too deep, or longer than ``LONGEST_TOML``."""
    if len(text) > LONGEST_TOML:
        raise ValueError(f"{path} has {len(text)} letters; a TOML file of ours has {LONGEST_TOML} at most")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error


def preset_names(package: str) -> list[str]:
    """Names of the TOML files in the folder ``presets`` of a package."""
    entries = (resources.files(package) / "presets").iterdir()
    return sorted(entry.name[:-5] for entry in entries if entry.name.endswith(".toml"))


def preset_text(package: str, name: str, kind: str, endings: str) -> str:
    """The TOML text of a preset of a package; ValueError if there is none, with the nearest.

    ``kind`` and ``endings`` say in the message what it is and how a user's own files end.
    """
    if name not in (known := preset_names(package)):
        raise ValueError(
            f"unknown {kind} {name!r}{did_you_mean(name, known)}; presets are {', '.join(known)}; "
            f"a file of your own ends in {endings}"
        )
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

    def check(value: str) -> str:
        if value not in known:
            *others, last = map(repr, known)
            raise ValueError(f"input should be {', '.join(others)} or {last}")
        return value

    return AfterValidator(check)


Table = TypeVar("Table", bound=Strict)


def validated(model: type[Table], content: Mapping[str, Any], path: Path, tables: Mapping[str, type[Strict]]) -> Table:
    """Content checked against a model.

    Args:
        model: keys and their ranges.  content: of the file.  path: for messages.
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
