"""The truth table: every rule beside the true impedance of resolved cases. No favourite."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from torchliner.conversions import reflection_from_impedance
from torchliner.eduction.averaging import ORDERS
from torchliner.eduction.choices import Choices
from torchliner.eduction.prepare import prepare
from torchliner.eduction.velocity import replay
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.replay.kernels import Liner

DRIVES = (
    ("instantaneous", "kept"),
    ("instantaneous", "removed"),
    ("rms", "kept"),
    ("running-rms", "kept"),
)
PHASES = ("averaged", "self-consistent", "given")

DEFAULT = ("instantaneous", "kept", "averaged")
NOWHERE = complex(float("nan"), float("nan"))

TOLERABLE = 0.1  # share of |Z_true| beyond which the table says that a rule fails


@dataclass(frozen=True)
class TruthRow:
    """One educed value beside the truth, all normalised.

    Args:
        case, height: of the plane; height in m.
        drive, mean, phase, order: the rule.
        educed, true: Z.
        in_situ: what the file states for the in situ method, nan if nothing.
        low, high: bounds of the statistical interval (real parts: R, imaginary: X); nan where the
            replay did not keep the blocks that the rule needs (``self-consistent``).
    """

    case: str
    height: float
    drive: str
    mean: str
    phase: str
    order: str
    educed: complex
    true: complex
    in_situ: complex = NOWHERE
    low: complex = NOWHERE
    high: complex = NOWHERE

    @property
    def rule(self) -> tuple[str, str, str]:
        """Drive, mean and phase."""
        return self.drive, self.mean, self.phase

    @property
    def miss(self) -> complex:
        """Z - Z_true: dR + j dX, in rho c."""
        return self.educed - self.true

    @property
    def error(self) -> float:
        """|Z - Z_true|, in rho c."""
        return abs(self.miss)

    def plain(self) -> dict[str, Any]:
        """For JSON and CSV: complex values as two numbers."""
        row: dict[str, Any] = {}
        for key, value in vars(self).items():
            if isinstance(value, complex):
                row[f"{key}_resistance"], row[f"{key}_reactance"] = value.real, value.imag
            else:
                row[key] = value
        return {**row, "error": self.error}

    @classmethod
    def from_plain(cls, row: Mapping[str, Any]) -> TruthRow:
        """The row of a CSV again."""

        def pair(key: str) -> complex:
            return complex(float(row[f"{key}_resistance"]), float(row[f"{key}_reactance"]))

        return cls(
            str(row["case"]), float(row["height"]), str(row["drive"]), str(row["mean"]),
            str(row["phase"]), str(row["order"]), pair("educed"), pair("true"), pair("in_situ"),
            pair("low"), pair("high"),
        )  # fmt: skip


def true_wave_phase(plane: VelocityPlane, seen: ImpedanceMap) -> float:
    """Phase of the incident wave (rad) from the plane-mean velocity at f and the TRUE impedance.

    Only a resolved case knows it; with measured data a reference microphone has to give it.
    """
    reflection = reflection_from_impedance(torch.tensor(plane.reference["true"]))
    amplitude = seen.velocity_amplitude[..., 0].mean()
    return float((amplitude / (1 - reflection)).angle())


def truth_rows(plane: VelocityPlane, liner: Liner) -> Iterator[TruthRow]:
    """All drives x phase rules x averaging orders of one plane with a known impedance.

    Raises:
        ValueError: the plane states no true impedance or no tone.
    """
    if "true" not in plane.reference:
        raise ValueError(f"{plane.name} states no true impedance (reference 'true')")
    case = str(plane.provenance.get("case", plane.title))
    for drive, mean in DRIVES:
        replayed = replay(prepare([plane], liner, None, Choices(drive=drive, mean=mean))[0])
        averaged = replayed.map("averaged")
        for phase in PHASES:
            known = true_wave_phase(plane, averaged) if phase == "given" else None
            found = replayed.map(phase, known)
            known_in_situ = complex(plane.reference.get("in situ", NOWHERE))
            for order, value, bounds in zip(ORDERS, *_both_orders(found), strict=True):
                yield TruthRow(
                    case, plane.height or 0.0, drive, mean, phase, order,
                    value, complex(plane.reference["true"]), known_in_situ, *bounds,
                )  # fmt: skip


def _both_orders(found: ImpedanceMap) -> tuple[list[complex], list[tuple[complex, complex]]]:
    """Z of the whole liner in both orders, and the bounds of its intervals."""
    values = [found.liner_impedance, found.liner_impedance_velocity_first]
    bounds = [(NOWHERE, NOWHERE)] * 2
    if (known := found.uncertainty) is not None:
        both = (known.liner, known.liner_velocity_first)
        bounds = [(complex(each.low[0]), complex(each.high[0])) for each in both]
    return [complex(value[0]) for value in values], bounds


def truth_table(
    planes: Sequence[VelocityPlane],
    liner_of: Callable[[VelocityPlane], Liner],
    progress: Callable[[int], None] | None = None,
) -> list[TruthRow]:
    """``truth_rows`` of several planes, ordered by case and height; ``progress`` per plane."""
    rows: list[TruthRow] = []
    for plane in planes:
        rows += truth_rows(plane, liner_of(plane))
        if progress is not None:
            progress(1)
    return rows


@dataclass(frozen=True)
class RuleErrors:
    """Errors of one rule over planes: medians and largest of |dR| (real part) and |dX|."""

    drive: str
    mean: str
    phase: str
    order: str
    planes: int
    median: complex
    largest: complex


def errors_by_rule(rows: Sequence[TruthRow]) -> list[RuleErrors]:
    """Of every rule in the rows, in their order."""
    groups: dict[tuple[str, str, str, str], list[complex]] = {}
    for row in rows:
        groups.setdefault((*row.rule, row.order), []).append(row.miss)
    return [
        RuleErrors(
            *rule,
            len(misses),
            *(
                complex(pick([abs(m.real) for m in misses]), pick([abs(m.imag) for m in misses]))
                for pick in (statistics.median, max)
            ),
        )
        for rule, misses in groups.items()
    ]


def drive_label(drive: str, mean: str) -> str:
    """'instantaneous' or 'instantaneous, mean removed'."""
    return drive + (", mean removed" if mean == "removed" else "")


def format_rules(rows: Sequence[TruthRow]) -> str:
    """Median |dR| and |dX| of every rule over all planes given: drive and order x phase."""
    found = {(e.drive, e.mean, e.order, e.phase): e for e in errors_by_rule(rows)}
    planes = next(iter(found.values())).planes
    lines = [f"median |dR|, |dX| (rho c) of each rule; planes: {planes}"]
    lines.append(f"{'':46s}" + "".join(f"{phase:>18s}" for phase in PHASES))
    for drive, mean in DRIVES:
        for order in ORDERS:
            cells = [found[drive, mean, order, phase].median for phase in PHASES]
            texts = "".join(f"{f'{c.real:.3f}, {c.imag:.3f}':>18s}" for c in cells)
            lines.append(f"{drive_label(drive, mean):30s}{order:16s}" + texts)
    return "\n".join(lines)


def format_truth(rows: Sequence[TruthRow]) -> str:
    """A text table: a line per case, height and drive; columns phase rule x order."""
    lines = []
    heading = "".join(f"{phase:^30s}" for phase in PHASES)
    orders = "".join(f"{order:>15s}" for order in ORDERS) * len(PHASES)
    previous = ""
    for first in range(0, len(rows), len(PHASES) * len(ORDERS)):
        group = rows[first : first + len(PHASES) * len(ORDERS)]
        row = group[0]
        if row.case != previous:
            lines += ["", f"case {row.case}: true Z = {format_complex(row.true)} (normalised)"]
            lines += [f"{'':30s}{heading}", f"{'y mm':>5s}  {'drive':23s}{orders}"]
            previous = row.case
        label = drive_label(row.drive, row.mean)
        values = "".join(f"{format_complex(cell.educed):>15s}" for cell in group)
        lines.append(f"{1e3 * row.height:5.1f}  {label:28s}"[:35].ljust(30) + values)
    return "\n".join(lines).lstrip("\n")


def format_summary(rows: Sequence[TruthRow]) -> str:
    """Per case: the error of the default rules over the heights, and of the best and worst rule."""
    lines = ["|Z - Z_true| over all heights (rho c)"]
    heading = (
        "default, probes first",
        "default, velocity first",
        "best of all",
        "worst of all",
        "default",
    )
    lines.append(f"{'case':10s}{'|Z_true|':>9s}" + "".join(f"{h:>25s}" for h in heading))
    for case in dict.fromkeys(row.case for row in rows):
        mine = [row for row in rows if row.case == case]
        cells, within = [], []
        for order in ORDERS:
            errors = [row.error for row in mine if row.rule == DEFAULT and row.order == order]
            cells.append(f"{min(errors):.3f} to {max(errors):.3f}")
            within += [error < TOLERABLE * abs(mine[0].true) for error in errors]
        cells += [f"{f(row.error for row in mine):.3f}" for f in (min, max)]
        cells.append("holds" if all(within) else f"FAILS in {within.count(False)} of {len(within)}")
        lines.append(f"{case:10s}{abs(mine[0].true):9.3f}" + "".join(f"{c:>25s}" for c in cells))
    lines.append(
        f"(FAILS: off by more than {100 * TOLERABLE:g} % of |Z_true|. Default: phase averaged, "
        "instantaneous |v|, mean kept; both orders at every height are counted)"
    )
    best = [
        (row.case, row)
        for case in dict.fromkeys(row.case for row in rows)
        for row in [min((r for r in rows if r.case == case), key=lambda r: r.error)]
    ]
    for case, row in best:
        lines.append(
            f"best for {case}: y = {1e3 * row.height:g} mm, {drive_label(row.drive, row.mean)}, "
            f"{row.phase}, {row.order}, {format_complex(row.educed)} for {format_complex(row.true)}"
        )
    lines.append(
        "(The best is named with hindsight; 'given' uses the phase of the true wave. n115 and o115 "
        "fix the models' linear part and test little. No one rule is best for all cases.)"
    )
    return "\n".join(lines)


def format_complex(value: complex) -> str:
    """'0.168-0.066j'; no zero has a minus."""
    real, imaginary = (round(part, 3) + 0.0 for part in (value.real, value.imag))
    return f"{real:.3f}{imaginary:+.3f}j"
