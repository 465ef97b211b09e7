"""DIR-TDIBC as printed: the signal that each probe reflects is formed, and R(f) is its spectrum over the wave's."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.engine.blocks import SLAB
from torchliner.engine.intervals import FEWEST_BLOCKS, remaining
from torchliner.engine.kernels import build_kernels
from torchliner.engine.replay import Replay, Transfer, transfer
from torchliner.io.reflected_file import reflected_file
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.incident import ComplexTones, as_incident
from torchliner.velocity import replay_checks, review
from torchliner.velocity.answer import facts_of, map_of, origin_facts
from torchliner.velocity.averages import Asked, Averages, Reflection, averages_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress, Reading, take_moments

AVERAGED = ("admittance", "velocity")
MOST_TONES = 3  # frequencies at which v is measured, too; of more that of the data


def replay(
    plane: VelocityPlane,
    liner: Liner,
    incident: Any,
    frequency: Any = None,
    *,
    kernel: str = "two-sided",
    levels: int = 200,
    spacing: str = "sqrt",
    interpolation: str = "cubic",
    velocity_max: float | None = None,
    window: str | None = None,
    segment: float | None = None,
    averaging: str = "admittance",
    mean: str = "kept",
    interval: float | None = 0.95,
    missing: str = "refuse",
    reflected: str | Path | None = None,
    progress: Progress | None = None,
    device: str | torch.device | None = None,
    dtype: str | torch.dtype | None = None,
) -> ImpedanceMap:
    """Impedance map from the reflected signal of any incident wave, formed sample by sample: eq. (3.2).

    ``educe`` gives Z under a tone at once, from the model itself. This is for other waves, for the signal, and for
    the paper to the letter, which is one call (200 uniform levels, causal kernels, Hann window, silence before)::

        tl.replay(plane, liner, 1400.0, kernel="causal", levels=200, spacing="uniform", interpolation="linear",
                  window="hann")

    Args:
        plane: (..., T) m/s. Its gradients, and those of the liner, pass to R with ``interval=None``.
        liner: as of ``educe``.
        incident: wave such as ``tl.BandNoise(300, 6000)``, its text ``"noise:300:6000"``, or frequencies, Hz: complex
            tones, each by itself, so that the phase is ``averaged``.
        frequency: Hz; default the tones, else the lines of the segments in the band of the wave, thinned to 200.
        kernel: ``two-sided``, or ``causal`` (the paper), which loses up to a third of the resistance.
        levels: of |v| in the table of kernels.
        spacing: of the levels, uniform in the root of |v| (``sqrt``) or in |v| (``uniform``, the paper).
        interpolation: between levels, ``cubic`` or ``linear`` (the paper).
        velocity_max: highest level, m/s; default the largest |v| of the record, rounded up.
        window: ``hann`` or ``boxcar``; default ``hann`` for tones and for segments.
        segment: s, of segments that overlap by half; default the whole record as one.
        averaging: ``admittance`` (the paper) or ``velocity``; the map holds both.
        mean, missing, device, dtype: as of ``educe``.
        interval: level, from four segments on; see ``engine.intervals``.
        reflected: file for the reflected signal of every probe, .h5 or .nc.
        progress: called with numbers of samples replayed.
    Raises:
        ValueError: data or options that cannot give an answer; the message says what would.
        TypeError: no plane, such as moments.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), eqs (3.1)-(3.5); R = sum Y X* / sum |X|^2 over segments (H1). Departures: taps before
        zero, levels uniform in the root of |v| and cubics are the default.

    >>> plane = tl.VelocityPlane(torch.full((2, 900), 5.0), sampling_rate=42e3)  # m/s, two probes
    >>> found = tl.replay(plane, tl.load_liner("polito"), "noise:700:2100", 1400.0)
    >>> f"{complex(found.answer[0]):.2f}"  # |v| never changes: the model's own value
    '4.62-0.65j'
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; a signal needs each sample: give the VelocityPlane")
    require_choice("averaging", averaging, AVERAGED)
    model, wave = as_liner(liner).in_flow(plane.mach), as_incident(incident, ComplexTones)
    rate, samples = plane.sampling_rate, plane.samples
    length = samples if segment is None else replay_checks.segment_length(segment, plane)
    how: dict[str, Any] = {
        "segment": None if segment is None else length,
        "window": window or (wave.window if segment is None else "hann"),
    }
    sent, asked = wave.sampled(samples, rate), replay_checks.lines_of(wave, frequency, plane, length)
    band = replay_checks.kernel_band(wave, asked, model, rate)
    if reflected is not None and sent.is_complex():
        raise ValueError("reflected: complex tones have no one signal; take incident=tl.Tones(...)")
    options: dict[str, Any] = {"averaging": averaging, "mean": mean, "interval": interval, "missing": missing}
    chosen = Choices(**options, device=device, dtype=dtype, allow_short=True)
    notes = [*review.review_record(plane, asked), *review.review_liner(plane, model)]

    tones = asked if len(asked) <= MOST_TONES else asked.new_tensor([plane.frequency or float(asked[0])])
    reading = Reading.of(plane, chosen, tones, None, model.cell_pitch)
    with torch.no_grad():
        known = take_moments(reading)
    reading, members, still = reading.without(~known.used), known.membership, known.survey.mean * (mean == "removed")

    def drive(v: Tensor, begin: int) -> Tensor:
        """Probes, then the mean velocity of each cell, (t, P + C)."""
        v = v - still.to(v)
        return torch.cat([v, members.mean(v)], 1)

    limit = replay_checks.velocity_limit(velocity_max, known, reading, still, model)
    table: dict[str, Any] = {"levels": levels, "spacing": spacing, "interpolation": interpolation}
    kernels = build_kernels(model, rate, velocity_max=limit, kind=kernel, band=band, **table)
    speed = float(known.survey.mean_square.median().sqrt())
    error = replay_checks.still_error(kernels, wave, asked, speed, samples, how)
    facts = {
        **facts_of(known, model, chosen, kernels.error),
        **table,
        "kernel": kernel,
        "velocity_max": limit,
        "kernel_error": kernels.error,
        "kernel_gain": kernels.gain,
        "level_error": kernels.level_error,
        "band": list(kernels.band),
        "incident": wave.label,
        "edge": wave.edge,
        "window": how["window"],
        "segment": segment,
        "phase": "averaged" if sent.is_complex() else "signal",
        "signal_error": error,
        "level_check": "not checked by replay",
        **origin_facts(plane, model, None, None),
    }
    with nullcontext() if reflected is None else reflected_file(reflected, plane, sent, known.used, facts) as store:
        signal = Replay(reading.record(progress), kernels, wave, drive, store=store)
        found = transfer(signal, wave, asked, rate, **how)
        rest = samples - samples % (length if segment is None else length // 2)  # behind the last segment
        if store and rest < samples:
            for _ in signal.slabs([(low, min(low + SLAB, samples)) for low in range(rest, samples, SLAB)]):
                pass
    count = facts["blocks"] = len(found.incident)
    lengths, about = torch.ones(count, device=reading.device).double(), Asked(model, asked, torch.empty(0), chosen)
    parts = _replicates(found, interval).split([plane.probes, known.cells.count], 1)
    held = torch.ones(plane.probes, len(asked), dtype=torch.bool, device=reading.device)
    averages: dict[str, Averages] = {
        name: averages_of(known, about, name, lengths, _columns_of(part), held[: part.shape[1]])
        for name, part in zip(AVERAGED, parts, strict=True)
    }
    notes += known.notes
    notes += replay_checks.review_replay(kernels, wave, sent, error, averages[averaging].liner)
    if segment is not None and interval is not None:
        notes += replay_checks.review_segments(count, segment, averages[averaging].liner)
    tell([note.text for note in notes])
    return map_of(known, model, asked, averages, averaging, phase_rule=held, choices=facts, notes=tuple(notes))


def _columns_of(values: Tensor) -> Reflection:
    return lambda part: values[:, part]


def _replicates(found: Transfer, interval: float | None) -> Tensor:
    """R from all segments and, if there are intervals, without each of them, (B, N, F)."""
    x, whole = found.incident[:, None], found.reflection[None]
    if interval is None or len(x) < FEWEST_BLOCKS:
        return whole
    cross, power = found.reflected * x.conj(), x.abs().square()
    left = remaining(power)[1:].clamp(min=1e-12 * power.sum(0))
    return torch.cat([whole, remaining(cross)[1:] / left])
