"""Write torchliner/__init__.pyi: the public names, which are imported late, for editors and mypy.

``python scripts/make_stub.py`` after a public name or a choice of an eduction has changed.
"""

import ast
import dataclasses
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

import torchliner as tl
from torchliner.velocity.choices import Choices

STUB = Path(tl.__file__).with_suffix(".pyi")
NAMED = ("educe", "moments", "sensitivities")  # with all choices of an eduction by name
HEAD = '''# ruff: noqa
# fmt: off
"""Public names of torchliner; written by scripts/make_stub.py."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

import torch

from torchliner.studies.variants import Study
from torchliner.liners.model import Liner
from torchliner.velocity.reading import Progress, Reduce
'''


def signature(name: str) -> str:
    """A function's head with the choices by name."""
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(getattr(tl, name))))
    found = next(node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    assert found.args.kwarg is not None
    found.args.kwarg.annotation = ast.Name("Unpack[_Choices]")
    found.body, found.decorator_list = [ast.Expr(ast.Constant(...))], []
    return ast.unparse(found).replace(":\n    ...", ": ...")


def lines() -> Iterator[str]:
    """Of the stub."""
    yield HEAD
    for name, home in sorted(vars(tl)["_HOMES"].items(), key=lambda item: (item[1], item[0])):
        if name not in NAMED:
            yield f"from {home} import {name} as {name}"
    yield "from torchliner.names import __version__ as __version__\n"
    yield "__all__: list[str]\n\nclass _Choices(TypedDict, total=False):"
    yield from (f"    {field.name}: {inspect.formatannotation(field.type)}" for field in dataclasses.fields(Choices))
    yield from map(signature, NAMED)


def text() -> str:
    """The whole stub."""
    return "\n".join(lines()) + "\n"


if __name__ == "__main__":
    STUB.write_text(text(), encoding="utf-8")
