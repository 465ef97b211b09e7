r"""DIR-TDIBC of one station of bursts: cut into overlapping segments, which are read side by side like probes.

R of a segment is the mean of R(f, |v|) over its emission times, weighted as its window is. Under a Hann window on the
reflected signal, which is the paper's, the line at f of the reply to e^{j omega t} is exactly
:math:`\sum_q c_q \sum_k e^{2\pi j q k/N} R(f - q f_s/N, |v_k|)` with :math:`c_0 = 1/2, c_{\pm 1} = -1/4`; where each
whole period weighs alike it is the plain mean.
"""

import dataclasses
import math
from dataclasses import asdict, dataclass, field
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.arrivals import GridSignal, corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.bursts.stations import BurstFilters, Station
from torchliner.checks import SAME_FREQUENCY, frequency_tensor, make_plain, require_choice, require_positive
from torchliner.engine.blocks import Blocks
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes, interpolation_error
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.names import CORRECTIONS, FLAGGED, GRID_METHODS, STATION_WINDOWS, __version__
from torchliner.records import BurstRecord, ImpedanceLine, ReferenceChannel, VelocityPlane
from torchliner.tones import tone_amplitudes, transfer_function, window_weights
from torchliner.velocity.answer import goodrich_of
from torchliner.velocity.averages import PHASE_RULES
from torchliner.velocity.choices import TOLERANCES, Choices
from torchliner.velocity.reading import reading_of, take_moments
from torchliner.velocity.review import fallen_back

NAMED = {"method": GRID_METHODS, "correction": CORRECTIONS, "window": STATION_WINDOWS, "flagged": FLAGGED}
OF_PLANES = {"averaging": "admittance", "background": None, "missing": "refuse"}  # what a single place has
MOST_SEGMENTS, MOST_DRAWS = 5000, 1_000_000
STATED = ("frequency", "fluid", "incident_level", "mach", "source_side", "liner", "displacement_thickness", "name")
CASE = ("fluid", "mach", "incident_level", "source_side", "reference")  # one for a whole line
WINDOWS = {"whole-periods": ("boxcar", {0: 1.0}), "hann": ("hann", {0: 0.5, 1: -0.25, -1: -0.25})}  # c_q by q
COARSE = 8.0  # samples a period, below which linear interpolation spoils a reference
FEWEST_PIECES = 8  # of a record, over which coherence is found
NO_TONE = 0.05  # squared coherence with v below which a reference knows no phase


@dataclass(frozen=True)
class StationChoices:
    """From bursts to segments and from segments to averages; those of the eduction itself are a plane's.

    Args:
        method: of the reconstruction between arrivals: ``linear`` (the paper), ``hold`` or ``band-limited``.
        grid_rate: Hz; default twice the mean rate, with a tone at least 16 whole steps a period.
        band_limit: of ``band-limited``, Hz; default a quarter of the station's mean rate.
        correction: what is put back of what the reconstruction took from the stated tone, else from a single frequency
            asked for: ``tone``, its line; ``tone-and-noise``, also the noise made of it is taken out; ``none`` (the
            paper).
        segment: length of a segment, s (the paper: 1).
        overlap: share of a segment that the next one covers too (the paper: 0.5).
        window: of a segment: ``whole-periods``, each of which weighs alike, or ``hann`` on the reflected signal (the
            paper).
        flagged: stations with doubtful bursts: ``exclude`` from the averages or ``use`` them.
        monte_carlo: draws of (5.2) (the paper: 5000).
        filters: which bursts count.
    """

    method: str = "linear"
    grid_rate: float | None = None
    band_limit: float | None = None
    correction: str = "tone"
    segment: float = 1.0
    overlap: float = 0.5
    window: str = "whole-periods"
    flagged: str = "exclude"
    monte_carlo: int = 5000
    filters: BurstFilters = field(default_factory=BurstFilters)

    def __post_init__(self) -> None:
        make_plain(self)
        for name, known in NAMED.items():
            require_choice(name, getattr(self, name), known)
        require_positive("segment (s)", self.segment)
        if self.band_limit is not None and self.method != "band-limited":
            raise ValueError(f"band_limit is for method 'band-limited', not {self.method!r}; leave it out")
        if not 0 <= self.overlap < 1:
            raise ValueError(f"overlap is {self.overlap:g}; it is a share of a segment, 0 to below 1")
        if not 2 <= self.monte_carlo <= MOST_DRAWS:
            raise ValueError(f"monte_carlo is {self.monte_carlo}; it is 2 to {MOST_DRAWS} draws")


def split_choices(options: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Those of stations, and those of the eduction; ValueError for a choice that is for planes of many probes."""
    of_stations = {key: options[key] for key in options.keys() & StationChoices.__dataclass_fields__.keys()}
    rest = OF_PLANES | {key: value for key, value in options.items() if key not in of_stations}
    for name, only in OF_PLANES.items():
        if rest[name] != only:
            raise ValueError(f"{name} is {rest[name]!r}; it is for planes of many probes: leave {name} out")
    return StationChoices(**of_stations), Choices(**rest)


def educe_station(
    record: BurstRecord,
    liner: LinerModel,
    frequency: Any,
    own: StationChoices,
    choices: Choices,
    reference: ReferenceChannel | None = None,
    reference_phase: float | None = None,
) -> ImpedanceLine:
    """One station, as read, which depends on no other: a line of N = 1 without average and intervals.

    ``own`` are from bursts to segments, ``choices`` of the eduction; see ``educe_bursts``.
    """
    liner, station = liner.in_flow(record.mach), Station.of(record, own.filters)
    wanted = frequency_tensor(frequency, record=record).cpu()
    if choices.phase == "given" and reference is None and reference_phase is None:
        raise ValueError("phase='given' needs a reference channel, or reference_phase in rad")
    plane, grid, hop, attenuation, corrected, notes = cut_into_segments(station.kept, wanted, own)
    start = grid.start + hop * torch.arange(plane.probes, dtype=torch.float64) / grid.rate
    a, b, velocity, weights, known, model_error = segment_means(plane, liner, wanted, choices, own.window)
    seen = known.survey
    phases, follows, each = 2 * torch.pi * torch.outer(start, wanted), velocity, seen.coherence(wanted).cpu()
    if reference is not None:
        block = plane.duration / seen.blocks.count
        phases, follows, each = follow_reference(grid, reference, wanted, plane.frequency, block, hop, weights)
    coherence = each if reference is not None else each.mean(0)
    held = ((each >= choices.minimum_coherence) | (choices.phase != "self-consistent")).expand(velocity.shape)
    psi = phases + (reference_phase or 0.0)
    reviewed = (*known.notes, *fallen_back(held, choices))
    notes = [*station.kept.notes, *(note.text for note in reviewed), *notes]
    for f, square in zip(wanted.tolist(), coherence.tolist(), strict=True):
        if reference is not None and square < NO_TONE:
            text = f"the squared coherence of v with the reference is {square:.2g} at {f:g} Hz (limit {NO_TONE:g})"
            notes.append(f"{text}: it tells nothing of the phase of the sound there")
    vertical = station.moments.components["wall_normal"]
    numbers = {axis: math.nan if (value := getattr(record, axis)) is None else float(value) for axis in "xyz"}
    numbers |= {"mean_velocity": vertical.weighted_mean, "velocity_rms": vertical.weighted_rms}
    numbers |= {"rate": grid.mean_rate, "grid_rate": grid.rate, "longest_gap": grid.longest_gap[0]}
    tensors: dict[str, Any] = {
        "reflection": PHASE_RULES[choices.phase](a, b, velocity=follows, held=held, phase=psi),
        "segment_start": start,
        "velocity_amplitude": 2 * (velocity * torch.exp(-1j * phases)).mean(0),
        "coherence": coherence,
        "attenuation": attenuation,
        "corrected": corrected,
        "phase_held": held.to(torch.float64).mean(0),
        "received": torch.tensor(record.received),
        "bursts": torch.tensor(station.kept.bursts),
        "used": torch.tensor(not station.flags or own.flagged == "use"),
        **{key: torch.tensor(value, dtype=torch.float64) for key, value in numbers.items()},
    }
    return ImpedanceLine(
        frequency=wanted,
        wall=None if choices.wall_filter is None else (coherence < choices.wall_filter)[None],
        interval=None,
        names=(station.name,),
        flags=(station.flags,),
        dropped=(dict(station.kept.dropped),),
        station_notes=(tuple(notes),),
        goodrich=goodrich_of(plane, liner, wanted),
        choices={
            "version": __version__,
            **choices.describe(),
            "liner": liner.describe(),
            "tone": record.frequency,
            "surface": record.liner,
            "blocks": seen.blocks.count,
            "referred": reference is not None,
            "nodes": None if known.nodes is None else vars(known.nodes),
            "model_error": model_error,
            **asdict(own),
        },
        **{key: value[None] for key, value in tensors.items()},
        **{key: getattr(record, key) for key in CASE},
    )


def cut_into_segments(
    record: BurstRecord, frequency: Tensor, choices: StationChoices
) -> tuple[VelocityPlane, GridSignal, int, Tensor, Tensor, list[str]]:
    """Validated bursts onto a grid, the tone corrected, cut into segments.

    The stated tone is corrected whatever is asked for, since it drives |v| at all frequencies. Without a stated tone a
    single frequency asked for is one.

    Returns:
        A plane, with a probe a segment; the signal; by how many samples segments are apart; the attenuation of the
        tones over the whole record and where it was corrected, (F,); notes.
    Raises:
        ValueError: no wall-normal velocity, a record shorter than two segments, a gap longer than a segment, fewer than
            two arrivals a period, a tone damped below 0.3.
    """
    name, tone = record.name, record.frequency
    if record.wall_normal is None:
        raise ValueError(f"{name} holds no wall-normal velocity; say which channel it is, components=-wall_normal")
    about: dict[str, Any] = {"frequency": tone or float(frequency.max()), "band": choices.band_limit, "name": name}
    signal = onto_grid(record.arrival_time, record.wall_normal, choices.grid_rate, choices.method, **about)
    length = round(choices.segment * signal.rate)
    hop = max(1, int((1 - choices.overlap) * length + 1e-9))
    count, (gap, begin), notes = 1 + (signal.samples - length) // hop, signal.longest_gap, list[str]()
    if not 2 <= count <= MOST_SEGMENTS:
        raise ValueError(
            f"{name}: {record.bursts} bursts over {signal.samples / signal.rate:.4g} s hold {count} segments of "
            f"{choices.segment:g} s that overlap by {choices.overlap:g}; 2 to {MOST_SEGMENTS} are possible. Change "
            "segment and overlap"
        )
    if gap > choices.segment:
        raise ValueError(
            f"{name}: no burst for {gap:.4g} s from {begin:.6g} s on, longer than a segment of {choices.segment:g} s, "
            "which would be made up; cut the record there"
        )
    tone = None if choices.correction == "none" else tone or (float(frequency) if len(frequency) == 1 else None)
    corrected = (frequency / (tone or torch.inf) - 1).abs() < SAME_FREQUENCY
    damping = tone_attenuation(signal, frequency)
    if tone is not None:
        alone = damping if corrected.tolist() == [True] else tone_attenuation(signal, tone)
        if not bool(corrected.any()):
            text = f"the stated tone of {tone:g} Hz, of which {signal.method} reconstruction leaves "
            notes.append(f"{text}{float(alone.factor.abs()):.3f}, is corrected: it drives |v| at all frequencies")
        signal = corrected_coherent_part(signal, alone, noise=choices.correction == "tone-and-noise")
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=signal.rate,
        height=record.y if record.y is not None and record.y > 0 else None,
        **{key: getattr(record, key) for key in STATED},
    )
    return plane, signal, hop, damping.factor, corrected, notes


def segment_means(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, choices: Choices, window: str
) -> tuple[Tensor, Tensor, Tensor, Tensor, Moments, float]:
    """What segments, (S, n), read as ``educe`` reads a plane under a window, leave for a phase rule.

    Returns:
        <R>, <R e^{-2 j omega t}> and half the complex peak amplitude of v into the liner, m/s, (S, F); the window,
        (n,); the moments, a probe a segment; the error in R of the interpolation over |v|.
    """
    rate, samples, (kind, orders) = plane.sampling_rate, plane.samples, WINDOWS[window]
    shifts = rate / samples * torch.tensor(list(orders), dtype=torch.float64)  # Hz, (Q,)
    shares = torch.tensor(list(orders.values()), dtype=torch.float64)
    read = frequency[:, None] - shifts  # Hz, (F, Q)
    nodes = choose_nodes([liner], read.flatten(), TOLERANCES[choices.working(plane.velocity)[1]])
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
        a = reflection_of(liner, frequency[:, None], square.clamp(min=0).sqrt().cpu()).T
        b = torch.zeros_like(a)
    else:
        c = nodes.coefficients(reflection_of(liner, read.reshape(-1, 1), nodes.speeds)).unflatten(
            0, read.shape
        )  # (F, Q, K)
        cosine, sine = known.sums["admittance"].sum(0).cpu()[1:].unflatten(0, (2, -1))
        waves = torch.complex(cosine, -sine)  # sums of T_k e^{-j g t}, (Q + F Q, K, S)
        forth, back = waves[: len(shifts)].conj(), waves[len(shifts) :].unflatten(0, read.shape)
        zero = shares[0] * end
        whole = Blocks((0, end), rate, 1).wave_sums(turns[len(shifts) :])[0]
        twice = (shares * whole.unflatten(0, read.shape)).sum(1)
        a = torch.einsum("q,fqk,qks->sf", shares.to(c), c, forth) / zero
        b = torch.einsum("q,fqk,fqks->sf", shares.to(c), c, back) / zero - twice / zero * a
        error = interpolation_error(nodes, liner, frequency, known.top_speed(liner))[0]
    velocity = -tone_amplitudes(plane.load().velocity, frequency, rate, weights)
    return a, b, velocity, weights, known, error


def follow_reference(
    grid: GridSignal,
    reference: ReferenceChannel,
    frequency: Tensor,
    tone: float | None,
    block: float,
    hop: int,
    weights: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """What of v follows a reference channel, in segments under a window of weights, (n,), ``hop`` samples apart.

    Returns:
        Phase of the reference at each segment's first sample, rad, and half the complex peak amplitude of the v into
        the liner that follows it, (S, F); squared coherence of the two over pieces of a ``block``, s, (F,), 0 where the
        reference is 0 throughout.
    Raises:
        ValueError: the channel does not cover the station, or has fewer than 8 samples a period.
    """
    highest = float(frequency.max())
    if reference.sampling_rate < COARSE * highest:
        raise ValueError(
            f"{reference.name} is sampled at {reference.sampling_rate:g} Hz, less than {COARSE:g} times a period of "
            f"{highest:g} Hz; its phase between the samples would be wrong"
        )
    values, found = reference.at(grid.times), []
    for f in frequency.tolist():
        piece, apart = block, 0.0 if tone is None else abs(f - tone * max(1, round(f / tone)))
        if apart >= SAME_FREQUENCY * f:
            # A harmonic of the tone is in both channels, and would count as coherent: it has to lie two bins away, at
            # the zero of Hann's window.
            piece = max(block, min(2 / apart, grid.samples / grid.rate / FEWEST_PIECES))
        at = torch.tensor([f], dtype=torch.float64)
        found.append(transfer_function(values, grid.values, at, grid.rate, segment=piece))
    amplitude = tone_amplitudes(values.unfold(0, len(weights), hop), frequency, grid.rate, weights)
    coherence = torch.nan_to_num(torch.cat([each.coherence for each in found]), nan=0.0)
    return amplitude.angle(), -torch.cat([each.response for each in found]) * amplitude, coherence
