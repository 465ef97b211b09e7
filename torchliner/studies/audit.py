"""How far each choice that the paper leaves open moves the answer, beside its statistical interval.

Each factor is a function that makes variants of the base, or says why there is none.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, require_choice, tell
from torchliner.engine.kernels import kernel_band, kernel_taps, tap_response
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, LinerModel, as_liner, reflection_of
from torchliner.liners.sdof import porosity_readings, velocity_readings
from torchliner.names import AVERAGINGS, DRIVES, MEANS
from torchliner.records import VelocityPlane
from torchliner.records.case import planes_by_height
from torchliner.studies.variants import Row, Study, Variant, evaluate, every_second, of_blocks, read_again, read_for
from torchliner.velocity.choices import COMPUTED, Choices
from torchliner.velocity.educe import answer, fitting
from torchliner.velocity.reading import Progress
from torchliner.velocity.review import FEWEST_SAMPLES_PER_PERIOD

PSI_STEPS = 72  # of the incident wave, over one turn of 2 psi
CONTRACTION_COEFFICIENTS = (0.75, 0.8, 0.85)
KERNELS = {"two-sided": "", "causal": ", the paper to the letter"}


def audit(
    planes: VelocityPlane | Sequence[VelocityPlane],
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
        liner, progress: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        averaging: one of ``names.AVERAGINGS``.
        choices: of the base, see ``torchliner.velocity.choices.Choices``; its phase rule is ``averaged``.
    Returns:
        base (Z of the whole liner), low, high, level (its interval; None without one), level_check (dB), skipped
        (factors that cannot be varied with these data, and why). ``rows``, the factor that moves Z most first: factor,
        variant, impedance, change (off the base), level_check.
    """
    plane, *above = [planes] if isinstance(planes, VelocityPlane) else planes
    if above:
        planes_by_height([plane, *above])
    require_choice("averaging", averaging, AVERAGINGS)
    model, asked, chosen = as_liner(liner), plane.asked(frequency), Choices(**choices)
    if len(asked) != 1:
        raise ValueError(f"an audit has one frequency; {len(asked)} are given")
    others, skipped = _other_liners(model)
    turns = (2 * float(asked[0]), plane.sampling_rate / 2)
    known, nodes = read_for(plane, [model, *others.values()], asked, chosen, turns, progress)
    with torch.no_grad():
        found = answer(known, model, asked, fitting(known, model, asked, chosen))
    z = complex(found.liner[averaging].impedance[0])
    base = Variant({}, known, model, averaging, replace(chosen, interval=None))
    variants = [_vary(base, *labels, liner=other) for labels, other in others.items()]
    for factor, make in FACTORS.items():
        try:
            variants += make(base, asked)  # those before a reason stay
        except ValueError as reason:
            skipped[factor] = str(reason)
    rest = [name for name in COMPUTED[chosen.averaging] if name != averaging]
    variants += [_vary(base, "averaging", name, averaging=name) for name in rest]
    drives = [name for name in DRIVES if name != chosen.drive]
    unread = [_vary(base, "drive", name, drive=name, running_window=None) for name in drives]
    unread += [_vary(base, "mean velocity", name, mean=name) for name in MEANS if name != chosen.mean]
    variants += read_again(plane, nodes, asked, unread, progress)
    for other in above:
        moments, _ = read_for(other, [model], asked, chosen, (), progress)
        variants.append(_vary(base, "height", f"y = {1e3 * (other.height or 0.0):.3g} mm", moments=moments))
    if not above:
        skipped["height"] = "one plane is given; name the other heights too"
    whole, *rows = evaluate([base, *variants], asked, known)
    rows = [Row(each, change=each.impedance - z) for each in rows]
    size = {row.factor: max(abs(each.change) for each in rows if each.factor == row.factor) for row in rows}
    tell(notes := tuple(note.text for note in found.notes))
    low, high = found.bounds_of_liner(averaging) or (None, None)
    return Study(
        title=found.title or plane.name,
        frequency=float(asked[0]),
        averaging=averaging,
        base=z,
        low=low,
        high=high,
        level=found.level,
        level_check=whole.level_check,
        level_check_words=found.level_check_words,
        rows=tuple(sorted(rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))),
        skipped=skipped,
        choices=dict(found.choices),
        notes=notes,
    )


def _vary(base: Variant, factor: str, name: str, **changes: Any) -> Variant:
    """The base with choices, or fields of ``Variant``, changed."""
    about = {key: changes.pop(key) for key in ("moments", "liner", "averaging", "psi") if key in changes}
    return replace(base, labels={"factor": factor, "variant": name}, chosen=replace(base.chosen, **changes), **about)


def _other_liners(model: Any) -> tuple[dict[tuple[str, str], LinerModel], dict[str, str]]:
    """By factor and variant; and why a factor has none."""
    makers: dict[str, Callable[[], dict[str, Any]]] = {
        "contraction coefficient": lambda: {
            f"{c:g}": model.replace(vena_contracta=c) for c in CONTRACTION_COEFFICIENTS if c != model.vena_contracta
        },
        "velocity reading": lambda: velocity_readings(model),
        "porosity reading": lambda: porosity_readings(model),
    }
    found, skipped = dict[tuple[str, str], LinerModel](), dict[str, str]()
    for factor, others in makers.items():
        try:
            found |= {(factor, name): other for name, other in others().items()}
        except AttributeError:
            skipped[factor] = f"{type(model).__name__} has no such parameter"
        except ValueError as reason:
            skipped[factor] = str(reason)
    return found, skipped


def _of_one_liner(known: Moments, reflection: Tensor) -> Moments:
    """Moments of one R(f, |v|), from its values at the speeds of the nodes, (F, K)."""
    nodes = known.nodes
    assert nodes is not None
    of_one = nodes.coefficients(reflection).to(known.survey.sums.device)
    onto = torch.cat([of_one.real, of_one.imag])
    sums = {name: onto @ each for name, each in known.sums.items() if each.shape[2] == nodes.count}
    return replace(known, sums=sums, onto=onto)


def _kernels(base: Variant, frequency: Tensor) -> Iterator[Variant]:
    known, rate = base.moments, base.moments.plane.sampling_rate
    if known.nodes is None:
        raise ValueError("|v| is constant, and its kernel is the liner's response there")
    band = kernel_band(frequency[:1].tolist(), base.liner, rate)
    for kind, words in KERNELS.items():
        found = tap_response(*kernel_taps(base.liner, known.nodes.speeds, rate, kind, band), frequency, rate).T
        yield _vary(base, "kernel", kind + words, moments=_of_one_liner(known, found))


def _halves(base: Variant, frequency: Tensor) -> Iterator[Variant]:
    known = base.moments
    count, half = known.survey.blocks.count, known.survey.blocks.count // 2
    parts = {"first": of_blocks(known, slice(0, half)), "second": of_blocks(known, slice(count - half, count))}
    periods = parts["first"].survey.blocks.periods
    if periods < FEWEST_PERIODS and not (half and known.settings["allow_short"]):
        raise ValueError(f"half the record holds {periods} whole periods, fewer than {FEWEST_PERIODS:g}")
    for name, part in parts.items():
        words = f"{name}, mean over {part.survey.blocks.periods} whole periods"
        yield _vary(base, "half the record", words, moments=part)


def _half_rate(base: Variant, frequency: Tensor) -> Iterator[Variant]:
    known, rate, f = base.moments, base.moments.plane.sampling_rate / 2, float(frequency[0])
    if rate < FEWEST_SAMPLES_PER_PERIOD * f:
        raise ValueError(f"{rate:g} Hz has {rate / f:.3g} samples per period, fewer than {FEWEST_SAMPLES_PER_PERIOD:g}")
    if known.nodes is None:
        raise ValueError("the rms of the record is all that acts on the liner")
    yield _vary(base, "sampling rate", f"every second sample, {rate:.6g} Hz", moments=every_second(known))


def _phase_rules(base: Variant, frequency: Tensor) -> Iterator[Variant]:
    """The phases of the incident wave that move R and X furthest, wherever it may lie, and that of the tone in v."""
    known, f, least = base.moments, float(frequency[0]), base.chosen.minimum_coherence
    of_one = known
    if known.nodes is not None:  # many phases are quicker asked of R of one liner
        of_one = _of_one_liner(known, reflection_of(base.liner, frequency[:, None], known.nodes.speeds))

    def at(psi: float, words: str = "") -> Variant:
        name = f"given, psi = {psi:.2f} rad ({words})"
        return _vary(base, "phase rule", name, phase="given", moments=of_one, psi=psi)

    turn = [math.pi * step / PSI_STEPS for step in range(PSI_STEPS)]
    z = [complex(at(psi).averages(frequency).liner.impedance[0]) for psi in turn]
    for parts, letter in (([each.real for each in z], "R"), ([each.imag for each in z], "X")):
        yield at(turn[parts.index(min(parts))], f"smallest {letter}")
        yield at(turn[parts.index(max(parts))], f"largest {letter}")
    share = 100 * float((known.survey.coherence(frequency)[known.membership.used] >= least).double().mean())
    if not share:
        raise ValueError(f"self-consistent: no probe is coherent with {f:g} Hz by {least:g}")
    name = "self-consistent"
    yield _vary(base, "phase rule", f"{name} ({share:.3g} % of probes)", phase=name, moments=of_one)


FACTORS: dict[str, Callable[[Variant, Tensor], Iterator[Variant]]] = {  # of a base at a frequency, Hz, (1,)
    "kernel": _kernels,
    "half the record": _halves,
    "sampling rate": _half_rate,
    "phase rule": _phase_rules,
}
