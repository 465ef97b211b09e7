"""DIR-TDIBC as printed: the signal that each probe reflects is formed, and R(f) is its spectrum over the wave's."""

import math
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import frequency_tensor, require_choice, require_positive, tell
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, replicates
from torchliner.engine.kernels import KernelTable, build_kernels, kernel_band
from torchliner.engine.replay import Replay, cross_spectra
from torchliner.engine.sums import PlaneRecord
from torchliner.io.plane_writer import reflected_file
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.educed import Educed
from torchliner.records.incident import ComplexTones, Incident, as_incident
from torchliner.records.notes import Note
from torchliner.velocity.averages import fold
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import facts_of, map_of
from torchliner.velocity.reading import Progress, reading_of, take_moments
from torchliner.velocity.review import review_case

AVERAGED = ("admittance", "velocity")
MOST_LINES = 200  # frequencies, unless more are asked for
SMALLEST = 1e-3  # m/s
LARGEST_ERROR = 1e-3  # in R, of kernels and of the interpolation between levels
LARGEST_GAIN = 10.0  # 1.3 on the default band, 5 up to 5 kHz
LARGEST_SHARE = 1e-3  # of the energy of a recorded wave


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
        interval: confidence level of the error bars, which need four segments.
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
    rate, samples, length = plane.sampling_rate, plane.samples, plane.samples
    if segment is not None:
        require_positive("segment (s)", segment)
        length = 2 * round(segment * rate / 2)
        if not 2 <= length <= samples:
            raise ValueError(f"segment is {segment:g} s, and the record has {plane.duration:.4g} s; shorten it")
    window = window or (wave.window if segment is None else "hann")
    sent, asked = wave.sampled(samples, rate), _lines_of(wave, frequency, plane, length)
    band = kernel_band([*asked.tolist(), *(wave.band or ())], model, rate)
    if reflected is not None and sent.is_complex():
        raise ValueError("reflected: complex tones have no one signal; take incident=tl.Tones(...)")
    options: dict[str, Any] = {"averaging": averaging, "mean": mean, "interval": interval, "missing": missing}
    chosen = Choices(**options, device=device, dtype=dtype, allow_short=True)

    reading = reading_of(plane, [model], asked, chosen, summed=False)
    with torch.no_grad():
        known = take_moments(reading)
    members, still = known.membership, known.survey.mean * (mean == "removed")

    def drive(v: Tensor, begin: int) -> Tensor:
        """Probes, then the mean velocity of each cell, (t, P + C)."""
        v = v - still.to(v)
        return torch.cat([v, members.mean(v)], 1)

    # What follows the last whole period is replayed, too.
    rest = plane.read(min(known.survey.blocks.borders[-1], samples - 1), samples).detach().abs().amax(0)
    peak = torch.maximum(known.survey.peak.cpu(), rest.cpu().double()) + still.abs().cpu()
    limit = _velocity_limit(velocity_max, torch.where(known.used, peak, 0), plane, model)
    table: dict[str, Any] = {"levels": levels, "spacing": spacing, "interpolation": interpolation}
    kernels = build_kernels(model, rate, velocity_max=limit, kind=kernel, band=band, **table)
    facts = facts_of(known, model, chosen, kernels.error) | table
    facts |= {"kernel": kernel, "velocity_max": limit, "band": list(kernels.band)}
    facts |= {"kernel_error": kernels.error, "kernel_gain": kernels.gain, "level_error": kernels.level_error}
    facts |= {"incident": wave.label, "edge": wave.edge, "window": window, "segment": segment}
    facts |= {"phase": "averaged" if sent.is_complex() else "signal", "level_check": "not checked by replay"}
    with nullcontext() if reflected is None else reflected_file(reflected, plane, sent, known.used, facts) as store:
        record = PlaneRecord(plane, reading.dtype, reading.device, known.used, progress)
        signal = Replay(record, kernels, wave, drive, store=store)
        cut = None if segment is None else length
        cross, power = cross_spectra(signal, wave, asked, rate, segment=cut, window=window)
    count = facts["blocks"] = len(power)
    # R from all segments and, if there are intervals, without each of them, (B, N, F).
    bars = interval is not None and count >= FEWEST_BLOCKS
    left, averages = replicates(power, every=bars), {}
    replicated = replicates(cross, every=bars) / left.clamp(min=1e-12 * left[0])
    lengths = torch.ones(count, dtype=torch.float64, device=reading.device)
    for name, each in zip(AVERAGED, replicated.split([plane.probes, known.cells.count], 1), strict=True):
        held = torch.ones(each.shape[1:], dtype=torch.bool, device=reading.device)
        averages[name] = fold(known, name, lengths, lambda at, r=each: r[:, at], held, interval)  # type: ignore[misc]
    chief = averages[averaging].liner
    notes = [*review_case(plane, model, asked), *known.notes, *_review_replay(kernels, wave, sent, chief)]
    runs = 0.0 if chief.interval is None else float(chief.interval.runs.min())
    if segment is not None and interval is not None and runs < FEWEST_RUNS:
        text = f"error bars rest on {runs:.2g} independent runs of segments, fewer than {FEWEST_RUNS}, and are rough"
        notes.append(Note("few-segments", f"{text}: there are {count} segments of {segment:.3g} s; shorten them"))
    tell([note.text for note in notes])
    return map_of(known, model, asked, averages, averaging=averaging, choices=facts, notes=tuple(notes))


def _lines_of(wave: Incident, frequency: Any, plane: VelocityPlane, length: int) -> Tensor:
    """As asked for, or what the wave has in segments of so many samples, Hz, (F,)."""
    rate, spacing = plane.sampling_rate, plane.sampling_rate / length
    if isinstance(wave, ComplexTones):
        asked = frequency_tensor(wave.frequency if frequency is None else frequency, rate).cpu()
        if wave.sampled(1, rate).is_complex() and not torch.equal(asked, wave.frequency):
            raise ValueError("incident and frequency name different tones; name them once")
        return asked
    if frequency is None and wave.band is not None:
        first, last = math.ceil(wave.band[0] / spacing - 1e-9), math.floor(wave.band[1] / spacing + 1e-9)
        return spacing * torch.arange(first, last + 1, max(1, math.ceil((last - first + 1) / MOST_LINES))).double()
    return plane.asked(frequency)


def _velocity_limit(stated: float | None, largest: Tensor, plane: VelocityPlane, liner: LinerModel) -> float:
    """Top of the levels, m/s, from the largest |v| of each probe, (P,), rounded up to a power of the root of 2, so that
    the levels rarely depend on the data."""
    top, known = largest.max().item(), liner.speed_max or math.inf
    place = plane.place(largest.argmax())
    if not math.isfinite(top):
        raise ValueError(f"{plane.name} holds nan or inf at probe {place} behind its last whole period; cut it there")
    rounded = 2.0 ** (math.ceil(2 * math.log2(max(top, SMALLEST))) / 2) * (1 + 1e-9)
    limit, what = (min(rounded, known), "the liner's table") if stated is None else (stated, "velocity_max")
    if top > limit * (1 + 1e-6):
        raise ValueError(
            f"{plane.name} reaches |v| = {top:.4g} m/s at probe {place}, above {what}, {limit:.4g} m/s; extend it to "
            f"at least {top * 1.01:.3g} m/s"
        )
    return limit


def _review_replay(kernels: KernelTable, wave: Incident, sent: Tensor, chief: Educed) -> Iterator[Note]:
    """Warnings; ``sent`` is the wave, ``chief`` the R to quote."""
    low, high = kernels.band
    size = float((1 + chief.impedance.detach()).abs().square().max()) / 2  # of dZ, over that of dR
    if kernels.error > LARGEST_ERROR or kernels.gain > LARGEST_GAIN:
        text = f"the {kernels.kind} kernels are off by up to {kernels.error:.2g} in R within {low:g}-{high:g} Hz "
        text += f"(limit {LARGEST_ERROR:g}) and amplify up to {kernels.gain:.3g} times (limit {LARGEST_GAIN:g}); "
        remedy = "take kernel='two-sided'" if kernels.kind == "causal" else "narrow the wave and the frequencies"
        yield Note("kernel", text + remedy, kernels.error * size)
    if kernels.level_error > LARGEST_ERROR:
        text = f"between {kernels.grid.levels} levels of |v| R is off by up to {kernels.level_error:.2g} (limit "
        yield Note("levels", f"{text}{LARGEST_ERROR:g}); take more levels", kernels.level_error * size)
    if wave.band is None:
        power = torch.fft.rfft(sent).abs().square()
        lines = torch.fft.rfftfreq(len(sent), 1 / kernels.sampling_rate, dtype=torch.float64)
        share = float(power[(lines < low) | (lines > high)].sum() / power.sum())
        if share > LARGEST_SHARE:
            text = f"{100 * share:.2g} % of the energy of {wave.label} lies outside {low:g}-{high:g} Hz, the band of"
            yield Note("signal-band", f"{text} the kernels; filter it")
