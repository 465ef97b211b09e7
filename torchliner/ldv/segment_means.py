r"""R of every segment of a station: the mean of R(f, |v|) over its emission times, weighted as its window is.

Under a Hann window on the reflected signal, which is the paper's, the line at f of the reply to e^{j omega t} is
exactly :math:`\sum_q c_q \sum_k e^{2\pi j q k/N} R(f - q f_s/N, |v_k|)` with :math:`c_0 = 1/2, c_{\pm 1} = -1/4`;
where each whole period weighs alike it is the plain mean.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.engine.blocks import Blocks, geometric
from torchliner.engine.drives import LessMean, RunningRms, as_measured
from torchliner.engine.nodes import Nodes, choose_nodes, interpolation_error, response
from torchliner.engine.phase import PHASE_RULES, Sound
from torchliner.engine.plane_record import PlaneRecord
from torchliner.engine.sums import Job, reduce, wave_rows
from torchliner.engine.survey import Survey, survey_job, survey_of
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.windows import make_window
from torchliner.velocity.choices import Choices

HANN = {0: 0.5, 1: -0.25, -1: -0.25}
WHOLE = {0: 1.0}


@dataclass(frozen=True, eq=False)
class SegmentMeans:
    """What the segments of a station leave for a phase rule.

    Args:
        a, b: <R> and <R e^{-2 j omega t}>, complex128, (S, F).
        velocity: half the complex peak amplitude of v into the liner, m/s, (S, F).
        coherence: squared, of v with a steady tone over the blocks of a segment, (S, F).
        blocks: of a segment.
        nodes, model_error: of the model table; None and 0 with drive ``rms``.
        weights: of the samples of a segment, (n,).
    """

    a: Tensor
    b: Tensor
    velocity: Tensor
    coherence: Tensor
    blocks: int
    nodes: Nodes | None
    model_error: float
    weights: Tensor

    def reflection(self, phase: str, sound: Sound) -> Tensor:
        """R of each segment under a phase rule, (S, F)."""
        return PHASE_RULES[phase](self.a, self.b, sound)


def segment_means(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, choices: Choices, window: str
) -> SegmentMeans:
    """Read the segments of a station once, or once more where the mean is removed.

    Args:
        plane: a probe a segment, (S, n).
        liner: whose R.  frequency: Hz, (F,).  choices: ``drive``, ``mean``, ``running_window``, device and dtype.
        window: ``whole-periods`` or ``hann``.
    """
    rate, samples = plane.sampling_rate, plane.samples
    orders, step = (HANN, rate / samples) if window == "hann" else (WHOLE, 0.0)
    blocks = Blocks.of(samples, rate, plane.frequency or float(frequency.min()))
    if window == "hann":
        blocks = dataclasses.replace(blocks, borders=(*blocks.borders[:-1], samples))
    dtype, device = choices.working_dtype(plane.velocity.dtype), choices.working_device(torch.device("cpu"))
    record = PlaneRecord(plane, dtype, device)
    surveyed = survey_job(as_measured, frequency.to(device), rate)
    shifts = torch.tensor(list(orders), dtype=torch.float64) * step
    # Waves e^{+j shift t}, and then e^{-j (2 f - shift) t}.
    turns = torch.cat([shifts, (2 * frequency[:, None] - shifts).flatten()])
    read = frequency[:, None] - shifts  # Hz, (F, Q)
    nodes = choose_nodes([liner], read.flatten(), choices.tolerance(plane.velocity.dtype))
    rows = wave_rows(turns.to(device), rate)
    instantaneous = choices.drive != "rms"
    jobs = [Job(as_measured, rows, nodes.sums)] if instantaneous and choices.mean == "kept" else []
    jobs = [_running(job, choices.window(frequency), plane) for job in jobs]
    found = reduce(record, blocks, [surveyed, *jobs])
    seen, sums = survey_of(found[0], blocks, frequency, 0), found[1] if jobs else None
    if instantaneous and sums is None:
        again = Job(LessMean(as_measured, seen.mean), rows, nodes.sums)
        (sums,) = reduce(record, blocks, [_running(again, choices.window(frequency), plane)])
    end = blocks.borders[-1]
    own = make_window("hann" if window == "hann" else "boxcar", end).weights
    weights = torch.nn.functional.pad(own, (0, samples - end))
    a, b, error = _of_rms(seen, liner, frequency, choices)
    if sums is not None:
        c = nodes.coefficients(response(liner, read.flatten(), nodes.speeds)).unflatten(0, read.shape)  # (F, Q, K)
        total, ends = sums.sum(0).cpu(), torch.tensor(list(orders.values()), dtype=torch.float64)
        a, b = _lines(total, c * ends[:, None], len(turns), len(frequency))
        zero, twice = _window_sums(frequency, rate, end, orders, step)
        a = a / zero
        b = (b - twice * a) / zero
        top = max(min(float(seen.peak.max()), liner.speed_max or torch.inf), 1e-3)
        error = interpolation_error(nodes, liner, frequency, top)[0]
    velocity = -tone_amplitudes(plane.load().velocity, frequency, rate, weights)
    coherence = seen.coherence(frequency).cpu()
    return SegmentMeans(a, b, velocity, coherence, blocks.count, nodes if sums is not None else None, error, weights)


def _running(job: Job, window: float | None, plane: VelocityPlane) -> Job:
    if window is None:
        return job
    drive = RunningRms(job.drive, max(1, round(window * plane.sampling_rate)), plane.samples)
    return dataclasses.replace(job, drive=drive, reach=drive.reach)


def _of_rms(seen: Survey, liner: LinerModel, frequency: Tensor, choices: Choices) -> tuple[Tensor, Tensor, float]:
    """R at the rms of each segment, which has no 2 f line."""
    square = seen.mean_square - (seen.mean**2 if choices.mean == "removed" else 0)
    a = response(liner, frequency, square.clamp(min=0).sqrt().cpu()).T
    return a, torch.zeros_like(a), 0.0


def _lines(total: Tensor, c: Tensor, turns: int, count: int) -> tuple[Tensor, Tensor]:
    """Lines at f of the replies to e^{j omega t} and e^{-j omega t}, (S, F), from sums (1 + 2 T, K, S)."""
    waves = torch.complex(total[1 : 1 + turns], -total[1 + turns :])  # sums of T_k e^{-j g t}, (T, K, S)
    orders = c.shape[1]
    forward = torch.einsum("fqk,qks->sf", c, waves[:orders].conj())
    backward = torch.einsum("fqk,fqks->sf", c, waves[orders:].unflatten(0, (count, orders)))
    return forward, backward


def _window_sums(
    frequency: Tensor, rate: float, end: int, orders: dict[int, float], step: float
) -> tuple[float, Tensor]:
    """Sums of the window, and of the window times e^{-2 j omega t}, (F,)."""
    twice = sum(share * geometric(2 * frequency - q * step, rate, 0, end) for q, share in orders.items())
    assert isinstance(twice, Tensor)
    return orders[0] * end, twice
