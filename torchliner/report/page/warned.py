"""Warnings, those first that move the answer most."""

from __future__ import annotations

import cmath
import re
from collections.abc import Iterable, Sequence
from typing import Any

from torchliner.records.origin import standing
from torchliner.report.page.blocks import Block, Bullets, Text, shown
from torchliner.report.page.sizes import KINDS, Kind, Size, Whole, whole_map, whole_points
from torchliner.report.page.subject import MapSubject, inputs_of
from torchliner.report.typesetting import typeset

UNKNOWN = "size unknown"
MOST_READ = 2000  # characters that tell a kind; ours are a quarter as long, those of a file any
LEAD = (
    "By kind, from what makes Z another quantity to what a short record does; within a kind by how "
    "far it may move R or X, over ρc, as far as the result holds numbers for it."
)
Sized = tuple[str, Size | None]


def warnings_of(notes: Sequence[str], source: str = "") -> list[Block]:
    """Of what has no sizes: by kind, and of two alike the larger closure in dB first."""
    return _listed([(text, None) for text in _texts(notes, source)], sizes=())


def sized_warnings(notes: Sequence[str], known: Whole | None, source: str = "") -> list[Sized]:
    """Each with its size, None where that is not known."""
    return [(text, size_of(text, known)) for text in _texts(notes, source)]


def listed(found: Sequence[Sized]) -> list[Block]:
    """The largest first within each kind, those of unknown size behind; sizes beside them."""
    return [Text(LEAD), *_listed(found, sizes=found)] if found else _listed(found, sizes=())


def size_of(text: str, known: Whole | None) -> Size | None:
    """Of one warning."""
    kind, said = _kind(text)
    if known is None:
        return None
    try:
        found = kind.size(known, said)
    except (ValueError, ArithmeticError):  # words of another program that look like ours
        return None
    # Where every probe counts as wall there is no Z that could move.
    return found if found is not None and cmath.isfinite(found.change) else None


def _kind(text: str) -> tuple[Kind, re.Match[str]]:
    begun = text[:MOST_READ]  # the search of some words grows as the square of the text
    return next((kind, said) for kind in KINDS if (said := re.search(kind.words, begun)))


def _texts(notes: Iterable[str], source: str) -> list[str]:
    return [shown(note).removeprefix(source).removeprefix(": ") for note in dict.fromkeys(notes)]


def _listed(found: Sequence[Sized], sizes: Sequence[Sized]) -> list[Block]:
    """A list; a sentence where there is none."""
    if not found:
        return [Text("None.")]
    ordered = sorted(dict(found).items(), key=_place)
    beside = [typeset(UNKNOWN if size is None else size.text()) for _, size in ordered]
    return [Bullets([typeset(_begun(text)) for text, _ in ordered], ordered=True,
                    beside=beside if sizes else ())]  # fmt: skip


def _place(each: Sized) -> tuple[float, ...]:
    text, size = each
    return _kind(text)[0].rank, size is None, -_decibels(text) if size is None else -size.largest


def _begun(text: str) -> str:
    """With a capital, unless it begins with a name of a file."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].strip(",:").isalpha() else text


def _decibels(text: str) -> float:
    found = re.search(r"([+-]\d+(?:\.\d*)?) dB", text)
    return abs(float(found[1])) if found else 0.0


def changed_inputs(result: Any) -> list[str]:
    """Warnings of inputs that are no longer what they were."""
    return [f"{each['what']}: {each['name']} is {now.words}; it is not what the result was made of"
            for each in inputs_of(result) if (now := standing(each)).changed]  # fmt: skip


def of_map(subject: MapSubject) -> list[Block]:
    """Of the map, and of the methods that stand beside it."""
    result = subject.result
    notes, source = [*changed_inputs(result), *result.notes], str(result.choices.get("source", ""))
    found = sized_warnings(notes, whole_map(subject), source)
    for other in result.alongside:
        found += sized_warnings(other.notes, whole_points(other))
    return listed(found)
