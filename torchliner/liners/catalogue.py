"""Liners from files: the presets of the package and the user's own."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Union

from pydantic import AfterValidator, Field, create_model
from torch import Tensor

from torchliner import toml_files
from torchliner.fluid import Fluid
from torchliner.liners.layered import layer_kinds
from torchliner.liners.model import LinerModel
from torchliner.liners.parameters import arguments_of, parameters_of
from torchliner.liners.plates import Layer
from torchliner.liners.python_file import read_liner
from torchliner.liners.tabulated import TabulatedLiner
from torchliner.names import LINER_MODELS, did_you_mean, resolve
from torchliner.toml_files import FluidTable, Pair, Strict, preset_or_file, validated

PACKAGE, KIND = "torchliner.liners", ("liner", ".toml, .csv or .py")
ABOUT = {"name": (str, ""), "description": (str, ""), "source": (str, "")}
IN_FILE = {  # how fields that are no parameters stand in a file, by type
    Fluid: Annotated[FluidTable, AfterValidator(FluidTable.build)],
    complex | Tensor: Annotated[Pair, AfterValidator(lambda pair: complex(*pair))],
}


def preset_names() -> list[str]:
    """Names of the liners shipped with the package.

    >>> [name for name in tl.preset_names() if not name.startswith("lbm") and not name.endswith("_example")]
    ['onera', 'polito', 'polito_as_printed']
    """
    return toml_files.preset_names(PACKAGE)


def preset_text(name: str) -> str:
    """The TOML text of a preset, to copy and edit; ValueError if there is none, with the nearest."""
    return toml_files.preset_text(PACKAGE, name, *KIND)


def load_liner(name: str | Path | Mapping[str, Any]) -> LinerModel:
    """A liner by preset name, from a TOML, CSV or Python file, or from what a map holds of it.

    Args:
        name: one of ``preset_names()``, or a path that ends in .toml, .csv or .py. A Python file is run; it has
            ``impedance(frequency, speed)`` or an object ``liner``. Or what ``describe`` of a model from a preset, TOML
            or CSV gives, as ``choices["liner"]`` of a map: the same liner, from its numbers alone.
    Raises:
        ValueError: no such preset (the nearest is named), or a file with mistakes: all of them are listed, each
            mistyped key with the nearest valid one; of a Python file the line. A description without the numbers of its
            model.
        FileNotFoundError: no such file.

    >>> liner = tl.load_liner("polito")
    >>> [f"{z:.2f}" for z in liner.impedance(1400.0, [0.0, 5.0]).tolist()]  # |v| = 0, 5 m/s
    ['0.08-0.40j', '4.62-0.65j']
    """
    if isinstance(name, Mapping):
        return _described(name)
    suffix = Path(name).suffix.lower()
    files = [str(name)] if suffix in (".toml", ".csv", ".py") else []
    if suffix == ".csv":
        found: LinerModel = TabulatedLiner.read_csv(name)
    elif suffix == ".py":
        found = read_liner(Path(name))
    else:
        content, path = preset_or_file(PACKAGE, name, *KIND)
        found = _build(content, path)
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
    keys = {**ABOUT, **(made.file_keys or _keys(made)), "model": (str, ...)}
    layers: dict[str, type[Strict]] = {}
    if "layers" in keys:
        kinds = layer_kinds()
        layers = {each: _table(each, kind=(Literal[each], ...), **_keys(own)) for each, own in kinds.items()}
        built = [Annotated[table, AfterValidator(partial(_layer, kinds[each]))] for each, table in layers.items()]
        one: Any = Annotated[Union[*built], Field(discriminator="kind")]
        keys["layers"] = (list[one], ...)
    table = validated(_table(made.__name__, **keys), content, path, {"fluid": FluidTable, **layers})
    given = {name: getattr(table, name) for name in keys if name not in ("model", "description", "source")}
    try:
        return made.from_file({**given, "name": given["name"] or path.stem}, path.parent)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _layer(kind: type[Layer], table: Strict) -> Layer:
    return kind(**table.model_dump(exclude={"kind"}))


def _table(title: str, /, **keys: Any) -> type[Strict]:
    made: type[Strict] = create_model(title, __base__=Strict, **keys)
    return made


def _keys(declared: type) -> dict[str, tuple[Any, Any]]:
    """Keys of a file, for pydantic, from the arguments of a class."""
    found: dict[str, tuple[Any, Any]] = {}
    for name, (hint, default) in arguments_of(declared).items():
        needed = ... if default is inspect.Parameter.empty else default
        found[name] = (IN_FILE.get(hint, hint), needed)
        if within := parameters_of(declared).get(name):
            limits: dict[str, Any] = {"ge" if within.low_included else "gt": within.low, "le": within.high}
            found[name] = (float | None if default is None else float, Field(needed, **limits))
    return found


def liner_text(liner: LinerModel, source: str, description: str = "") -> str:
    """TOML text that ``load_liner`` reads back as ``liner``, of plain numbers and with a name;
    ``source`` says where the numbers come from."""
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
