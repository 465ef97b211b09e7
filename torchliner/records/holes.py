"""Where the holes of a liner are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
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
        ValueError: other numbers of values, none, not finite; a diameter beyond 0 to 0.1 m.
    """

    x: tuple[float, ...] = var("hole", unit="m", text="streamwise coordinate of the centre of a hole")
    diameter: tuple[float, ...] = var("hole", unit="m", text="diameter of a hole, or width of a slit along x")
    z: tuple[float, ...] | None = var("hole", unit="m", text="spanwise coordinate, likewise", default=None)

    def __post_init__(self) -> None:
        for label in ("x", "diameter", "z"):
            if (value := getattr(self, label)) is not None:
                places = tuple(finite_places(value, label, "holes").tolist())
                object.__setattr__(self, label, places)
                if len(places) != len(self.x) or not places:
                    raise ValueError(f"holes: {label} has {len(places)} values for {len(self.x)} holes")
        for x, diameter in zip(self.x, self.diameter, strict=True):
            if not 0 < diameter <= WIDEST:
                raise ValueError(
                    f"holes: diameter of the hole at x = {x:g} m is {diameter:g} m; it must be positive, and at most "
                    f"{WIDEST:g} m: check its unit"
                )

    def __len__(self) -> int:
        return len(self.x)

    @property
    def words(self) -> str:
        """'2 slits, x = 6.2 to 18.7 mm'."""
        kind = ("hole" if self.z is not None else "slit") + "s" * (len(self) > 1)
        return f"{len(self)} {kind}, x = {1e3 * min(self.x):.4g} to {1e3 * max(self.x):.4g} mm"

    def __repr__(self) -> str:
        return f"Holes: {self.words}"

    def __mul__(self, factor: float) -> Holes:
        """All lengths times a factor."""
        fields = (each and tuple(factor * one for one in each) for each in vars(self).values())
        return Holes(*fields)  # type: ignore[arg-type]

    def within(self, x: Tensor | None, z: Tensor | None) -> Holes | None:
        """Those that touch the range of coordinates, m, of probes (None where unknown); None if none is left."""
        kept, half = np.ones(len(self), bool), np.array(self.diameter) / 2
        for own, at in ((self.x, x), (self.z, z)):
            if own is not None and at is not None:
                kept &= (own + half >= float(at.min())) & (own - half <= float(at.max()))
        fields = (each and tuple(np.array(each)[kept].tolist()) for each in vars(self).values())
        return Holes(*fields) if kept.any() else None  # type: ignore[arg-type]


def merged_bands(holes: Holes) -> list[tuple[float, float]]:
    """Stretches of x, m, that lie over some hole, in order: those that overlap are one."""
    found: list[tuple[float, float]] = []
    for low, high in sorted((x - size / 2, x + size / 2) for x, size in zip(holes.x, holes.diameter, strict=True)):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(high, found[-1][1])
        else:
            found.append((low, high))
    return found
