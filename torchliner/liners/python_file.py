"""A liner as a user's Python file, which is run because the user names it, never from a TOML."""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import STATED, LinerModel, as_liner, plain
from torchliner.liners.response import checked_impedance
from torchliner.names import did_you_mean
from torchliner.toml_files import read_text


def read_liner(path: Path) -> LinerModel:
    """The liner that a Python file defines.

    Args:
        path: of a file with a function ``impedance(frequency, speed)``, which takes tensors (Hz,
            m/s) and returns complex Z of their broadcast shape, beside it perhaps names of
            ``model.STATED``; or with an object ``liner``.
    Raises:
        FileNotFoundError: no such file.
        ValueError: it cannot be run, or defines no liner; file and line are named. Likewise
            when its function is called: it fails, or gives real numbers or another shape.
    """
    text = read_text(path)
    names: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    try:
        exec(compile(text, str(path), "exec"), names)
    except (Exception, SystemExit) as error:
        raise ValueError(f"{_place(path, error)}: {_words(error)}") from error
    source = names.get("liner")
    if isinstance(source, LinerModel):
        return source
    wanted = (*STATED, "orifice_diameter")
    held = {name: names.get(name) if source is None else getattr(source, name, None) for name in wanted}
    members = {name: value for name, value in held.items() if value is not None}
    if not callable(members.get("impedance")):
        near = did_you_mean("impedance", [name for name in names if name[0] != "_"])
        raise ValueError(
            f"{path} defines no function impedance(frequency, speed){near}, which is to return Z "
            "normalised by rho c, and no object 'liner' with one"
        )
    if not isinstance(members.get("fluid", Fluid()), Fluid):
        raise ValueError(f"{path}: fluid is {members['fluid']!r}; a torchliner.Fluid is needed")
    digest = hashlib.sha256(text.encode()).hexdigest()
    facts = {"model": "python", "name": path.stem, "file": path.name, "sha256": digest}
    facts |= {name: plain(value) for name, value in members.items() if not callable(value)}
    members = {"describe": lambda: dict(facts), **members, "impedance": _guarded(path, members["impedance"])}
    bound = {name: staticmethod(member) if callable(member) else member for name, member in members.items()}
    return as_liner(type(path.stem, (), bound)())


def _guarded(path: Path, function: Callable[[Tensor, Tensor], Any]) -> Callable[..., Tensor]:
    """The function, with errors that name file and line."""
    code = getattr(function, "__code__", None)
    where = f"{path}, line {code.co_firstlineno}" if code else str(path)

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        f, v = real_tensor(frequency), real_tensor(speed)
        try:
            found = function(f, v)
        except Exception as error:
            raise ValueError(
                f"{_place(path, error, where)}: impedance(frequency, speed) failed for tensors of shape "
                f"{tuple(f.shape)} and {tuple(v.shape)}: {_words(error)}"
            ) from error
        name = f"{where}: impedance(frequency, speed)"
        checked = checked_impedance(found, f, v, name)
        if not torch.is_complex(torch.as_tensor(found)):
            raise ValueError(f"{name} gave real numbers; Z = R + j X is complex, add 1j times the reactance, or 0j")
        return checked

    return impedance


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {getattr(error, 'msg', error)}"


def _place(path: Path, error: BaseException, otherwise: str = "") -> str:
    """File and the last of its lines that an error came through."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return f"{path}, line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == str(path)]
    return f"{path}, line {lines[-1]}" if lines else otherwise or str(path)
