"""How far each choice that the paper leaves open moves the answer, beside its statistical interval.

Each factor is a function that makes variants of the base, or says why there is none.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, require_choice, tell
from torchliner.engine.kernels import BAND, response_at
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import OfOneLiner, response
from torchliner.liners.cell import CellLiner
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.liners.sdof import SDoFLiner, porosity_readings, velocity_readings
from torchliner.names import AVERAGINGS, DRIVES, MEANS, PHASES
from torchliner.records import VelocityPlane
from torchliner.records.boxes import grid_of, windows_of
from torchliner.records.same_case import planes_by_height
from torchliner.studies.reference_cases import nearest_case
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Records, Source, Variant, every_second, of_blocks, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress
from torchliner.velocity.review import FEWEST_SAMPLES_PER_PERIOD

PSI_STEPS = 72  # of the incident wave, over one turn of 2 psi
LENGTHS = (0.25, 0.5, 1.0)  # of a cell
CONTRACTION_COEFFICIENTS = (0.75, 0.8, 0.85)
KERNELS = {"two-sided": "", "causal": ", the paper to the letter"}


def audit(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    averaging: str = "phase-locked",
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others are its other heights.
            What ``Moments`` do not hold is left out, with the reason.
        liner: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        averaging: one of ``names.AVERAGINGS``.
        progress: called with numbers of samples read.
        choices: of the base, see ``torchliner.velocity.choices.Choices``; its phase rule is ``averaged``.
    Returns:
        title, frequency (Hz), averaging; base (Z of the whole liner with the choices as they are), low, high, level
        (its interval; None without one), level_check (dB) and level_check_words, choices, notes; nearest_case (what
        came out in the shipped case most like this one, whose impedance is known); readings (how often the velocity was
        read through, over all planes); skipped (factors that cannot be varied with these data, and why). ``rows``, the
        factor that moves Z most first: factor, variant (what was changed, and to what), impedance, change (off the
        base), level_check.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, Records) else list(planes)
    if len(several) > 1:
        planes_by_height([plane_of(each) for each in several])
    record, model, plane = several[0], as_liner(liner), plane_of(several[0])
    require_choice("averaging", averaging, AVERAGINGS)
    if choices.get("phase") is not None:
        raise ValueError("phase cannot be chosen for an audit, which varies it from a base of the phase averaged")
    if len(plane.asked(frequency)) != 1:
        raise ValueError(f"an audit has one frequency; {len(plane.asked(frequency))} are given")
    stated = Choices(**choices)
    if isinstance(record, Moments):
        stated = dataclasses.replace(stated, averaging=record.settings["averaging"])
        require_choice(f"averaging of moments reduced with {stated.averaging!r}:", averaging, stated.averagings)
    skipped = dict[str, str]()
    others = _other_liners(model, skipped)
    turns = lambda f: (2 * float(f[0]), plane.sampling_rate / 2)  # noqa: E731
    source = Source(record, [model, *others.values()], frequency, stated, more_turns=turns, progress=progress)
    with torch.no_grad():
        found = answer(source.known, model, source.frequency, stated)
    z = found.liner[averaging].impedance
    if not bool(torch.isfinite(z.abs()).all()):
        raise ValueError(
            f"{plane.name}: the base has no admittance: every probe counts as wall; lower or leave out wall_filter"
        )
    quiet = dataclasses.replace(stated, interval=None)
    base = Base(source, float(source.frequency[0]), averaging, quiet, skipped)
    variants = [base.variant(*labels, liner=other) for labels, other in others.items()]
    for factor, make in FACTORS.items():
        try:
            variants += make(base)  # those before a reason stay
        except ValueError as reason:
            skipped[factor] = str(reason)
    rows, readings = source.evaluate(variants), source.readings
    if len(several) == 1:
        skipped["height"] = "one plane is given; name the other heights too"
    for other in several[1:]:
        above = Source(other, [model], frequency, stated, progress=progress)
        rows += above.evaluate([base.variant("height", f"y = {1e3 * (above.plane.height or 0.0):.3g} mm")])
        readings += above.readings
    rows = [Row(each, change=each.impedance - complex(z[0])) for each in rows]
    size = {row.factor: max(abs(each.change) for each in rows if each.factor == row.factor) for row in rows}
    tell(notes := tuple(note.text for note in found.notes))
    low, high = found.bounds_of_liner(averaging) or (None, None)
    return Study(
        title=found.title or plane.name,
        frequency=base.frequency,
        averaging=averaging,
        base=complex(z[0]),
        low=low,
        high=high,
        level=found.level,
        level_check=source.level_of(z)[0],
        level_check_words=found.level_check_words,
        rows=tuple(sorted(rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))),
        skipped=skipped,
        readings=readings,
        choices=dict(found.choices),
        nearest_case=nearest_case(found),
        notes=notes,
    )


@dataclass(frozen=True, eq=False)
class Base:
    """What is varied: a plane, by choices without an interval, which no row has; ``skipped`` gets factors that cannot
    be varied, and why."""

    source: Source
    frequency: float
    averaging: str
    chosen: Choices
    skipped: dict[str, str]

    def variant(self, factor: str, name: str, averaging: str | None = None, **about: Any) -> Variant:
        """With ``choices`` changed, or another field of ``Variant``."""
        chosen = dataclasses.replace(self.chosen, **about.pop("choices", {}))
        return Variant({"factor": factor, "variant": name}, averaging or self.averaging, chosen, **about)


def _contraction(liner: SDoFLiner) -> dict[str, SDoFLiner]:
    others = [value for value in CONTRACTION_COEFFICIENTS if value != liner.vena_contracta]
    return {f"{value:g}": liner.replace(vena_contracta=value) for value in others}


OTHER_LINERS: dict[str, tuple[type, str, Callable[[Any], dict[str, Any]]]] = {
    "vena contracta": (SDoFLiner, "SDoF liners", _contraction),
    "velocity reading": (CellLiner, "SDoF and layered liners", velocity_readings),
    "porosity reading": (SDoFLiner, "SDoF liners", porosity_readings),
}


def _other_liners(model: LinerModel, skipped: dict[str, str]) -> dict[tuple[str, str], LinerModel]:
    """By factor and variant; ``skipped`` gets why there are none."""
    found: dict[tuple[str, str], LinerModel] = {}
    for factor, (needed, words, others) in OTHER_LINERS.items():
        try:
            if not isinstance(model, needed):
                raise ValueError(f"{type(model).__name__} has no such parameter; only {words} have")
            found |= {(factor, name): other for name, other in others(model).items()}
        except ValueError as reason:
            skipped[factor] = str(reason)
    return found


def _kernels(base: Base) -> Iterator[Variant]:
    source, liner = base.source, base.source.liner
    reach = liner.frequency_range or (-math.inf, math.inf)
    band = max(min(BAND[0], base.frequency), reach[0]), min(max(BAND[1], base.frequency), reach[1])
    if source.known.nodes is None:
        raise ValueError("|v| is constant, and its kernel is the liner's response there")
    speeds, rate = source.known.nodes.speeds, source.plane.sampling_rate
    for kind, words in KERNELS.items():
        found = response_at(liner, source.frequency, speeds, rate, kind, band).T
        yield base.variant("kernel", kind + words, moments=_projected(source.known, found, source.frequency))


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
    known, rate = base.source.known, base.source.plane.sampling_rate / 2
    if rate < FEWEST_SAMPLES_PER_PERIOD * base.frequency:
        samples = f"{rate / base.frequency:.3g} samples per period, fewer than {FEWEST_SAMPLES_PER_PERIOD:g}"
        raise ValueError(f"{rate:g} Hz would leave {samples}")
    if known.nodes is None or not bool((known.turns == rate).any()):
        raise ValueError("rows of alternating sign are needed, which an audit of the plane itself sums over |v|")
    yield base.variant("sampling rate", f"every second sample, {rate:.6g} Hz", moments=every_second(known))


def _averagings(base: Base) -> Iterator[Variant]:
    for name in base.chosen.averagings:
        if name != base.averaging:
            yield base.variant("averaging", name, averaging=name)


def _phase_rules(base: Base) -> Iterator[Variant]:
    source, known, f = base.source, base.source.known, base.frequency
    if base.chosen.drive != "rms" and not bool((known.turns == 2 * f).any()):
        raise ValueError("the moments hold no rows of phase rules; reduce the plane with phase='self-consistent'")
    of_one, least = known, base.chosen.minimum_coherence
    if known.nodes is not None:  # many phases are quicker asked of R of one liner
        of_one = _projected(known, response(source.liner, source.frequency, known.nodes.speeds), source.frequency)
    for name in PHASES:
        if name == "given":
            yield from _stated_phases(base, of_one)
        elif name != base.chosen.phase:
            share = 100 * float((known.survey.coherence(source.frequency)[known.counted] >= least).double().mean())
            if share:
                words = f"{name} ({share:.3g} % of probes)"
                yield base.variant("phase rule", words, choices={"phase": name}, moments=of_one)
            else:
                base.skipped[f"phase rule, {name}"] = f"no probe is coherent with {f:g} Hz by {least:g}"


def _stated_phases(base: Base, known: Moments) -> Iterator[Variant]:
    """The phases of the incident wave that move R and X furthest, wherever it may lie."""
    source, found = base.source, dict[float, complex]()

    def at(psi: float, words: str = "") -> Variant:
        name = f"given, psi = {psi:.2f} rad ({words})"
        return base.variant("phase rule", name, choices={"phase": "given"}, moments=known, psi=psi)

    for psi in (math.pi * step / PSI_STEPS for step in range(PSI_STEPS)):
        found[psi] = complex(at(psi).averages(known, source.liner, source.frequency).liner.impedance[0])
    for part, letter in (("real", "R"), ("imag", "X")):
        values = {psi: getattr(z, part) for psi, z in found.items()}
        yield at(min(values, key=values.__getitem__), f"smallest {letter}")
        yield at(max(values, key=values.__getitem__), f"largest {letter}")


def _projected(known: Moments, reflection: Tensor, frequency: Tensor) -> Moments:
    """Moments of one R(f, |v|) at some frequencies, Hz, (F,), from its values at the speeds of the nodes, (F, K)."""
    assert known.nodes is not None
    assert not isinstance(known.nodes, OfOneLiner)
    nodes = OfOneLiner.of(known.nodes, known.nodes.coefficients(reflection).to(known.survey.sums.device), frequency)
    sums = {name: nodes.matrix @ each for name, each in known.sums.items() if each.shape[2] == known.nodes.count}
    return dataclasses.replace(known, sums=sums, nodes=nodes)


def _other_speeds(base: Base) -> Iterator[Variant]:
    """Other drives and means; the rms is known from the survey, for the others the samples are read."""
    for name in ("rms", *(name for name in DRIVES if name != "rms")):
        if name != base.chosen.drive:
            yield base.variant("drive", name, choices={"drive": name, "running_window": None})
        base.source.samples()
    for name in MEANS:
        if name != base.chosen.mean:
            yield base.variant("mean velocity", name, choices={"mean": name})


def _lengths(base: Base) -> Iterator[Variant]:
    source, pitch = base.source, base.source.liner.cell_pitch
    source.samples()
    if pitch is None:
        raise ValueError("the liner states no cell_pitch")
    grid = grid_of(source.plane)
    shares = [share for share in LENGTHS if grid.spacing <= share * pitch <= grid.length * (1 + 1e-6)]
    if not shares:
        raise ValueError(f"none of {', '.join(map('{:g}'.format, LENGTHS))} cells fits between probe spacing and plane")
    used = source.known.used.reshape(grid.rows, grid.columns)
    chosen = {"averaging": "velocity", "background": None}
    for share in shares:
        windows, name = windows_of(grid, share * pitch, used), f"velocity over {share:g} of a cell"
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
