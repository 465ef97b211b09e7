"""The engines on a prepared plane."""

from __future__ import annotations

from collections.abc import Sequence

from torchliner.replay.direct import direct_sums
from torchliner.replay.emissions import ComplexTones, Emission
from torchliner.replay.incident import LineSums
from torchliner.replay.sinks import ToneSink
from torchliner.replay.unfold import Sink, replay_unfold
from torchliner.tdibc.prepared import Prepared, Progress


def tone_sums(prepared: Prepared, backward: bool, progress: Progress | None) -> LineSums:
    """Windowed lines of the replies to complex tones, by ``unfold`` or ``direct``."""
    record, drive = prepared.record, prepared.driving
    assert prepared.kernels is not None
    if prepared.chosen.engine == "direct":
        sums = direct_sums(prepared.whole_speed(), prepared.kernels, prepared.frequency, record)
        if progress is not None:
            progress(drive.samples)
        return LineSums(sums.forward, sums.backward if backward else None)
    sink = ToneSink(prepared.frequency, record, sum(drive.widths), drive.device)
    tones = ComplexTones(prepared.frequency, record.sampling_rate)
    unfold_into(prepared, tones, [sink], progress)
    return sink.sums(backward)


def unfold_into(prepared: Prepared, emission: Emission, sinks: Sequence[Sink], progress: Progress | None) -> None:
    """``replay_unfold`` of a prepared plane, with its choices."""
    assert prepared.drive is not None and prepared.kernels is not None  # noqa: PT018
    replay_unfold(
        prepared.drive, prepared.kernels, emission, prepared.record, sinks, progress=progress,
        tolerance=prepared.chosen.rank_tolerance, memory=prepared.chosen.tail_memory,
    )  # fmt: skip
