"""Impedance lines as netCDF-4 and as CSV: the fields of ``ImpedanceLine`` name the variables."""

from __future__ import annotations

from typing import Any

from torchliner.io.csv_rows import Rows, rows_of
from torchliner.io.own_file import RESULT_ENDINGS, OwnFile
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
    return [{"station": name, **row} for name, row in zip(names, rows_of(columns, shape), strict=True)]


class LineFile(OwnFile):
    """Its CSV has the columns of the table on a terminal."""

    def rows(self, record: ImpedanceLine, of: str | None = None) -> Rows:
        """Of the stations."""
        return line_rows(record)


FILE = LineFile(
    "torchliner line 1",
    "impedance line",
    record=ImpedanceLine,
    others=RESULT_ENDINGS,
    places={"stations": ("station",)},
    csv={"end": "\n"},
)
write_line, read_line = FILE.write, FILE.read
