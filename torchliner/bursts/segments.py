r"""A station cut into overlapping segments side by side like probes, and R of every segment.

R of a segment is the mean of R(f, |v|) over its emission times, weighted as its window is. Under a Hann window on the
reflected signal, which is the paper's, the line at f of the reply to e^{j omega t} is exactly
:math:`\sum_q c_q \sum_k e^{2\pi j q k/N} R(f - q f_s/N, |v_k|)` with :math:`c_0 = 1/2, c_{\pm 1} = -1/4`; where each
whole period weighs alike it is the plain mean.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.bursts.arrivals import ArrivalGrid, GridSignal, checked_bursts
from torchliner.bursts.choices import StationChoices
from torchliner.bursts.tone_damping import corrected_coherent_part, tone_attenuation
from torchliner.checks import SAME_FREQUENCY
from torchliner.engine.blocks import geometric
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes, interpolation_error, response
from torchliner.liners.model import LinerModel
from torchliner.records import BurstRecord, ReferenceChannel, VelocityPlane
from torchliner.tones import tone_amplitudes, transfer_function, window_weights
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of, take_moments

MOST_SEGMENTS = 5000
STATED = ("frequency", "fluid", "incident_level", "mach", "source_side", "liner", "displacement_thickness", "name")
DAMPED = 0.95  # warned of below
WINDOWS = {"whole-periods": ("boxcar", {0: 1.0}), "hann": ("hann", {0: 0.5, 1: -0.25, -1: -0.25})}  # c_q by q
COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference
FEWEST_PIECES = 8  # of a record, over which coherence is found


@dataclass(frozen=True, eq=False)
class Segments:
    """A station cut into S overlapping segments.

    Args:
        plane: a probe a segment, (S, n): a view of ``signal``.
        signal: the station on its grid, the tone corrected if that was asked for.
        start: of each segment on the clock of the arrivals, s, (S,).  hop: samples from one segment to the next.
        attenuation: factor on a tone over the whole record, complex128, (F,).
        corrected: frequencies whose tone was corrected, bool, (F,).  notes: warnings.
    """

    plane: VelocityPlane
    signal: GridSignal
    start: Tensor
    hop: int
    attenuation: Tensor
    corrected: Tensor
    notes: tuple[str, ...]


def cut_into_segments(record: BurstRecord, frequency: Tensor, choices: StationChoices) -> Segments:
    """Validated bursts onto a grid, the tone corrected, cut into segments.

    The stated tone is corrected whatever is asked for, since it drives |v| at all frequencies. Without a stated tone a
    single frequency asked for is one.

    Raises:
        ValueError: no wall-normal velocity, a record shorter than two segments, a gap longer than a segment, fewer than
            two arrivals a period, a tone damped below 0.3.
    """
    name, tone = record.name, record.frequency
    if record.wall_normal is None:
        raise ValueError(
            f"{name} holds no wall-normal velocity, only streamwise; say which channel measures it, e.g. components = "
            "-wall_normal"
        )
    times, values = checked_bursts(record.arrival_time, record.wall_normal, name)
    asked = tone or float(frequency.max())
    grid = ArrivalGrid.of(times, choices.grid_rate, choices.method, asked, choices.band_limit, name)
    length = round(choices.segment * grid.rate)
    hop = max(1, int((1 - choices.overlap) * length + 1e-9))
    count, (gap, begin) = 1 + (grid.samples - length) // hop, grid.longest_gap
    if not 2 <= count <= MOST_SEGMENTS:
        remedy = "Measure longer, or shorten the segment" if count < 2 else "Lower the overlap, or lengthen the segment"
        raise ValueError(
            f"{name}: {len(times)} bursts over {grid.seconds:.4g} s hold {count} segments of {choices.segment:g} s "
            f"with an overlap of {choices.overlap:g}; 2 to {MOST_SEGMENTS} are possible. {remedy}"
        )
    if gap > choices.segment:
        raise ValueError(
            f"{name}: no burst for {gap:.4g} s from {begin:.6g} s on, longer than a segment of {choices.segment:g} s, "
            "which would be made up; cut the record there"
        )
    signal, notes = GridSignal(grid(values), grid), tuple[str, ...]()
    tone = None if choices.correction == "none" else tone or (float(frequency) if len(frequency) == 1 else None)
    corrected = (frequency / (tone or torch.inf) - 1).abs() < SAME_FREQUENCY
    unasked = tone is not None and not bool(corrected.any())
    damping = tone_attenuation(signal, [*frequency.tolist(), tone] if unasked else frequency)
    if tone is not None:
        place = slice(-1, None) if unasked else corrected
        own = {key: getattr(damping, key)[place] for key in ("factor", "image", "frequency")}
        left = float(own["factor"].abs())
        if unasked and left < DAMPED:
            text = f"the stated tone of {tone:g} Hz, of which {grid.method} reconstruction leaves {left:.3f}, is"
            notes = (f"{text} corrected: it drives |v| at all frequencies",)
        alone = dataclasses.replace(damping, **own)
        signal = corrected_coherent_part(signal, alone, noise=choices.correction == "tone-and-noise")
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=grid.rate,
        height=record.y if record.y is not None and record.y > 0 else None,
        **{key: getattr(record, key) for key in STATED},
    )
    start = grid.start + hop * torch.arange(count, dtype=torch.float64) / grid.rate
    return Segments(plane, signal, start, hop, damping.factor[: len(frequency)], corrected, notes)


@dataclass(frozen=True, eq=False)
class SegmentMeans:
    """What the segments of a station leave for a phase rule.

    Args:
        a, b: <R> and <R e^{-2 j omega t}>, complex128, (S, F).
        velocity: half the complex peak amplitude of v into the liner, m/s, (S, F).
        weights: of the samples of a segment, (n,).  moments: of the segments as probes.
        model_error: of the model table, in R.
    """

    a: Tensor
    b: Tensor
    velocity: Tensor
    weights: Tensor
    moments: Moments
    model_error: float


def segment_means(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, choices: Choices, window: str
) -> SegmentMeans:
    """Read segments, a probe each, (S, n), as ``educe`` reads a plane, under a window; ``frequency`` in Hz, (F,)."""
    rate, samples, (kind, orders) = plane.sampling_rate, plane.samples, WINDOWS[window]
    shifts = rate / samples * torch.tensor(list(orders), dtype=torch.float64)  # Hz, (Q,)
    shares = torch.tensor(list(orders.values()), dtype=torch.float64)
    read = frequency[:, None] - shifts  # Hz, (F, Q)
    nodes = choose_nodes([liner], read.flatten(), choices.tolerance(plane.velocity.dtype))
    reading = reading_of(plane, [liner], frequency, dataclasses.replace(choices, interval=None), nodes=nodes)
    blocks = reading.blocks
    if window == "hann":  # over all samples, whole periods or not
        blocks = dataclasses.replace(blocks, borders=(*blocks.borders[:-1], samples))
    # Waves e^{+j shift t}, and then e^{-j (2 f - shift) t}.
    turns = torch.cat([shifts, (2 * frequency[:, None] - shifts).flatten()])
    known = take_moments(dataclasses.replace(reading, blocks=blocks, turns=turns))
    end, error = blocks.borders[-1], 0.0
    weights = torch.nn.functional.pad(window_weights(kind, end), (0, samples - end))
    if known.nodes is None:  # drive rms: one speed for the whole segment
        square = known.survey.mean_square - (known.survey.mean**2 if choices.mean == "removed" else 0)
        a = response(liner, frequency, square.clamp(min=0).sqrt().cpu()).T
        b = torch.zeros_like(a)
    else:
        c = nodes.coefficients(response(liner, read.flatten(), nodes.speeds)).unflatten(0, read.shape)  # (F, Q, K)
        cosine, sine = known.sums["admittance"].sum(0).cpu()[1:].unflatten(0, (2, -1))
        waves = torch.complex(cosine, -sine)  # sums of T_k e^{-j g t}, (Q + F Q, K, S)
        forth, back = waves[: len(shifts)].conj(), waves[len(shifts) :].unflatten(0, read.shape)
        zero = shares[0] * end
        twice = (shares * torch.stack([geometric(2 * frequency - shift, rate, 0, end) for shift in shifts], 1)).sum(1)
        a = torch.einsum("q,fqk,qks->sf", shares.to(c), c, forth) / zero
        b = torch.einsum("q,fqk,fqks->sf", shares.to(c), c, back) / zero - twice / zero * a
        error = interpolation_error(nodes, liner, frequency, known.top_speed(liner))[0]
    velocity = -tone_amplitudes(plane.load().velocity, frequency, rate, weights)
    return SegmentMeans(a, b, velocity, weights, known, error)


def follow_reference(
    cut: Segments, reference: ReferenceChannel, frequency: Tensor, known: SegmentMeans
) -> tuple[Tensor, Tensor, Tensor]:
    """The tone of a reference channel on the clock of the arrivals in the segments, and what of v follows it.

    Coherence is found over pieces as long as the blocks of ``known``.

    Returns:
        Phase of the reference at each segment's first sample, rad, and half the complex peak amplitude of the v into
        the liner that follows it, (S, F); squared coherence of the two, (F,), 0 where the reference is 0 throughout.
    Raises:
        ValueError: the channel does not cover the station, or has fewer than 8 samples a period.
    """
    grid, highest, tone = cut.signal.grid, float(frequency.max()), cut.plane.frequency
    if reference.sampling_rate < COARSE * highest:
        raise ValueError(
            f"{reference.name} is sampled at {reference.sampling_rate:g} Hz, less than {COARSE:g} times a period of "
            f"{highest:g} Hz; its phase between the samples would be wrong"
        )
    block = cut.plane.duration / known.moments.survey.blocks.count
    values, found = reference.at(grid.times), []
    for f in frequency.tolist():
        piece, apart = block, 0.0 if tone is None else abs(f - tone * max(1, round(f / tone)))
        if apart >= SAME_FREQUENCY * f:
            # A harmonic of the tone is in both channels, and would count as coherent: it has to lie two bins away, at
            # the zero of Hann's window.
            piece = max(block, min(2 / apart, grid.samples / grid.rate / FEWEST_PIECES))
        at = torch.tensor([f], dtype=torch.float64)
        found.append(transfer_function(values, cut.signal.values, at, grid.rate, segment=piece))
    amplitude = tone_amplitudes(values.unfold(0, cut.plane.samples, cut.hop), frequency, grid.rate, known.weights)
    coherence = torch.nan_to_num(torch.cat([each.coherence for each in found]), nan=0.0)
    return amplitude.angle(), -torch.cat([each.response for each in found]) * amplitude, coherence
