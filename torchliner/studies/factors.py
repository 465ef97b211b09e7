"""What an audit varies: each factor is a function that makes variants of the base, or says why there is none.

One set of moments serves the phase rule, the kernel, the liner's readings, both halves of the record and half the
sampling rate. All other |v|, which are drives, means and averaging lengths, share one more reading.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.kernels import BAND, response_at
from torchliner.engine.moments import Moments
from torchliner.liners.cell import CellLiner
from torchliner.liners.model import LinerModel
from torchliner.liners.readings import porosity_readings, velocity_readings
from torchliner.liners.sdof import SDoFLiner
from torchliner.names import DRIVES, MEANS, PHASES
from torchliner.records.boxes import grid_of, windows_of
from torchliner.studies.variants import Source, Variant, average_of, every_second, of_blocks, of_liner
from torchliner.velocity.choices import Choices
from torchliner.velocity.review import FEWEST_SAMPLES_PER_PERIOD

PSI_STEPS = 72  # of the incident wave, over one turn of 2 psi
LENGTHS = (0.25, 0.5, 1.0)  # of a cell
CONTRACTION_COEFFICIENTS = (0.75, 0.8, 0.85)
KERNELS = {"two-sided": "", "causal": ", the paper to the letter"}


@dataclass(frozen=True, eq=False)
class Base:
    """What is varied.

    Args:
        source: the plane.
        averaging: of all values but those of other averagings.
        chosen: choices of the base, without an interval, which no row has.
        running_window: s, of the drive ``running-rms``, of the base or not.
        skipped: factors that cannot be varied, and why.
    """

    source: Source
    averaging: str
    chosen: Choices
    running_window: float | None
    skipped: dict[str, str]

    def variant(self, factor: str, name: str, **about: Any) -> Variant:
        """With ``choices`` changed, or another field of ``Variant``."""
        chosen = dataclasses.replace(self.chosen, **about.pop("choices", {}))
        labels = {"factor": factor, "variant": name}
        return Variant(labels, about.pop("averaging", self.averaging), chosen, **about)


def _require(liner: LinerModel, needed: type, words: str) -> Any:
    if not isinstance(liner, needed):
        raise ValueError(f"{type(liner).__name__} has no such parameter; only {words} have")
    return liner


def _contraction(liner: LinerModel) -> dict[str, Any]:
    own = _require(liner, SDoFLiner, "SDoF liners")
    others = [value for value in CONTRACTION_COEFFICIENTS if value != own.vena_contracta]
    return {f"{value:g}": own.replace(vena_contracta=value) for value in others}


OTHER_LINERS: dict[str, Callable[[LinerModel], dict[str, Any]]] = {
    "vena contracta": _contraction,
    "velocity reading": lambda liner: velocity_readings(_require(liner, CellLiner, "SDoF and layered liners")),
    "porosity reading": lambda liner: porosity_readings(_require(liner, SDoFLiner, "SDoF liners")),
}


class KernelLiner(LinerModel):
    """A liner as its kernels answer, made at the very |v| that is asked for.

    Args:
        liner: whose kernels.
        sampling_rate: of the data, Hz.
        kind: ``two-sided`` or ``causal``.
        band: Hz.
    """

    def __init__(self, liner: LinerModel, sampling_rate: float, kind: str, band: tuple[float, float]) -> None:
        self.liner, self.how = liner, (sampling_rate, kind, band)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Z, (F, V), of frequencies (F, 1) in Hz and speeds (V,) in m/s."""
        return impedance_from_reflection(response_at(self.liner, frequency[:, 0], speed, *self.how).T)


def _kernels(base: Base) -> Iterator[Variant]:
    source, liner, f = base.source, base.source.liner, float(base.source.frequency[0])
    low, high = min(BAND[0], f), max(BAND[1], f)
    if liner.frequency_range is not None:
        low, high = max(low, liner.frequency_range[0]), min(high, liner.frequency_range[1])
    if source.known.nodes is None:
        raise ValueError("|v| is constant, and its kernel is the liner's response there")
    for kind, words in KERNELS.items():
        kernels = KernelLiner(liner, source.plane.sampling_rate, kind, (low, high))
        yield base.variant("kernel", kind + words, moments=of_liner(source.known, kernels, source.frequency))


def _halves(base: Base) -> Iterator[Variant]:
    known = base.source.known
    count, half = known.survey.blocks.count, known.survey.blocks.count // 2
    parts = {"first": of_blocks(known, slice(0, half)), "second": of_blocks(known, slice(count - half, count))}
    periods = parts["first"].survey.blocks.periods
    if periods < FEWEST_PERIODS and not (half and known.settings["allow_short"]):
        raise ValueError(f"half the record holds {periods} whole periods, fewer than {FEWEST_PERIODS:g}")
    for name, part in parts.items():
        words = f"{name}, mean over {part.survey.blocks.periods} whole periods"
        yield base.variant("half the record", words, moments=part)


def _half_rate(base: Base) -> Iterator[Variant]:
    known, frequency = base.source.known, float(base.source.frequency[0])
    rate = known.plane.sampling_rate / 2
    if rate < FEWEST_SAMPLES_PER_PERIOD * frequency:
        raise ValueError(
            f"{rate:g} Hz would leave {rate / frequency:.3g} samples per period, fewer than "
            f"{FEWEST_SAMPLES_PER_PERIOD:g}"
        )
    if known.nodes is None:
        raise ValueError("|v| is constant, and its square is known of all samples together")
    if not bool((known.turns == rate).any()):
        raise ValueError(
            "the moments were reduced without the rows of alternating sign, which an audit of the plane itself sums"
        )
    yield base.variant("sampling rate", f"every second sample, {rate:.6g} Hz", moments=every_second(known))


def _averagings(base: Base) -> Iterator[Variant]:
    for name in base.chosen.averagings:
        if name != base.averaging:
            yield base.variant("averaging", name, averaging=name)


def _phase_rules(base: Base) -> Iterator[Variant]:
    source, known = base.source, base.source.known
    if base.chosen.drive != "rms" and not bool((known.turns == 2 * float(source.frequency[0])).any()):
        raise ValueError(
            "the moments were reduced without the rows of phase rules; reduce the plane again with "
            "phase='self-consistent'"
        )
    known = of_liner(known, source.liner, source.frequency)
    for name in PHASES:
        if name == "given":
            yield from _stated_phases(base, known)
        elif name != base.chosen.phase:
            held = source.known.survey.coherence(source.frequency)[source.known.counted]
            share = 100 * float((held >= base.chosen.minimum_coherence).double().mean())
            if share:
                words = f"{name} ({share:.3g} % of probes)"
                yield base.variant("phase rule", words, choices={"phase": name}, moments=known)
            else:
                base.skipped[f"phase rule, {name}"] = (
                    f"no probe is coherent with {float(source.frequency[0]):g} Hz by {base.chosen.minimum_coherence:g}"
                )


def _stated_phases(base: Base, known: Moments) -> Iterator[Variant]:
    """The phases of the incident wave that move R and X furthest, wherever it may lie."""

    def at(psi: float, words: str = "") -> Variant:
        name = f"given, psi = {psi:.2f} rad ({words})"
        return base.variant("phase rule", name, choices={"phase": "given"}, moments=known, psi=psi)

    source, found = base.source, {}
    for step in range(PSI_STEPS):
        psi = math.pi * step / PSI_STEPS
        average = average_of(known, source.liner, source.frequency, at(psi))
        found[psi] = complex(average.liner.impedance[0])
    for part, letter in (("real", "R"), ("imag", "X")):
        for word, pick in (("smallest", min), ("largest", max)):
            psi = pick(found, key=lambda each, part=part: getattr(found[each], part))  # type: ignore[misc]
            yield at(psi, f"{word} {letter}")


def _other_speeds(base: Base) -> Iterator[Variant]:
    """Other drives and means; the rms is known from the survey, for the others the samples are read."""
    if base.chosen.drive != "rms":
        yield base.variant("drive", "rms", choices={"drive": "rms", "running_window": None})
    base.source.require_samples()
    for name in DRIVES:
        if name not in (base.chosen.drive, "rms"):
            window = base.running_window if name == "running-rms" else None
            yield base.variant("drive", name, choices={"drive": name, "running_window": window})
    for name in MEANS:
        if name != base.chosen.mean:
            yield base.variant("mean velocity", name, choices={"mean": name})


def _lengths(base: Base) -> Iterator[Variant]:
    source, pitch = base.source, base.source.liner.cell_pitch
    source.require_samples()
    if pitch is None:
        raise ValueError("the liner states no cell_pitch")
    grid = grid_of(source.plane)
    shares = [share for share in LENGTHS if grid.spacing <= share * pitch <= grid.length * (1 + 1e-6)]
    if not shares:
        raise ValueError(
            f"none of {', '.join(f'{share:g}' for share in LENGTHS)} cells lies between the spacing, "
            f"{1e3 * grid.spacing:.3g} mm, and the plane's length, {1e3 * grid.length:.3g} mm"
        )
    used = source.known.used.reshape(grid.rows, grid.columns)
    chosen = {"averaging": "velocity", "background_rms": None}
    for share in shares:
        windows = windows_of(grid, share * pitch, used)
        name = f"velocity over {share:g} of a cell"
        yield base.variant("averaging length", name, averaging="velocity", choices=chosen, windows=windows)


FACTORS: dict[str, Callable[[Base], Iterator[Variant]]] = {
    "kernel": _kernels,
    "half the record": _halves,
    "sampling rate": _half_rate,
    "averaging": _averagings,
    "phase rule": _phase_rules,
    "drive, mean velocity": _other_speeds,
    "averaging length": _lengths,
}
