r"""What a liner's model can return at all: the |v| that gives a resistance or a reactance, and the
impedances that no |v(t)| gives.

With w = 1/(Z + 1) the reflection is R = 1 - 2 w. The educed R is a weighted mean of R(|v(t)|) with
weights that are not negative (phase averaged), so the educed w lies
in the convex hull of the curve w(|v|), whatever the velocity does: rule ``averaged``. An admittance
averaged over probes, Y = w/(1 - w), lies in the hull of the Y of that hull: ``over probes``. With a
stated phase the educed w is :math:`\langle w(|v|)\,(1 + e^{-2j\theta})\rangle` over the phase
:math:`\theta` of the wave. That is a convex set too; its extreme point in a direction takes at each
phase the |v| that leads furthest: ``given``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from torchliner.checks import require_choice, require_positive
from torchliner.liners.model import Liner

Complex = NDArray[np.complex128]
RULES = ("averaged", "over probes", "given")
PARTS = ("resistance", "reactance")
WAVEFORMS = ("constant", "sine")
SMALLEST_SPEED = 1e-4  # m/s, the first above rest
SPEEDS = 800  # on the curve
DIRECTIONS = 720  # of the hull
PHASES = 360
ALONG = 40  # points on each side of a hull


@dataclass(frozen=True)
class Reach:
    """The impedances that a model returns under a rule, whatever |v(t)| up to some limit.

    Args:
        rule: one of ``RULES``.
        boundary: Z along the edge of the set, closed, complex128.
        corners: of the convex set itself, counter-clockwise, in w (``over probes``: in Y).
    """

    rule: str
    boundary: Complex
    corners: Complex

    def nearest(self, impedance: complex) -> complex:
        """The reachable impedance nearest to a given one; itself where it can be reached."""
        inner = impedance if self.rule == "over probes" else impedance + 1
        turn = np.conj(np.roll(self.corners, -1) - self.corners) * (1 / inner - self.corners)
        if bool((turn.imag >= 0).all()):
            return impedance
        return complex(self.boundary[np.abs(self.boundary - impedance).argmin()])


def reach(liner: Liner, frequency: float, speed_max: float, rule: str = "averaged") -> Reach:
    """The set for |v| from 0 to ``speed_max``.

    Args:
        liner: model.
        frequency: Hz.
        speed_max: m/s.
        rule: ``averaged`` (a probe, or the velocity averaged first; phase averaged), ``over
            probes`` (the admittance averaged over them) or ``given`` (a probe with a stated phase).
    Raises:
        ValueError: an unknown rule, or a limit that is not above 0.
    Source: Roncen et al. (2026), eq. (3.2), through the identity of docs/method.md.
    """
    require_choice("rule", rule, RULES)
    curve = 1 / (_impedance(liner, frequency, _speeds(speed_max)) + 1)
    if rule == "given":
        corners = _given_hull(curve)
    else:
        corners = _hull(curve)
    if rule == "over probes":
        edge = _sides(corners)
        corners = _hull(edge / (1 - edge))
        return Reach(rule, 1 / _sides(corners), corners)
    return Reach(rule, 1 / _sides(corners) - 1, corners)


def speed_that_gives(
    liner: Liner,
    frequency: float,
    value: float,
    part: str,
    waveform: str = "constant",
    speed_max: float = 343.0,
) -> float | None:
    """The lowest rms velocity (m/s) at which the educed R or X has a value; None if none has.

    Args:
        liner: model.
        frequency: Hz.
        value: resistance or reactance, normalised.
        part: ``resistance`` or ``reactance``.
        waveform: of |v(t)|: ``constant``, or ``sine`` (|v| of a sine, phase averaged).
        speed_max: m/s, where the search ends; beyond the speed of sound no model means anything.
    """
    require_choice("part", part, PARTS)
    require_choice("waveform", waveform, WAVEFORMS)
    from scipy.optimize import brentq

    def off(speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        found = 1 / _response(liner, frequency, speeds, waveform) - 1
        return (found.real if part == "resistance" else found.imag) - value

    grid = _speeds(speed_max)
    gap = off(grid)
    crossed = np.flatnonzero(gap[:-1] * gap[1:] <= 0)
    if len(crossed) == 0:
        return None
    i = int(crossed[0])
    return float(brentq(lambda v: float(off(np.array([v]))[0]), grid[i], grid[i + 1], xtol=1e-12))


def _response(liner: Liner, frequency: float, rms: NDArray[np.float64], waveform: str) -> Complex:
    """Mean of w = 1/(Z + 1) over a waveform of each rms value, (V,)."""
    if waveform == "constant":
        return 1 / (_impedance(liner, frequency, rms) + 1)
    turn = 0.5 * np.pi * (np.arange(PHASES) + 0.5) / PHASES
    speed = np.outer(rms, 2**0.5 * np.cos(turn))
    values = _impedance(liner, frequency, speed.reshape(-1)).reshape(speed.shape)
    return np.asarray((1 / (values + 1)).mean(1))


def _speeds(speed_max: float) -> NDArray[np.float64]:
    require_positive("speed_max (m/s)", speed_max)
    low = min(SMALLEST_SPEED, 0.1 * speed_max)
    return np.concatenate([[0.0], np.geomspace(low, speed_max, SPEEDS)])


def _impedance(liner: Liner, frequency: float, speed: NDArray[np.float64]) -> Complex:
    with torch.no_grad():
        values = liner.impedance(frequency, torch.from_numpy(speed))
    return np.asarray(torch.as_tensor(values).reshape(-1).to(torch.complex128).numpy())


def _directions() -> Complex:
    return np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)


def _hull(points: Complex) -> Complex:
    """Corners of the convex hull, counter-clockwise: the furthest point in each direction."""
    furthest = (np.conj(_directions())[:, None] * points).real.argmax(1)
    return points[furthest[np.flatnonzero(furthest != np.roll(furthest, 1))]]


def _given_hull(curve: Complex) -> Complex:
    theta = 2 * np.pi * (np.arange(PHASES) + 0.5) / PHASES
    weight = 1 + np.exp(-2j * theta)
    corners = []
    for direction in _directions():
        best = (np.conj(direction) * np.outer(weight, curve)).real.argmax(1)
        corners.append((weight * curve[best]).mean())
    return np.array(corners)


def _sides(corners: Complex) -> Complex:
    """Points along the sides of a polygon."""
    share = np.arange(ALONG) / ALONG
    ahead = np.roll(corners, -1) - corners
    return (corners[:, None] + ahead[:, None] * share).reshape(-1)
