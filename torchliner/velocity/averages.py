r"""R of every probe, cell and the whole liner, each with its interval, from sums over blocks.

Over a record of velocities the replayed tone :math:`X e^{j\omega t} + \text{conjugate}` comes back as
:math:`X a + X^* b` with :math:`a = \langle R \rangle` and :math:`b = \langle R e^{-2j\omega t} \rangle`, so that
:math:`R = a + b X^*/X`. What the phase of the tone relative to v does to R is a phase rule: algebra on a and b. A new
rule is a function here and a row of ``PHASE_RULES``.

All of it is computed from all blocks and without each block in turn, along one axis of length B (``replicates``), so
that the intervals of probes, cells and liner come from the same lines of code as their values. It stays on the device.
"""

import contextlib
import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.conversions import admittance_from_reflection, reflection_from_admittance
from torchliner.engine.drives import survey_of_locked
from torchliner.engine.intervals import FEWEST_BLOCKS, jackknife, replicates
from torchliner.engine.moments import Moments
from torchliner.engine.sums import in_order, is_differentiated
from torchliner.engine.survey import Survey
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.records import VelocityPlane
from torchliner.records.educed import Educed, Interval
from torchliner.velocity.choices import Choices

ELEMENTS = 1 << 17  # complex values that a thread works on at once on a CPU


def averaged(a: Tensor, b: Tensor, **_: Any) -> Tensor:
    """Over all phases, since nothing else is known: R = a."""
    return a


def given(a: Tensor, b: Tensor, *, phase: Tensor, **_: Any) -> Tensor:
    r"""The phase is stated: :math:`R = a + b e^{-2j\psi}`; psi of the tone cos(omega t + psi), rad, (N, F or 1)."""
    return a + b * torch.exp(-2j * phase)


def self_consistent(a: Tensor, b: Tensor, *, velocity: Tensor, **_: Any) -> Tensor:
    r"""The wave whose replayed reflection gives the tone in v itself: V, half the complex peak amplitude of v into the
    liner at f, m/s, (..., N, F).

    :math:`(1 - a) X - b X^* = V` has the solution :math:`X = [(1 - a)^* V + b V^*]/(|1 - a|^2 - |b|^2)`; iterating
    for X fails at high |v|.
    """
    wave = (1 - a).conj() * velocity + b * velocity.conj()
    wave = wave / ((1 - a).abs().square() - b.abs().square())
    wave = torch.where(wave == 0, torch.ones_like(wave), wave)
    return a + b * wave.conj() / wave


PHASE_RULES: dict[str, Callable[..., Tensor]] = {
    "averaged": averaged,
    "self-consistent": self_consistent,
    "given": given,
}


@dataclass(frozen=True, eq=False)
class Averages:
    """R under one averaging."""

    probes: Educed | None  # (P, F); None for ``velocity``, which knows cells only
    cells: Educed  # (C, F)
    liner: Educed  # (F,)
    along_x: Educed | None  # averaged over z, (X, F); None for planes without rows and for ``velocity``
    replicates: Tensor  # R of the liner and of the cells from all blocks and without each, (B, 1 + C, F)
    held: Tensor  # where the phase rule could be used, bool, (N, F); N probes or cells
    wall: Tensor | None  # probes that count as wall, bool, (P, F); None without a wall filter


def average(
    known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices, averaging: str, reference_phase: Any = None
) -> Averages:
    """R of probes, cells and liner under one averaging, on the device of the moments; nothing is read back."""
    plane, seen, cells, lengths = known.plane, known.survey, known.membership, known.survey.lengths
    device, liner, locked, wall, phase = lengths.device, liner.in_flow(plane.mach), known.locked, None, None
    heard, of_cells = chosen.hears_tone, averaging == "velocity"
    if chosen.wall_filter is not None:
        wall = (seen.coherence(frequency) < chosen.wall_filter) & cells.used[:, None]
    held = torch.ones(cells.count if of_cells else plane.probes, len(frequency), dtype=torch.bool, device=device)
    if chosen.drive == "rms" or heard:
        seen = survey_of_columns(known, averaging)
    if heard:
        held = seen.coherence(frequency) >= chosen.minimum_coherence
    if chosen.phase == "given" or reference_phase is not None:
        phase = phase_of(plane, chosen, reference_phase, len(frequency)).to(device)
        phase = cells.mean(torch.exp(1j * phase).T).T.angle() if of_cells else phase
    bars = chosen.interval is not None and len(lengths) >= FEWEST_BLOCKS
    one = torch.eye(len(frequency), dtype=torch.complex128, device=device)
    coefficients = torch.cat([one, 1j * one], 1)  # of R in the sums, (F, J)
    if known.nodes is not None and known.onto is None:
        values = reflection_of(liner, frequency[:, None], known.nodes.speeds)
        coefficients = known.nodes.coefficients(values).to(device)
    each = torch.view_as_real(coefficients)  # (F, J, 2)
    of_all = each.transpose(0, 1).flatten(1)
    turns = []  # places of 2 f
    if chosen.phase != "averaged" and len(known.turns):
        turns = [int((known.turns - 2 * f).abs().argmin()) for f in frequency.tolist()]

    # From sums over blocks: of all blocks and, if there are intervals, without each of them, (B, ...).
    means = partial(replicates, lengths=lengths, every=bars)
    own_waves = means(seen.blocks.wave_sums(2 * frequency).to(device))[:, None] if turns else None

    def reflection(part: slice) -> Tensor:
        if chosen.drive == "rms":  # R at the rms over the record, and without each block
            square = means(seen.squares[:, part])
            if chosen.mean == "removed":
                square = square - means(seen.sums[:, 0, part]) ** 2
            speed = square.clamp(min=0).sqrt()
            return reflection_of(liner, frequency, speed.cpu()[..., None]).to(device)
        sums = known.sums[averaging][..., part]
        a = torch.view_as_complex((means(sums[:, 0]).transpose(1, 2) @ of_all).unflatten(2, (-1, 2)))  # <R>
        b = torch.zeros_like(a)  # <R e^{-2 j omega t}> less what the mean of R leaves in it
        if own_waves is not None:
            cosine, sine = (
                torch.view_as_complex(means(sums[:, [first + i for i in turns]]).transpose(2, 3) @ each)
                for first in (1, 1 + len(known.turns))
            )
            b = (cosine - 1j * sine).transpose(1, 2) - own_waves * a
        tone = -seen.tone(frequency, every=bars, columns=part) / 2 if heard else None
        own = None if phase is None else phase[part]
        found = PHASE_RULES[chosen.phase](a, b, velocity=tone, phase=own)
        found = torch.where(held[part], found, a) if heard else found  # ``averaged`` where v is not coherent
        if averaging == "phase-locked" and locked is not None and locked.scale is not None:
            # The record's own level of turbulence, which varies from block to block, was replaced by a stated one.
            found = torch.cat([found[:1], found[:1] + (found[1:] - found[:1]) / locked.scale[part, None]])
        return found

    threads = not is_differentiated(coefficients)
    return fold(known, averaging, lengths, reflection, held, chosen.interval, wall=wall, threads=threads)


def phase_of(plane: VelocityPlane, chosen: Choices, phase: Any, count: int) -> Tensor:
    """psi of all probes, (P, F), from what was given for F = ``count`` frequencies."""
    if chosen.phase != "given" or phase is None:
        raise ValueError("phase='given' and reference_phase, in rad, one for all or per probe, go together")
    values, shape = real_tensor(phase, name="reference_phase (rad)").cpu(), plane.probe_shape
    if not bool(torch.isfinite(values).all()):
        raise ValueError("reference_phase holds values that are not finite; it is in rad")
    with contextlib.suppress(RuntimeError):
        each = values if values.ndim > len(shape) else values[..., None]
        return each.broadcast_to((*shape, count)).reshape(plane.probes, count)
    raise ValueError(
        f"reference_phase has shape {tuple(values.shape)}; it must broadcast over probes of shape {shape}, with a last "
        f"axis over these and {count} frequencies"
    )


def survey_of_columns(known: Moments, averaging: str) -> Survey:
    """Of the columns that an averaging has: probes, cells, or probes with the phase-locked velocity of their cell."""
    seen, cells = known.survey, known.membership
    if averaging == "velocity":
        squares = known.sums.get("square of cells")
        of_cells = torch.full_like(cells.mean(seen.squares), torch.nan) if squares is None else squares[:, 0, 0]
        return dataclasses.replace(seen, sums=cells.mean(seen.sums), squares=of_cells, peaks=cells.mean(seen.peaks))
    if averaging == "phase-locked" and known.locked is not None:
        return survey_of_locked(known.locked, seen)
    return seen


def fold(
    known: Moments,
    averaging: str,
    lengths: Tensor,
    reflection: Callable[[slice], Tensor],
    held: Tensor,
    level: float | None,
    *,
    wall: Tensor | None = None,
    threads: bool = True,
) -> Averages:
    """Averages of the admittances of columns: probes or, of averaging ``velocity``, cells.

    ``reflection`` is R of some columns, from all blocks, of weights ``lengths``, (S,), and without each, (B, n, F);
    ``level`` of the intervals, 0 to 1, or None; several ``threads`` may work at once.
    """
    cells, device, (columns, frequencies) = known.membership, lengths.device, held.shape
    of_cells, level = averaging == "velocity", level if len(lengths) >= FEWEST_BLOCKS else None
    # Sums of admittances over each cell, the probes of no cell, and each x, side by side.
    labels, weight, rows = cells.labels, cells.used.double(), 0
    if of_cells:
        labels, weight = torch.arange(cells.count, device=device), torch.ones_like(cells.sizes)
        weight = weight if known.cells.weight is None else known.cells.weight.to(device)
    elif averaging == "phase-locked":
        weight = weight * (labels < cells.count)
    places, leave = [labels], (weight == 0)[:, None]
    if not of_cells and len(known.plane.probe_shape) == 2:
        rows = known.plane.probe_shape[1]
        places.append(cells.count + 1 + torch.arange(columns, device=device) % rows)
    leave = leave if wall is None or of_cells else leave | wall
    numbers, sums = torch.zeros(cells.count + 1 + rows, dtype=torch.float64, device=device), torch.empty(0)
    shares = lengths / lengths.sum()

    def work(part: slice) -> tuple[slice, Tensor, Educed]:
        each = reflection(part)
        own = None if level is None or of_cells else jackknife(each.detach(), shares, level)
        admittance = admittance_from_reflection(each).masked_fill(leave[part], 0)
        return part, admittance * weight[part, None] if of_cells else admittance, Educed(each[0], own)

    # The bits of a column do not depend on how the columns are shared out.
    size = max(1, ELEMENTS // ((1 + len(lengths)) * frequencies)) if device.type == "cpu" else columns
    parts, found = [slice(left, min(left + size, columns)) for left in range(0, columns, size)], list[Educed]()
    for part, admittance, own in in_order(work, parts, device) if threads else map(work, parts):
        sums = sums if found else admittance.new_zeros(len(admittance), len(numbers), frequencies)
        found.append(own)
        for place in places:
            sums.index_add_(1, place[part], admittance)
            numbers.index_add_(0, place[part], weight[part])
    sums, number = (
        torch.cat([each[..., : cells.count + 1, :].sum(-2, keepdim=True), each], -2)
        for each in (sums, numbers[:, None])
    )
    averages = reflection_from_admittance(sums / torch.where(number > 0, number, torch.nan))
    joined = Educed(averages[0], None if level is None else jackknife(averages.detach(), shares, level))
    bounds = [each.interval for each in found if each.interval is not None]
    whole = Educed(torch.cat([each.reflection for each in found]), Interval.joined(bounds) if bounds else None)
    return Averages(
        probes=None if of_cells else whole,
        cells=joined.map(lambda value: value[1 : 1 + cells.count]),
        liner=joined.map(lambda value: value[0]),
        along_x=joined.map(lambda value: value[2 + cells.count :]) if rows else None,
        replicates=averages[:, : 1 + cells.count],
        held=held,
        wall=wall,
    )
