"""A wall that a periodic wave alone drives, without a kernel: the model's own response over a whole period at once, or
with |v| at rest at its rms."""

import math

import torch
from scipy.optimize import brentq
from torch import Tensor

from torchliner.conversions import REFERENCE_PRESSURE, impedance_from_reflection
from torchliner.engine.kernels import VelocityGrid, interpolate
from torchliner.fluid import Fluid
from torchliner.liners.model import LinerModel, impedance_of, reflection_of

DAMPINGS = (1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the iteration, until one of them settles
MOST_ITERATIONS = 400  # with each
SETTLED = 1e-12  # change of v in an iteration, of its largest
PLACES = 2001  # speeds between which a fixed point is looked for, closer towards rest
RANK_ERROR = 1e-13  # of the largest singular value of the table of R: fewer transforms


def settle_period(sent: Tensor, response: Tensor, grid: VelocityGrid) -> Tensor:
    """The periodic reply y to one period of a wave, m/s, (n,): y is the sum over emissions of R(f, |v_k|) at the lines
    k fs/n of the period, from R at the levels of the grid, complex, (V, n/2 + 1); x - y(v) = v by damped iteration."""
    left, values, right = torch.linalg.svd(torch.cat([response.real, response.imag], 1), full_matrices=False)
    rank = max(1, int((values > RANK_ERROR * values[0]).sum()))
    across, along = left[:, :rank] * values[:rank], torch.complex(*right[:rank].chunk(2, 1))
    for damping in DAMPINGS:
        velocity = sent
        for _ in range(MOST_ITERATIONS):
            located = grid.locate(velocity.abs().clamp(max=grid.maximum))  # on the way it may leave the table
            mixed = torch.fft.rfft(interpolate(across, *located).T * sent)
            change = sent - torch.fft.irfft((mixed * along).sum(0), n=len(sent)) - velocity
            if change.abs().max() <= SETTLED * sent.abs().max():
                return sent - velocity
            velocity = velocity + damping * change
    raise ValueError("the iteration over a period does not converge")


def driven_impedance(liner: LinerModel, level: float, tone: float, samples: int = 0, grid: float = 20.0) -> complex:
    """Z at a tone, Hz, of so many dB, from one period of ``samples``; default as many as 48 kHz has, at least."""
    n = samples or math.ceil(48e3 / tone)
    fluid = liner.fluid or Fluid()
    peak = 2**0.5 * REFERENCE_PRESSURE * 10 ** (level / 20) / float(fluid.characteristic_impedance)
    sent = peak * torch.cos(2 * torch.pi / n * torch.arange(n, dtype=torch.float64))
    levels, lines = VelocityGrid(grid), tone * torch.arange(1, n // 2 + 1, dtype=torch.float64)
    at_zero = torch.ones(levels.levels, 1, dtype=torch.complex128)  # R(0) = 1
    response = torch.cat([at_zero, reflection_of(liner, lines, levels.speeds[:, None])], 1)
    found = torch.fft.rfft(settle_period(sent, response, levels))[1] / torch.fft.rfft(sent)[1]
    return complex(impedance_from_reflection(found))


def fixed_impedance(liner: LinerModel, level: float, tone: float, highest: float = 20.0) -> complex:
    """Z at a tone, Hz, of so many dB, at the least rms |v| that is just what the wave then drives."""
    rms = REFERENCE_PRESSURE * 10 ** (level / 20) / float((liner.fluid or Fluid()).characteristic_impedance)
    f = torch.tensor([tone], dtype=torch.float64)
    speed = fixed_speed(liner, f, torch.tensor([rms**2], dtype=torch.float64), highest)
    return complex(impedance_of(liner, f, torch.tensor([speed], dtype=torch.float64)))


def fixed_speed(liner: LinerModel, frequency: Tensor, power: Tensor, highest: float) -> float:
    r"""The least rms speed, m/s, that wave and wall agree on in the frequency domain; nan if none is up to ``highest``.

    With p_i the mean square of the incident wave (as a velocity, m2/s2, (F,)) at its frequencies f_i (Hz, (F,)),
    :math:`s^2 = \sum_i p_i |1 - R(f_i, s)|^2`, which lies between 0 and :math:`4 \sum p_i` for passive walls.
    """

    def excess(speed: Tensor) -> Tensor:
        made = power[:, None] * (1 - reflection_of(liner, frequency[:, None], speed)).abs() ** 2
        return speed - made.sum(0).sqrt()

    top = min(highest, 2.5 * float(power.sum().sqrt()))
    places = top * torch.linspace(0, 1, PLACES, dtype=torch.float64) ** 2
    beyond = excess(places) > 0
    if not bool(beyond.any()):
        return float("nan")
    first = int(beyond.int().argmax())
    low, high = places[[first - 1, first]].tolist()
    return float(brentq(lambda s: float(excess(places.new_tensor([s]))), low, high, xtol=1e-14))
