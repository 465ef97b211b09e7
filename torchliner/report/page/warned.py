"""Warnings, those first that move the answer most."""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Sequence
from typing import Any

from torchliner.records.notes import Note
from torchliner.records.origin import standing
from torchliner.report.page.blocks import Block, Bullets, Text, shown
from torchliner.report.page.sizes import KINDS, UNRANKED, Size
from torchliner.report.page.subject import MapSubject, inputs_of
from torchliner.report.typesetting import typeset

UNKNOWN = "size unknown"
LEAD = (
    "By kind, from what makes Z another quantity to what a short record does; within a kind by how "
    "far it may move R or X, over ρc, as far as the result holds numbers for it."
)
Sized = tuple[Note, Size | None]


def warnings_of(notes: Iterable[Note | str]) -> list[Block]:
    """Of what has no sizes: by kind."""
    return _listed([(each, None) for each in as_notes(notes)], with_sizes=False)


def listed(found: Sequence[Sized]) -> list[Block]:
    """The largest first within each kind, those of unknown size behind; sizes beside them."""
    return [Text(LEAD), *_listed(found)] if found else _listed(found)


def as_notes(notes: Iterable[Note | str]) -> list[Note]:
    """Each once; texts have no code."""
    return list(dict.fromkeys(Note("", each) if isinstance(each, str) else each for each in notes))


def size_of(note: Note, subject: MapSubject) -> Size | None:
    """Of one warning of a map."""
    _, sizing = KINDS.get(note.code, (UNRANKED, None))
    found = None if sizing is None else sizing(subject, note)
    # Where every probe counts as wall there is no Z that could move.
    return found if found is not None and cmath.isfinite(found.change) else None


def _listed(found: Sequence[Sized], *, with_sizes: bool = True) -> list[Block]:
    """A list; a sentence where there is none."""
    if not found:
        return [Text("None.")]
    ordered = sorted(found, key=_place)
    beside = [typeset(UNKNOWN if size is None else size.text()) for _, size in ordered]
    texts = [typeset(_begun(shown(note.text))) for note, _ in ordered]
    return [Bullets(texts, ordered=True, beside=beside if with_sizes else ())]


def _place(each: Sized) -> tuple[float, ...]:
    note, size = each
    return KINDS.get(note.code, (UNRANKED, None))[0], size is None, 0.0 if size is None else -size.largest


def _begun(text: str) -> str:
    """With a capital, unless it begins with a name of a file."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].strip(",:").isalpha() else text


def changed_inputs(result: Any) -> list[Note]:
    """Warnings of inputs that are no longer what they were."""
    return [
        Note("changed-input", f"{each['what']}: {each['name']} is {now.words}; it is not what the result was made of")
        for each in inputs_of(result)
        if (now := standing(each)).changed
    ]


def of_map(subject: MapSubject) -> list[Block]:
    """Of the map, and of the methods that stand beside it."""
    result, source = subject.result, str(subject.result.choices.get("source", ""))
    notes = [Note(n.code, n.text.removeprefix(source).removeprefix(": "), n.size) for n in result.notes]
    found: list[Sized] = [(note, size_of(note, subject)) for note in as_notes([*changed_inputs(result), *notes])]
    for other in result.alongside:
        found += [(note, None) for note in as_notes(other.notes)]
    return listed(found)
