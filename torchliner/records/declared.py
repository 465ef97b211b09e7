"""A quantity said once: axes, unit and words of a field, from which its documentation and its file follow."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field
from itertools import takewhile
from typing import Any, TypeVar, dataclass_transform

from torchliner.checks import require_complex

SEVERAL = ("probes", "columns", "rows", "draws", "facesheet", "backplate")  # may stand for several axes or none
PARTS = {"impedance": ("resistance", "reactance"), "complex": ("real", "imaginary")}
LONG_NAMES = {"impedance": "normalised {}, {}", "complex": "{} part of the {}"}
Kind = TypeVar("Kind", bound=type)


@dataclass(frozen=True)
class Variable:
    """How a field stands in a file.

    Args:
        field: of the record.
        unit: SI, of record and file; the reader converts other units of the same quantity.
        dims: names of the axes, () for one number. "time", last in records, is first in files; some names stand
            for several axes or none, as the writer says.
        kind: real, flag (0 and 1 in the file), text, complex (two variables ``_real`` and ``_imaginary``), impedance.
        text: what it is.
        name: of the variable; default that of the field. That of an impedance has "{}" where those of its parts have
            resistance and reactance.
        optional: may be None in the record and absent from the file.
        wide: a sum, a bound or a quotient, which may be infinite or far from all that is measured.
        attributes: beside ``units`` and ``long_name``.
    """

    field: str
    unit: str = "1"
    dims: tuple[str, ...] = ()
    kind: str = "real"
    text: str = ""
    name: str = ""
    optional: bool = False
    wide: bool = False
    attributes: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if "{}" in self.name:
            object.__setattr__(self, "kind", "impedance")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the variable, or of its two parts."""
        name = self.name or self.field
        if self.kind not in PARTS:
            return (name,)
        return tuple(name.format(part) if "{}" in name else f"{name}_{part}" for part in PARTS[self.kind])

    @property
    def long_names(self) -> tuple[str, ...]:
        """Likewise; empty where nothing is said."""
        return tuple(LONG_NAMES[self.kind].format(part, self.text) for part in PARTS.get(self.kind, ())) or (self.text,)

    def within(self, part: Part) -> Variable:
        """The same in the file of the record that it is a part of."""
        words = " ".join(filter(None, (self.text, part.text)))
        dims = part.dims + tuple(name for dim in self.dims for name in part.axes.get(dim, (dim,)))
        return dataclasses.replace(self, name=part.stem + (self.name or self.field), dims=dims, text=words)


@dataclass(frozen=True)
class Part:
    """How a record within a record stands in its file: its variables behind a stem, their axes behind others.

    Args:
        stem: of names.  dims: axes before those of its own.  text: behind what its variables are.
        axes: dimensions that names of its own stand for.
        head: before the names of its attributes.
        by: "averagings": a mapping, its values stacked along ``averaging``; "names": a mapping, the stem of each behind
            its key; "groups": one or several records, each in a group of its own; "": one record.
    """

    stem: str = ""
    dims: tuple[str, ...] = ()
    text: str = ""
    axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    by: str = ""
    head: str = ""

    def within(self, outer: Part, field: str) -> Part:
        """The same, a field of a record that is a part itself."""
        inner = Variable("", dims=self.dims, text=self.text, name=self.stem).within(outer)
        head = f"{outer.head}{field}_"
        return dataclasses.replace(self, stem=inner.name, dims=inner.dims, text=inner.text, head=head)


def var(
    *dims: str,
    unit: str = "1",
    text: str = "",
    kind: str = "real",
    name: str = "",
    wide: bool = False,
    default: Any = MISSING,
    **attributes: str,
) -> Any:
    """A field of a record with what its file says of it; see ``Variable``."""
    about = Variable("", unit, dims, kind, text, name, default is not MISSING, wide, attributes)
    return field(default=default, metadata={"variable": about})


def part(
    stem: str = "",
    *dims: str,
    text: str = "",
    by: str = "",
    default: Any = MISSING,
    default_factory: Any = MISSING,
    **axes: tuple[str, ...],
) -> Any:
    """A field that is a record, or a mapping of records, by itself; see ``Part``."""
    known: Any = {"default": default, "default_factory": default_factory}
    return field(**known, metadata={"part": Part(stem, dims, text, axes, by)})


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(var, part, field))
def record(cls: Kind) -> Kind:
    """A frozen dataclass whose documentation lists what its fields say of themselves."""
    made: Any = dataclass(frozen=True, eq=False, repr=not hasattr(cls, "_heading"))(cls)
    head, _, rest = textwrap.dedent(f"    {cls.__doc__}").partition("\nArgs:\n")
    written = list(takewhile(lambda line: line.startswith(" "), rest.splitlines()))
    own = [f"    {row.field}: {_words(row)}." for row in variables_of(made) if row.field in cls.__annotations__]
    made.SAID = [*(line for base in cls.__bases__ for line in getattr(base, "SAID", ())), *written, *own]
    made.__doc__ = "\n".join([head.rstrip(), "", "Args:", *made.SAID, *rest.splitlines()[len(written) :]])
    return made


def _words(row: Variable) -> str:
    kind = {"impedance": "normalised impedance", "flag": "bool", "complex": "complex"}.get(row.kind, "")
    axes = f"({', '.join(row.dims)})" if row.dims else ""
    return ", ".join(filter(None, (row.text, kind, "" if row.unit == "1" else row.unit, axes)))


def variables_of(kind: type) -> list[Variable]:
    """What the fields of a record are in its file, in order; those of its parts aside."""
    return [
        dataclasses.replace(each.metadata["variable"], field=each.name)
        for each in dataclasses.fields(kind)
        if "variable" in each.metadata
    ]


def table_of(kind: type, *names: str) -> tuple[Variable, ...]:
    """Some of them, by field."""
    return tuple(row for row in variables_of(kind) if row.field in names)


def require_shapes(record: Any, name: str) -> None:
    """Refuse fields whose axes are not those that they say, or are longer than in the fields before.

    Raises:
        TypeError: a real tensor where a complex one is meant.
        ValueError: a shape; what is needed is named.
    """
    sizes: dict[str, int] = {}
    for row in variables_of(type(record)):
        value = getattr(record, row.field)
        if value is None or not row.dims:
            continue
        if row.kind in PARTS:
            require_complex(f"{name}: {row.field}", value)
        shape = (len(value),) if row.kind == "text" else tuple(value.shape)
        own = [dim for dim in row.dims if dim not in SEVERAL]
        tail = shape[len(shape) - len(own) :] if len(own) <= len(shape) else ()
        wanted = [sizes.setdefault(dim, size) for dim, size in zip(own, tail, strict=False)]
        if [*tail] != wanted or len(wanted) < len(own) or (len(own) == len(row.dims) < len(shape)):
            needed = ", ".join(f"{sizes[dim]} {dim}" if dim in sizes else dim for dim in row.dims)
            raise ValueError(f"{name}: {row.field} has shape {shape}; ({needed}) is needed")
