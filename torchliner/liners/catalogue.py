"""Liners from files: the presets of the package and the user's own TOML, CSV and Python files."""

import hashlib
import inspect
import json
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from torch import Tensor

from torchliner import file_checks
from torchliner.checks import real_tensor
from torchliner.file_checks import FluidTable, preset_or_file, read_text, validated
from torchliner.liners.laws import LAWS
from torchliner.liners.layered import Cavity
from torchliner.liners.model import STATED, LinerModel, arguments_of, as_liner, impedance_of, plain
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.names import LINER_MODELS, did_you_mean, resolve

PACKAGE, KIND = "torchliner.liners", ("liner", ".toml, .csv or .py")
ABOUT = ("model", "name", "description", "source")  # keys of any liner file


def preset_names() -> list[str]:
    """Names of the liners shipped with the package."""
    return file_checks.preset_names(PACKAGE)


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit; ValueError if there is none, with the nearest."""
    return file_checks.preset_text(PACKAGE, name, *KIND)


def load_liner(name: str | Path) -> LinerModel:
    """A liner by preset name, or from a TOML, CSV or Python file.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml, .csv or .py (which is run; it has
            ``impedance(frequency, speed)`` or an object ``liner``).
    Raises:
        ValueError: no such preset, a file with mistakes.  FileNotFoundError: no such file.

    >>> liner = tl.load_liner("polito")
    >>> [f"{z:.2f}" for z in liner.impedance(1400.0, [0.0, 5.0]).tolist()]  # |v| = 0, 5 m/s
    ['0.08-0.40j', '4.62-0.65j']
    """
    suffix = Path(name).suffix.lower()
    if suffix == ".csv":
        found: LinerModel = TabulatedLiner.read_csv(name)
    elif suffix == ".py":
        found = _python_liner(Path(name))
    else:
        found = _build(*preset_or_file(PACKAGE, name, *KIND))
    found.settle(files=(str(name),) if suffix in (".csv", ".py", ".toml") else ())
    return found


def _build(content: Mapping[str, Any], path: Path) -> LinerModel:
    try:
        made: type[LinerModel] = resolve(_row_of(LINER_MODELS, content, "model"))
        given = _arguments(made, content, "", ABOUT)
        if "impedance_offset" in given:
            pair = given["impedance_offset"]
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError(f"impedance_offset is {pair!r}; two numbers are needed, [resistance, reactance]")
            given["impedance_offset"] = complex(*pair)
        if "layers" in given:
            given["layers"] = [_layer(table, f"layers.{i}") for i, table in enumerate(given["layers"])]
        if "fluid" in given:
            given["fluid"] = validated(FluidTable, given["fluid"], path).build()
        return made(**{**given, "name": given.get("name") or path.stem})
    except (TypeError, ValueError) as error:
        raise ValueError(str(error) if str(error).startswith(f"{path} has ") else f"{path}: {error}") from error


def _layer(table: Any, place: str) -> Any:
    if not isinstance(table, Mapping):
        raise ValueError(f"{place} = {table!r} is no table; write [[layers]], with two brackets, for each of them")
    kind = _row_of({**LAWS, Cavity.kind: Cavity}, table, "kind", f"{place}: ")
    return kind(**_arguments(kind, table, f"{place}.{kind.kind}.", ("kind",)))


def _row_of(known: Mapping[str, Any], table: Mapping[str, Any], key: str, place: str = "") -> Any:
    """What a table names by a key."""
    name = table.get(key)
    if not isinstance(name, str) or name not in known:
        near = did_you_mean(str(name), [*known])
        raise ValueError(f"{place}{key} is {name!r}{near}; it is one of {', '.join(known)}")
    return known[name]


def _arguments(made: type, table: Mapping[str, Any], place: str, about: tuple[str, ...]) -> dict[str, Any]:
    """Arguments of a class from a table with further keys; ValueError with all keys that are missing or unknown."""
    known, valid = arguments_of(made), [*about, *arguments_of(made)]
    needed = [name for name, (_, default) in known.items() if default is inspect.Parameter.empty]
    wrong = [f"{place}{key}: no such key{did_you_mean(key, valid)}" for key in table if key not in valid]
    wrong += [f"{place}{name}: missing" for name in needed if name not in table]
    if wrong:
        raise ValueError("; ".join(wrong))
    return {key: value for key, value in table.items() if key == "name" or key not in about}


def liner_text(liner: LinerModel, source: str) -> str:
    """TOML text that ``load_liner`` reads back as ``liner``; ``source`` says where the numbers come from."""
    facts = liner.describe()
    tables = [("[[layers]]", layer) for layer in facts.pop("layers", [])]
    tables += [("[fluid]", facts.pop("fluid"))] if facts.get("fluid") else []
    about = {"model": facts.pop("model"), "name": facts.pop("name"), "description": "", "source": source}
    # A JSON string, number or list of these is a TOML one.
    lines = ["# SI units; lengths in m, impedances normalised by rho c."]
    for heading, table in (("", about | facts), *tables):
        lines += ["", heading] if heading else []
        lines += [f"{key} = {json.dumps(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines) + "\n"


def _python_liner(path: Path) -> LinerModel:
    """The liner of a Python file: an object ``liner``, or a function ``impedance(frequency, speed)`` of tensors (Hz,
    m/s), beside it perhaps names of ``model.STATED``. Errors, also when the function is called, name file and line."""
    text, names = read_text(path), dict[str, Any](__name__=path.stem, __file__=str(path))
    try:
        exec(compile(text, str(path), "exec"), names)
    except (Exception, SystemExit) as error:
        raise ValueError(_where(error, path)) from error
    source = names.get("liner", SimpleNamespace(**{name: names[name] for name in STATED if name in names}))
    if isinstance(source, LinerModel):
        return source
    if not callable(getattr(source, "impedance", None)):
        wanted = "a function impedance(frequency, speed), or an object 'liner' with one"
        raise ValueError(f"{path} must define {wanted}")
    stated = {name: plain(getattr(source, name)) for name in STATED[2:] if hasattr(source, name)}
    digest = hashlib.sha256(text.encode()).hexdigest()
    facts = {"model": "python", "name": path.stem, "file": path.name, "sha256": digest, **stated}

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        name = f"{path}: impedance(frequency, speed)"
        try:
            return impedance_of(source, real_tensor(frequency), real_tensor(speed), name)
        except Exception as error:
            raise ValueError(str(error) if name in str(error) else _where(error, path)) from error

    found = as_liner(source)
    found.settle(**{"describe": lambda: dict(facts)} if not hasattr(source, "describe") else {}, impedance=impedance)
    return found


def _where(error: BaseException, path: Path) -> str:
    """File, last line of it that an error came through, and the error."""
    lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(path)]
    last = getattr(error, "lineno", [0, *lines][-1])
    return f"{path}, line {last}: {type(error).__name__}: {getattr(error, 'msg', error)}"
