r"""Impedance as poles and residues: stable, passive, ready for solvers in the time domain.

The reflection coefficient of a wall that rests on a rigid back tends to 1 at high frequencies, so that

.. math:: R(s) = 1 + \sum_k \frac{r_k}{s - p_k}, \qquad s = j\omega,

with real poles and conjugate pairs. All :math:`\operatorname{Re} p_k < 0` makes it stable and causal, :math:`|R| \le 1`
at every frequency passive. In time each pole is one number that is carried on from step to step. The admittance
:math:`y = (1 - R)/(1 + R)` of such an R has as many poles, which follow from it without another fit.
"""

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.checks import frequency_tensor, one_number, real_tensor, whole_number
from torchliner.conversions import impedance_from_reflection, reflection_from_impedance
from torchliner.names import resolve

MOST_POLES = 40
DAMPING = (0.01, 50.0)  # of two poles: less would be a resonance between two frequencies; above 1 they are real
BEYOND = 4.0  # times the band that |p| may lie outside of it
START = -0.5 + 1j  # of poles at first, times frequencies that are spread evenly
EVALUATIONS = 200  # of the search for poles
RIDGE = 1e-4  # weight of a multiple against an error in R
ROOM = 1e-6  # by which |R|^2 stays below 1 in the band: more than it varies between the frequencies looked at
ROUNDS = 30  # of adding frequencies at which |R| exceeded 1
Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Multipole:
    """A passive reflection coefficient; as ``impedance(frequency, speed)`` a liner that does not know |v|.

    Args:
        poles, residues: p, Re p < 0, conjugates side by side, and r; 1/s, complex128, (N,).
        band: lowest and highest frequency of the fit, Hz. Beyond it R is stable and passive, and not known.
        error: largest error in R at the frequencies of the fit.
        correction: largest change in R there that made it passive everywhere.
        about: where it comes from, plain values.
    """

    poles: Tensor
    residues: Tensor
    band: tuple[float, float]
    error: float
    correction: float
    about: dict[str, Any] = field(default_factory=dict)

    def reflection(self, frequency: Any) -> Tensor:
        """R at frequencies in Hz, complex128, of their shape."""
        s = 2j * torch.pi * real_tensor(frequency, name="frequency (Hz)")[..., None]
        return 1 + (self.residues / (s - self.poles)).sum(-1)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Z, normalised, of the broadcast shape of frequency (Hz) and |v| (m/s), on which it does not depend."""
        return impedance_from_reflection(self.reflection(frequency)) + 0 * real_tensor(speed, name="speed (m/s)")

    def admittance(self) -> tuple[Tensor, Tensor]:
        r"""Poles and residues of :math:`y = \sum_k r_k/(s - p_k)`, (N,) each: those of (1 - R)/(1 + R)."""
        ones = torch.ones_like(self.poles)
        closed = torch.diag(self.poles) - ones[:, None] * self.residues / 2
        poles, modes = torch.linalg.eig(closed)
        return poles, -(self.residues @ modes) * torch.linalg.solve(modes, ones) / 2

    def recursion(self, sampling_rate: float) -> dict[str, Tensor]:
        r"""``decay`` e, ``now`` a, ``before`` b, complex128, (N,), of :math:`\psi_n = e\,\psi_{n-1} + a\,x_n +
        b\,x_{n-1}`, the reflected signal being :math:`x_n + \sum_k r_k \psi_{k,n}`; exact where x is linear between
        samples, of a rate in Hz."""
        step = 1 / one_number("sampling_rate (Hz)", sampling_rate)
        decay = torch.exp(self.poles * step)
        whole = torch.expm1(self.poles * step) / self.poles
        now = (whole - step) / (self.poles * step)
        return {"decay": decay, "now": now, "before": whole - now}

    def reflect(self, signal: Any, sampling_rate: float) -> Tensor:
        """The reflected signal, real, (..., T), of an incident one, by ``recursion`` at a rate in Hz, from rest."""
        from scipy.signal import lfilter  # takes half a second to import

        sent = real_tensor(signal, name="signal").numpy()
        found = sent.astype(np.complex128)
        rows = torch.stack([self.residues, *self.recursion(sampling_rate).values()], 1)
        for residue, decay, now, before in rows.tolist():
            found += residue * lfilter([now, before], [1, -decay], sent)
        return torch.from_numpy(found.real.copy())

    def write(self, path: str | Path) -> None:
        """Write ``.json``, or ``.txt`` for OpenFOAM (docs/results.md)."""
        resolve("torchliner.io.result_writers:write_multipole")(self, path)

    def __repr__(self) -> str:
        return f"Multipole({len(self.poles)} poles, {self.band} Hz, R within {self.error:.2g})"


def fit_multipole(frequency: Any, impedance: Any, poles: int = 8, **about: Any) -> Multipole:
    """A stable and passive reflection coefficient through known impedances.

    Args:
        frequency: Hz, (F,).
        impedance: Z, normalised by rho c, exp(+j omega t), complex, (F,).
        poles: N, an odd number has one real pole; fewer than F.
        about: plain values to keep with it.
    Raises:
        ValueError: too many poles for the frequencies; Z with nan, inf or -1.
    Source: poles start from the AAA algorithm (Nakatsukasa, Sete and Trefethen, SIAM J. Sci. Comput. 40, 2018, A1494),
        which are then moved into the left half plane and fitted by least squares in R. Where |R| exceeds 1, anywhere
        between 0 Hz and ten thousand times the band, the residues are those of least error with |R| < 1 there.
    """
    (f, order), count = frequency_tensor(frequency).sort(), whole_number("poles", poles)
    z = torch.as_tensor(impedance).detach().cpu().to(torch.complex128)
    if z.shape != f.shape:
        raise ValueError(f"impedance has shape {tuple(z.shape)}; of {len(f)} frequencies ({len(f)},) is needed")
    z = z[order]
    for wrong in f[~torch.isfinite((z + 1 / (z + 1)).abs())].tolist():
        raise ValueError(f"impedance is nan, inf or -1 at {wrong:g} Hz; leave that frequency out")
    if not 1 <= count <= MOST_POLES or len(f) <= count:
        asked = f"{count} poles are asked for, and Z is known at {len(f)} frequencies"
        raise ValueError(f"{asked}; take 1 to {MOST_POLES} poles, fewer than frequencies")
    wanted = reflection_from_impedance(z).numpy() - 1
    unit = 2 * math.pi * math.sqrt(float(f[0]) * float(f[-1]))  # rad/s, in which poles are of order 1
    s, band = 2j * np.pi * f.numpy() / unit, (float(f[0]), float(f[-1]))
    factors = _fitted(s, wanted, count)
    basis = _basis(s, *factors)
    free = _multiples(basis, wanted)
    passive = _passive(free, basis, wanted, factors, abs(s[-1]))
    p, r = (torch.from_numpy(each * unit) for each in _poles_and_residues(passive, *factors))
    error, correction = (float(np.abs(off).max()) for off in (basis @ passive - wanted, basis @ (passive - free)))
    return Multipole(p, r, band, error, correction, about)


def _basis(s: Array, w: Array, d: Array) -> Array:
    """Functions whose real multiples make up R - 1, (F, N): w^2 and w s over s^2 + 2 d w s + w^2 for each d, two poles;
    for odd N also w/(s + w) of the last w, one pole."""
    two, one, s = w[: len(d)], w[len(d) :], s[:, None]
    over = two / (s**2 + 2 * d * two * s + two**2)
    return np.concatenate([two * over, s * over, one / (s + one)], 1)


def _multiples(basis: Array, wanted: Array) -> Array:
    """Real multiples of least error; large ones of poles that nearly coincide are held down (Tikhonov)."""
    ridge = RIDGE * np.eye(basis.shape[1])
    rows = np.concatenate([basis.real, basis.imag, ridge])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([wanted.real, wanted.imag, ridge[0] * 0]), rcond=None)[0])


def _fitted(s: Array, wanted: Array, count: int) -> tuple[Array, Array]:
    """w, (N - N // 2,), and d, (N // 2,), of the least error in R and the least |R| above 1; from the poles of the AAA
    algorithm, with others where it finds too few, and from poles spread evenly."""
    from scipy.interpolate import AAA  # takes a quarter of a second to import
    from scipy.optimize import least_squares

    pairs, size, outside = count // 2, count - count // 2, _grid(abs(s[-1]), 300, np.zeros(0))
    low = np.log([abs(s[0]) / BEYOND] * size + [DAMPING[0]] * pairs)
    high = np.log([abs(s[-1]) * BEYOND] * size + [DAMPING[1]] * pairs)

    def misfit(x: Array) -> Array:
        w, d = np.exp(x[:size]), np.exp(x[size:])
        basis = _basis(s, w, d)
        solved = _multiples(basis, wanted)
        off, excess = basis @ solved - wanted, np.abs(1 + _basis(outside, w, d) @ solved) - 1
        return np.concatenate([off.real, off.imag, excess.clip(min=0)])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that it has not converged with so few terms
        found = AAA(np.concatenate([s, s.conj()]), np.concatenate([wanted, wanted.conj()]), max_terms=count + 1).poles()
    above = found[found.imag > 1e-6 * np.abs(found)]
    spread = START * np.geomspace(abs(s[0]), abs(s[-1]), pairs + 2)[1:-1]
    tried = []
    for poles in (np.concatenate([above[np.argsort(np.abs(above))], spread])[:pairs], spread):
        damping = np.abs(poles.real / poles).clip(DAMPING[0])
        start = np.concatenate([np.log(np.abs(poles)), np.zeros(count % 2), np.log(damping)])
        limits: Any = {"bounds": (low, high), "x_scale": "jac", "max_nfev": EVALUATIONS}
        tried.append(least_squares(misfit, np.clip(start, low + 1e-6, high - 1e-6), **limits))
    best = np.exp(min(tried, key=lambda each: float(each.cost)).x)
    return best[:size], best[size:]


def _passive(x: Array, basis: Array, wanted: Array, factors: tuple[Array, Array], top: float) -> Array:
    """The real multiples of least error with |R| < 1: a convex problem, with one bound for each peak of |R|."""
    from scipy.optimize import minimize

    grid = _grid(top, 30_000, _poles_and_residues(x, *factors)[0])
    dense, weight = _basis(grid, *factors), 1 + np.abs(grid / top) ** 2  # |R| tends to 1 as its inverse
    held = np.zeros(len(grid), dtype=bool)
    scale = 1 / np.linalg.norm(basis, axis=0)
    rows, bounded, y = basis * scale, dense * scale, x / scale

    def cost(y: Array) -> tuple[float, Array]:
        off = rows @ y - wanted
        return float(np.vdot(off, off).real), 2 * (rows.conj().T @ off).real

    def above(y: Array) -> tuple[Array, Array]:
        """What |R|^2 exceeds 1 by, weighted, where it is held, and its slope."""
        r = 1 + bounded[held] @ y
        return weight[held] * (np.abs(r) ** 2 - 1), 2 * ((weight[held] * r.conj())[:, None] * bounded[held]).real

    bounds = {"type": "ineq", "fun": lambda y: -ROOM - above(y)[0], "jac": lambda y: -above(y)[1]}
    for _ in range(ROUNDS):
        size = weight * (np.abs(1 + bounded @ y) ** 2 - 1)
        peaks = np.concatenate([[True], size[1:] >= size[:-1]]) & np.concatenate([size[:-1] >= size[1:], [True]])
        over = peaks & (size > -ROOM / 2)
        if not over.any():
            return np.asarray(y * scale)
        held |= over
        how: Any = {"method": "SLSQP", "constraints": bounds, "options": {"maxiter": 300, "ftol": 1e-14}}
        y = minimize(cost, y, jac=True, **how).x
    raise ValueError(f"R could not be made passive: |R|^2 still exceeds 1 by {size.max():.2g}; take fewer poles")


def _grid(top: float, count: int, poles: Array) -> Array:
    """s from 0 to ten thousand times the band, rising, most of them up to three times it, and many around each pole."""
    near = np.linspace(0, 3 * top, count)
    around = poles.imag - poles.real * np.tan(np.linspace(-1.55, 1.55, 3001))[:, None]
    return 1j * np.unique(np.concatenate([near, np.geomspace(3 * top, 1e4 * top, count // 4), np.abs(around).ravel()]))


def _poles_and_residues(x: Array, w: Array, d: Array) -> tuple[Array, Array]:
    """From the real multiples of ``_basis``: the two poles of a factor side by side, a single one last."""
    count = len(d)
    two, one, root = w[:count], w[count:], w[:count] * np.sqrt(d.astype(complex) ** 2 - 1)
    both = np.stack([-d * two + root, -d * two - root], 1)
    by_s, constant = (two * x[count : 2 * count])[:, None], (two**2 * x[:count])[:, None]
    residues = (by_s * both + constant) / np.stack([2 * root, -2 * root], 1)
    return np.concatenate([both.ravel(), -one]), np.concatenate([residues.ravel(), one * x[2 * count :]])
