"""A straight duct with a liner on one wall: what is to be solved, and its wall as a reflection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import FEEDS, require_choice, require_positive, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.duct.flow_profiles import MeanFlow
from torchliner.names import CONDITIONS, SOURCES

ACTIVE = 1e-12  # |Z + 1| from which R overflows what the sums keep
GAINS = 1 + 1e-9  # of an end's reflection; nearer to 1 it is rounding


def other_side(source: str) -> str:
    """``downstream`` for ``upstream`` and the reverse."""
    return SOURCES[1 - SOURCES.index(source)]


@dataclass(frozen=True, eq=False)
class DuctCase:
    """Rigid walls at y = 0 and y = H, the one at y = 0 lined in places; flow along +x.

    Args:
        profile: mean flow M(y), which also states H and c.
        start, end: x of the duct's ends, m; both reflect nothing unless said otherwise.
        liner: x of the two edges of a lined patch, m, or several such pairs, which may touch.
        source: ``upstream`` (at ``start``, its wave runs along +x) or ``downstream``.
        incident: amplitude (peak) of the incident plane-like mode on the rigid wall at the lined edge that it meets
            first, or at the source's end where there is no liner, Pa; complex.
        end_reflection, source_reflection: ratio of the wall pressures of the plane-like mode that
            comes back to the one that goes out, at the far end and at the source's; complex,
            broadcast against (F,), leading axes free.
        density: rho, kg/m3; velocities are p/(rho c).
        slip_condition: ``ingard-myers`` or ``continuous-velocity``, needed for a liner along which
            the flow slips. Ingard's and Myers' condition is integrated from the downstream edge of
            each lined stretch, where the displacement starts from 0: integrated from the other
            edge, the hydrodynamic wave of the vortex sheet grows beyond all bounds.
    Raises:
        ValueError: an end before the start, a patch outside the duct or of no length, patches that
            overlap, a density not above 0, a number that is not finite, an unknown word.
    Warns:
        DataWarning: an end that reflects more than it gets.
    """

    profile: MeanFlow
    start: float
    end: float
    liner: Sequence[Any] = ()
    source: str = "upstream"
    incident: complex = 1.0
    end_reflection: Any = 0.0
    source_reflection: Any = 0.0
    density: float = 1.204
    slip_condition: str | None = None

    def __post_init__(self) -> None:
        most = {}
        for name in ("start", "end", "incident", "end_reflection", "source_reflection"):
            value = getattr(self, name)
            exact = value.detach() if isinstance(value, Tensor) else np.asarray(value or 0.0, np.complex128)
            sizes = torch.as_tensor(exact).abs()
            if not bool(torch.isfinite(sizes).all()):
                raise ValueError(f"{name} is {value}; it must be finite")
            most[name] = float(sizes.max()) if sizes.numel() else 0.0
        require_positive("duct length, end - start (m)", self.end - self.start)
        require_positive("density (kg/m3)", self.density)
        require_choice("source", self.source, SOURCES)
        if self.slip_condition is not None:
            require_choice("slip condition", self.slip_condition, CONDITIONS)
        object.__setattr__(self, "liner", _patches(self.liner))
        before = self.start
        for start, end in self.liner:
            where = f"the lined patch from x = {start:g} to {end:g} m"
            if not end > start:
                raise ValueError(f"{where} has the length {end - start:.3g} m; it must be above 0")
            if start < self.start or end > self.end:
                raise ValueError(
                    f"{where} lies outside the duct, {self.start:g} to {self.end:g} m; move its edges, or the duct's "
                    "ends (start, end)"
                )
            if start < before:
                raise ValueError(
                    f"lined patches overlap: one ends at x = {before:g} m, the next starts at {start:g} m; give them "
                    "in order along x"
                )
            before = end
        for name in ("end_reflection", "source_reflection"):
            if most[name] > GAINS:
                tell(
                    f"{name} has a modulus of {most[name]:.4g}, above 1: such an end sends back more than it gets, and "
                    "fields may have no bound",
                    depth=2,
                )

    @property
    def height(self) -> float:
        """H, m."""
        return self.profile.duct_height

    def place_of_incidence(self, source: str) -> float:
        """x where the wave of a source has the incident amplitude, m."""
        edges = (self.start, self.end) if not self.liner else (self.liner[0][0], self.liner[-1][1])
        return float(edges[SOURCES.index(source)])

    def wavenumber(self, frequency: Tensor) -> Tensor:
        """k = omega/c, 1/m."""
        return 2 * math.pi / self.profile.sound_speed * frequency


def _patches(liner: Any) -> tuple[tuple[float, float], ...]:
    try:
        pairs = [liner] if liner and isinstance(liner[0], (int, float)) else liner
        return tuple((float(start), float(end)) for start, end in pairs)
    except (TypeError, ValueError):
        raise ValueError(f"liner is {liner!r}; it must be (start, end) in m, or a list of such pairs") from None


def wall_reflection(impedance: Any, device: torch.device | None = None) -> Tensor:
    r"""R = (Z - 1)/(Z + 1), complex128, for any passive Z with 0 and infinity among them; gradients are kept.

    Args:
        impedance: Z, normalised, v into the wall.  device: of what is no tensor.
    Raises:
        ValueError: Z is nan, or -1, where a wall gives out waves without being asked.
    Warns:
        DataWarning: negative resistance.
    """
    if isinstance(impedance, Tensor):
        wall = impedance.to(torch.complex128)
    else:
        wall = torch.as_tensor(np.asarray(impedance, np.complex128), device=device)
    rigid = torch.isinf(wall.real) | torch.isinf(wall.imag)
    finite = torch.where(rigid, 1, wall)
    if bool(torch.isnan(finite).any()):
        raise ValueError("impedance is nan; a hard wall is inf")
    if bool(((finite + 1).abs() < ACTIVE).any()):
        raise ValueError("impedance is -1, a wall that sends waves unasked; change it slightly")
    resistance = finite.detach().real
    feeds = resistance < FEEDS
    if bool(feeds.any()):
        tell(
            f"impedance has a negative resistance, {float(resistance.min()):.3g} at least, in {int(feeds.sum())} of "
            f"{feeds.numel()} values: such a wall feeds the sound, and fields may have no bound",
            depth=2,
        )
    return torch.where(rigid, 1, reflection_from_impedance(finite))


def result_type(impedance: Any) -> torch.dtype:
    """complex64 for a tensor of single precision, else complex128; sums are done in complex128."""
    single = isinstance(impedance, Tensor) and impedance.dtype in (torch.complex64, torch.float32)
    return torch.complex64 if single else torch.complex128


def require_slip_condition(profile: MeanFlow, slip_condition: str | None) -> bool:
    """Whether the wall condition is Ingard-Myers'; either is the same where the flow does not slip.

    Raises:
        ValueError: the profile slips along the wall y = 0 and no condition is stated.
    """
    if slip_condition is not None:
        require_choice("slip condition", slip_condition, CONDITIONS)
    slip = float(profile.mach(0.0))
    if slip > 0 and slip_condition is None:
        raise ValueError(
            f"the flow slips along the lined wall at Mach {slip:.3g}; say which condition holds there: "
            "slip_condition='ingard-myers' (continuity of displacement) or 'continuous-velocity'"
        )
    return slip > 0 and slip_condition == "ingard-myers"
