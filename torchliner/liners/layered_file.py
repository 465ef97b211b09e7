"""Liner files with ``model = "layered"``: a table ``[[layers]]`` each, from the flow down.

The keys of a layer are the parameters of its class, so a new law needs nothing here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, ValidationError, create_model
from pydantic_core import InitErrorDetails

from torchliner.liners.catalogue import CellFile
from torchliner.liners.layered import LayeredLiner, layer_kinds
from torchliner.liners.parameters import keys_of
from torchliner.liners.sheets.sheet import Layer
from torchliner.names import did_you_mean
from torchliner.toml_files import Strict


def table_of(kind: str, layer: type[Layer]) -> type[Strict]:
    """Keys of a layer's table, with ranges and defaults."""
    keys = {"kind": (Literal[kind], ...)} | keys_of(layer)
    made: type[Strict] = create_model(f"{layer.__name__}Table", __base__=Strict, **keys)
    return made


def layer_of(table: Any) -> Layer:
    """A layer from its table.

    Raises:
        ValidationError: mistakes in its keys, at places that begin with the kind.
        ValueError: no table, no such kind, or values that no such layer has.
    """
    kinds = layer_kinds()
    if not isinstance(table, dict):
        raise ValueError("a table [[layers]] is needed")
    kind = table.get("kind")
    if kind not in list(kinds):
        raise ValueError(f"kind is {kind!r}{did_you_mean(str(kind), list(kinds))}; it is one of {', '.join(kinds)}")
    try:
        stated = table_of(kind, kinds[kind]).model_validate(table).model_dump(exclude={"kind"})
    except ValidationError as error:
        raise ValidationError.from_exception_data(
            error.title,
            [
                InitErrorDetails(
                    type=each["type"], loc=(kind, *each["loc"]), input=each["input"],
                    ctx=each.get("ctx", {}),
                )
                for each in error.errors()
            ],
        ) from None  # fmt: skip
    return kinds[kind](**stated)


def _listed(value: Any) -> Any:
    if not isinstance(value, list):
        raise ValueError("write [[layers]], with two brackets, above the table of each layer")
    return value


class LayeredFile(CellFile):
    """Keys of a file with ``model = "layered"``."""

    model: Literal["layered"]
    layers: Annotated[list[Annotated[Any, PlainValidator(layer_of)]], BeforeValidator(_listed)]
    septum_ratio: float | None = Field(None, gt=0)
    septum_speed: float | None = Field(None, gt=0)

    @classmethod
    def tables(cls) -> dict[str, type[Strict]]:
        """See ``LinerFile``."""
        return super().tables() | {kind: table_of(kind, of) for kind, of in layer_kinds().items()}

    def build(self, path: Path, name: str) -> LayeredLiner:
        """See ``LinerFile``."""
        return LayeredLiner(**self.arguments(name))
