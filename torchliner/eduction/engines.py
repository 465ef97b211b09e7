"""The engines on a prepared plane."""

from __future__ import annotations

from torchliner.eduction.choices import Choices
from torchliner.eduction.prepare import Prepared, Progress
from torchliner.records.slabs import WORK_BYTES
from torchliner.replay.direct import direct_sums
from torchliner.replay.emissions import ComplexTones
from torchliner.replay.incident import LineSums
from torchliner.replay.lines import plan_lines
from torchliner.replay.sinks import ToneSink
from torchliner.replay.spectral import spectral_sums
from torchliner.replay.unfold import replay_unfold


def tone_sums(ready: Prepared, backward: bool, progress: Progress | None) -> LineSums:
    """Windowed lines of the replies to complex tones, by the engine chosen."""
    record, drive, chosen = ready.record, ready.drive, ready.chosen
    if chosen.engine == "spectral":
        lines = plan_lines(
            ready.liner, ready.frequency.tolist(), record, ready.grid, ready.kernels,
            of_kernel=chosen.uses_kernel_response, backward=backward,
        )  # fmt: skip
        return spectral_sums(
            drive, lines, ready.grid, compile_loops=chosen.compile, progress=progress
        )
    assert ready.kernels is not None
    if chosen.engine == "direct":
        sums = direct_sums(ready.whole_speed(), ready.kernels, ready.frequency, record)
        if progress is not None:
            progress(drive.samples)
        return sums if backward else LineSums(sums.forward, None)
    sink = ToneSink(ready.frequency, record, sum(drive.widths), drive.device)
    tones = ComplexTones(ready.frequency, record.sampling_rate)
    replay_unfold(
        drive, ready.kernels, tones, record, [sink], tolerance=chosen.rank_tolerance,
        memory=tail_memory(chosen), progress=progress,
    )  # fmt: skip
    return sink.sums(backward)


def tail_memory(chosen: Choices) -> int | None:
    """Bytes for what ``unfold`` stages and carries: half of the limit, slabs have the other."""
    memory = chosen.memory_bytes
    return None if memory is None else max(0, memory - WORK_BYTES) // 2
