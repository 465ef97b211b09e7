"""Impedance lines as CSV, one row a station and frequency."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from torchliner.io.hdf5 import written_whole
from torchliner.records import ImpedanceLine


def write_line_csv(line: ImpedanceLine, path: str | Path) -> None:
    """Write a line as CSV; the old file is replaced when the new one is whole."""
    with written_whole(path) as temporary, temporary.open("w", newline="") as file:
        rows = line_rows(line)
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def line_rows(line: ImpedanceLine) -> list[dict[str, Any]]:
    """One row a station and frequency: Z of (5.1), its interval, the spread over the segments."""
    rows = []
    middle, spread, admittance = line.impedance, line.segment_spread, line.admittance
    level = line.inferred_incident_level
    for n, name in enumerate(line.names):
        for f, frequency in enumerate(line.frequency.tolist()):
            row: dict[str, Any] = {"station": name}
            row |= {f"{key} (m)": float(getattr(line, key)[n]) for key in "xyz"}
            row |= {"frequency (Hz)": frequency}
            for part, word in (("real", "resistance"), ("imag", "reactance")):
                row[word] = float(getattr(middle[n, f], part))
                if line.interval is not None:
                    for end in ("low", "high"):
                        row[f"{word} {end}"] = float(
                            getattr(getattr(line.interval, end)[n, f], part)
                        )
                row[f"{word} spread over segments"] = float(getattr(spread[n, f], part))
                row[f"admittance {part}"] = float(getattr(admittance[n, f], part))
            row |= {
                "mean velocity (m/s)": float(line.mean_velocity[n]),
                "velocity rms (m/s)": float(line.velocity_rms[n]),
                "coherent velocity peak (m/s)": float(line.velocity_level[n, f]),
                "coherence": float(line.coherence[n, f]),
                "inferred incident level (dB)": float(level[n, f]),
                "attenuation": float(line.attenuation[n, f].abs()),
                "segments": int(line.segments[n]),
                "bursts": int(line.bursts[n]),
                "rate (1/s)": float(line.rate[n]),
                "counts": int(line.used[n]),
                "wall": "" if line.wall is None else int(line.wall[n, f]),
                "flags": len(line.flags[n]),
            }
            rows.append(row)
    return rows
