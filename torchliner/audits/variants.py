"""What an audit changes without another reading: the liner, its response, or which samples count.

The moments of |v| know neither liner nor response, so any liner may be read off them. Half the record is the sum over
half of its blocks, and every second sample is a row of alternating sign.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.kernels import BAND, response_at
from torchliner.engine.moments import Moments, projection_of
from torchliner.liners.cell import CellLiner
from torchliner.liners.model import LinerModel
from torchliner.liners.readings import Readings, porosity_readings, velocity_readings
from torchliner.liners.sdof import SDoFLiner
from torchliner.velocity.parts import with_rows
from torchliner.velocity.review import FEWEST_SAMPLES_PER_PERIOD

VENA_CONTRACTA = (0.75, 0.8, 0.85)
KERNELS = {"two-sided": "", "causal": ", the paper to the letter"}
Variant = tuple[str, str, Moments, LinerModel]  # what is changed, to what, and the result of both


class CannotApply(ValueError):
    """A factor that cannot be varied here; the text says why."""


def other_liners(liner: LinerModel) -> tuple[list[tuple[str, str, CellLiner]], dict[str, str]]:
    """Factor, name and liner of each variant of a liner, and why a factor has none."""
    found, skipped = [], {}
    factors: tuple[tuple[str, Any, type[CellLiner], str], ...] = (
        ("vena contracta", _vena_contracta, SDoFLiner, "SDoF liners"),
        ("velocity reading", velocity_readings, CellLiner, "SDoF and layered liners"),
        ("porosity reading", porosity_readings, SDoFLiner, "SDoF liners"),
    )
    for factor, of, needed, words in factors:
        try:
            if not isinstance(liner, needed):
                kind = type(liner).__name__
                raise CannotApply(f"{kind} has no such parameter; only {words} have")
            found += [(factor, name, other) for name, other in of(liner).items()]
        except ValueError as reason:
            skipped[factor] = str(reason)
    return found, skipped


def _vena_contracta(liner: SDoFLiner) -> Readings:
    others = [value for value in VENA_CONTRACTA if value != liner.vena_contracta]
    return {f"{value:g}": liner.replace(vena_contracta=value) for value in others}


def variants(
    known: Moments, liner: LinerModel, liners: list[tuple[str, str, CellLiner]], frequency: float
) -> tuple[list[Variant], dict[str, str]]:
    """All that moments give at one frequency (Hz), and why a factor has none.

    Args:
        known: of the base.
        liner: of the base.
        liners: of ``other_liners``, which the nodes of ``known`` serve too.
        frequency: Hz.
    """
    factors: dict[str, Callable[[], Iterator[Variant]]] = {
        "kernel": lambda: _kernels(known, liner, frequency),
        "liner": lambda: ((factor, name, known, other) for factor, name, other in liners),
        "half the record": lambda: _halves(known, liner),
        "sampling rate": lambda: _half_rate(known, liner, frequency),
    }
    found: list[Variant] = []
    skipped = {}
    for factor, make in factors.items():
        try:
            found += make()
        except ValueError as reason:  # a liner's table may be too narrow
            skipped[factor] = str(reason)
    return found, skipped


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


def _kernels(known: Moments, liner: LinerModel, frequency: float) -> Iterator[Variant]:
    low, high = min(BAND[0], frequency), max(BAND[1], frequency)
    if liner.frequency_range is not None:
        low, high = max(low, liner.frequency_range[0]), min(high, liner.frequency_range[1])
    if known.nodes is None:
        raise CannotApply("|v| is constant, and its kernel is the liner's response there")
    for kind, words in KERNELS.items():
        kernels = KernelLiner(liner, known.plane.sampling_rate, kind, (low, high))
        yield "kernel", kind + words, of_liner(known, kernels, torch.tensor([frequency], dtype=torch.float64)), liner


def _halves(known: Moments, liner: LinerModel) -> Iterator[Variant]:
    count = known.survey.blocks.count
    half = count // 2
    parts = {"first": of_blocks(known, slice(0, half)), "second": of_blocks(known, slice(count - half, count))}
    periods = parts["first"].survey.blocks.periods
    if periods < FEWEST_PERIODS and not (half and known.settings["allow_short"]):
        raise CannotApply(f"half the record holds {periods} whole periods, fewer than {FEWEST_PERIODS:g}")
    for name, part in parts.items():
        words = f"{name}, mean over {part.survey.blocks.periods} whole periods"
        yield "half the record", words, part, liner


def of_blocks(known: Moments, part: slice) -> Moments:
    """Moments of some consecutive blocks, with the phase-locked velocity of the whole record."""
    blocks = known.survey.blocks
    first, last = (blocks.periods * i // blocks.count for i in (part.start, part.stop))
    borders = blocks.borders[part.start : part.stop + 1]
    fewer = with_rows(known, lambda rows: rows[part])
    own = dataclasses.replace(blocks, borders=borders, periods=last - first)
    return dataclasses.replace(fewer, survey=dataclasses.replace(fewer.survey, blocks=own))


def _half_rate(known: Moments, liner: LinerModel, frequency: float) -> Iterator[Variant]:
    rate = known.plane.sampling_rate / 2
    if rate < FEWEST_SAMPLES_PER_PERIOD * frequency:
        raise CannotApply(
            f"{rate:g} Hz would leave {rate / frequency:.3g} samples per period, fewer than "
            f"{FEWEST_SAMPLES_PER_PERIOD:g}"
        )
    if known.nodes is None:
        raise CannotApply("|v| is constant, and its square is known of all samples together")
    if not bool((known.turns == rate).any()):
        raise CannotApply(
            "the moments were reduced without the rows of alternating sign, which an audit of the plane itself sums"
        )
    yield "sampling rate", f"every second sample, {rate:.6g} Hz", every_second(known), liner


def of_liner(known: Moments, liner: LinerModel, frequency: Tensor) -> Moments:
    """Moments of R at some frequencies (Hz, (F,)) alone: many answers about phases are quicker from them."""
    projection = None if known.nodes is None else projection_of(known.nodes, liner, frequency)
    if projection is None:
        return known
    count = projection.shape[1]
    sums = {name: projection.to(each) @ each for name, each in known.sums.items() if each.shape[2] == count}
    return dataclasses.replace(known, sums=sums, projected=frequency)


def every_second(known: Moments) -> Moments:
    """Moments of the samples 0, 2, ... alone, whose weight is (1 + (-1)^n)/2: of |v| as it is, for phase ``averaged``.

    Args:
        known: with half the sampling rate among its ``turns``.
    """
    seen, rate = known.survey, known.plane.sampling_rate / 2
    row = 1 + int((known.turns == rate).nonzero()[0])
    gram = seen.gram.clone()
    signs = seen.blocks.wave_sums(torch.tensor([rate]))[:, 0].real
    gram[:, 0, 0] = (gram[:, 0, 0] + signs.to(gram)) / 2
    return dataclasses.replace(
        known,
        survey=dataclasses.replace(seen, gram=gram),
        turns=known.turns[:0],
        sums={n: (v[:, :1] + v[:, row : row + 1]) / 2 for n, v in known.sums.items() if v.shape[1] > 1},
    )
