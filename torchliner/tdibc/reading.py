"""The readings of a plane for an eduction: what is summed, and probes that hold no numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.reduction.basis import Basis
from torchliner.reduction.drive import DriveSpeed
from torchliner.reduction.line_means import lines_needed, window_lines
from torchliner.reduction.moments import Moments, PlaneSums
from torchliner.reduction.periodic import MOST_TONES, Harmonics, coherent_tones
from torchliner.reduction.plan import PassPlan, merged
from torchliner.reduction.probe_velocity import ProbeVelocity
from torchliner.reduction.readings import First, Wanted, read_again, read_once
from torchliner.reduction.survey import Survey, SurveySums
from torchliner.replay.edges import Record
from torchliner.replay.levels import carries_gradient
from torchliner.replay.phase_rule import phase_rule
from torchliner.signals.blocks import Blocks
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.reduced import window_of
from torchliner.tdibc.review import review_cells, review_coherent, review_survey


@dataclasses.dataclass(frozen=True)
class Asked:
    """A plane with what is asked of it, before its data are read."""

    plane: VelocityPlane
    frequency: Tensor
    record: Record
    blocks: Blocks
    sent: Tensor | None
    notes: list[str]
    known: Moments | None = None


def reader_lines(record: Record, chosen: Choices) -> list[tuple[float, complex]]:
    """Lines of the window under which moments are read."""
    if chosen.engine != "spectral" or chosen.whole_periods:
        return [(0.0, 1.0)]
    return window_lines(record.window, record.start, record.sampling_rate)


def turns_of(frequency: Tensor, chosen: Choices, every_rule: bool = False) -> Tensor:
    """Of the phase rule, or of any rule of one tone, Hz, (F, Q)."""
    own = phase_rule(chosen.phase).turns(frequency)
    return 2 * frequency[:, None] if every_rule and own.shape[1] == 0 else own


def _measured(plane: VelocityPlane, frequency: Tensor, chosen: Choices) -> Tensor:
    """Frequencies at which v itself is looked at: all if they are few or if something depends on
    them, else the tone of the data, (n,)."""
    needed = phase_rule(chosen.phase).needs_velocity or chosen.wall_filter is not None
    if needed or len(frequency) <= MOST_TONES:
        return frequency
    if plane.frequency is None:
        return frequency[:0]
    return frequency[(frequency / plane.frequency - 1).abs() < SAME_FREQUENCY]


def read_plane(
    asked: Asked, liner: LinerModel, chosen: Choices, basis: Basis | None, *,
    every_rule: bool = False, progress: Progress | None = None,
    further_lines: Sequence[float] = (),
) -> tuple[DriveSpeed | None, PlaneSums, list[str]]:  # fmt: skip
    """The readings of a plane: one, another where |v| needs a statistic of the record, another for
    the extremes of v* where the largest |v| is limited, and another without faulty probes.

    Args:
        asked: of ``ask``.
        liner: whose cells and largest |v| count.
        chosen: all choices.
        basis: functions of |v| that are summed; None for a survey alone.
        every_rule: whether the rows of all phase rules of one tone are summed.
        further_lines: Hz, waves that are summed beside those of window and phase rule.
        progress: called with numbers of samples done.
    Returns:
        |v| for the other engines, the sums, notes.
    """
    if asked.known is not None:
        return None, asked.known.sums, list(asked.notes)
    plane, notes = asked.plane, list(asked.notes)
    cells = sort_into_cells(plane, liner.cell_pitch)
    wanted = wanted_of(asked, liner, chosen, basis, every_rule, further_lines)
    velocity, first, used = _first_reading(plane, cells, wanted, chosen, progress, notes)
    notes += review_survey(plane, first.survey, used)
    kept = cells.kept(used)
    if first.periodic is not None:
        notes += review_coherent(plane, kept, first.periodic, asked.frequency, liner, chosen)
    drive, sums, more = read_again(velocity, wanted, first, kept, used, progress)
    return drive, sums, notes + more


def wanted_of(
    asked: Asked, liner: LinerModel, chosen: Choices, basis: Basis | None, every_rule: bool = False,
    further_lines: Sequence[float] = (),
) -> Wanted:  # fmt: skip
    """What the readings of a plane are asked for; arguments as for ``read_plane``."""
    plane, record = asked.plane, asked.record
    rate, several = plane.sampling_rate, phase_rule(chosen.phase).several_tones
    lines: tuple[float, ...] = ()
    if basis is not None:
        turns = turns_of(asked.frequency, chosen, every_rule)
        of_window = lines_needed(reader_lines(record, chosen), turns)
        lines = merged((*of_window, *further_lines))
    plan = PassPlan(plane.samples, rate, record.start, record.end, asked.blocks, lines)
    harmonics = None
    if chosen.order == ORDERS[2]:
        tones = coherent_tones(plane.frequency, asked.frequency)
        if several:
            tones = tuple(asked.frequency.tolist())
        harmonics = Harmonics.of(tones, rate)
    running = window_of(chosen, asked.frequency)
    return Wanted(
        plan, _measured(plane, asked.frequency, chosen), record.weights(0, plane.samples), basis,
        plane.frequency, chosen.drive, chosen.mean, max(1, round(running * rate)), harmonics,
        chosen.oncoming_rms,
        keeps_blocks=several or (chosen.interval is not None and chosen.incident is None),
        velocity_blocks=phase_rule(chosen.phase).needs_velocity or chosen.drive == "rms",
        true_extremes=not (liner.speed_max is None and chosen.velocity_max is None),
    )  # fmt: skip


def _first_reading(
    plane: VelocityPlane, cells: Cells, wanted: Wanted, chosen: Choices,
    progress: Progress | None, notes: list[str],
) -> tuple[ProbeVelocity, First, Tensor]:  # fmt: skip
    """Probes with faults are found and left out, (P,), and with them cells that hold no other."""
    like = plane.velocity
    if (
        chosen.engine == "spectral" and isinstance(like, Tensor)
        and carries_gradient(like) and torch.is_grad_enabled()
    ):  # fmt: skip
        raise ValueError(
            f"{plane.name}: velocity carries a gradient, which the moments of engine 'spectral' "
            "would lose; use engine 'unfold' or 'direct', or give velocity.detach()"
        )
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)

    def over(used: Tensor, report: Progress | None, samples_read: int = 0) -> tuple[ProbeVelocity, First]:
        held = cells.kept(used)
        velocity = ProbeVelocity(plane, held, dtype, device, used, chosen.slab_memory)
        velocity.samples_read = samples_read
        first, more = read_once(velocity, wanted, held, used, report)
        notes.extend(more)
        return velocity, first

    velocity, first = over(torch.ones(plane.probes, dtype=torch.bool), progress)
    used = (first.survey.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        refuse_bad_probes(plane, first.survey, used, chosen)
        velocity, first = over(used, None, velocity.samples_read)
        notes += review_cells(plane, cells, used)
    return velocity, first, used


def refuse_bad_probes(plane: VelocityPlane, seen: Survey | SurveySums, used: Tensor, chosen: Choices) -> None:
    """Refuse faults unless they are to be left out, and something is left."""
    first = int((~used).nonzero()[0])
    place = tuple(int(i) for i in torch.unravel_index(torch.tensor(first), plane.probe_shape))
    text = (
        f"{plane.name} holds {int(seen.bad[: plane.probes].sum())} nan or inf at "
        f"{int((~used).sum())} of {plane.probes} probes, the first at probe {place}, sample "
        f"{int(seen.first_bad[first])}"
    )
    if chosen.missing == "refuse":
        raise ValueError(f"{text}; repair them, or leave these probes out with missing='exclude'")
    if not bool(used.any()):
        raise ValueError(f"{text}; no probe is left")
