r"""DIR-TDIBC of one station of bursts: cut into overlapping segments, which are read side by side like probes.

R of a segment is the mean of R(f, |v|) over its emission times, weighted as its window is. Under a Hann window on the
reflected signal, which is the paper's, the line at f of the reply to e^{j omega t} is exactly
:math:`\sum_q c_q \sum_k e^{2\pi j q k/N} R(f - q f_s/N, |v_k|)` with :math:`c_0 = 1/2, c_{\pm 1} = -1/4`; where each
whole period weighs alike it is the plain mean.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.bursts.arrivals import GridSignal, corrected_coherent_part, onto_grid, tone_attenuation
from torchliner.bursts.stations import Station
from torchliner.checks import SAME_FREQUENCY, frequency_tensor, make_plain, require_choice, require_positive
from torchliner.engine.blocks import Blocks
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes, interpolation_error
from torchliner.liners.model import LinerModel, reflection_of
from torchliner.liners.plates import goodrich_of
from torchliner.names import CORRECTIONS, FLAGGED, GRID_METHODS, STATION_WINDOWS, __version__
from torchliner.pressure.spectra import tone_amplitudes, window_weights
from torchliner.records import BurstRecord, ImpedanceLine, VelocityPlane
from torchliner.velocity.averages import PHASE_RULES
from torchliner.velocity.choices import TOLERANCES, Choices
from torchliner.velocity.reading import reading_of, take_moments
from torchliner.velocity.review import fallen_back

NAMED = {"method": GRID_METHODS, "correction": CORRECTIONS, "window": STATION_WINDOWS, "flagged": FLAGGED}
# What a single place has, of choices for planes.
OF_PLANES = {"averaging": "admittance", "background": None, "missing": "refuse", "wall_filter": None}
MOST_SEGMENTS, MOST_DRAWS = 5000, 100_000
STATED = ("frequency", "fluid", "incident_level", "mach", "source_side", "liner", "displacement_thickness", "name")
CASE = ("fluid", "mach", "incident_level", "source_side", "reference")  # one for a whole line
WINDOWS = {"whole-periods": ("boxcar", {0: 1.0}), "hann": ("hann", {0: 0.5, 1: -0.25, -1: -0.25})}  # c_q by q


@dataclass(frozen=True)
class StationChoices:
    """From bursts to segments and from segments to averages; those of the eduction itself are a plane's.

    Args:
        method: of the reconstruction between arrivals: ``linear`` (the paper), ``hold`` or ``band-limited``.
        grid_rate: Hz; default twice the mean rate, with a tone at least 16 whole steps a period.
        band_limit: of ``band-limited``, Hz; default a quarter of the station's mean rate.
        correction: ``tone`` puts back what the reconstruction took from the line of the stated tone, else of a single
            frequency asked for; ``none`` does not (the paper).
        segment: length of a segment, s (the paper: 1).
        overlap: share of a segment that the next one covers too (the paper: 0.5).
        window: of a segment: ``whole-periods``, each of which weighs alike, or ``hann`` on the reflected signal (the
            paper).
        flagged: stations with doubtful bursts: ``exclude`` from the averages or ``use`` them.
        monte_carlo: draws of (5.2) (the paper: 5000).
        without: filters of bursts that are switched off, of ``validate_bursts``.
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
    without: Sequence[str] = ()

    def __post_init__(self) -> None:
        make_plain(self)
        for name, known in NAMED.items():
            require_choice(name, getattr(self, name), known)
        require_positive("segment (s)", self.segment)
        if not 0 <= self.overlap < 1:
            raise ValueError(f"overlap is {self.overlap:g}; it is a share of a segment, 0 to below 1")
        if not 2 <= self.monte_carlo <= MOST_DRAWS:
            raise ValueError(f"monte_carlo is {self.monte_carlo}; it is 2 to {MOST_DRAWS} draws")


def split_choices(options: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Those of stations, and those of the eduction; ValueError for a choice that is for planes of many probes."""
    names = options.keys() & StationChoices.__dataclass_fields__.keys()
    own = StationChoices(**{name: options[name] for name in names})
    chosen = Choices(**OF_PLANES | {name: options[name] for name in options.keys() - names})
    for name, only in OF_PLANES.items():
        if getattr(chosen, name) != only:
            raise ValueError(f"{name} is {getattr(chosen, name)!r}; it is for planes of many probes: leave {name} out")
    if chosen.phase == "given":
        raise ValueError("phase is 'given'; stations share no clock: take 'averaged' or 'self-consistent'")
    return own, chosen


def educe_station(
    record: BurstRecord, liner: LinerModel, frequency: Any, own: StationChoices, choices: Choices
) -> ImpedanceLine:
    """One station, as read, which depends on no other: a line of N = 1 without average and intervals.

    ``own`` are from bursts to segments, ``choices`` of the eduction; see ``educe_bursts``.
    """
    liner, station = liner.in_flow(record.mach), Station.of(record, own.without)
    wanted = frequency_tensor(frequency, record=record).cpu()
    signal, attenuation, corrected = resample(station.kept, wanted, own)
    length = round(own.segment * signal.rate)
    hop, samples = max(1, int((1 - own.overlap) * length + 1e-9)), len(signal.values)
    count, gap = 1 + (samples - length) // hop, station.moments.longest_gap
    if not 2 <= count <= MOST_SEGMENTS or gap > own.segment:
        raise ValueError(
            f"{record.name}: {station.kept.bursts} bursts over {samples / signal.rate:.4g} s, with a gap of {gap:.4g} "
            f"s, hold {count} segments of {own.segment:g} s that overlap by {own.overlap:g}; 2 "
            f"to {MOST_SEGMENTS} longer than any gap are needed. Change segment and overlap, or cut the record"
        )
    plane = VelocityPlane(
        signal.values.unfold(0, length, hop),
        sampling_rate=signal.rate,
        height=record.y if record.y is not None and record.y > 0 else None,
        **{key: getattr(record, key) for key in STATED},
    )
    start = signal.start + hop * torch.arange(count, dtype=torch.float64) / signal.rate
    a, b, velocity, known, model_error = segment_means(plane, liner, wanted, choices, own.window)
    coherence, turns = known.survey.coherence(wanted).cpu(), torch.exp(-2j * torch.pi * torch.outer(start, wanted))
    held = (coherence >= choices.minimum_coherence) | (not choices.hears_tone)
    reviewed = (*known.notes, *fallen_back(held, choices))
    vertical = station.moments.components["wall_normal"]
    numbers = {axis: math.nan if (value := getattr(record, axis)) is None else float(value) for axis in "xyz"}
    numbers |= {"mean_velocity": vertical.weighted_mean, "velocity_rms": vertical.weighted_rms}
    numbers |= {"rate": signal.mean_rate, "grid_rate": signal.rate, "longest_gap": gap}
    tensors: dict[str, Any] = {
        "reflection": torch.where(held, PHASE_RULES[choices.phase](a, b, velocity=velocity), a),
        "segment_start": start,
        "velocity_amplitude": 2 * (velocity * turns).mean(0),
        "coherence": coherence.mean(0),
        "attenuation": attenuation,
        "corrected": corrected,
        "received": torch.tensor(record.received),
        "bursts": torch.tensor(station.kept.bursts),
        "used": torch.tensor(not station.flags or own.flagged == "use"),
        **{key: torch.tensor(value, dtype=torch.float64) for key, value in numbers.items()},
    }
    return ImpedanceLine(
        frequency=wanted,
        interval=None,
        names=(station.name,),
        flags=(station.flags,),
        dropped=(dict(station.kept.dropped),),
        station_notes=((*station.kept.notes, *(note.text for note in reviewed)),),
        goodrich=goodrich_of(plane, liner, wanted),
        choices={
            "version": __version__,
            **choices.describe(),
            "liner": liner.describe(),
            "tone": record.frequency,
            "surface": record.liner,
            "blocks": known.survey.blocks.count,
            "nodes": None if known.nodes is None else vars(known.nodes),
            "model_error": model_error,
            **asdict(own),
        },
        **{key: value[None] for key, value in tensors.items()},
        **{key: getattr(record, key) for key in CASE},
    )


def resample(record: BurstRecord, frequency: Tensor, choices: StationChoices) -> tuple[GridSignal, Tensor, Tensor]:
    """Validated bursts onto a grid, the tone corrected; its attenuation over the whole record and where it was
    corrected, (F,).

    The stated tone is corrected whatever is asked for, since it drives |v| at all frequencies. Without a stated tone a
    single frequency asked for is one.
    """
    name, tone = record.name, record.frequency
    if record.wall_normal is None:
        raise ValueError(f"{name} holds no wall-normal velocity; say which channel it is, components=-wall_normal")
    about: dict[str, Any] = {"frequency": tone or float(frequency.max()), "band": choices.band_limit, "name": name}
    signal = onto_grid(record.arrival_time, record.wall_normal, choices.grid_rate, choices.method, **about)
    tone = None if choices.correction == "none" else tone or (float(frequency) if len(frequency) == 1 else None)
    corrected, damping = (
        (frequency / (tone or torch.inf) - 1).abs() < SAME_FREQUENCY,
        tone_attenuation(signal, frequency),
    )
    if tone is not None:
        alone = damping if corrected.tolist() == [True] else tone_attenuation(signal, tone)
        signal = corrected_coherent_part(signal, alone)
    return signal, damping.factor, corrected


def segment_means(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, choices: Choices, window: str
) -> tuple[Tensor, Tensor, Tensor, Moments, float]:
    """What segments, (S, n), read as ``educe`` reads a plane under a window, leave for a phase rule.

    Returns:
        <R>, <R e^{-2 j omega t}> and half the complex peak amplitude of v into the liner, m/s, (S, F); the moments, a
        probe a segment; the error in R of the interpolation over |v|.
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
    velocity = -tone_amplitudes(plane.load().velocity, frequency, rate, weights)
    if known.nodes is None:  # drive rms: one speed for the whole segment
        square = known.survey.mean_square - (known.survey.mean**2 if choices.mean == "removed" else 0)
        a = reflection_of(liner, frequency[:, None], square.clamp(min=0).sqrt().cpu()).T
        return a, torch.zeros_like(a), velocity, known, error
    values = reflection_of(liner, read.reshape(-1, 1), nodes.speeds)
    c = nodes.coefficients(values).unflatten(0, read.shape)  # (F, Q, K)
    cosine, sine = known.sums["admittance"].sum(0).cpu()[1:].unflatten(0, (2, -1))
    waves = torch.complex(cosine, -sine)  # sums of T_k e^{-j g t}, (Q + F Q, K, S)
    forth, back = waves[: len(shifts)].conj(), waves[len(shifts) :].unflatten(0, read.shape)
    zero = shares[0] * end
    whole = Blocks((0, end), rate, 1).wave_sums(turns[len(shifts) :])[0]
    twice = (shares * whole.unflatten(0, read.shape)).sum(1)
    a = torch.einsum("q,fqk,qks->sf", shares.to(c), c, forth) / zero
    b = torch.einsum("q,fqk,fqks->sf", shares.to(c), c, back) / zero - twice / zero * a
    return a, b, velocity, known, interpolation_error(nodes, liner, frequency, known.top_speed(liner))[0]
