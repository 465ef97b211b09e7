"""A quantity said once: axes, unit, range and words of a field; its documentation, checks and file follow from it."""

from __future__ import annotations

import dataclasses
import functools
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, replace
from itertools import takewhile
from typing import Any, TypeVar, dataclass_transform

ANY = "(-inf, inf)"  # the range of what is finite
# What users give, unless another is declared: signals (Pa, m/s), whose squares are summed; places (m) and times (s).
RANGES = {"signal": "[-1e9, 1e9]", "places": "[-1e5, 1e5]"}
Kind = TypeVar("Kind", bound=type)


@dataclass(frozen=True)
class Variable:
    """How a field stands in a file.

    Of its ``dims``, () for one number, "time" is last in records and first in files; those of ``checked.SEVERAL`` stand
    for what the ``axes`` of the record say. Its ``kind`` is real, flag (0 and 1 in the file), text or complex (two
    variables); what users give and ``checked.check`` makes a tensor of is a signal or places.
    """

    field: str  # of the record
    unit: str = "1"  # SI, of record and file; the reader converts other units of the same quantity
    dims: tuple[str, ...] = ()
    kind: str = "real"
    text: str = ""
    name: str = ""  # default that of the field; of an impedance with "{}" for resistance and reactance
    optional: bool = False  # may be None in the record and absent from the file
    wide: bool = False  # a sum, a bound or a quotient, which may be infinite or far from all that is measured
    range: str = ""  # of the values of a record, such as "[0, 1)"; "" for any
    attributes: Mapping[str, str] = dataclasses.field(default_factory=dict)  # beside ``units`` and ``long_name``

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
    axes, and behind what they are. ``by`` "averagings" it is a mapping, its values stacked along ``averaging``; by
    "names" one with the stem of each behind its key; by "groups" one or several records, each in a group of its own.
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
        stem, text = self.stem + own.stem, " ".join(filter(None, (own.text, self.text)))
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
    range = range or RANGES.get(kind, "")
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
    values = f"within {row.range}" if row.range not in ("", ANY, *RANGES.values()) else ""
    return ", ".join(filter(None, (row.text, kind, "" if row.unit == "1" else row.unit, values, axes)))


def _variables_of(kind: Any) -> tuple[Variable, ...]:
    fields = dataclasses.fields(kind)
    return tuple(replace(each.metadata["variable"], field=each.name) for each in fields if "variable" in each.metadata)


def _parts_of(kind: Any) -> dict[str, Part]:
    return {each.name: each.metadata["part"] for each in dataclasses.fields(kind) if "part" in each.metadata}


# What the fields of a record are in its file, in order, those of its parts aside; and the records within it, by field.
variables_of: Callable[[Any], tuple[Variable, ...]] = functools.cache(_variables_of)
parts_of: Callable[[Any], dict[str, Part]] = functools.cache(_parts_of)


def table_of(kind: type, *names: str) -> tuple[Variable, ...]:
    """Some of the variables, by field."""
    return tuple(row for row in variables_of(kind) if row.field in names)


def facts_of(kind: Any) -> list[str]:
    """Fields that are neither variables nor records: attributes of its file."""
    return [each.name for each in dataclasses.fields(kind) if each.init and not {"variable", "part"} & {*each.metadata}]


def flat(record: Any, part: Part = WHOLE, *, derived: bool = True) -> Iterator[tuple[Variable, Any]]:
    """Every variable of a record and of its parts as its file has it, and its value; ``derived``: what follows, too."""
    for row in (*variables_of(type(record)), *(getattr(record, "DERIVED", ()) if derived else ())):
        if (value := getattr(record, row.field)) is not None:
            yield part.row(row), value
    for name, own in parts_of(type(record)).items():
        value, several = getattr(record, name), {"": getattr(record, name)}
        if own.by == "groups" or value is None:
            continue
        if own.by == "averagings":
            several = {"": type(next(iter(value.values()))).stacked([*value.values()])}
        for key, one in (value if own.by == "names" else several).items():
            yield from flat(one, part.part(own, key), derived=derived)
