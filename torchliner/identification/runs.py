"""What is known of the runs: weights of node speeds, and what each plane is held to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.calibration.misfit import LevelMisfit, Misfit, SpeedWeights, driving_speed, speed_weights
from torchliner.calibration.targets import (
    held_reference,
    nepers_of,
    noise_of,
    references_of,
    ties_of,
)
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.moments import Moments
from torchliner.liners.adjusted import AdjustedSDoFLiner
from torchliner.liners.model import LinerModel
from torchliner.liners.sdof import SDoFLiner
from torchliner.pressure.dean import in_situ
from torchliner.records import PressureRecord, VelocityPlane
from torchliner.records.same_case import require_same_run
from torchliner.velocity.choices import Choices

SHARE = 0.02  # of |Z|: noise of references for which none is stated
LEVEL_NOISE = 0.2  # dB, of levels
LEVEL_CHECK, IN_SITU = "level-check", "in-situ"


@dataclass(frozen=True, eq=False)
class Run:
    """One plane and what its impedance is held to.

    Args:
        weights: of node speeds.  liner: with the plane's own flow.  group: label of its run.
        wanted: Z, (F,); nan where a level alone is known.
        noise: u(R) + j u(X), (F,); of a level u of level (nepers) and phase (rad).
        ratio: implied over known pressure, from Z (F,); None with references.
        has_phase: whether the phase of that is known.
    """

    weights: SpeedWeights
    liner: LinerModel
    group: str
    wanted: Tensor
    noise: Tensor
    ratio: Callable[[Tensor], Tensor] | None = None
    has_phase: bool = True

    @property
    def plane(self) -> VelocityPlane:
        """Its facts."""
        return self.weights.plane

    @property
    def frequency(self) -> Tensor:
        """Hz, (F,)."""
        return self.weights.frequency

    @property
    def speed(self) -> float:
        """rms of the |v| that drives the model, m/s."""
        return driving_speed(self.weights)

    def misses(self, impedance: Tensor) -> Tensor:
        """What is left, complex, (F,): Z less the reference, or the logarithm of the ratio of
        pressures, without a phase where none is known."""
        if self.ratio is None:
            return impedance - self.wanted
        left = self.ratio(impedance).log()
        return left if self.has_phase else left.real.to(left.dtype)

    def off(self, impedance: Tensor) -> Tensor:
        """Error by which models are compared, (F,): of the reflection coefficient, or relative of
        the pressure."""
        if self.ratio is not None:
            return self.misses(impedance).abs()
        return reflection_from_impedance(torch.stack([impedance, self.wanted])).diff(dim=0)[0].abs()


def misfit_of(runs: Sequence[Run], names: tuple[str, ...], low: Tensor, high: Tensor) -> Misfit:
    """Of parameters that the liners of some runs share."""
    about: Any = (
        [run.weights for run in runs], [run.liner for run in runs], names, low, high,
        torch.cat([run.wanted for run in runs]), torch.cat([run.noise for run in runs]), {},
    )  # fmt: skip
    ratios = [run.ratio for run in runs if run.ratio is not None]
    held = [ratios, [run.has_phase for run in runs]] if ratios else []
    kind: Any = LevelMisfit if ratios else Misfit
    found: Misfit = kind(*about, *held)
    return found


def with_flow(liner: LinerModel, mach: float | None = None) -> LinerModel:
    """An SDoF liner with the Mach number of a plane, and with factors unless its own law takes one;
    any other as it is."""
    if not isinstance(liner, SDoFLiner):
        return liner
    if "mach" in liner.numbers():
        return liner.replace(mach=mach or 0.0)
    return AdjustedSDoFLiner.of(liner, mach=mach or 0.0)


@dataclass(frozen=True)
class AtRest(LinerModel):
    """A table's Z at rest, at any |v|: what reads the data must be smooth."""

    liner: LinerModel
    cell_pitch: float | None = None

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Any:
        """See ``LinerModel``."""
        rest = self.liner.impedance(frequency, torch.zeros(1, dtype=torch.float64))
        return rest + 0 * torch.as_tensor(speed)


def read_weights(plane: VelocityPlane | Moments, liner: LinerModel, frequency: Any, chosen: Choices) -> SpeedWeights:
    """A plane read once, for any liner."""
    drawn = liner if liner.speed_max is None else AtRest(liner, liner.cell_pitch)
    return speed_weights(plane, drawn, frequency, chosen)


def gather(
    weights: Sequence[SpeedWeights], liners: Sequence[LinerModel], groups: Sequence[str],
    references: Any, pressure: Any, noise: Any,
) -> list[Run]:  # fmt: skip
    """Runs with their references, or with known levels.

    Raises:
        ValueError: a reference that is missing or of a wall that feeds sound, pressures that do
            not fit the planes.
    """
    ready = weights
    counts = [len(each.frequency) for each in ready]
    ratios: list[Any] = [None] * len(ready)
    if isinstance(references, str) and references == LEVEL_CHECK:
        ratios, phases = ties_of(ready, None, _by_case(ready, pressure, all_of_them=True))
        wanted = torch.full((sum(counts),), complex(torch.nan, torch.nan), dtype=torch.complex128)
        spread = noise_of(nepers_of(LEVEL_NOISE if noise is None else noise), counts)
    else:
        if isinstance(references, str) and references == IN_SITU:
            references = _in_situ(ready, pressure)
        phases = [True] * len(ready)
        wanted = references_of(ready, references)
        spread = noise_of(noise, counts)
        if noise is None:
            spread = torch.complex(SHARE * wanted.abs(), SHARE * wanted.abs())
    rows = zip(weights, liners, groups, wanted.split(counts), spread.split(counts),
               ratios, phases, strict=True)  # fmt: skip
    runs = [Run(*row) for row in rows]
    for run in runs:
        if bool((run.wanted.real < 0).any()):
            raise ValueError(
                f"{run.plane.name}: its reference has a resistance of "
                f"{float(run.wanted.real.min()):.3g}; the response of a passive liner, R at least "
                "0 at every |v|, cannot give it: leave that plane out"
            )
    return runs


def _by_case(ready: Sequence[SpeedWeights], given: Any, *, all_of_them: bool) -> Any:
    """The pressure record of each plane, found by its case, tone, level and flow; records that do
    not tell runs apart are taken in the order of the planes. None where there is none.

    Args:
        ready: planes, of two runs at least.
        given: records; what is none (a line of microphones, None) stays in its order.
        all_of_them: whether a plane without a record is refused.
    Raises:
        ValueError: a plane without a record; records that could be of several runs.
    """
    records = _listed(given)
    if not records or not all(isinstance(each, PressureRecord) for each in records):
        return given
    faults = [[_fault(one.plane, record) for record in records] for one in ready]
    in_order = len(records) == len(ready) and not any(faults[i][i] for i in range(len(records)))
    found: list[PressureRecord | None] = []
    for i, (one, mine) in enumerate(zip(ready, faults, strict=True)):
        fitting = [k for k, fault in enumerate(mine) if not fault]
        if not fitting and all_of_them:
            raise ValueError(f"{mine[-1]}; give the pressure record of the same run")
        if any(len(fitting) > 1 or not any(row[k] for row in faults) for k in fitting):
            if not in_order:
                names = ", ".join(records[k].name for k in fitting)
                raise ValueError(
                    f"nothing tells which of the runs {names} is of: {one.plane.name} and others "
                    "fit; state case, level or Mach number in the files, or give a record for "
                    "each plane, in their order"
                )
            fitting = [i]
        found.append(records[fitting[0]] if fitting else None)
    return found


def _listed(given: Any) -> list[Any]:
    return [given] if isinstance(given, PressureRecord) else list(given or [])


def _fault(plane: VelocityPlane, record: PressureRecord) -> str:
    """Why a record is of another run than a plane; nothing if it may be of the same."""
    try:
        require_same_run(plane, record)
    except ValueError as error:
        return str(error).rpartition("; ")[0]
    return ""


def _in_situ(ready: Sequence[SpeedWeights], given: Any) -> list[Tensor]:
    """In situ Z of each plane from the record of its case, or the one it holds."""
    records = _by_case(ready, given, all_of_them=False) or [None] * len(ready)
    found = []
    for one, record in zip(ready, records, strict=True):
        plane, short = one.plane, bool(one.known.settings["allow_short"])
        if record is not None:
            beside = in_situ(record, one.frequency, interval=None, allow_short=short)
            found.append(beside.liner_impedance_pressure_first)
        elif "in situ" in plane.reference:
            found.append(held_reference(one, "in situ"))
        else:
            fault = "no pressure record is given"
            if several := _listed(given):
                fault = _fault(plane, several[-1])
            raise ValueError(
                f"{plane.name} has no in situ impedance: {fault}; give the pressure record of "
                "the same run, or leave the plane out"
            )
    return found


def require_spread(runs: Sequence[Run], least: float) -> None:
    """Runs at different speeds, by which a curve can be told.

    Raises:
        ValueError: the rms |v| of the fastest is less than ``least`` times the slowest's.
    """
    speeds = [run.speed for run in runs]
    low, high = min(speeds), max(speeds)
    if high < least * low or not math.isfinite(high):
        ratio = high / low if low > 0 else math.nan
        raise ValueError(
            f"all runs are at one speed: rms |v| is {low:.3g} to {high:.3g} m/s, a ratio of "
            f"{ratio:.3g} (at least {least:g} is needed to tell a curve over |v|); add runs at "
            "other levels, or fit one parameter instead (models=[('vena_contracta',)])"
        )
