r"""Walls and ends put on a duct that was swept with both open: the small system that holds Z.

The sweep knows the duct by what comes out for every unit wave in: X = (s_L, c_L, x, s_R, c_R), the
plane-like modes into the left end (downstream s, upstream c: its part along the flow), the waves x
from the lined wall and the modes into the right end (upstream s, downstream c). For the wall's eta,
c_L and c_R, the amplitudes that go out,

.. math:: a(X) = T \eta, \quad m_L(X) = s_L m_L^+ + c_L m_L^-, \quad
    m_R(X) = c_R m_R^+ + s_R m_R^-, \quad x = E \eta,

with a the waves that arrive at the wall, m the means over the ends of the outgoing p -+ u, m^+ and
m^- those of the modes, and s = s0 + r c where the end sends r of what goes out back in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchliner.duct.walls import Wall

SINGULAR = 1e-6  # residual over right-hand side
CHUNK = 64 * 2**20  # bytes of matrices solved at once


@dataclass(frozen=True, eq=False)
class Response:
    """What comes out of a swept duct for D unit waves in, in the order of X.

    Args:
        wall: waves that arrive at the lined wall, (F, W, D).
        left, right: means of the outgoing waves at the ends, (F, D).
        left_modes, right_modes: the same of the modes downstream and upstream, (F, 2).
    """

    wall: Tensor
    left: Tensor
    right: Tensor
    left_modes: Tensor
    right_modes: Tensor


def solve_ports(response: Response, wall: Wall | None, starts: Tensor, returns: Tensor) -> Tensor:
    """X for waves sent in from the ends.

    Args:
        response: of the swept duct.  wall: of the liner, or None where there is none.
        starts: s0 at the left and right end, (..., F, 2).
        returns: r of the left and right end, (..., F, 2).
    Returns:
        X, (..., F, D).
    Raises:
        RuntimeError: the system is singular; the message holds the residual.
    """
    count = 0 if wall is None else response.wall.shape[-2]
    reading = torch.cat([response.wall[..., :count, :], response.left[:, None], response.right[:, None]], -2)
    system = _system(response, reading, wall, returns)
    modes = torch.stack([response.left_modes[:, 0], response.right_modes[:, 1]], -1)
    sources = reading[..., [0, 2 + count]]
    right = (sources * starts[..., None, :]).sum(-1)
    own = torch.cat([torch.zeros_like(right[..., :count]), modes * starts], -1)
    right = own - right
    try:
        found = torch.linalg.solve_ex(system, right[..., None])[0][..., 0]
    except RuntimeError as problem:
        # Seen once, for a system that is singular to the last digit: rows exchanged with row 0.
        if "ivots" not in str(problem):
            raise
        raise _singular(torch.inf) from problem
    _require_solved(system, found, right)
    eta, going = found[..., :count], found[..., count:]
    coming = starts + returns * going
    waves = eta if wall is None else wall.waves(eta)
    return torch.cat([coming[..., :1], going[..., :1], waves, coming[..., 1:], going[..., 1:]], -1)


def _system(response: Response, reading: Tensor, wall: Wall | None, returns: Tensor) -> Tensor:
    """Of eta, c_L, c_R; rows: walls, left, right; (..., F, W + 2, W + 2)."""
    count, back = reading.shape[-2] - 2, returns[..., None, :]
    parts = reading[..., [1, 3 + count]] + back * reading[..., [0, 2 + count]]
    left, right = response.left_modes, response.right_modes
    own = torch.stack([left[:, 1], right[:, 0]], -1)
    rest = torch.diag_embed(own + returns * torch.stack([left[:, 0], right[:, 1]], -1))
    zeros = rest.new_zeros(*rest.shape[:-2], count, 2)
    parts = parts - torch.cat([zeros, rest], -2)
    if wall is None:
        return parts
    sent = wall.after(reading[..., 2 : 2 + count])
    shape = np.broadcast_shapes(sent.shape[:-2], parts.shape[:-2])
    one = torch.eye(count, dtype=sent.dtype, device=sent.device)
    arrive = one if wall.arrive is None else wall.arrive
    arrive = torch.cat([arrive, arrive.new_zeros(*arrive.shape[:-2], 2, count)], -2)
    walls = (sent - arrive).expand(*shape, -1, -1)
    return torch.cat([walls, parts.expand(*shape, -1, -1)], -1)


def _require_solved(system: Tensor, found: Tensor, right: Tensor) -> None:
    left = (system.detach() @ found.detach()[..., None])[..., 0] - right
    size = right.abs().amax(-1).clamp(min=1e-300)
    residual = torch.nan_to_num(left.abs().amax(-1) / size, nan=torch.inf)
    worst = float(residual.max())
    if worst > SINGULAR:
        raise _singular(worst)


def _singular(residual: float) -> RuntimeError:
    return RuntimeError(
        f"the duct's equations are singular: their solution leaves a residual of {residual:.2g} "
        "of the incident wave (a wall or two ends that feed a resonance); change the impedance, "
        "the end reflections or the frequency"
    )
