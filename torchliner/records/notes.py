"""Warnings as objects: a code to act on, a text to read, and how much is at stake where that is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Note:
    """One warning about a result.

    Args:
        code: short and stable, such as "short-record"; what to search and filter by.
        text: what is wrong, with its numbers, the limit and the remedy.
        size: how far Z may be off by it, normalised; None where no number can be derived.
    """

    code: str
    text: str
    size: float | None = None

    def __str__(self) -> str:
        return self.text
