"""Liners from files: the presets of the package and the user's own TOML, CSV and Python files."""

import hashlib
import inspect
import json
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from torchliner import file_checks
from torchliner.checks import real_tensor
from torchliner.file_checks import FluidTable, preset_or_file, read_text, validated
from torchliner.fluid import Fluid
from torchliner.liners.laws import LAWS
from torchliner.liners.layered import Cavity
from torchliner.liners.model import STATED, LinerModel, arguments_of, as_liner, impedance_of, plain
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.names import LINER_MODELS, did_you_mean, resolve

PACKAGE, KIND = "torchliner.liners", ("liner", ".toml, .csv or .py")
ABOUT = ("model", "name", "description", "source")  # keys of any liner file


def preset_names() -> list[str]:
    """Names of the liners shipped with the package.

    >>> [name for name in tl.preset_names() if not name.startswith("lbm") and not name.endswith("_example")]
    ['onera', 'polito', 'polito_as_printed']
    """
    return file_checks.preset_names(PACKAGE)


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit; ValueError if there is none, with the nearest."""
    return file_checks.preset_text(PACKAGE, name, *KIND)


def load_liner(name: str | Path | Mapping[str, Any]) -> LinerModel:
    """A liner by preset name, from a TOML, CSV or Python file, or from what a map holds of it.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml, .csv or .py (which is run; it has
            ``impedance(frequency, speed)`` or an object ``liner``). Or what ``describe`` of a model gives, as
            ``choices["liner"]`` of a map.
    Raises:
        ValueError: no such preset, a file with mistakes (missing and unknown keys, with the nearest valid one), or a
            description that lacks numbers.
        FileNotFoundError: no such file.

    >>> liner = tl.load_liner("polito")
    >>> [f"{z:.2f}" for z in liner.impedance(1400.0, [0.0, 5.0]).tolist()]  # |v| = 0, 5 m/s
    ['0.08-0.40j', '4.62-0.65j']
    """
    if isinstance(name, Mapping):
        return _described(name)
    suffix, files = Path(name).suffix.lower(), [str(name)]
    if suffix == ".csv":
        found: LinerModel = TabulatedLiner.read_csv(name)
    elif suffix == ".py":
        found = _python_liner(Path(name))
    else:
        content, path = preset_or_file(PACKAGE, name, *KIND)
        found = _build(content, path)
        files = files if suffix == ".toml" else []
        files += [str(path.parent / content["file"])] if "file" in content else []
    found.settle(files=tuple(files))
    return found


def _described(about: Mapping[str, Any]) -> LinerModel:
    if "file" in about:  # whoever wrote a map does not choose what is read here
        raise ValueError(f"the liner is described by the file {about['file']!r} and not by its numbers; load that file")
    found = _build(about, Path(str(about.get("name", "liner"))))
    differ = [key for key, value in found.describe().items() if value != about.get(key)]
    if differ:
        lost = f"the description of liner {about.get('name')!r} lacks {', '.join(differ)}"
        raise ValueError(f"{lost}; describe() of a model, and so a map, states them")
    return found


def _build(content: Mapping[str, Any], path: Path) -> LinerModel:
    kind = content.get("model")
    if not isinstance(kind, str) or kind not in LINER_MODELS:
        near = did_you_mean(str(kind), list(LINER_MODELS))
        raise ValueError(f"{path}: model is {kind!r}{near}; it is one of {', '.join(LINER_MODELS)}")
    made: type[LinerModel] = resolve(LINER_MODELS[kind])
    try:
        given = _arguments(made, content, "", ABOUT)
        pair = given.get("impedance_offset", (0, 0))
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise ValueError(f"impedance_offset is {pair!r}; two numbers are needed, [resistance, reactance]")
        if "impedance_offset" in given:
            given["impedance_offset"] = complex(*pair)
        if "layers" in given:
            given["layers"] = [_layer(table, f"layers.{i}") for i, table in enumerate(given["layers"])]
        if "fluid" in given:
            given["fluid"] = validated(FluidTable, given["fluid"], path, {}).build()
        return made.from_file({**given, "name": given.get("name") or path.stem}, path.parent)
    except (TypeError, ValueError) as error:
        raise ValueError(str(error) if str(error).startswith(f"{path} has ") else f"{path}: {error}") from error


def _layer(table: Any, place: str) -> Any:
    if not isinstance(table, Mapping):
        raise ValueError(f"{place} = {table!r} is no table; write [[layers]], with two brackets, for each of them")
    kinds, kind = {**LAWS, Cavity.kind: Cavity}, table.get("kind")
    if kind not in kinds:
        near = did_you_mean(str(kind), [*kinds])
        raise ValueError(f"{place}: kind is {kind!r}{near}; it is one of {', '.join(kinds)}")
    return kinds[kind](**_arguments(kinds[kind], table, f"{place}.{kind}.", ("kind",)))


def _arguments(made: type, table: Mapping[str, Any], place: str, about: tuple[str, ...]) -> dict[str, Any]:
    """Arguments of a class from a table with further keys; ValueError with all keys that are missing or unknown."""
    known, keys = arguments_of(made), getattr(made, "file_keys", None)
    needed = [name for name, (_, default) in known.items() if default is inspect.Parameter.empty and not keys]
    valid = [*about, *(keys or known)]
    wrong = [f"{place}{key}: no such key{did_you_mean(key, valid)}" for key in table if key not in valid]
    wrong += [f"{place}{name}: missing" for name in needed if name not in table]
    if wrong:
        raise ValueError("; ".join(wrong))
    return {key: value for key, value in table.items() if key == "name" or key not in about}


def liner_text(liner: LinerModel, source: str, description: str = "") -> str:
    """TOML text that ``load_liner`` reads back as ``liner``; ``source`` says where the numbers come from."""
    facts = liner.describe()
    tables = [("[[layers]]", layer) for layer in facts.pop("layers", [])]
    tables += [("[fluid]", facts.pop("fluid"))] if facts.get("fluid") else []
    about = {"model": facts.pop("model"), "name": facts.pop("name"), "description": description, "source": source}
    # A JSON string, number or list of these is a TOML one.
    lines = ["# SI units; lengths in m, impedances normalised by rho c."]
    for heading, table in (("", about | facts), *tables):
        lines += ["", heading] if heading else []
        lines += [f"{key} = {json.dumps(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines) + "\n"


def _python_liner(path: Path) -> LinerModel:
    """The liner of a Python file: an object ``liner``, or a function ``impedance(frequency, speed)`` of tensors (Hz,
    m/s), beside it perhaps names of ``model.STATED``. Errors, also when the function is called, name file and line."""
    text = read_text(path)
    names: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    try:
        exec(compile(text, str(path), "exec"), names)
    except (Exception, SystemExit) as error:
        raise ValueError(_where(error, path)) from error
    source = names.get("liner", SimpleNamespace(**names))
    if isinstance(source, LinerModel):
        return source
    wanted = (*STATED, "orifice_diameter")
    members = {name: getattr(source, name) for name in wanted if getattr(source, name, None) is not None}
    function = members.get("impedance")
    if not callable(function) or not isinstance(members.get("fluid", Fluid()), Fluid):
        raise ValueError(
            f"{path} must define a function impedance(frequency, speed), which returns Z normalised by rho c, or an "
            "object 'liner' with one; fluid, if it is stated, is a torchliner.Fluid"
        )
    digest = hashlib.sha256(text.encode()).hexdigest()
    facts = {"model": "python", "name": path.stem, "file": path.name, "sha256": digest}
    facts |= {name: plain(value) for name, value in members.items() if not callable(value)}

    def guarded(f: Tensor, v: Tensor) -> Any:
        try:
            found = function(f, v)
        except Exception as error:
            raise ValueError(f"{_where(error, path)} (frequency {tuple(f.shape)}, speed {tuple(v.shape)})") from error
        if not torch.is_complex(torch.as_tensor(found)):
            raise ValueError(f"{path}: impedance gave real numbers; Z = R + j X is complex, add 1j times X, or 0j")
        return found

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        name, own = f"{path}: impedance(frequency, speed)", SimpleNamespace(impedance=guarded)
        return impedance_of(own, real_tensor(frequency), real_tensor(speed), name)

    return as_liner(SimpleNamespace(**{"describe": lambda: dict(facts), **members, "impedance": impedance}))


def _where(error: BaseException, path: Path) -> str:
    """File, last line of it that an error came through, and the error."""
    lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(path)]
    last = error.lineno if isinstance(error, SyntaxError) else [0, *lines][-1]
    return f"{path}, line {last}: {type(error).__name__}: {getattr(error, 'msg', error)}"
