"""Options from the signatures and docstrings of public functions, which are read and not imported."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from torchliner import names
from torchliner.cli.options import ARRAY, COUNT, FILE, HZ, NUMBER, TEXT, M, Option, S

PACKAGE = Path(__file__).resolve().parents[1]
KINDS = {"float": NUMBER, "int": COUNT, "bool": None}


class Parameter(NamedTuple):
    """Of a function, or a field of a dataclass."""

    annotation: str
    default: Any
    text: str


def of(home: str, wanted: str, *, shown: str = "", group: str = "", **changes: dict[str, Any]) -> list[Option]:
    """Options of parameters, with their kinds, defaults and texts.

    Args:
        home: module and name, "velocity.educe:educe".
        wanted: names of parameters, as options without dashes.
        shown: those that --help shows, if not all; of their texts it shows the first sentence.
        group: title in the help.
        changes: of fields of an ``Option``, by parameter.
    """
    known = parameters(home)
    found = []
    for name in wanted.split():
        one = known[name]
        text, usual = one.text.rstrip(".").replace("``", ""), ""
        if one.default is not None and one.default is not False and not re.search(r"\bdefault\b", text):
            usual = f"; default {one.default:g}" if isinstance(one.default, float) else f"; default {one.default}"
        kind = (
            getattr(names, NAMES[name])
            if name in NAMES
            else UNITS.get(name) or KINDS.get(one.annotation.split(" | ")[0], TEXT)
        )
        about: dict[str, Any] = {"kind": kind, "further": bool(shown) and name not in shown.split(), "group": group}
        about |= {"flag": f"--{name.replace('_', '-')}", "text": text + usual, "about": text.split(". ")[0] + usual}
        found.append(Option(**about | changes.get(name, {})))
    return found


NAMES = {
    "averaging": "AVERAGINGS",
    "phase": "PHASES",
    "drive": "DRIVES",
    "mean": "MEANS",
    "missing": "MISSING",
    "dtype": "DTYPES",
    "kernel": "KERNELS",
    "spacing": "SPACINGS",
    "interpolation": "INTERPOLATIONS",
    "overlap": "OVERLAPS",
    "normal": "NORMALS",
    "window": "WINDOWS",
    "condition": "CONDITIONS",
    "weights": "WEIGHTS",
    "far_end": "FAR_ENDS",
    "losses": "LOSSES",
    "correction": "CORRECTIONS",
    "flagged": "FLAGGED",
}  # lists of names by parameter
UNITS = {
    "running_window": S,
    "segment": S,
    "start": S,
    "stop": S,
    "sampling_rate": HZ,
    "cell_pitch": M,
    "x": ARRAY,
    "z": ARRAY,
    "y": ARRAY,
    "holes": FILE,
    "points": FILE,
}


@cache
def parameters(home: str) -> dict[str, Parameter]:
    """Of a function or of a dataclass, by name, as the source has them."""
    module, name = home.split(":")
    body = ast.parse((PACKAGE / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")).body
    node: Any = next(each for each in body if getattr(each, "name", "") == name)
    constants = {ast.unparse(n.targets[0]): n.value for n in body if isinstance(n, ast.Assign)}
    pairs: dict[str, tuple[Any, Any]] = {}
    if isinstance(node, ast.ClassDef):
        pairs = {ast.unparse(n.target): (n.annotation, n.value) for n in node.body if isinstance(n, ast.AnnAssign)}
    elif isinstance(node, ast.FunctionDef):
        usual, keywords = node.args.args, node.args.kwonlyargs
        values = [None] * (len(usual) - len(node.args.defaults)) + node.args.defaults + node.args.kw_defaults
        pairs = {a.arg: (a.annotation, v) for a, v in zip([*usual, *keywords], values, strict=True)}
    texts = _texts(ast.get_docstring(node) or "")
    return {
        name: Parameter(ast.unparse(annotation), _value(default, constants), texts.get(name, ""))
        for name, (annotation, default) in pairs.items()
    }


def _value(default: ast.expr | None, constants: dict[str, ast.expr]) -> Any:
    """A literal, or a constant of the module; None for all else."""
    if isinstance(default, ast.Name):
        default = constants.get(default.id)
    try:
        return None if default is None else ast.literal_eval(default)
    except ValueError:
        return None


def _texts(docstring: str) -> dict[str, str]:
    """What Args says of each parameter; names before one colon share a text."""
    section = re.search(r"^Args:\n((?: +.*\n)+)", docstring + "\n", re.MULTILINE)
    found = {}
    for entry in re.split(r"\n(?=    \S)", section[1].rstrip() if section else ""):
        known, _, text = entry.partition(": ")
        found.update(dict.fromkeys(known.replace(",", " ").split(), " ".join(text.split())))
    return found
