"""A straight duct with a liner on one wall: what is to be solved, and its wall as a reflection."""

import math
from collections.abc import Callable, Sequence
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


def other_side(source: str) -> str:
    """``downstream`` for ``upstream`` and the reverse."""
    return SOURCES[1 - SOURCES.index(source)]


def complex_tensor(value: Any, device: torch.device | None = None) -> Tensor:
    """Numbers, arrays or tensors as complex128; torch alone would make complex64 of a complex number."""
    if isinstance(value, Tensor):
        return value.to(device, torch.complex128)
    return torch.as_tensor(np.asarray(value, np.complex128), device=device)


@dataclass(frozen=True, eq=False)
class DuctCase:
    """Rigid walls at y = 0 and y = H, the one at y = 0 lined in places; flow along +x.

    Args:
        profile: mean flow M(y), which also states H and c.
        start, end: x of the duct's ends, m; both reflect nothing unless said otherwise.
        liner: x of the two edges of a lined patch, m, or several such pairs in order, which may touch.
        source: ``upstream`` (at ``start``, its wave runs along +x) or ``downstream``.
        incident: amplitude (peak) of the incident plane-like mode on the rigid wall at the lined edge that it meets
            first, or at the source's end where there is no liner, Pa; complex.
        end_reflection, source_reflection: of the plane-like mode in wall pressure, at the far end and at the source's;
            complex, broadcast against (F,), leading axes free.
        density: rho, kg/m3.
        slip_condition: ``ingard-myers`` or ``continuous-velocity``, needed for a liner along which the flow slips.
            The former is integrated from the downstream edge of each lined stretch, where the displacement starts from
            0: from the other edge the hydrodynamic wave of the vortex sheet grows beyond all bounds.
    Raises:
        ValueError: lengths, patches, numbers or words that cannot be.
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
        for name in ("start", "end", "incident", "end_reflection", "source_reflection"):
            sizes = complex_tensor(getattr(self, name)).detach().abs()
            if not bool(torch.isfinite(sizes).all()):
                raise ValueError(f"{name} is {getattr(self, name)}; it must be finite")
        require_positive("duct length, end - start (m)", self.end - self.start)
        require_positive("density (kg/m3)", self.density)
        require_choice("source", self.source, SOURCES)
        if self.slip_condition is not None:
            require_choice("slip condition", self.slip_condition, CONDITIONS)
        pairs = [self.liner] if self.liner and isinstance(self.liner[0], (int, float)) else self.liner
        patches = tuple((float(start), float(end)) for start, end in pairs)
        object.__setattr__(self, "liner", patches)
        before = self.start
        for start, end in patches:
            if not before <= start < end <= self.end:
                room = f"lie between {before:g} m, where the duct begins or another patch ends, and {self.end:g} m"
                raise ValueError(f"the lined patch from x = {start:g} to {end:g} m must have a length and {room}")
            before = end

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


def wall_reflection(impedance: Any, device: torch.device | None = None) -> Tensor:
    r"""R = (Z - 1)/(Z + 1), complex128, for any passive Z, 0 and infinity included; gradients are kept.

    Raises:
        ValueError: Z is nan, or -1, where a wall gives out waves without being asked.
    Warns:
        DataWarning: negative resistance.
    """
    wall = complex_tensor(impedance, impedance.device if isinstance(impedance, Tensor) else device)
    rigid = torch.isinf(wall.real) | torch.isinf(wall.imag)
    finite = torch.where(rigid, 1, wall)
    if not bool(((finite + 1).abs() >= ACTIVE).all()):
        raise ValueError("impedance is nan or -1, a wall that sends waves unasked; a hard wall is inf")
    resistance = finite.detach().real
    feeds = resistance < FEEDS
    if bool(feeds.any()):
        least = f"{float(resistance.min()):.3g} at least, in {int(feeds.sum())} of {feeds.numel()} values"
        tell(f"impedance has a negative resistance, {least}: such a wall feeds the sound", depth=2)
    return torch.where(rigid, 1, reflection_from_impedance(finite))


def require_slip_condition(profile: MeanFlow, slip_condition: str | None) -> bool:
    """Whether the wall condition is Ingard's and Myers'; without slip the two conditions are the same.

    Raises:
        ValueError: the profile slips along the wall y = 0 and no condition is stated.
    """
    if slip_condition is not None:
        require_choice("slip condition", slip_condition, CONDITIONS)
    slip = float(profile.mach(0.0))
    if slip > 0 and slip_condition is None:
        raise ValueError(
            f"the flow slips along the lined wall at Mach {slip:.3g}; say which condition holds there: "
            "slip_condition='ingard-myers' or 'continuous-velocity'"
        )
    return slip > 0 and slip_condition == "ingard-myers"


def impedance_along(x: Any, impedance: Any) -> Callable[[Tensor, Tensor], Tensor]:
    """Z(x) at all frequencies: linear in the admittance between stations x (m, (N,)), constant beyond; inf is rigid.
    ValueError where x does not increase."""
    places, values = np.asarray(x, np.float64), np.asarray(impedance, np.complex128)
    if (np.diff(places) <= 0).any():
        raise ValueError("the stations of an impedance profile must increase along x")
    rigid = np.isinf(values)
    admittance = np.where(rigid, 0, 1 / np.where(rigid, 1, values))

    def along(at: Tensor, frequency: Tensor) -> Tensor:
        found = np.interp(at.detach().cpu().numpy(), places, admittance)
        hard = found == 0
        return torch.as_tensor(np.where(hard, np.inf, 1 / np.where(hard, 1, found))).expand(len(frequency), -1)

    return along
