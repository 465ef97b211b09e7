r"""Axial wavenumbers of a plane duct in uniform flow, rigid at one wall, lined at the other.

With waves :math:`e^{j\omega t - j\alpha x}`, :math:`d = k - \alpha M` and :math:`\gamma^2 = d^2 - \alpha^2`

.. math:: Z = \frac{jsd}{\gamma\tan\gamma H}, \quad s = d/k \text{ (Ingard-Myers)},\ 1 \text{ (continuous velocity)}.

Roots are sought of :math:`F = a\,\gamma\sin\gamma H - j b\,s\,d\cos\gamma H`, Z = a/b, which is even in gamma, has no
poles and covers Z = 0 (a = 0) and the rigid wall (b = 0). A mode is named by its rigid root, :math:`\gamma H = m\pi`,
followed while the wall's reflection goes straight from 1 to (Z - 1)/(Z + 1): every wall on the way is passive if the
last one is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.checks import real_tensor, require_choice, require_complex
from torchliner.duct.case import wall_reflection
from torchliner.duct.numerics import LONGEST_STEP, follow_roots
from torchliner.names import CONDITIONS, DIRECTIONS
from torchliner.records import MicrophoneLine
from torchliner.records.notes import Note

STEEP = 300.0  # |Im gamma H|: beyond, the ratio of cos and sin is -+j to the last digit, and both overflow

Pair = tuple[Tensor, Tensor]


def impedance_from_wavenumber(
    alpha: Tensor,
    frequency: Any,
    *,
    height: Any,
    mach: Any = 0.0,
    sound_speed: Any = 343.2,
    condition: str = "ingard-myers",
) -> Tensor:
    r"""Impedance of the lined wall at which a wavenumber is one of the duct's.

    Args:
        alpha: axial wavenumber, 1/m, complex, of :math:`e^{-j\alpha x}`, x along the flow.
        frequency: Hz.  height: H, m.  mach: M of the uniform flow along +x.  sound_speed: c, m/s.
        condition: at the liner, one of ``names.CONDITIONS``.
    Returns:
        Z, normalised, of the broadcast shape, differentiable; inf at wavenumbers of a rigid duct.
    Raises:
        TypeError: alpha is not complex.
        ValueError: a frequency, height or sound speed not above 0, \|M\| >= 1.
    Source: Ingard (1959), Myers (1980); for continuous velocity the plain momentum equation.
    """
    require_complex("alpha", alpha)
    duct, wave = duct_of(alpha, frequency, height, mach, sound_speed, condition)
    (rigid, _), (soft, _) = relation(wave, duct)
    hard = rigid == 0
    return torch.where(hard, torch.inf, soft / torch.where(hard, 1, rigid)).to(alpha.dtype)


def wavenumber_from_impedance(
    impedance: Tensor,
    frequency: Any,
    *,
    height: Any,
    mach: Any = 0.0,
    sound_speed: Any = 343.2,
    condition: str = "ingard-myers",
    direction: str = "downstream",
    mode: Any = 0,
) -> Tensor:
    r"""Axial wavenumber of one mode, followed from the rigid wall.

    Args:
        impedance: Z, normalised, complex; 0 and inf are allowed.
        frequency, height, mach, sound_speed, condition: as for ``impedance_from_wavenumber``.
        direction: ``downstream`` or ``upstream``, that of the rigid mode.
        mode: m of the rigid mode :math:`\gamma H = m\pi`, 0 the plane wave; an integer or tensor.
    Returns:
        alpha, 1/m, of the broadcast shape. Differentiable in Z and every real argument up to third order.
    Raises:
        TypeError, ValueError: as ``impedance_from_wavenumber`` and ``wall_reflection``.
        RuntimeError: two modes meet on the way, or in the rigid duct, exactly at a cut-on.
    Warns:
        DataWarning: Z has a negative resistance, so that the wall feeds the wave.

    >>> wall = torch.tensor(2.33 - 0.30j, dtype=torch.complex128)
    >>> duct = {"height": 0.05, "mach": 0.3, "sound_speed": 343.0}
    >>> alpha = tl.wavenumber_from_impedance(wall, 1500.0, **duct)
    >>> f"{complex(alpha):.3f}"  # 1/m, decaying downstream
    '21.458-2.511j'
    >>> f"{complex(tl.impedance_from_wavenumber(alpha, 1500.0, **duct)):.2f}"
    '2.33-0.30j'
    """
    require_complex("impedance", impedance)
    sign = 1 - 2 * DIRECTIONS.index(require_choice("direction", direction, DIRECTIONS))
    mode = torch.as_tensor(mode, device=impedance.device)
    if mode.is_floating_point() or mode.is_complex() or bool((mode < 0).any()):
        raise ValueError(f"mode is {mode.reshape(-1)[0].item()}; modes are numbered 0, 1, 2, ...")
    reflection = wall_reflection(impedance) + torch.zeros_like(mode, dtype=torch.float64)
    duct, reflection = duct_of(reflection, frequency, height, mach, sound_speed, condition)
    shape, flat = reflection.shape, duct.at(...)
    mode, reflection = mode.expand(shape).reshape(-1), reflection.reshape(-1)
    wall = 1 + reflection, 1 - reflection
    with torch.no_grad():
        start = rigid_wavenumber(flat.wavenumber, flat.mach, torch.pi * mode / flat.height, sign)
        rigid = torch.full_like(start, 2), torch.zeros_like(start)
        root, arrived = carry_wavenumber(flat, start, rigid, wall)
        if not bool(arrived.all()):
            i = int((~arrived).nonzero()[0])
            raise RuntimeError(
                f"no wavenumber was found for R = {complex(reflection[i]):.4g} at k = {float(flat.wavenumber[i]):.4g} "
                "1/m: two modes meet on the way from the rigid wall, or at a cut-on; change Z or the frequency slightly"
            )
    if any(part.requires_grad for part in (reflection, flat.wavenumber, flat.height, flat.mach)):
        # Two Newton steps from the root move nothing, but hand derivatives on, to third order.
        for _ in range(2):
            hard, soft = relation(root, flat)
            value, slope = (wall[0] * r - wall[1] * s for r, s in zip(hard, soft, strict=True))
            root = root - value / slope
    return root.reshape(shape).to(impedance.dtype)


class Duct(NamedTuple):
    """What the relation needs besides alpha and Z, as real tensors of one shape."""

    wavenumber: Tensor  # k = omega/c, 1/m
    height: Tensor  # H, m
    mach: Tensor
    displaced: bool  # Ingard-Myers, else continuous velocity

    def at(self, index: Any) -> Duct:
        """Some items of the batch, or all of them in one row (``...``)."""
        k, height, mach = (part[index].reshape(-1) for part in self[:3])
        return Duct(k, height, mach, self.displaced)


def duct_of(
    first: Tensor, frequency: Any, height: Any, mach: Any, sound_speed: Any, condition: str
) -> tuple[Duct, Tensor]:
    """The duct and the first argument in float64, broadcast against each other, checked."""
    require_choice("condition", condition, CONDITIONS)
    stated = {"frequency (Hz)": frequency, "height (m)": height, "sound_speed (m/s)": sound_speed, "mach": mach}
    hertz, tall, speed, flow = reals = [real_tensor(value).to(first.device) for value in stated.values()]
    for name, value in zip(stated, reals, strict=True):
        known, limit = value.detach(), "finite and above 0"
        bad = ~((known > 0) & torch.isfinite(known))
        if name == "mach":
            bad, limit = ~(known.abs() < 1), "between -1 and 1 (a Mach number, not m/s)"
        if bool(bad.any()):
            raise ValueError(f"{name} is {float(known[bad].reshape(-1)[0]):g}; it must be {limit}")
    wave, k, tall, flow = torch.broadcast_tensors(first.to(torch.complex128), 2 * torch.pi * hertz / speed, tall, flow)
    return Duct(k, tall, flow, condition == CONDITIONS[0]), wave


def relation(alpha: Tensor, duct: Duct) -> tuple[Pair, Pair]:
    r"""gamma sin gamma H and j s d cos gamma H, each with its derivative in alpha.

    With w = gamma^2 and x = gamma H: (gamma sin x)_w = H (sinc x + cos x)/2, (cos x)_w = -H^2 sinc x/2;
    w' = -2 (M d + alpha).
    """
    h, m = duct.height, duct.mach
    d = duct.wavenumber - alpha * m
    w, w_slope = d * d - alpha * alpha, -2 * (m * d + alpha)
    zero = w == 0
    x = torch.sqrt(torch.where(zero, 1, w)) * h
    turn = torch.complex(x.real, x.imag.clamp(-STEEP, STEEP))
    cos, sinc = torch.where(zero, 1, torch.cos(turn)), torch.where(zero, 1, torch.sin(turn) / x)
    rigid = (w * h * sinc, h * (sinc + cos) / 2 * w_slope)
    f, f_slope = (d * d / duct.wavenumber, -2 * m * d / duct.wavenumber) if duct.displaced else (d, -m + 0 * d)
    return rigid, (1j * f * cos, 1j * (f_slope * cos - f * h * h * sinc / 2 * w_slope))


def rigid_wavenumber(k: Tensor, mach: Any, number: Tensor, sign: int) -> Tensor:
    r"""Roots of :math:`(1-M^2)\alpha^2 + 2kM\alpha - k^2 + n^2 = 0`, n = m pi/H, sign +1 towards +x, -1 towards -x.

    Cut off, or at a k with Im k < 0, the mode decays in its direction: Im alpha < 0 towards +x.
    """
    beta = 1 - mach**2
    root = torch.sqrt((k**2 - beta * number**2).to(torch.complex128))
    return (-k * mach + sign * torch.where(root.imag > 0, -root, root)) / beta


def carry_wavenumber(
    duct: Duct, start: Tensor, begin: Pair, end: Pair, first_step: float = LONGEST_STEP
) -> tuple[Tensor, Tensor]:
    """Roots followed while the wall goes straight from ``begin`` to ``end``, (a, b) with a : b = Z : 1, (N,) each, and
    whether each arrived; ``first_step`` of the way is tried first."""
    a0, b0, a1, b1 = (*begin, *end)

    def values(alpha: Tensor, t: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        rigid, soft = relation(alpha, duct.at(index))
        da, db = (a1 - a0)[index], (b1 - b0)[index]
        a, b = a0[index] + t * da, b0[index] + t * db
        value, slope = (a * r - b * s for r, s in zip(rigid, soft, strict=True))
        return value, slope, da * rigid[0] - db * soft[0]

    root, place = follow_roots(values, start, first_step)
    return root, place == 1


def higher_mode_notes(line: MicrophoneLine) -> list[Note]:
    """Higher modes of the rigid duct, over its height and its width, that carry sound along microphones."""
    notes, speed = [], float(line.fluid.sound_speed) * (1 - line.stated_mach**2) ** 0.5
    for what, size in (("height", line.duct_height), ("width", line.duct_width)):
        limit = speed / (2 * float(size)) if size is not None else torch.inf
        if above := line.frequency[line.frequency >= limit].tolist():
            text = f"from {limit:.4g} Hz on the duct's {what}, {1e3 * float(size or 0):g} mm, carries a higher mode"
            share = f"{len(above)} of {len(line.frequency)} frequencies from {min(above):g} Hz on"
            notes.append(Note("higher-modes", f"{line.name}: {text}: {share}"))
    return notes
