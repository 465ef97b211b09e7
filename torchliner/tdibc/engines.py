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


def tone_sums(prepared: Prepared, backward: bool, progress: Progress | None) -> LineSums:
    """Windowed lines of the replies to complex tones, by the engine chosen."""
    record, drive, chosen = prepared.record, prepared.drive, prepared.chosen
    block_lines = block_lines_of(prepared, backward)
    if chosen.engine == "spectral":
        lines = plan_lines(
            prepared.liner, prepared.frequency.tolist(), record, prepared.grid, prepared.kernels,
            of_kernel=chosen.uses_kernel_response, backward=backward,
        )  # fmt: skip
        return spectral_sums(
            drive, lines, prepared.grid, block_lines=block_lines, compile_loops=chosen.compile,
            progress=progress,
        )  # fmt: skip
    assert prepared.kernels is not None
    blocks = None
    if block_lines:  # these engines know no sums per block: R(f, |v|) is read once more
        blocks = spectral_sums(
            drive, [], prepared.grid, block_lines=block_lines, compile_loops=chosen.compile
        ).blocks
    if chosen.engine == "direct":
        sums = direct_sums(prepared.whole_speed(), prepared.kernels, prepared.frequency, record)
        if progress is not None:
            progress(drive.samples)
        return LineSums(sums.forward, sums.backward if backward else None, blocks)
    sink = ToneSink(prepared.frequency, record, sum(drive.widths), drive.device)
    tones = ComplexTones(prepared.frequency, record.sampling_rate)
    unfold_into(prepared, tones, [sink], progress)
    return dataclasses.replace(sink.sums(backward), blocks=blocks)


def block_lines_of(prepared: Prepared, backward: bool) -> list[BlockLine]:
    """For error bars; the drive ``rms`` moves with the mean square alone, see ``survey``."""
    if prepared.blocks is None or prepared.chosen.drive == "rms":
        return []
    return plan_block_lines(
        prepared.liner, prepared.frequency.tolist(), prepared.record.sampling_rate, prepared.blocks,
        prepared.grid, prepared.kernels if prepared.chosen.uses_kernel_response else None,
        backward=backward,
    )  # fmt: skip


def unfold_into(
    prepared: Prepared, emission: Emission, sinks: Sequence[Sink], progress: Progress | None
) -> None:
    """``replay_unfold`` of a prepared plane, with its choices."""
    assert prepared.kernels is not None
    replay_unfold(
        prepared.drive, prepared.kernels, emission, prepared.record, sinks, progress=progress,
        tolerance=prepared.chosen.rank_tolerance, memory=prepared.chosen.tail_memory,
    )  # fmt: skip


def with_liner(prepared: Prepared, liner: LinerModel) -> Prepared:
    """The same survey, drive and levels with another liner; its kernels are built anew."""
    kernels = prepared.kernels
    if kernels is not None:
        kernels = build_kernels(
            liner, prepared.grid, kernels.sampling_rate, kind=kernels.kind, band=kernels.band
        )
    return dataclasses.replace(prepared, liner=liner, kernels=kernels)
