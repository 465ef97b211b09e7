r"""A curve of limited bandwidth through random samples, by least squares.

No library among the dependencies fits a truncated Fourier series to irregular samples (that takes a
non-uniform FFT, and the fit is global). Splines of degree 5 on uniform knots 1/(2 B) apart, from
scipy (``BSpline.design_matrix``, ``solveh_banded``), tend to the functions band-limited to B as
their degree grows (Unser 1999) and have a short basis: the normal equations are banded, the cost is
that of a filter, and a gap spoils its neighbourhood alone.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import require_positive

DEGREE = 5
SMOOTHING = 1e-3  # second differences over the mean diagonal; 1e-4 gave turbulence 10 % too strong


def spline_fit(arrival_times: Tensor, values: Tensor, points: Tensor, band: float) -> Tensor:
    """Least squares in splines, second differences of the coefficients weakly penalised.

    The penalty (P-splines, Eilers & Marx 1996) leaves constants and straight lines as they are, and
    is all that holds the curve where a gap leaves a coefficient without arrivals.

    Args:
        arrival_times: s, increasing, (N,).  values: (..., N).
        points: s, (T,), between the first and the last arrival.
        band: B, Hz; needs more than 2 B arrivals a second.
    Returns:
        (..., T), float64.
    """
    from scipy.interpolate import BSpline  # takes half a second or more to import
    from scipy.linalg import solveh_banded

    require_positive("band (Hz)", band)
    times = arrival_times.numpy()
    pieces = math.floor((times[-1] - times[0]) * 2 * band) + 1
    knots = times[0] + np.arange(-DEGREE, pieces + DEGREE + 1) / (2 * band)
    design = BSpline.design_matrix(times, knots, DEGREE)
    count = pieces + DEGREE
    normal = (design.T @ design).tocsr()
    bands = np.zeros((DEGREE + 1, count))  # upper form: row DEGREE - d holds diagonal d
    # D'D of the second differences has the diagonals 6, -4, 1 but for the ends.
    difference = np.array([1.0, -2.0, 1.0])
    for d in range(DEGREE + 1):
        bands[DEGREE - d, d:] = normal.diagonal(d)
        for i in range(3 - d):
            last = count - 2 + i
            bands[DEGREE - d, i + d : last + d] += (
                SMOOTHING * len(times) / count * difference[i] * difference[i + d]
            )
    flat = values.reshape(-1, len(times)).detach().cpu().numpy()
    coefficients = solveh_banded(bands, design.T @ flat.T)
    within = np.clip(points.numpy(), times[0], times[-1])
    found = BSpline.design_matrix(within, knots, DEGREE) @ coefficients
    return torch.from_numpy(found.T.copy()).reshape(*values.shape[:-1], -1).to(values.device)
