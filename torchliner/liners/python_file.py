"""A liner as a user's Python file, which is run because the user names it, never from a TOML."""

from __future__ import annotations

import dataclasses
import hashlib
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import STATED, LinerModel, as_liner
from torchliner.names import did_you_mean
from torchliner.toml_files import read_text

Function = Callable[[Tensor, Tensor], Any]
TAKEN = (*STATED, "orifice_diameter")


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
        raise ValueError(f"{_place(path, error) or path}: {_words(error)}") from error
    source = names.get("liner")
    if isinstance(source, LinerModel):
        return source
    stated = {name: names.get(name) if source is None else getattr(source, name, None) for name in TAKEN}
    members = {name: value for name, value in stated.items() if value is not None}
    if not callable(members.get("impedance")):
        near = did_you_mean("impedance", [name for name in names if name[0] != "_"])
        raise ValueError(
            f"{path} defines no function impedance(frequency, speed){near}, which is to return Z "
            "normalised by rho c, and no object 'liner' with one"
        )
    if not isinstance(members.get("fluid", Fluid()), Fluid):
        raise ValueError(f"{path}: fluid is {members['fluid']!r}; a torchliner.Fluid is needed")
    about: dict[str, Any] = {
        key: value.item() if isinstance(value, Tensor) else value
        for key, value in members.items()
        if not callable(value)
    }
    if "fluid" in about:
        about["fluid"] = dataclasses.asdict(about["fluid"])
    digest = hashlib.sha256(text.encode()).hexdigest()
    facts = {"model": "python", "name": path.stem, "file": path.name, "sha256": digest, **about}
    members = {"describe": lambda: dict(facts), **members}
    members["impedance"] = _guarded(path, members["impedance"])
    held = {name: staticmethod(m) if callable(m) else m for name, m in members.items()}
    return as_liner(type(path.stem, (), held)())


def _guarded(path: Path, function: Function) -> Function:
    """The function, with errors that name file and line."""

    code = getattr(function, "__code__", None)
    where = f"{path}, line {code.co_firstlineno}" if code else f"{path}"

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        f, v = real_tensor(frequency), real_tensor(speed)
        shape = torch.broadcast_shapes(f.shape, v.shape)
        try:
            found = function(f, v)
            found = found if isinstance(found, Tensor) else torch.from_numpy(np.asarray(found))
        except Exception as error:
            raise ValueError(
                f"{_place(path, error) or where}: impedance(frequency, speed) failed for tensors "
                f"of shape {tuple(f.shape)} and {tuple(v.shape)}: {_words(error)}"
            ) from error
        if not found.is_complex():
            raise ValueError(
                f"{where}: impedance(frequency, speed) gave real numbers; Z = R + j X is complex, "
                "add 1j times the reactance, or 0j"
            )
        if not bool(torch.isfinite(found.detach().abs()).all()):
            raise ValueError(
                f"{where}: impedance(frequency, speed) gave nan or inf between {float(f.min()):g} "
                f"and {float(f.max()):g} Hz and up to {float(v.max()):g} m/s"
            )
        try:
            return found.to(torch.complex128).broadcast_to(shape)
        except RuntimeError as error:
            raise ValueError(
                f"{where}: impedance(frequency, speed) gave shape {tuple(found.shape)} for a "
                f"frequency of shape {tuple(f.shape)} and a speed of shape {tuple(v.shape)}; "
                f"{tuple(shape)} is needed"
            ) from error

    return impedance


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {getattr(error, 'msg', error)}"


def _place(path: Path, error: BaseException) -> str:
    """File and the last of its lines that an error came through; "" where it came through none."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return f"{path}, line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == str(path)]
    return f"{path}, line {lines[-1]}" if lines else ""
