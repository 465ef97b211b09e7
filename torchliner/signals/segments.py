"""Overlapping segments of a record."""

from __future__ import annotations


def segment_starts(
    samples: int, start: int, seconds: float | None, sampling_rate: float
) -> tuple[list[int], int]:
    """First sample of each segment, and their length: overlapping by half, from ``start`` on.

    Args:
        samples: n of the record.
        start: first sample that may be used.
        seconds: length; None for one segment of all that is there.
        sampling_rate: Hz.
    Raises:
        ValueError: no segment fits, or it has fewer than two samples.
    """
    if seconds is None:
        return [start], samples - start
    length = round(seconds * sampling_rate)
    if not 2 <= length <= samples - start:
        raise ValueError(
            f"segment is {seconds:g} s, {length} samples; it must have 2 to the record's "
            f"{samples - start} ({(samples - start) / sampling_rate:g} s)"
        )
    return list(range(start, samples - length + 1, max(1, length // 2))), length
