"""The truth table: every rule beside the true impedance of resolved cases. No favourite."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
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
TOLERABLE = 0.1  # share of |Z_true| beyond which the table says that a rule fails


@dataclass(frozen=True)
class TruthRow:
    """One educed value beside the truth, both normalised."""

    case: str
    height: float
    drive: str
    mean: str
    phase: str
    order: str
    educed: complex
    true: complex

    @property
    def error(self) -> float:
        """|Z - Z_true|, in rho c."""
        return abs(self.educed - self.true)

    def plain(self) -> dict[str, Any]:
        """For JSON and CSV: complex values as two numbers."""
        row = asdict(self)
        for key in ("educed", "true"):
            value = row.pop(key)
            row[f"{key}_resistance"], row[f"{key}_reactance"] = value.real, value.imag
        return {**row, "error": self.error}


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
            values = (found.liner_impedance[0], found.liner_impedance_velocity_first[0])
            for order, value in zip(ORDERS, values, strict=True):
                yield TruthRow(
                    case, plane.height or 0.0, drive, mean, phase, order,
                    complex(value), complex(plane.reference["true"]),
                )  # fmt: skip


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
        label = row.drive + (", mean removed" if row.mean == "removed" else "")
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
            errors = [
                row.error
                for row in mine
                if (row.drive, row.mean, row.phase, row.order)
                == ("instantaneous", "kept", "averaged", order)
            ]
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
        drive = row.drive + (", mean removed" if row.mean == "removed" else "")
        lines.append(
            f"best for {case}: y = {1e3 * row.height:g} mm, {drive}, {row.phase}, {row.order}, "
            f"{format_complex(row.educed)} for {format_complex(row.true)}"
        )
    lines.append(
        "(The best is named with hindsight; 'given' uses the phase of the true wave. n115 and o115 "
        "fix the models' linear part and test little. No one rule is best for all cases.)"
    )
    return "\n".join(lines)


def format_complex(value: complex) -> str:
    """'0.168-0.066j'."""
    return f"{value.real:.3f}{value.imag:+.3f}j"
