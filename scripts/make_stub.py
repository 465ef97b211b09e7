"""Write torchliner/__init__.pyi: the public names, which are imported late, for editors and mypy.

``python scripts/make_stub.py`` after a public name or a choice of an eduction has changed.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

import torchliner as tl
from torchliner.tdibc.choices import Choices

STUB = Path(tl.__file__).with_suffix(".pyi")
NAMED = ("moments", "moments_part", "sensitivities")  # with all choices of an eduction by name
PLANE = "VelocityPlane | Moments"
OVERLOADS = {PLANE: "ImpedanceMap", f"Sequence[{PLANE}]": "list[ImpedanceMap]"}  # of educe
HEAD = '''# ruff: noqa
# fmt: off
"""Public names of torchliner; written by scripts/make_stub.py."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack, overload

import torch

from torchliner.calibration.sensitivities import Sensitivities
from torchliner.liners.model import Liner
from torchliner.tdibc.prepared import Progress
'''


def signature(name: str, **changed: str) -> str:
    """A function's head with the choices by name, and other annotations where they are given."""
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(getattr(tl, name))))
    found = next(node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    assert found.args.kwarg is not None
    found.args.kwarg.annotation = ast.Name("Unpack[_Choices]")
    for argument in found.args.args:
        if argument.arg in changed:
            argument.annotation = ast.Name(changed[argument.arg])
    if "returns" in changed:
        found.returns = ast.Name(changed["returns"])
    found.body, found.decorator_list = [ast.Expr(ast.Constant(...))], []
    return ast.unparse(found).replace(":\n    ...", ": ...")


def lines() -> Iterator[str]:
    """Of the stub."""
    yield HEAD
    written = {"educe", *NAMED}
    for name, home in sorted(vars(tl)["_HOMES"].items(), key=lambda item: (item[1], item[0])):
        if name not in written:
            yield f"from {home} import {name} as {name}"
    yield "from torchliner.version import __version__ as __version__\n"
    yield "__all__: list[str]\n\nclass _Choices(TypedDict, total=False):"
    yield from (f"    {field.name}: {field.type}" for field in dataclasses.fields(Choices))
    for plane, returns in OVERLOADS.items():
        yield f"\n@overload\n{signature('educe', plane=plane, returns=returns)}"
    yield from map(signature, NAMED)


def text() -> str:
    """The whole stub."""
    return "\n".join(lines()) + "\n"


if __name__ == "__main__":
    STUB.write_text(text(), encoding="utf-8")
