"""Impedances educed from wall pressures as rows and as a text table."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from typing import Any

from torchliner.records import FieldFit, MicrophoneLine, WallEduction
from torchliner.report.table import Column, Table, format_bounds, format_complex, plain_columns, real_and_imaginary

LEVEL = 0.95  # of the intervals
HARD = 1e6  # |Z| that a table calls rigid
SHOWN = 4  # singular values in the table
ERRORS = ["level_error", "phase_error"]  # that the draws have
FIT = ["standard_error", "end_reflection"]  # of a fit of the field
UNKNOWN: dict[str, Any] = dict.fromkeys("low high deviation wavenumber singular_values known off".split() + FIT)
UNKNOWN |= dict.fromkeys(["energy_share", "misfit", *ERRORS], math.nan) | {"failed": 0}
Educed = WallEduction | FieldFit
Row = dict[str, Any]


def wall_rows(line: MicrophoneLine, found: Educed) -> list[Row]:
    """One row per frequency of a line without leading axes.

    ``deviation`` is u(R) + j u(X) over the draws; without draws the standard error, by what the
    waves leave or by the errors stated to a fit of the field, infinite where it has no bound.
    ``known`` is Z of the wall where the line states it, as one does that was solved, ``off`` the impedance less that.
    ``low`` and ``high`` bound the 95 % statistical interval, of the draws or of that error. What a
    method does not give is None.

    Raises:
        ValueError: the line has leading axes, as files of draws do.
    """
    if found.impedance.ndim != 1:
        raise ValueError(f"{line.name} holds {tuple(found.impedance.shape[:-1])} lines; a table needs one")
    head = {
        "line": line.title or line.name,
        "source": found.source_side,
        "method": found.method,
        "mach": found.choices.get("mach", line.mach),
    }
    names = ["frequency", "impedance", "residual"]
    names += ["wavenumber", "energy_share"] if isinstance(found, WallEduction) else FIT
    values: dict[str, Any] = {name: getattr(found, name) for name in names}
    if found.misfit is not None:
        values["misfit"] = found.misfit**0.5
    if line.wall_impedance is not None:
        values |= {"known": line.wall_impedance, "off": found.impedance - line.wall_impedance}
    if isinstance(found, WallEduction) and found.singular_values is not None:
        values["singular_values"] = (found.singular_values / found.singular_values[0]).T
    if found.draws is not None:
        values |= {"failed": found.failed, "deviation": found.standard_deviation}
        values |= dict(zip(ERRORS, found.used_errors, strict=True)) if isinstance(found, WallEduction) else {}
    elif found.covariance is not None:
        values["deviation"] = found.standard_error
    if "deviation" in values:
        values["low"], values["high"] = found.interval(LEVEL)
    rows = [
        UNKNOWN | head | {name: column[f].tolist() for name, column in values.items()}
        for f in range(len(found.frequency))
    ]
    for row in rows:
        error = row["standard_error"]
        if error is not None and cmath.isinf(error):
            row |= {"deviation": error, "low": None, "high": None}
    return rows


def _singular_values(digits: int, most: int | None = None) -> Callable[[Row], str]:
    return lambda row: " ".join(f"{v:.{digits}g}" for v in (row["singular_values"] or ())[:most])


_LOW, _HIGH = (real_and_imaginary(f"resistance_{end}", f"reactance_{end}", end) for end in ("low", "high"))
COLUMNS = (
    *plain_columns("line source method frequency"),
    *real_and_imaginary("wavenumber_real", "wavenumber_imag", "wavenumber"),
    *real_and_imaginary("resistance", "reactance", "impedance"),
    *real_and_imaginary("resistance_deviation", "reactance_deviation", "deviation"),
    *(_LOW[0], _HIGH[0], _LOW[1], _HIGH[1]),
    Column("residual"),
    Column("singular_values", _singular_values(3)),
    Column("failed_draws", "failed"),
    Column("misfit"),
    *real_and_imaginary("end_reflection_real", "end_reflection_imag", "end_reflection"),
    Column("energy_share"),
    Column("mach"),
    Column("level_error_used", "level_error"),
    Column("phase_error_used", "phase_error"),
    *real_and_imaginary("known_resistance", "known_reactance", "known"),
)


def wall_table(rows: Sequence[Row]) -> Table:
    """For CSV and JSON: complex values as two numbers, nan where there is none."""
    return Table(rows, COLUMNS)


def format_wall(line: MicrophoneLine, found: Educed) -> str:
    """A text table of one line."""
    kind = "" if isinstance(found, FieldFit) or found.rank is None else (f", rank {found.rank}, order {found.order}")
    head = (
        f"{line.title or line.name}: {found.method}{kind}, source {found.source_side}, "
        f"{len(found.x)} microphones from {1e3 * float(found.x[0]):.4g} to "
        f"{1e3 * float(found.x[-1]):.4g} mm, H {1e3 * float(line.duct_height):.4g} mm, "
        f"M {float(found.choices.get('mach', line.mach)):.3g}"
    )
    rows = wall_rows(line, found)
    known = KNOWN if any(row["known"] is not None and row["known"] == row["known"] for row in rows) else ()
    share = f"{100 * LEVEL:g} %"
    if isinstance(found, WallEduction):
        return (
            f"{head}, {found.choices['condition']}\n{Table(rows, (*WAVES, *known)).as_text()}\n"
            "Z is p/(rho c v), exp(+jwt - j alpha x), x along the flow; energy: of this wave over "
            f"the strongest's\n{share} statistical interval and deviation: {_reason(found)}; not "
            f"the error of the model\nover errors: residual over what {_assumed(found)} leave"
        )
    errors = "the microphones' stated errors" if found.draws is None else "the draws"
    return (
        f"{head}, far end {found.choices['far_end']}\n{Table(rows, (*FIELD, *known)).as_text()}\n"
        f"Z is p/(rho c v), exp(+jwt); {share} statistical interval and deviation: of R and X by "
        f"{errors}; over errors: residuals over the stated errors, 1 if the duct is right"
    )


def _reason(found: WallEduction) -> str:
    """Where the interval comes from."""
    if found.draws is not None:
        count = len(found.draws.impedance)
        level, phase = ({f"{float(end):.2g}" for end in (used.min(), used.max())} for used in found.used_errors)
        used = f"{' to '.join(sorted(level, key=float))} dB, {' to '.join(sorted(phase, key=float))} degrees"
        return f"of R and X over {count} draws of the microphones' errors, {used}, by the residual"
    if found.covariance is None:
        return "unknown, the waves leave no degree of freedom"
    return f"of R and X by what the waves leave, {found.freedom} degrees of freedom"


def _assumed(found: WallEduction) -> str:
    return f"the assumed errors of {found.choices['level_error']:g} dB, {found.choices['phase_error']:g} degrees"


def _wall(impedance: complex) -> str:
    return "rigid" if abs(impedance) > HARD else format_complex(impedance)


def _deviation(value: complex | None) -> str:
    if value is not None and cmath.isinf(value):
        return "no bound"
    if value is not None and cmath.isnan(value):
        return "none settled"
    # Two digits, however small: 0.000 would say that there is none.
    return "-" if value is None else f"{value.real:.2g}, {value.imag:.2g}"


def _interval(row: Row) -> tuple[complex, complex] | None:
    low, high = row["low"], row["high"]
    return None if low is None or cmath.isnan(low) else (low, high)


_FREQUENCY = Column("", "frequency", "f Hz", ".1f")
_BARS = (Column("", "deviation", "deviation", _deviation), Column("", _interval, "statistical interval", format_bounds))
_LEFT = (Column("", "residual", "residual %", ".3f", 100), Column("", "misfit", "over errors", ".3g"))
WAVES = (
    _FREQUENCY,
    Column("", "wavenumber", "alpha 1/m", lambda z: f"{z.real:.3f}{z.imag:+.3f}j"),
    Column("", "impedance", "Z", format_complex),
    *_BARS,
    Column("", "energy_share", "energy", ".3f"),
    *_LEFT,
    Column("", _singular_values(2, SHOWN), "singular values"),
)
FIELD = (
    _FREQUENCY,
    Column("", "impedance", "Z", _wall),
    *_BARS,
    *_LEFT,
    Column("", "end_reflection", "end reflection", format_complex),
)
KNOWN = (Column("", "known", "known Z", format_complex), Column("", "off", "Z - known", format_complex))
