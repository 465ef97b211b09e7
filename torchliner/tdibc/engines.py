"""The engines on a prepared plane."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from torchliner.liners.model import LinerModel
from torchliner.replay.block_lines import BlockLine, plan_block_lines
from torchliner.replay.direct import direct_sums
from torchliner.replay.emissions import ComplexTones, Emission
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import build_kernels
from torchliner.replay.lines import plan_lines
from torchliner.replay.sinks import ToneSink
from torchliner.replay.spectral import spectral_sums
from torchliner.replay.unfold import Sink, replay_unfold
from torchliner.tdibc.prepared import Prepared, Progress


def tone_sums(ready: Prepared, backward: bool, progress: Progress | None) -> LineSums:
    """Windowed lines of the replies to complex tones, by the engine chosen."""
    record, drive, chosen = ready.record, ready.drive, ready.chosen
    block_lines = block_lines_of(ready, backward)
    if chosen.engine == "spectral":
        lines = plan_lines(
            ready.liner, ready.frequency.tolist(), record, ready.grid, ready.kernels,
            of_kernel=chosen.uses_kernel_response, backward=backward,
        )  # fmt: skip
        return spectral_sums(
            drive, lines, ready.grid, block_lines=block_lines, compile_loops=chosen.compile,
            progress=progress,
        )  # fmt: skip
    assert ready.kernels is not None
    blocks = None
    if block_lines:  # these engines know no sums per block: R(f, |v|) is read once more
        blocks = spectral_sums(
            drive, [], ready.grid, block_lines=block_lines, compile_loops=chosen.compile
        ).blocks
    if chosen.engine == "direct":
        sums = direct_sums(ready.whole_speed(), ready.kernels, ready.frequency, record)
        if progress is not None:
            progress(drive.samples)
        return LineSums(sums.forward, sums.backward if backward else None, blocks)
    sink = ToneSink(ready.frequency, record, sum(drive.widths), drive.device)
    tones = ComplexTones(ready.frequency, record.sampling_rate)
    unfold_into(ready, tones, [sink], progress)
    return dataclasses.replace(sink.sums(backward), blocks=blocks)


def block_lines_of(ready: Prepared, backward: bool) -> list[BlockLine]:
    """For error bars; the drive ``rms`` moves with the mean square alone, see ``survey``."""
    if ready.blocks is None or ready.chosen.drive == "rms":
        return []
    return plan_block_lines(
        ready.liner, ready.frequency.tolist(), ready.record.sampling_rate, ready.blocks,
        ready.grid, ready.kernels if ready.chosen.uses_kernel_response else None,
        backward=backward,
    )  # fmt: skip


def unfold_into(
    ready: Prepared, emission: Emission, sinks: Sequence[Sink], progress: Progress | None
) -> None:
    """``replay_unfold`` of a prepared plane, with its choices."""
    assert ready.kernels is not None
    replay_unfold(
        ready.drive, ready.kernels, emission, ready.record, sinks, progress=progress,
        tolerance=ready.chosen.rank_tolerance, memory=ready.chosen.tail_memory,
    )  # fmt: skip


def with_liner(ready: Prepared, liner: LinerModel) -> Prepared:
    """The same survey, drive and levels with another liner; its kernels are built anew."""
    kernels = ready.kernels
    if kernels is not None:
        kernels = build_kernels(
            liner, ready.grid, kernels.sampling_rate, kind=kernels.kind, band=kernels.band
        )
    return dataclasses.replace(ready, liner=liner, kernels=kernels)
