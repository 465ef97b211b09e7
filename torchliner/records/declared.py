"""A quantity said once: axes, unit, range and words of a field; its documentation, checks and file follow from it."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from itertools import takewhile
from typing import Any, TypeVar, dataclass_transform

import torch

from torchliner.checks import make_plain, require_complex

SEVERAL = ("probes", "columns", "rows", "draws", "facesheet", "backplate")  # may stand for several axes or none
OF_TWO = {"part": (2,), "with_part": (2,)}  # dimensions of real and imaginary part
PARTS = {"impedance": ("resistance", "reactance"), "complex": ("real", "imaginary")}
LONG_NAMES = {"impedance": "normalised {}, {}", "complex": "{} part of the {}"}
ANY = "(-inf, inf)"  # the range of what is finite
Kind = TypeVar("Kind", bound=type)


@dataclass(frozen=True)
class Variable:
    """How a field stands in a file.

    Args:
        field: of the record.
        unit: SI, of record and file; the reader converts other units of the same quantity.
        dims: names of the axes, () for one number. "time", last in records, is first in files; those of ``SEVERAL``
            stand for what the ``axes`` of the record say.
        kind: real, flag (0 and 1 in the file), text, complex (two variables ``_real`` and ``_imaginary``), impedance.
        text: what it is.
        name: of the variable; default that of the field. That of an impedance has "{}" where those of its parts have
            resistance and reactance.
        optional: may be None in the record and absent from the file.
        wide: a sum, a bound or a quotient, which may be infinite or far from all that is measured.
        range: of the values of a record, such as "[0, 1)"; "" for any.
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
    range: str = ""
    attributes: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if "{}" in self.name:
            object.__setattr__(self, "kind", "impedance")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the variable, or of its two parts."""
        name = self.name or self.field
        return tuple(name.format(part) if "{}" in name else f"{name}_{part}" for part in PARTS.get(self.kind, ())) or (
            name,
        )

    @property
    def long_names(self) -> tuple[str, ...]:
        """Likewise."""
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

    def named(self, name: str) -> Part:
        """One of several by names; as measured, the averaging ``admittance`` needs none."""
        stem, text = ("", "") if name == "admittance" else (f"{name.replace('-', '_')}_", f", averaging {name}")
        return dataclasses.replace(self, stem=stem + self.stem, text=self.text + text)


def var(
    *dims: str,
    unit: str = "1",
    text: str = "",
    kind: str = "real",
    name: str = "",
    wide: bool = False,
    range: str = "",
    default: Any = MISSING,
    **attributes: str,
) -> Any:
    """A field of a record with what its file says of it; see ``Variable``."""
    about = Variable("", unit, dims, kind, text, name, default is not MISSING, wide, range, attributes)
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
    made: Any = dataclass(frozen=True, eq=False, repr=not hasattr(cls, "_facts"))(cls)
    head, _, rest = textwrap.dedent(f"    {cls.__doc__}").partition("\nArgs:\n")
    written = list(takewhile(lambda line: line.startswith(" "), rest.splitlines()))
    own = [f"    {row.field}: {_words(row)}." for row in variables_of(made) if row.field in cls.__annotations__]
    made.SAID = [*(line for base in cls.__bases__ for line in getattr(base, "SAID", ())), *written, *own]
    made.__doc__ = "\n".join([head.rstrip(), "", "Args:", *made.SAID, *rest.splitlines()[len(written) :]])
    return made


def _words(row: Variable) -> str:
    kind = {"impedance": "normalised impedance", "flag": "bool", "complex": "complex"}.get(row.kind, "")
    axes = f"({', '.join(row.dims)})" if row.dims else ""
    values = f"within {row.range}" if row.range not in ("", ANY) else ""
    return ", ".join(filter(None, (row.text, kind, "" if row.unit == "1" else row.unit, values, axes)))


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


def parts_of(kind: type, outer: Part) -> dict[str, Part]:
    """Records within a record, by field."""
    known = {each.name: each.metadata["part"] for each in dataclasses.fields(kind) if "part" in each.metadata}
    return {name: own.within(outer, name) for name, own in known.items()}


def flat(record: Any, part: Part | None = None, *, derived: bool = True) -> Iterator[tuple[Variable, Any]]:
    """Every variable of a record and of its parts as its file has it, and its value; ``derived``: what follows, too."""
    part = part or Part()
    for row in (*variables_of(type(record)), *(getattr(record, "DERIVED", ()) if derived else ())):
        if (value := getattr(record, row.field)) is not None:
            yield row.within(part), value
    for name, inner in parts_of(type(record), part).items():
        value = getattr(record, name)
        if inner.by == "averagings":
            several = [*value.values()]
            yield from flat(type(several[0]).stacked(several), inner, derived=derived)
        elif inner.by == "names":
            for key, one in value.items():
                yield from flat(one, inner.named(key), derived=derived)
        elif inner.by == "" and dataclasses.is_dataclass(value):
            yield from flat(value, inner, derived=derived)


def check(record: Any, *, tensors: bool = False) -> None:
    """Make the numbers of a record plain, and refuse values beyond their ranges and shapes that disagree.

    Args:
        record: with a ``name``, for messages.
        tensors: leave scalar tensors, through which derivatives may pass.
    Raises:
        TypeError: another kind of value.
        ValueError: field, value, place and range are named.
    """
    make_plain(record, tensors=tensors)
    for row in variables_of(type(record)):
        value = getattr(record, row.field)
        if value is not None and row.range:
            _require_range(row, torch.as_tensor(value).detach(), record.name)
    require_shapes(record, record.name)


def _require_range(row: Variable, values: torch.Tensor, name: str) -> None:
    low, high = (float(end) for end in row.range[1:-1].split(","))
    real = values.abs() if values.is_complex() else values
    above, below = (
        real >= low if row.range[0] == "[" else real > low,
        real <= high if row.range[-1] == "]" else real < high,
    )
    good = above & below
    if bool(good.all()):
        return
    place = tuple((~good).nonzero()[0].tolist())
    where = f" at {', '.join(map(str, place))} and {int((~good).sum()) - 1} more" if place else ""
    number, unit = float(real[place]), "" if row.unit == "1" else f" {row.unit}"
    needed = "finite values are" if row.range == ANY else f"{row.range}{unit} is"
    text = f" ({row.text})" if row.text else ""
    raise ValueError(f"{name}: {row.field} is {number:g}{unit}{where}; {needed} needed{text}")


def require_shapes(record: Any, name: str) -> None:
    """Refuse fields whose axes are not those that they say, or are longer than in the fields before.

    Raises:
        TypeError: a real tensor where a complex one is meant.
        ValueError: a shape; what is needed is named.
    """
    sizes: dict[str, tuple[int, ...]] = {**OF_TWO}
    for row, value in flat(record, derived=False):
        if row.dims:
            if row.kind in PARTS:
                require_complex(f"{name}: {row.field}", value)
            shape = (len(value),) if isinstance(value, tuple | list) else tuple(value.shape)
            require_shape(row, shape, sizes, f"{name}: {row.field}")


def require_shape(row: Variable, shape: Sequence[int], sizes: dict[str, tuple[int, ...]], label: str) -> None:
    """Each dimension has one length in all variables; ``sizes`` collects them, () for those of no axis.

    Raises:
        ValueError: this shape is another.
    """
    own = sum(dim not in SEVERAL for dim in row.dims)
    free, at = len(shape) - own, 0
    fits = free >= 0 and (free == 0 or own < len(row.dims))
    for dim in row.dims if fits else ():
        length = tuple(shape[at : at + (free if dim in SEVERAL else 1)])
        at += len(length)
        fits &= sizes.setdefault(dim, length) == length
    if not fits:
        needed = ", ".join(f"{'x'.join(map(str, sizes[dim]))} {dim}" if sizes.get(dim) else dim for dim in row.dims)
        raise ValueError(f"{label} has shape {tuple(shape)}; ({needed}) is needed")
