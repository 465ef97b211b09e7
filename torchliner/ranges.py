"""Frequencies as they are typed: one, or a range."""

from __future__ import annotations

MOST_FREQUENCIES = 10_000  # of one range: more is a slip of the step


def frequencies(text: str) -> list[float]:
    """One frequency, or LOW:HIGH:STEP with both ends.

    Raises:
        ValueError: neither.
    """
    numbers = [float(part) for part in text.split(":")]
    if len(numbers) == 1:
        return numbers
    low, high, step = numbers
    if not (step > 0 and low <= high < float("inf") and (high - low) / step < MOST_FREQUENCIES):
        raise ValueError(text)
    return [low + i * step for i in range(int((high - low) / step + 1e-9) + 1)]
