"""The first pass over a plane; faulty probes are found there and left out."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.replay.drive import ProbeVelocity, with_smaller_slabs
from torchliner.replay.edges import Record
from torchliner.replay.phase_rule import phase_rule
from torchliner.replay.survey import Survey, survey
from torchliner.signals.blocks import Blocks
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.prepared import Progress


def first_pass(
    plane: VelocityPlane,
    cells: Cells,
    frequency: Tensor,
    record: Record,
    blocks: Blocks | None,
    chosen: Choices,
    progress: Progress | None,
) -> tuple[ProbeVelocity, Survey, Tensor, list[str]]:
    """First pass: over the probes and the cell averages; faulty probes are found and left out."""
    like = plane.velocity
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)
    weights = record.weights(0, plane.samples)
    said: list[str] = []
    moves = phase_rule(chosen.phase).needs_velocity or chosen.drive == "rms"
    kept = blocks if moves else None
    everything = torch.ones(plane.probes, dtype=torch.bool)

    def look(used: Tensor, report: Progress | None) -> tuple[ProbeVelocity, Survey]:
        velocity = ProbeVelocity(plane, cells, dtype, device, used, chosen.slab_memory)
        rate = plane.sampling_rate
        seen, notes = with_smaller_slabs(
            velocity, lambda: survey(velocity, frequency, rate, weights, report, kept)
        )
        said.extend(notes)
        return velocity, seen

    velocity, seen = look(everything, progress)
    used = (seen.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        _refuse_bad_probes(plane, seen, used, chosen)
        velocity, seen = look(used, None)
    return velocity, seen, used, said


def _refuse_bad_probes(plane: VelocityPlane, seen: Survey, used: Tensor, chosen: Choices) -> None:
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
