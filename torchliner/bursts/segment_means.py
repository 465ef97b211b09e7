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

from torchliner.engine.blocks import geometric
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes, interpolation_error, response
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.signals.tones import tone_amplitudes
from torchliner.signals.windows import make_window
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of, take_moments
from torchliner.velocity.review import texts

WINDOWS = {"whole-periods": {0: 1.0}, "hann": {0: 0.5, 1: -0.25, -1: -0.25}}  # c_q by q


@dataclass(frozen=True, eq=False)
class SegmentMeans:
    """What the segments of a station leave for a phase rule.

    Args:
        a, b: <R> and <R e^{-2 j omega t}>, complex128, (S, F).
        velocity: half the complex peak amplitude of v into the liner, m/s, (S, F).
        coherence: squared, of v with a steady tone over the blocks of a segment, (S, F).
        weights: of the samples of a segment, (n,).
        moments: of the segments as probes.
        model_error: of the model table, in R.
    """

    a: Tensor
    b: Tensor
    velocity: Tensor
    coherence: Tensor
    weights: Tensor
    moments: Moments
    model_error: float

    @property
    def blocks(self) -> int:
        """Of a segment."""
        return self.moments.survey.blocks.count

    @property
    def notes(self) -> list[str]:
        """Warnings of the reading."""
        return texts(self.moments.notes)


def segment_means(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, choices: Choices, window: str
) -> SegmentMeans:
    """Read the segments of a station as ``educe`` reads a plane, under a window.

    Args:
        plane: a probe a segment, (S, n).
        liner: whose R.  frequency: Hz, (F,).  choices: of the eduction.
        window: ``whole-periods`` or ``hann``.
    """
    rate, samples, whole = plane.sampling_rate, plane.samples, window == "whole-periods"
    orders, step = WINDOWS[window], 0.0 if whole else rate / samples
    shifts = step * torch.tensor(list(orders), dtype=torch.float64)
    read = frequency[:, None] - shifts  # Hz, (F, Q)
    nodes = choose_nodes([liner], read.flatten(), choices.tolerance(plane.velocity.dtype))
    reading = reading_of(plane, [liner], frequency, dataclasses.replace(choices, interval=None), nodes=nodes)
    if not whole:
        blocks = dataclasses.replace(reading.blocks, borders=(*reading.blocks.borders[:-1], samples))
        reading = dataclasses.replace(reading, blocks=blocks)
    # Waves e^{+j shift t}, and then e^{-j (2 f - shift) t}.
    known = take_moments(
        dataclasses.replace(reading, turns=torch.cat([shifts, (2 * frequency[:, None] - shifts).flatten()]))
    )
    seen, end = known.survey, known.survey.blocks.borders[-1]
    weights = make_window("boxcar" if whole else "hann", end).weights
    weights = torch.nn.functional.pad(weights, (0, samples - end))
    if known.nodes is None:
        square = seen.mean_square - (seen.mean**2 if choices.mean == "removed" else 0)
        a = response(liner, frequency, square.clamp(min=0).sqrt().cpu()).T
        b, error = torch.zeros_like(a), 0.0
    else:
        shares = torch.tensor(list(orders.values()), dtype=torch.float64)
        c = nodes.coefficients(response(liner, read.flatten(), nodes.speeds)).unflatten(0, read.shape)  # (F, Q, K)
        a, b = _lines(known.sums["admittance"].sum(0).cpu(), c * shares[:, None])
        zero = orders[0] * end
        twice = sum(share * geometric(2 * frequency - q * step, rate, 0, end) for q, share in orders.items())
        a = a / zero
        b = (b - twice * a) / zero
        error = interpolation_error(nodes, liner, frequency, known.top_speed(liner))[0]
    velocity = -tone_amplitudes(plane.load().velocity, frequency, rate, weights)
    return SegmentMeans(a, b, velocity, seen.coherence(frequency).cpu(), weights, known, error)


def _lines(total: Tensor, c: Tensor) -> tuple[Tensor, Tensor]:
    """Lines at f of the replies to e^{j omega t} and e^{-j omega t}, (S, F), from sums (1 + 2 Q (1 + F), K, S)."""
    frequencies, orders, _ = c.shape
    cosine, sine = total[1:].unflatten(0, (2, -1))
    waves = torch.complex(cosine, -sine)  # sums of T_k e^{-j g t}
    forward = torch.einsum("fqk,qks->sf", c, waves[:orders].conj())
    backward = torch.einsum("fqk,fqks->sf", c, waves[orders:].unflatten(0, (frequencies, orders)))
    return forward, backward
