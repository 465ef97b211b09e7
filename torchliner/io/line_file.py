"""Impedance lines as the rows of a table on a terminal."""

from __future__ import annotations

from typing import Any

import torch

from torchliner.io.csv_rows import Rows
from torchliner.records import ImpedanceLine


def line_rows(line: ImpedanceLine) -> Rows:
    """One row a station and frequency: Z of (5.1), its interval, the spread over the segments."""
    shape = (line.stations, len(line.frequency))
    columns: dict[str, Any] = {f"{axis} (m)": getattr(line, axis)[:, None] for axis in "xyz"}
    columns["frequency (Hz)"] = line.frequency
    for part, word in (("real", "resistance"), ("imag", "reactance")):
        columns[word] = getattr(line.impedance, part)
        if line.interval is not None:
            columns |= {f"{word} {end}": getattr(getattr(line.interval, end), part) for end in ("low", "high")}
        columns[f"{word} spread over segments"] = getattr(line.segment_spread, part)
        columns[f"admittance {part}"] = getattr(line.admittance, part)
    columns |= {
        "mean velocity (m/s)": line.mean_velocity[:, None],
        "velocity rms (m/s)": line.velocity_rms[:, None],
        "coherent velocity peak (m/s)": line.velocity_level,
        "coherence": line.coherence,
        "inferred incident level (dB)": line.inferred_incident_level,
        "attenuation": line.attenuation.abs(),
        "segments": line.segments[:, None],
        "bursts": line.bursts[:, None],
        "rate (1/s)": line.rate[:, None],
        "counts": line.used[:, None].int(),
        "wall": "" if line.wall is None else line.wall.int(),
        "flags": [[len(flags)] for flags in line.flags],
    }
    if line.level_check is not None:
        columns["level check (dB)"] = line.level_check.cells.level[0]
    names = [name for name in line.names for _ in range(shape[1])]
    return [{"station": name, **row} for name, row in zip(names, _rows_of(columns, shape), strict=True)]


def _rows_of(columns: dict[str, Any], shape: tuple[int, int]) -> Rows:
    """One row for each element of ``shape``, of columns that broadcast to it; texts stand in every row."""
    flat = []
    for values in columns.values():
        if isinstance(values, str):
            flat.append([values] * (shape[0] * shape[1]))
        else:
            flat.append(torch.as_tensor(values).broadcast_to(*shape).reshape(-1).tolist())
    return [dict(zip(columns, row, strict=True)) for row in zip(*flat, strict=True)]
