"""A liner as a user's Python file, which is run because the user names it, never from a TOML."""

from __future__ import annotations

import hashlib
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.fluid import Fluid
from torchliner.liners.model import STATED, LinerModel, as_liner, checked_impedance
from torchliner.liners.parameters import plain
from torchliner.toml_files import read_text


def read_liner(path: Path) -> LinerModel:
    """The liner that a Python file defines.

    Args:
        path: of a file with a function ``impedance(frequency, speed)``, which takes tensors (Hz, m/s) and returns
            complex Z of their broadcast shape, beside it perhaps names of ``model.STATED``; or with an object
            ``liner``.
    Raises:
        FileNotFoundError: no such file.
        ValueError: it cannot be run, or defines no liner. Likewise when its function is called: it fails, or gives real
            numbers or another shape. The file is named, and of an error in it the line.
    """
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
    function, fluid = members.get("impedance"), members.get("fluid", Fluid())
    if not callable(function) or not isinstance(fluid, Fluid):
        raise ValueError(
            f"{path} must define a function impedance(frequency, speed), which returns Z normalised by rho c, or an "
            "object 'liner' with one; fluid, if it is stated, is a torchliner.Fluid"
        )
    facts = {
        "model": "python",
        "name": path.stem,
        "file": path.name,
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
        **{name: plain(value) for name, value in members.items() if not callable(value)},
    }

    def impedance(frequency: Any, speed: Any = 0.0) -> Tensor:
        """The function's, checked."""
        f, v = real_tensor(frequency), real_tensor(speed)
        try:
            found = function(f, v)
        except Exception as error:
            raise ValueError(f"{_where(error, path)} (frequency {tuple(f.shape)}, speed {tuple(v.shape)})") from error
        if not torch.is_complex(torch.as_tensor(found)):
            raise ValueError(f"{path}: impedance gave real numbers; Z = R + j X is complex, add 1j times X, or 0j")
        return checked_impedance(found, f, v, f"{path}: impedance(frequency, speed)")

    members = {"describe": lambda: dict(facts), **members, "impedance": impedance}
    return as_liner(SimpleNamespace(**members))


def _where(error: BaseException, path: Path) -> str:
    """File, last line of it that an error came through, and the error."""
    lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(path)]
    last = error.lineno if isinstance(error, SyntaxError) else [0, *lines][-1]
    return f"{path}, line {last}: {type(error).__name__}: {getattr(error, 'msg', error)}"
