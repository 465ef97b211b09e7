"""``SDoFLiner`` with further parameters, which a law of one's own puts into its coefficients."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import torch
from pydantic import create_model
from torch import Tensor

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.catalogue import SDoFFile
from torchliner.liners.cell import Parameter
from torchliner.liners.model import Number
from torchliner.liners.parameters import keys_of, numbers_of, parameters_of, require_ranges
from torchliner.liners.sdof import SDoFLiner

SAME_MACH = 0.01


class FurtherSDoFLiner(SDoFLiner):
    """Base of such models: frozen dataclasses with fields made by ``parameter`` and an own
    ``speed_law``."""

    mach: Parameter | None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_ranges(self._further(), "liner")

    def in_flow(self, mach: float | None) -> Self:
        """See ``LinerModel``."""
        if mach is None:
            return self
        if self.mach is None:
            return self.replace(mach=mach)
        stated = plain_number(self.mach)
        if abs(stated - mach) > SAME_MACH:
            raise ValueError(
                f"liner {self.name!r} states mach {stated:g}, and the data {mach:g}; leave mach out of the liner, "
                "which then takes that of the data"
            )
        return self

    @classmethod
    def of(cls, liner: SDoFLiner, **further: Any) -> Self:
        """The same liner with further parameters, SI; those it has already stay otherwise."""
        own = {each.name: getattr(liner, each.name) for each in dataclasses.fields(liner)}
        return cls(**own | further)

    def _further(self) -> dict[str, Number]:
        return numbers_of(self, "liner")

    def _tensors(self, device: torch.device) -> dict[str, Tensor]:
        """Further parameters, gradients kept."""
        return {name: real_tensor(getattr(self, name)).to(device) for name in self._further()}

    def _arguments(self) -> dict[str, Number]:
        return super()._arguments() | self._further()

    def _changes(self, values: Mapping[str, Any]) -> dict[str, Any]:
        own = {name: value for name, value in values.items() if name in self._further()}
        return super()._changes(values) | own


class FurtherFile(SDoFFile):
    """Keys of a file of such a model: those of "sdof", and the further parameters."""

    made: ClassVar[type[FurtherSDoFLiner]]

    def build(self, path: Path, name: str) -> FurtherSDoFLiner:
        """See ``LinerFile``."""
        return self.made(**self.arguments(name))


def file_of(made: type[FurtherSDoFLiner]) -> type[FurtherFile]:
    """Keys of a file with ``model = made.model``."""
    own = {each.name for each in parameters_of(made)}
    keys = {name: key for name, key in keys_of(made).items() if name in own}
    keys["model"] = (Literal[made.model], ...)
    found: type[FurtherFile] = create_model(f"{made.__name__}File", __base__=FurtherFile, **keys)
    found.made = made
    return found
