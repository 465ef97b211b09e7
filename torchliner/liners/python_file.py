"""A liner as a user's Python file, which is run because the user names it, never from a TOML."""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import STATED, LinerModel, as_liner
from torchliner.liners.parameters import plain
from torchliner.liners.response import checked_impedance
from torchliner.names import did_you_mean
from torchliner.toml_files import read_text


def read_liner(path: Path) -> LinerModel:
    """The liner that a Python file defines.

    Args:
        path: of a file with a function ``impedance(frequency, speed)``, which takes tensors (Hz, m/s) and returns
            complex Z of their broadcast shape, beside it perhaps names of ``model.STATED``; or with an object
            ``liner``.
    Raises:
        FileNotFoundError: no such file.
        ValueError: it cannot be run, or defines no liner; file and line are named. Likewise when its function is
            called: it fails, or gives real numbers or another shape.
    """
    text = read_text(path)
    names: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    with _naming_line(path):
        exec(compile(text, str(path), "exec"), names)
    source = names.get("liner", SimpleNamespace(**names))
    if isinstance(source, LinerModel):
        return source
    wanted = (*STATED, "orifice_diameter")
    members = {name: getattr(source, name) for name in wanted if getattr(source, name, None) is not None}
    function, fluid = members.get("impedance"), members.get("fluid", Fluid())
    if not callable(function):
        near = did_you_mean("impedance", [name for name in names if name[0] != "_"])
        raise ValueError(
            f"{path} defines no function impedance(frequency, speed){near}, which is to return Z "
            "normalised by rho c, and no object 'liner' with one"
        )
    if not isinstance(fluid, Fluid):
        raise ValueError(f"{path}: fluid is {fluid!r}; a torchliner.Fluid is needed")
    digest = hashlib.sha256(text.encode()).hexdigest()
    facts = {"model": "python", "name": path.stem, "file": path.name, "sha256": digest}
    facts |= {name: plain(value) for name, value in members.items() if not callable(value)}
    first = getattr(getattr(function, "__code__", None), "co_firstlineno", 1)

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        """The function's, checked."""
        f, v = real_tensor(frequency), real_tensor(speed)
        with _naming_line(path, f"impedance fails on tensors of shape {tuple(f.shape)} and {tuple(v.shape)}: ", first):
            found = function(f, v)
        name = f"{path}, line {first}: impedance(frequency, speed)"
        checked = checked_impedance(found, f, v, name)
        if not torch.is_complex(torch.as_tensor(found)):
            raise ValueError(f"{name} gave real numbers; Z = R + j X is complex, add 1j times the reactance, or 0j")
        return checked

    members = {"describe": lambda: dict(facts), **members, "impedance": impedance}
    return as_liner(SimpleNamespace(**members))


@contextmanager
def _naming_line(path: Path, words: str = "", line: int = 1) -> Iterator[None]:
    """A block that runs the file: what it raises becomes a ValueError with the last line of the file that it came
    through, else with ``line``."""
    try:
        yield
    except (Exception, SystemExit) as error:
        frames = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(path)]
        if isinstance(error, SyntaxError) and error.filename == str(path):
            frames.append(error.lineno)
        what = f"{type(error).__name__}: {getattr(error, 'msg', error)}"
        raise ValueError(f"{path}, line {[line, *frames][-1]}: {words}{what}") from error
