"""Impedances educed from wall pressures as rows and as a text table."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.report.table import format_complex

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

    def plain(self) -> dict[str, Any]:
        """For CSV and JSON: complex values as two numbers, nan where there is none."""
        nothing = complex(float("nan"), float("nan"))
        low, high = self.interval or (nothing, nothing)
        spread = nothing if self.deviation is None else self.deviation
        end = nothing if self.end_reflection is None else self.end_reflection
        rise = nothing if self.rise is None else self.rise
        rise_error = nothing if self.rise_error is None else self.rise_error
        return {
            "line": self.line, "source": self.source, "method": self.method,
            "frequency": self.frequency, "wavenumber_real": self.wavenumber.real,
            "wavenumber_imag": self.wavenumber.imag, "resistance": self.impedance.real,
            "reactance": self.impedance.imag, "resistance_deviation": spread.real,
            "reactance_deviation": spread.imag, "resistance_low": low.real,
            "resistance_high": high.real, "reactance_low": low.imag, "reactance_high": high.imag,
            "residual": self.residual,
            "singular_values": " ".join(f"{value:.3g}" for value in self.singular_values),
            "failed_draws": self.failed,
            "misfit": float("nan") if self.misfit is None else self.misfit,
            "end_reflection_real": end.real, "end_reflection_imag": end.imag,
            "rise_of_resistance": rise.real, "rise_of_reactance": rise.imag,
            "rise_of_resistance_error": rise_error.real, "rise_of_reactance_error": rise_error.imag,
        }  # fmt: skip


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


def format_wall(line: MicrophoneLine, found: Educed) -> str:
    """A text table of one line."""
    head = (
        f"{line.title or line.name}: {found.method}{{}}, source {found.source_side}, "
        f"{len(found.x)} microphones from {1e3 * float(found.x[0]):.4g} to "
        f"{1e3 * float(found.x[-1]):.4g} mm, H {1e3 * float(line.duct_height):.4g} mm, "
        f"M {float(line.mach):.3g}"
    )
    rows = wall_rows(line, found)
    if isinstance(found, WallEduction):
        return _wave_table(head, found, rows)
    return _field_table(head, found, rows)


def _wave_table(head: str, found: WallEduction, rows: Sequence[WallRow]) -> str:
    rank = "" if found.rank is None else f", rank {found.rank}, order {found.order}"
    lines = [f"{head.format(rank)}, {found.choices['condition']}",
             f"{'f Hz':>7s} {'alpha 1/m':>16s} {'Z':>14s} {'deviation':>13s} "
             f"{'resid. %':>8s}  singular values"]  # fmt: skip
    for row in rows:
        shown = " ".join(f"{value:.2g}" for value in row.singular_values[:SHOWN]) or "-"
        alpha = f"{row.wavenumber.real:.3f}{row.wavenumber.imag:+.3f}j"
        lines.append(
            f"{row.frequency:7.1f} {alpha:>16s} {format_complex(row.impedance):>14s} "
            f"{_spread(row.deviation):>13s} {100 * row.residual:8.3f}  {shown}"
        )
    lines.append(
        "Z is p/(rho c v), exp(+jwt - j alpha x), x along the flow; deviation: of R and X over the "
        "draws"
    )
    return "\n".join(lines)


def _field_table(head: str, found: FieldFit, rows: Sequence[WallRow]) -> str:
    lines = [f"{head.format('')}, far end {found.choices['far_end']}",
             f"{'f Hz':>7s} {'Z':>14s} {'deviation':>13s} {'rise along x':>14s} {'deviation':>13s} "
             f"{'resid. %':>8s} {'over errors':>11s} {'end reflection':>15s}"]  # fmt: skip
    for row in rows:
        assert row.end_reflection is not None
        assert row.rise is not None
        constant = found.choices["variation"] == "constant"
        rise = "-" if constant else format_complex(row.rise)
        rise_error = None if constant else row.rise_error
        wall = "rigid" if abs(row.impedance) > HARD else format_complex(row.impedance)
        lines.append(
            f"{row.frequency:7.1f} {wall:>14s} {_spread(row.deviation):>13s} "
            f"{rise:>14s} {_spread(rise_error):>13s} {100 * row.residual:8.3f} {row.misfit:11.3g} "
            f"{format_complex(row.end_reflection):>15s}"
        )
    from_what = "the microphones' errors" if found.draws is None else "the draws"
    lines.append(
        f"Z is p/(rho c v), exp(+jwt); deviation: of R and X by {from_what} (of the rise: by the "
        "fit); over errors: residuals over the stated errors, 1 if the duct is right"
    )
    return "\n".join(lines)


def _spread(deviation: complex | None) -> str:
    if deviation is None:
        return "-"
    if cmath.isinf(deviation):
        return "no bound"
    if cmath.isnan(deviation):
        return "none settled"
    return f"{deviation.real:.3f}, {deviation.imag:.3f}"
