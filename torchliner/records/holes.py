"""Where the holes of a liner are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchliner.records.declared import var
from torchliner.records.probes import finite_places

WIDEST = 0.1  # m, no hole of a liner: a slip of units


@dataclass(frozen=True, repr=False)
class Holes:
    """Holes of a liner's facesheet, for figures: no impedance follows from them.

    Args:
        x, z: of the centres, m, (H,); no z for slits, which go all along it.
        diameter: of round holes, or width along x of slits, m, (H,).
    Raises:
        ValueError: other numbers of values, none, not finite; a diameter that is not positive, or
            above 0.1 m.
    """

    x: tuple[float, ...] = var("hole", unit="m", text="streamwise coordinate of the centre of a hole")
    diameter: tuple[float, ...] = var("hole", unit="m", text="diameter of a hole, or width of a slit along x")
    z: tuple[float, ...] | None = var("hole", unit="m", text="spanwise coordinate, likewise", default=None)

    def __post_init__(self) -> None:
        for label in ("x", "diameter", "z"):
            value = getattr(self, label)
            if value is not None:
                places = tuple(finite_places(value, label, "holes").tolist())
                object.__setattr__(self, label, places)
                if len(places) != len(self.x) or not places:
                    raise ValueError(
                        f"holes: {label} has {len(places)} values for {len(self.x)} holes; each hole has one"
                    )
        for number, diameter in enumerate(self.diameter, 1):
            if not 0 < diameter <= WIDEST:
                raise ValueError(
                    f"holes: diameter of hole {number}, at x = {self.x[number - 1]:g} "
                    f"m, is {diameter:g} m; it must be positive, and at most "
                    f"{WIDEST:g} m: check its unit"
                )

    def __len__(self) -> int:
        return len(self.x)

    @property
    def words(self) -> str:
        """'2 slits of 0.68 mm, x = 6.2 to 18.7 mm'."""
        size, x = (
            " to ".join(f"{1e3 * end:.4g}" for end in sorted({min(own), max(own)})) for own in (self.diameter, self.x)
        )
        kind = ("hole" if self.z is not None else "slit") + "s" * (len(self) > 1)
        return f"{len(self)} {kind} of {size} mm, x = {x} mm"

    def __repr__(self) -> str:
        return f"Holes: {self.words}"

    def __mul__(self, factor: float) -> Holes:
        """All lengths times a factor."""
        z = None if self.z is None else tuple(factor * each for each in self.z)
        x, diameter = (tuple(factor * each for each in own) for own in (self.x, self.diameter))
        return Holes(x, diameter, z)

    def beyond(self, x: Tensor | None, z: Tensor | None) -> list[int]:
        """Those that no probe's neighbourhood touches: wholly outside the range of coordinates, m.

        Args:
            x, z: of probes, m; None where unknown: nothing is outside.
        """
        limits = [
            (own, float(at.min()), float(at.max()))
            for own, at in ((self.x, x), (self.z, z))
            if own is not None and at is not None
        ]
        return [
            i
            for i, size in enumerate(self.diameter)
            if any(own[i] + size / 2 < low or own[i] - size / 2 > high for own, low, high in limits)
        ]

    def within(self, x: Tensor | None, z: Tensor | None) -> Holes | None:
        """Those that are not ``beyond``; None if none is left."""
        out = set(self.beyond(x, z))
        kept = [i for i in range(len(self)) if i not in out]
        if not kept:
            return None
        places, sizes = (tuple(own[i] for i in kept) for own in (self.x, self.diameter))
        return Holes(places, sizes, None if self.z is None else tuple(self.z[i] for i in kept))


def merged_bands(holes: Holes) -> list[tuple[float, float]]:
    """Stretches of x, m, that lie over some hole, in order: those that overlap are one."""
    ends = sorted((x - size / 2, x + size / 2) for x, size in zip(holes.x, holes.diameter, strict=True))
    found: list[tuple[float, float]] = []
    for low, high in ends:
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(high, found[-1][1])
        else:
            found.append((low, high))
    return found


def require_holes_on_plane(holes: Any, x: Tensor | None, z: Tensor | None, name: str) -> None:
    """Refuse holes beyond the probes: they have another origin or unit than the plane.

    Args:
        holes: of the plane.
        x, z: of its probes, m; None where unknown.
        name: of the plane, for messages.
    Raises:
        TypeError: no ``Holes``.
        ValueError: there are some; the first and the probes' ranges are named.
    """
    if not isinstance(holes, Holes):
        raise TypeError(
            f"{name}: holes is {type(holes).__name__}; give Holes(x, diameter, z), in m, or read_holes(FILE)"
        )
    out = holes.beyond(x, z)
    if out:
        ranges = ", ".join(
            f"{label} = {1e3 * float(at.min()):.6g} to {1e3 * float(at.max()):.6g} mm"
            for label, at in (("x", x), ("z", z))
            if at is not None
        )
        at = f"x = {1e3 * holes.x[out[0]]:.6g} mm"
        at += "" if holes.z is None else f", z = {1e3 * holes.z[out[0]]:.6g} mm"
        raise ValueError(
            f"{name}: {len(out)} of {len(holes)} holes lie outside the plane, number {out[0] + 1} "
            f"first, at {at}; the probes are at {ranges}: give the holes in the coordinates of the "
            "plane, without those beyond it"
        )
