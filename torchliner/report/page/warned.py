"""Warnings, those first that move the answer most."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from torchliner.report.page.blocks import Block, Bullets, Text, shown
from torchliner.report.typesetting import typeset

# What a warning says, from what makes Z another quantity to what only widens its interval; of two
# alike the one with the larger closure in dB comes first.
SIZES = (
    ": failed: |null test", "closure at .* fails", "in the liner and", "closure at .* is open",
    "fewer than .*periods|samples per period|beyond|wavelengths",
    "excluded|no probe|lost|exactly 0", "admittances is off", "error bars|interval|blocks",
)  # fmt: skip


def warnings_of(notes: Sequence[str], source: str = "") -> list[Block]:
    """A list, the largest first; a sentence where there is none."""
    if not notes:
        return [Text("None.")]
    items = [shown(note).removeprefix(source).removeprefix(": ") for note in notes]
    ordered = sorted(dict.fromkeys(items), key=lambda text: (_rank(text), -_decibels(text)))
    return [Bullets([typeset(_begun(text)) for text in ordered], ordered=True)]


def _begun(text: str) -> str:
    """With a capital, unless it begins with a name of a file."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].strip(",:").isalpha() else text


def _rank(text: str) -> int:
    return next((i for i, words in enumerate(SIZES) if re.search(words, text)), len(SIZES) - 2)


def _decibels(text: str) -> float:
    found = re.search(r"([+-]\d+\.?\d*) dB", text)
    return abs(float(found[1])) if found else 0.0


def of_map(subject: Any) -> list[Block]:
    """Of the map, and of the methods that stand beside it."""
    result = subject.result
    notes = [*result.notes, *(note for other in result.alongside for note in other.notes)]
    return warnings_of(notes, str(result.choices.get("source", "")))
