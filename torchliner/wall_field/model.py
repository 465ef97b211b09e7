"""The pressures that a duct model offers for a fit: its answers to waves sent into it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.duct.case import other_side
from torchliner.forward_mode import dual_level
from torchliner.lee.energy import FED, GAIN, PASSIVE
from torchliner.lee.field import DuctField
from torchliner.lee.solver import DuctSolver
from torchliner.wall_field.wall import impedance_at

TOGETHER = 64  # impedances at once


@dataclass(frozen=True, eq=False)
class FieldModel:
    """Responses of a duct to the waves sent into it.

    Args:
        solver: the duct.  sources: sides that waves are sent from, (K,).  places: x, m, (N,).
        wall: of the places, ``opposite`` or ``lined``.
    """

    solver: DuctSolver
    sources: Sequence[str]
    places: Tensor
    wall: str

    def gains(self, place: Tensor) -> Tensor:
        """Energy out and absorbed over that coming in from the source, (B, F); 0 where the wave of
        no shear layer feeds it."""
        with torch.no_grad():
            balance = self.fields(place)[0].energy
        total = balance.out + balance.absorbed
        fed = (balance.out > GAIN) | (total > FED)
        return torch.where(fed & (balance.absorbed > PASSIVE), total, 0.0)

    def fields(self, place: Tensor) -> list[DuctField]:
        """For each source, of walls at coordinates (B, F, P) of ``wall.py``; warnings of a
        trial are not passed on."""
        start, end = self.solver.case.liner[0]
        wall = impedance_at(place)

        def along(x: Tensor, _: Tensor) -> Tensor:
            return wall[..., :1] + wall[..., 1:] * (2 * (x - start) / (end - start) - 1)

        impedance = wall if wall.shape[-1] == 1 else along
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(impedance, side) for side in self.sources]

    def response(self, place: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        return self._at(self.fields(place), self.places)

    def in_parts(self, place: Tensor) -> Tensor:
        """``response``, some walls at a time."""
        return torch.cat([self.response(part) for part in place.split(TOGETHER)])

    def with_slope(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """h, (B, F, N, K), and its forward derivatives by the coordinates, (P, B, F, N, K)."""
        units = torch.eye(place.shape[-1], dtype=place.dtype, device=place.device)
        values, slopes = [], []
        for part in place.split(TOGETHER):
            by_coordinate = []
            for unit in units:
                with dual_level():
                    both = self.response(forward_ad.make_dual(part, unit.expand_as(part).clone()))
                    value, slope = forward_ad.unpack_dual(both)
                by_coordinate.append(slope.detach())
            values.append(value.detach())
            slopes.append(torch.stack(by_coordinate))
        return torch.cat(values), torch.cat(slopes, 1)

    def heard(
        self, place: Tensor, amplitude: Tensor, along: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """What walls (B, F, P) and amplitudes (B, F, K) make.

        Returns:
            Pressure at the places, Pa, (B, F, N), and at ``along`` (m, (X,)), (B, F, X); of the end
            away from the first source the plane-like mode in over out, (B, F).
        """
        at, lines, ratios = [], [], []
        end = other_side(self.sources[0])
        for some, a in zip(place.split(TOGETHER), amplitude.split(TOGETHER), strict=True):
            fields = self.fields(some)
            waves = torch.stack([torch.stack(field.end_waves(end), -1) for field in fields], -1)
            sent, out = (waves * a[..., None, :]).sum(-1).unbind(-1)
            ratios.append(sent / out)
            at.append((self._at(fields, self.places) * a[..., None, :]).sum(-1))
            lines.append((self._at(fields, along) * a[..., None, :]).sum(-1))
        return torch.cat(at), torch.cat(lines), torch.cat(ratios)

    def _at(self, fields: Sequence[DuctField], places: Tensor) -> Tensor:
        where = places.cpu().numpy()
        return torch.stack([field.wall_pressure(where, self.wall) for field in fields], -1)
