"""Overlapping segments of a record."""

from __future__ import annotations

import math


def segment_starts(
    samples: int, start: int, seconds: float | None, sampling_rate: float, overlap: float = 0.5
) -> tuple[list[int], int]:
    """First sample of each segment, evenly spaced from ``start`` on, and their length.

    Args:
        samples: n of the record.  start: first sample that may be used.
        seconds: length; None for one segment of all that is there.  sampling_rate: Hz.
        overlap: share of a segment that the next one covers too, 0 to below 1.
    Raises:
        ValueError: no segment fits, it has fewer than two samples, or the overlap is none.
    """
    if not 0 <= overlap < 1:
        raise ValueError(f"overlap is {overlap:g}; it is a share of a segment, 0 to below 1")
    if seconds is None:
        return [start], samples - start
    if not math.isfinite(seconds):
        raise ValueError(f"segment is {seconds:g} s; it must be finite")
    length = round(seconds * sampling_rate)
    if not 2 <= length <= samples - start:
        raise ValueError(
            f"segment is {seconds:g} s, {length} samples; it must have 2 to the record's "
            f"{samples - start} ({(samples - start) / sampling_rate:g} s)"
        )
    step = max(1, int((1 - overlap) * length + 1e-9))
    return list(range(start, samples - length + 1, step)), length
