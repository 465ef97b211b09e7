r"""What a liner's model can return at all: the |v| that gives a resistance or a reactance, and the impedances that no
|v(t)| gives; and the velocity through the facesheet over time, from the pressure at the bottom of its cavities.

With w = 1/(Z + 1) the reflection is R = 1 - 2 w. With the phase averaged the educed R is a mean of R(|v(t)|) with
weights that are not negative, so the educed w lies in the convex hull of the curve w(|v|), whatever the velocity does.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from torchliner.liners.model import Liner
from torchliner.records import PressureRecord, VelocityPlane

Complex = NDArray[np.complex128]
SMALLEST_SPEED = 1e-4  # m/s, the first above rest
SPEEDS, DIRECTIONS, PHASES, ALONG = 800, 720, 360, 40  # on the curve; of the hull; of a sine; on each side of a hull


class Reach(NamedTuple):
    """The impedances that a model returns, phase averaged, whatever |v(t)| up to some limit.

    Args:
        boundary: Z along the edge of the set, closed, complex128.
        corners: of the convex set itself, counter-clockwise, in w.
    """

    boundary: Complex
    corners: Complex

    def nearest(self, impedance: complex) -> complex:
        """The reachable impedance nearest to a given one; itself where it can be reached."""
        turn = np.conj(np.roll(self.corners, -1) - self.corners) * (1 / (impedance + 1) - self.corners)
        if bool((turn.imag >= 0).all()):
            return impedance
        return complex(self.boundary[np.abs(self.boundary - impedance).argmin()])


def reach(liner: Liner, frequency: float, speed_max: float) -> Reach:
    """The set for |v| from 0 to ``speed_max``, m/s.

    Source: Roncen et al. (2026), eq. (3.2), through the identity of docs/method.md.
    """
    curve = 1 / (_impedance(liner, frequency, _speeds(speed_max)) + 1)
    directions = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    furthest = (np.conj(directions)[:, None] * curve).real.argmax(1)
    corners = curve[furthest[np.flatnonzero(furthest != np.roll(furthest, 1))]]
    ahead = np.roll(corners, -1) - corners
    sides = (corners[:, None] + ahead[:, None] * np.arange(ALONG) / ALONG).reshape(-1)
    return Reach(1 / sides - 1, corners)


def speed_that_gives(
    liner: Liner, frequency: float, value: float, part: str, waveform: str = "constant", speed_max: float = 343.0
) -> float | None:
    """The lowest rms velocity (m/s) at which the educed R or X has a value; None if none has.

    Args:
        part: ``real`` or ``imag``: which part of Z, normalised, is to have the value.
        waveform: of |v(t)|: ``constant``, or ``sine`` (|v| of a sine, phase averaged).
        speed_max: m/s, where the search ends; beyond the speed of sound no model means anything.
    """
    turn = 0.5 * np.pi * (np.arange(PHASES) + 0.5) / PHASES
    shape = np.ones(1) if waveform == "constant" else 2**0.5 * np.cos(turn)

    def off(rms: NDArray[np.float64]) -> NDArray[np.float64]:
        speed = np.outer(rms, shape)
        mean = (1 / (_impedance(liner, frequency, speed.reshape(-1)) + 1)).reshape(speed.shape).mean(1)
        found: NDArray[np.float64] = getattr(1 / mean - 1, part) - value
        return found

    grid = _speeds(speed_max)
    gap = off(grid)
    crossed = np.flatnonzero(gap[:-1] * gap[1:] <= 0)
    if len(crossed) == 0:
        return None
    i = int(crossed[0])
    return float(brentq(lambda v: float(off(np.array([v]))[0]), grid[i], grid[i + 1], xtol=1e-12))


def _speeds(speed_max: float) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.geomspace(min(SMALLEST_SPEED, 0.1 * speed_max), speed_max, SPEEDS)])


def _impedance(liner: Liner, frequency: float, speed: NDArray[np.float64]) -> Complex:
    with torch.no_grad():
        values = liner.impedance(frequency, torch.from_numpy(speed))
    return np.asarray(torch.as_tensor(values).reshape(-1).to(torch.complex128).numpy())


def hole_velocity(record: PressureRecord) -> VelocityPlane:
    r"""Velocity through the facesheet, averaged over the surface of each cell.

    ``cavity_mouth`` has rho c v_in = j phi_c sin(kH) p_b at one frequency. j sin(kH) is half a step ahead less half a
    step back by tau = H/c, so without losses :math:`\rho c\,v_{in}(t) = \tfrac12\varphi_c\,[\,p_b(t + \tau) -
    p_b(t - \tau)\,]` at every frequency at once (d'Alembert): the wave that will leave the bottom upwards less the one
    that came. It is the velocity in the holes times their share of the surface, turbulence in it included, and nothing
    that passes above the liner.

    Returns:
        A plane with a probe per cavity, v positive away from the liner; shorter than the record by tau at both ends.
        Samples between those of the record by cubic splines.
    """
    assert record.backplate is not None
    assert record.cavity_depth is not None
    pressure = record.backplate.double().numpy().reshape(-1, record.backplate.shape[-1])
    delay = record.cavity_depth / record.fluid.sound_speed * record.sampling_rate
    kept = np.arange(int(np.ceil(delay - 1e-9)), pressure.shape[-1] - int(np.ceil(delay - 1e-9)))
    spline = CubicSpline(np.arange(pressure.shape[-1]), pressure, axis=-1)
    into = record.cavity_porosity * (spline(kept + delay) - spline(kept - delay))
    return VelocityPlane(
        -into / (2 * record.fluid.characteristic_impedance),
        sampling_rate=record.sampling_rate,
        fluid=record.fluid,
        frequency=record.frequency,
        incident_level=record.incident_level,
        mach=record.mach,
        source_side="unknown",
        reference=dict(record.reference),
        name=f"{record.name}, velocity through the facesheet",
    )
