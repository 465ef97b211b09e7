"""A quantity said once: axes, unit, range and words of a field; its documentation, checks and file follow from it."""

from __future__ import annotations

import dataclasses
import functools
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, replace
from itertools import takewhile
from typing import Any, TypeVar, dataclass_transform

import torch

from torchliner.checks import make_plain, require_choice, require_complex

SEVERAL = ("probes", "columns", "rows", "draws", "facesheet", "backplate", "places")  # for several axes or none
OF_TWO = {"part": (2,), "with_part": (2,)}  # dimensions of real and imaginary part
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
        kind: real, flag (0 and 1 in the file), text or complex (two variables, ``_real`` and ``_imaginary``).
        text: what it is.
        name: of the variable; default that of the field. An impedance has "{}" where the names of its two variables
            have resistance and reactance.
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

    @property
    def parts(self) -> dict[str, str]:
        """Long names by name: of the variable, or of its real and its imaginary part."""
        name = self.name or self.field
        if "{}" in name:
            return {name.format(part): f"normalised {part}, {self.text}" for part in ("resistance", "reactance")}
        if self.kind == "complex":
            return {f"{name}_{part}": f"{part} part of the {self.text}" for part in ("real", "imaginary")}
        return {name: self.text}

    @property
    def names(self) -> tuple[str, ...]:
        """Of the variable, or of its two parts."""
        return tuple(self.parts)


@dataclass(frozen=True)
class Part:
    """How a record within a record stands in its file: what is put before the names of its variables and before their
    axes, and behind what they are.

    Args:
        stem, dims, text: these.
        by: "averagings": a mapping, its values stacked along ``averaging``; "names": a mapping, the stem of each behind
            its key; "groups": one or several records, each in a group of its own; "": one record.
    """

    stem: str = ""
    dims: tuple[str, ...] = ()
    text: str = ""
    by: str = ""

    def row(self, own: Variable) -> Variable:
        """A variable of the inner record as the file has it."""
        words = " ".join(filter(None, (own.text, self.text)))
        return replace(own, name=self.stem + (own.name or own.field), dims=self.dims + own.dims, text=words)

    def part(self, own: Part, key: str = "") -> Part:
        """A record within the inner one; of several by names that of a key. As measured, averaging ``admittance``, it
        needs none."""
        text = " ".join(filter(None, (own.text, self.text)))
        stem = self.stem + own.stem
        if key not in ("", "admittance"):
            stem, text = f"{key.replace('-', '_')}_{stem}", f"{text}, averaging {key}"
        return Part(stem, self.dims + own.dims, text, own.by)


WHOLE = Part()  # of a record that is a file, or a group of one, by itself


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


def part(stem: str = "", *dims: str, text: str = "", by: str = "", **default: Any) -> Any:
    """A field that is a record, or a mapping of records, by itself; see ``Part``."""
    return field(**default, metadata={"part": Part(stem, dims, text, by)})


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
    kind = "normalised impedance" if "{}" in row.name else {"flag": "bool", "complex": "complex"}.get(row.kind, "")
    axes = f"({', '.join(row.dims)})" if row.dims else ""
    values = f"within {row.range}" if row.range not in ("", ANY) else ""
    return ", ".join(filter(None, (row.text, kind, "" if row.unit == "1" else row.unit, values, axes)))


def _variables_of(kind: Any) -> tuple[Variable, ...]:
    fields = dataclasses.fields(kind)
    return tuple(replace(each.metadata["variable"], field=each.name) for each in fields if "variable" in each.metadata)


def _parts_of(kind: Any) -> dict[str, Part]:
    return {each.name: each.metadata["part"] for each in dataclasses.fields(kind) if "part" in each.metadata}


# What the fields of a record are in its file, in order, those of its parts aside; and how the records within it stand
# there, by field.
variables_of: Callable[[Any], tuple[Variable, ...]] = functools.cache(_variables_of)
parts_of: Callable[[Any], dict[str, Part]] = functools.cache(_parts_of)


def table_of(kind: type, *names: str) -> tuple[Variable, ...]:
    """Some of the variables, by field."""
    return tuple(row for row in variables_of(kind) if row.field in names)


def facts_of(kind: Any) -> list[str]:
    """Fields that are neither variables nor records: attributes of its file."""
    named = {"variable", "part"}
    return [each.name for each in dataclasses.fields(kind) if each.init and not named & {*each.metadata}]


def flat(record: Any, part: Part = WHOLE, *, derived: bool = True) -> Iterator[tuple[Variable, Any]]:
    """Every variable of a record and of its parts as its file has it, and its value; ``derived``: what follows, too."""
    for row in (*variables_of(type(record)), *(getattr(record, "DERIVED", ()) if derived else ())):
        if (value := getattr(record, row.field)) is not None:
            yield part.row(row), value
    for name, own in parts_of(type(record)).items():
        value = getattr(record, name)
        if own.by == "averagings":
            several = [*value.values()]
            yield from flat(type(several[0]).stacked(several), part.part(own), derived=derived)
        elif own.by == "names":
            for key, one in value.items():
                yield from flat(one, part.part(own, key), derived=derived)
        elif own.by == "" and value is not None:
            yield from flat(value, part.part(own), derived=derived)


def check(record: Any, *, tensors: bool = False) -> None:
    """Make the numbers of a record plain, and refuse values beyond their ranges and shapes that disagree.

    Args:
        record: with a ``name``, for messages.
        tensors: leave scalar tensors, through which derivatives may pass.
    Raises:
        TypeError: another kind of value.
        ValueError: field, value, place and range are named; a text that is none of the ``choices`` of its field.
    """
    make_plain(record, tensors=tensors)
    for each in dataclasses.fields(record):
        if "choices" in each.metadata:
            require_choice(f"{record.name}: {each.name}", getattr(record, each.name), each.metadata["choices"])
    there = [(row, value) for row in variables_of(type(record)) if (value := getattr(record, row.field)) is not None]
    for row, value in there:
        if not row.range:
            continue
        low, high = (float(end) for end in row.range[1:-1].split(","))
        values = torch.as_tensor(value).detach()
        values = values.abs() if values.is_complex() else values
        good = (values >= low if row.range[0] == "[" else values > low) & (
            values <= high if row.range[-1] == "]" else values < high
        )
        if not bool(good.all()):
            place = tuple((~good).nonzero()[0].tolist())
            where = f" at {', '.join(map(str, place))} and {int((~good).sum()) - 1} more" if place else ""
            unit = "" if row.unit == "1" else f" {row.unit}"
            needed = "finite values are" if row.range == ANY else f"{row.range}{unit} is"
            text = f" ({row.text})" if row.text else ""
            number = f"{float(values[place]):g}{unit}{where}"
            raise ValueError(f"{record.name}: {row.field} is {number}; {needed} needed{text}")
    require_shapes(there, record.name)


def require_shapes(
    rows: Iterable[tuple[Variable, Any]], name: str, sizes: Mapping[str, tuple[int, ...]] = OF_TWO
) -> None:
    """Refuse values whose axes are not those that they say, or are longer than in the values before.

    Args:
        rows: variables with their values, as of ``flat``.
        name: for messages.
        sizes: lengths of dimensions that are known, () for those of no axis.
    Raises:
        TypeError: a real tensor where a complex one is meant.
        ValueError: a shape; what is needed is named.
    """
    known = dict(sizes)
    for row, value in rows:
        if not row.dims:
            continue
        if row.kind == "complex" or "{}" in row.name:
            require_complex(f"{name}: {row.field}", value)
        shape = (len(value),) if isinstance(value, tuple | list) else tuple(value.shape)
        own = sum(dim not in SEVERAL for dim in row.dims)
        free, at = len(shape) - own, 0
        fits = free >= 0 and (free == 0 or own < len(row.dims))
        for dim in row.dims if fits else ():
            length = shape[at : at + (free if dim in SEVERAL else 1)]
            at += len(length)
            fits &= known.setdefault(dim, length) == length
        if not fits:
            needed = ", ".join(f"{'x'.join(map(str, known[dim]))} {dim}" if known.get(dim) else dim for dim in row.dims)
            raise ValueError(f"{name}: {row.field} has shape {shape}; ({needed}) is needed")
