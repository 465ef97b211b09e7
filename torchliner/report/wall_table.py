"""Impedances educed from wall pressures as rows and as a text table."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.report.table import Column, Table, format_complex, format_pair, real_and_imaginary

LEVEL = 0.95  # of the intervals
HARD = 1e6  # |Z| that a table calls rigid
SHOWN = 4  # singular values in the table
Educed = WallEduction | FieldFit


@dataclass(frozen=True)
class WallRow:
    """One frequency of one line.

    Args:
        line: file or title.  source: side.  method: of the eduction.  frequency: Hz.
        wavenumber: 1/m, nan for a fit of the field.  impedance: normalised.
        deviation: of R (real) and X (imaginary) over the draws; without draws None, or the error
            that a fit of the field states itself; infinite where that has no bound.
        interval: bounds of 95 % of the draws, None without them, or without a bound.
        residual: of the pressures, relative.
        singular_values: over the first one; empty for fits.
        failed: draws without an impedance.
        misfit: residuals over the stated errors, rms, end_reflection: of the far end, rise: of Z
            along the liner, and rise_error: its standard errors, of a fit of the field; None for
            other methods.
    """

    line: str
    source: str
    method: str
    frequency: float
    impedance: complex
    deviation: complex | None
    interval: tuple[complex, complex] | None
    residual: float
    failed: int
    wavenumber: complex = complex(math.nan, math.nan)
    singular_values: tuple[float, ...] = ()
    misfit: float | None = None
    end_reflection: complex | None = None
    rise: complex | None = None
    rise_error: complex | None = None


def wall_rows(line: MicrophoneLine, found: Educed) -> list[WallRow]:
    """A row a frequency of a line without leading axes.

    Raises:
        ValueError: the line has leading axes, as files of draws do.
    """
    if found.impedance.ndim != 1:
        raise ValueError(
            f"{line.name} holds {tuple(found.impedance.shape[:-1])} lines; a table needs one"
        )
    bounds = found.interval(LEVEL) if found.draws is not None else None
    rows = []
    for f, frequency in enumerate(found.frequency.tolist()):
        drawn = found.draws is not None
        rows.append(
            WallRow(
                line.title or line.name, found.source_side, found.method, frequency,
                impedance=complex(found.impedance[f]),
                deviation=complex(found.standard_deviation[f]) if drawn else None,
                interval=None if bounds is None else (complex(bounds[0][f]), complex(bounds[1][f])),
                residual=float(found.residual[f]), failed=int(found.failed[f]) if drawn else 0,
            )
        )  # fmt: skip
    if isinstance(found, WallEduction):
        return [replace(row, **_of_waves(found, f)) for f, row in enumerate(rows)]
    return [replace(row, **_of_field(found, row, f)) for f, row in enumerate(rows)]


def _of_waves(found: WallEduction, f: int) -> dict[str, Any]:
    """What only waves have."""
    values: tuple[float, ...] = ()
    if found.singular_values is not None:
        values = tuple((found.singular_values[:, f] / found.singular_values[0, f]).tolist())
    return {"wavenumber": complex(found.wavenumber[f]), "singular_values": values}


def _of_field(found: FieldFit, row: WallRow, f: int) -> dict[str, Any]:
    """What only a fit of the field has."""
    error = complex(found.standard_error[f])
    bounded = not cmath.isinf(error)
    return {
        "deviation": row.deviation if bounded and row.deviation is not None else error,
        "interval": row.interval if bounded else None,
        "misfit": float(found.misfit[f]) ** 0.5,
        "end_reflection": complex(found.end_reflection[f]),
        "rise": complex(found.rise[f]),
        "rise_error": complex(found.rise_error[f]),
    }


_LOW, _HIGH = (
    real_and_imaginary(f"resistance_{end}", f"reactance_{end}",
                       lambda row, i=i: row.interval and row.interval[i])
    for i, end in enumerate(("low", "high"))
)  # fmt: skip
COLUMNS = (
    Column("line"),
    Column("source"),
    Column("method"),
    Column("frequency"),
    *real_and_imaginary("wavenumber_real", "wavenumber_imag", "wavenumber"),
    *real_and_imaginary("resistance", "reactance", "impedance"),
    *real_and_imaginary("resistance_deviation", "reactance_deviation", "deviation"),
    _LOW[0],
    _HIGH[0],
    _LOW[1],
    _HIGH[1],
    Column("residual"),
    Column("singular_values", lambda row: " ".join(f"{v:.3g}" for v in row.singular_values)),
    Column("failed_draws", "failed"),
    Column("misfit", lambda row: math.nan if row.misfit is None else row.misfit),
    *real_and_imaginary("end_reflection_real", "end_reflection_imag", "end_reflection"),
    *real_and_imaginary("rise_of_resistance", "rise_of_reactance", "rise"),
    *real_and_imaginary("rise_of_resistance_error", "rise_of_reactance_error", "rise_error"),
)


def wall_table(rows: Sequence[WallRow]) -> Table:
    """For CSV and JSON: complex values as two numbers, nan where there is none."""
    return Table(rows, COLUMNS)


def format_wall(line: MicrophoneLine, found: Educed) -> str:
    """A text table of one line."""
    kind = "" if isinstance(found, FieldFit) or found.rank is None else (
        f", rank {found.rank}, order {found.order}")  # fmt: skip
    head = (
        f"{line.title or line.name}: {found.method}{kind}, source {found.source_side}, "
        f"{len(found.x)} microphones from {1e3 * float(found.x[0]):.4g} to "
        f"{1e3 * float(found.x[-1]):.4g} mm, H {1e3 * float(line.duct_height):.4g} mm, "
        f"M {float(line.mach):.3g}"
    )
    rows = wall_rows(line, found)
    if isinstance(found, WallEduction):
        return (
            f"{head}, {found.choices['condition']}\n{Table(rows, WAVES).as_text()}\n"
            "Z is p/(rho c v), exp(+jwt - j alpha x), x along the flow; deviation: of R and X over "
            "the draws"
        )
    errors = "the microphones' errors" if found.draws is None else "the draws"
    if found.choices["variation"] == "constant":
        rows = [replace(row, rise=None, rise_error=None) for row in rows]
    return (
        f"{head}, far end {found.choices['far_end']}\n{Table(rows, FIELD).as_text()}\n"
        f"Z is p/(rho c v), exp(+jwt); deviation: of R and X by {errors} (of the rise: by the "
        "fit); over errors: residuals over the stated errors, 1 if the duct is right"
    )


def _wall(impedance: complex) -> str:
    return "rigid" if abs(impedance) > HARD else format_complex(impedance)


def _deviation(value: complex | None) -> str:
    if value is not None and cmath.isinf(value):
        return "no bound"
    return "none settled" if value is not None and cmath.isnan(value) else format_pair(value)


WAVES = (
    Column("", "frequency", "f Hz", ".1f"),
    Column("", "wavenumber", "alpha 1/m", lambda z: f"{z.real:.3f}{z.imag:+.3f}j"),
    Column("", "impedance", "Z", format_complex),
    Column("", "deviation", "deviation", _deviation),
    Column("", "residual", "residual %", ".3f", 100),
    Column("", lambda row: " ".join(f"{value:.2g}" for value in row.singular_values[:SHOWN]) or "-",
           "singular values"),
)  # fmt: skip
FIELD = (
    Column("", "frequency", "f Hz", ".1f"),
    Column("", "impedance", "Z", _wall),
    Column("", "deviation", "deviation", _deviation),
    Column("", "rise", "rise along x", format_complex),
    Column("", "rise_error", "deviation", _deviation),
    Column("", "residual", "residual %", ".3f", 100),
    Column("", "misfit", "over errors", ".3g"),
    Column("", "end_reflection", "end reflection", format_complex),
)
