"""R(f) from one replay of any incident signal: sum Y X* / sum |X|^2 over windowed segments (H1).

With the record as one period of the signal (edge rule ``wrap``, no window) and |v| frozen every
line is exact. In turbulence each line also receives what |v(t)| shifts over from other lines of the
signal; that part has no mean over the signal's phases, so that over many draws of a noise the
estimate tends to <R(f, |v|)>, which ``spectral`` gives at once.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import torch
from torch import Tensor

from torchliner.io.reflected_file import reflected_file
from torchliner.records import ImpedanceMap
from torchliner.reduction.probe_velocity import with_smaller_slabs
from torchliner.replay.direct import replay_direct
from torchliner.replay.sinks import CrossSpectra, WholeSignal
from torchliner.replay.unfold import Sink
from torchliner.signals.segments import segment_starts
from torchliner.signals.windows import make_window
from torchliner.tdibc.assemble import assemble, facts_of
from torchliner.tdibc.closure import with_closure
from torchliner.tdibc.engines import unfold_into
from torchliner.tdibc.prepared import Prepared, Progress

FROZEN_ERROR = 1e-2  # in R
LOWEST_ENERGY = 1e-6  # of the strongest line: 60 dB below it a line is leakage, not signal


def educe_signal(prepared: Prepared, reflected: str | Path | None, progress: Progress | None) -> ImpedanceMap:
    """Map of a plane replayed with the incident signal of its choices.

    Args:
        prepared: prepared plane.
        reflected: file for the reflected signal, or None.
        progress: called with numbers of samples done.
    Raises:
        ValueError: the signal has no energy at a frequency asked for, or the segment does not fit.
    """
    chosen, start, rate = prepared.chosen, prepared.record.start, prepared.plane.sampling_rate
    sent = prepared.sent
    assert sent is not None
    starts, length = segment_starts(prepared.plane.samples, start, chosen.segment, rate)
    weights = make_window(chosen.window, length).weights
    columns, device = sum(prepared.driving.widths), prepared.driving.device

    def run() -> CrossSpectra:
        spectra = CrossSpectra(sent, weights, starts, prepared.frequency, rate, columns, device)
        _require_energy(prepared, spectra, weights, starts)
        _run(prepared, [spectra], reflected, progress)
        return spectra

    spectra, notes = with_smaller_slabs(prepared.driving.velocity, run)
    notes += _frozen_error(prepared, weights, starts)
    prepared = dataclasses.replace(prepared, notes=(*prepared.notes, *notes))
    reflection = spectra.reflection()
    held = torch.ones(reflection.shape, dtype=torch.bool, device=device)
    amplitude = prepared.velocity_amplitude
    found = assemble(prepared, "signal", reflection, held, 2 * amplitude, list(prepared.notes))
    return with_closure(prepared, found, {})


def _run(prepared: Prepared, sinks: list[Sink], reflected: str | Path | None, progress: Progress | None) -> None:
    if reflected is None:
        _replay(prepared, sinks, progress)
        return
    assert prepared.sent is not None
    with reflected_file(reflected, prepared.plane, prepared.sent, prepared.used, facts_of(prepared, "signal")) as store:
        _replay(prepared, [*sinks, WholeSignal(store)], progress)


def _replay(prepared: Prepared, sinks: list[Sink], progress: Progress | None) -> None:
    chosen, drive = prepared.chosen, prepared.driving
    assert prepared.kernels is not None
    emission = chosen.incident.emission(drive.samples, prepared.plane.sampling_rate)
    if chosen.engine == "direct":
        signal = replay_direct(prepared.whole_speed(), prepared.kernels, emission, prepared.record)
        for sink in sinks:
            sink.add(signal, slice(0, signal.shape[1]), 0)
            sink.flush()
        if progress is not None:
            progress(drive.samples)
        return
    unfold_into(prepared, emission, sinks, progress)


def _frozen_error(prepared: Prepared, weights: Tensor, starts: list[int]) -> list[str]:
    """What the estimate makes of this very signal where |v| never changes: there it should give the
    kernel's own response, but a segment meets replies to what was sent before it and after it."""
    kernels, sent, rate = prepared.kernels, prepared.sent, prepared.plane.sampling_rate
    assert kernels is not None and sent is not None  # noqa: PT018
    rms = float(prepared.driving.rms[0].median())
    level = int((kernels.grid.speeds - rms).abs().argmin())
    first, taps = kernels.first, kernels.taps[level].detach()
    emission = prepared.chosen.incident.emission(len(sent), rate)
    # Sample i of the record is the sum of taps[m] over emissions i - first - m.
    emitted = emission.values(1 - first - len(taps), len(sent) - first)[0]
    if prepared.record.edge == "wrap":
        emitted = sent[torch.arange(1 - first - len(taps), len(sent) - first) % len(sent)]
    size = len(emitted) + len(taps) - 1
    reply = torch.fft.irfft(torch.fft.rfft(emitted, n=size) * torch.fft.rfft(taps, n=size), n=size)
    reply = reply[len(taps) - 1 : len(taps) - 1 + len(sent)]
    spectra = CrossSpectra(sent, weights, starts, prepared.frequency, rate, 1, torch.device("cpu"))
    spectra.add(reply[None, None], slice(0, 1), 0)
    error = (spectra.reflection()[0] - kernels.response(prepared.frequency)[level]).abs()
    worst = int(error.argmax())
    if float(error[worst]) < FROZEN_ERROR:
        return []
    return [
        f"{prepared.plane.name}: with |v| frozen at {float(kernels.grid.speeds[level]):.3g} m/s "
        f"this signal over {len(starts)} segments of {1e3 * len(weights) / rate:.3g} ms gives R "
        f"off by {float(error[worst]):.2g} at {float(prepared.frequency[worst]):g} Hz (limit "
        f"{FROZEN_ERROR:g}): replies last {1e3 * len(taps) / rate:.3g} ms, so that a segment meets "
        "some to what was sent before it and misses part of its own; take longer segments, or "
        "noise over the whole record with edge='wrap'"
    ]


def _require_energy(prepared: Prepared, spectra: CrossSpectra, weights: Tensor, starts: list[int]) -> None:
    """Refuse frequencies at which the incident signal has next to no energy."""
    assert prepared.sent is not None
    length = len(weights)
    whole = torch.stack([prepared.sent[s : s + length] * weights for s in starts])
    strongest = float(torch.fft.rfft(whole).abs().square().sum(0).max())
    here = spectra.sent.abs().square().sum(0)
    label = prepared.chosen.incident.label
    if strongest == 0:
        raise ValueError(f"incident signal {label} is zero throughout")
    for f, power in zip(prepared.frequency.tolist(), here.tolist(), strict=True):
        if power < LOWEST_ENERGY * strongest:
            below = "-inf" if power == 0 else f"{10 * math.log10(power / strongest):.0f}"
            raise ValueError(
                f"incident signal {label} has no energy at {f:g} Hz: its line there is {below} dB "
                f"of the strongest (limit -60 dB); ask for other frequencies or send more there"
            )
