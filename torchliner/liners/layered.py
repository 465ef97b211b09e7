r"""Liners of several layers: sheets and cavities from the flow down to a rigid backplate.

Pressure p and velocity v, averaged over the cell and normalised, on both sides of a layer:

    sheet    p = p' + Z v',                                  v = v'
    cavity   p = cosh(g h) p' + sinh(g h) v'/phi,            v = phi sinh(g h) p' + cosh(g h) v'

with the g = j k_c of eq. (2.2d), depth h and share phi of the cell. On the backplate v' = 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import torch
from torch import Tensor

from torchliner.checks import plain_number, real_tensor
from torchliner.liners.cell import CellLiner, omega_of, speed_of
from torchliner.liners.layers import Cavity, Layer, Sheet
from torchliner.liners.parameters import Factor, Number, Range


@dataclass(frozen=True)
class LayeredLiner(CellLiner):
    r"""Sheets and cavities: one sheet over a cavity, perforate with mesh, two degrees of freedom.

    The measured |v| is that at the upper sheets, which no cavity parts from the flow. At a sheet
    behind a cavity (a septum) it is what the linear transfer makes of it,
    :math:`|v_s| = |v|\,|v_s/v|`, at the frequency asked for and with all sheets below at rest, or
    what ``septum_ratio`` or ``septum_speed`` state.

    Args:
        layers: from the flow down: ``sheet``s and ``Cavity``s. The first is a sheet, the last a cavity. In ``numbers``
            and messages they are called facesheet, facesheet2, ... (above the first cavity), septum, septum2, ...,
            cavity, cavity2, ...
        septum_ratio: |v| at every septum over |v| at the upper sheet; None: the linear transfer.
        septum_speed: |v| at every septum, m/s, whatever |v| is above.
        open_area_fraction, velocity_reading, velocity_gain, impedance_offset, cell_pitch, flow_facing_porosity, fluid,
            name: by keyword, see ``CellLiner``.
    Raises:
        TypeError: something else than layers.
        ValueError: an order of layers that is no liner; both rules for the septum, or one where
            there is none; a value outside its range.
    Source: transfer matrices of plane waves; cavities and, with the law ``perforate``, sheets as
        Roncen et al. (2026), eqs (2.2) and (2.4): with one of each it is ``SDoFLiner``. The paper
        names liners of two degrees of freedom in section 7.5 and gives no equations; that the
        sheets below count as at rest for |v| at a septum is a choice made here.

    >>> plate = tl.sheet("perforate", thickness=0.6e-3, orifice_diameter=1e-3, porosity=0.05)
    >>> septum = tl.sheet("perforate", thickness=0.8e-3, orifice_diameter=0.8e-3, porosity=0.02)
    >>> liner = tl.LayeredLiner([plate, tl.Cavity(20e-3, 5e-3), septum, tl.Cavity(20e-3, 5e-3)])
    >>> f"{complex(liner.impedance(1400.0, 3.0)):.2f}"
    '3.38-1.28j'
    """

    model = "layered"

    layers: tuple[Layer, ...]
    septum_ratio: Factor = None
    septum_speed: Annotated[Any, Range("m/s")] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        self._check_layers(f"liner {self.name or self.model!r}")
        super().__post_init__()

    def _check_layers(self, where: str) -> None:
        for place, layer in enumerate(self.layers):
            if not isinstance(layer, Layer):
                raise TypeError(f"{where}: layer {place + 1} is {layer!r}; a sheet or a Cavity")
        if not self.layers:
            raise ValueError(f"{where} has no layers; a sheet and a cavity are the least")
        named = self.named_layers()
        if not isinstance(self.layers[0], Sheet):
            raise ValueError(f"{where} begins with cavity; the first layer is the sheet that faces the flow")
        if not isinstance(self.layers[-1], Cavity):
            raise ValueError(
                f"{where} ends in {[*named][-1]} (sheet {self.layers[-1].kind!r}); the last layer is a cavity, whose "
                "depth is that from the lowest sheet to the backplate"
            )
        rules = [name for name in ("septum_ratio", "septum_speed") if getattr(self, name) is not None]
        if len(rules) == 2:
            raise ValueError(f"{where}: {' and '.join(rules)} are stated; one of them says |v|")
        if rules and "septum" not in named:
            raise ValueError(f"{where}: {rules[0]} is stated, but no sheet lies behind a cavity")

    def named_layers(self) -> dict[str, Layer]:
        """Layers by name, from the flow down."""
        count: Counter[str] = Counter()
        found = {}
        for layer in self.layers:
            name = "septum" if count["cavity"] else "facesheet"
            name = "cavity" if isinstance(layer, Cavity) else name
            count[name] += 1
            found[name if count[name] == 1 else f"{name}{count[name]}"] = layer
        return found

    @property
    def _sheets(self) -> list[Sheet]:
        return [layer for layer in self.layers if isinstance(layer, Sheet)]

    @property
    def hole_diameter(self) -> float | None:
        """Of the uppermost sheet, m, where it has holes."""
        return self._sheets[0].hole_diameter

    @property
    def facing(self) -> float | None:
        """See ``CellLiner``."""
        return self._sheets[0].open_area

    @property
    def flow_resistance(self) -> float:
        """See ``LinerModel``."""
        return sum(sheet.flow_resistance for sheet in self._sheets) / plain_number(self.open_area_fraction)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Tensor:
        """Normalised impedance at |v| = ``speed``; arguments, value and errors as ``SDoFLiner``."""
        omega = omega_of(frequency)
        alpha = real_tensor(self.open_area_fraction).to(omega.device)
        upper = speed_of(speed).to(omega.device) * self.gain().to(omega.device)
        cell, _ = self._stack(omega, self._speeds(omega, upper))
        return cell / alpha + self.impedance_offset

    def _stack(self, omega: Tensor, speeds: Sequence[Tensor]) -> tuple[Tensor, list[Tensor]]:
        """Impedance of a cell, and velocity below over that above each layer, upwards."""
        admittance, ratios = 0 * omega.to(torch.complex128), []
        for layer, speed in zip(reversed(self.layers), reversed(speeds), strict=True):
            ratio = torch.ones_like(omega)
            if isinstance(layer, Cavity):
                admittance, ratio = layer.down(omega, admittance, self.fluid)
            elif isinstance(layer, Sheet):
                drop = layer.impedance(omega, speed, self.fluid)
                admittance = 1 / (drop + 1 / admittance)
            ratios.append(ratio)
        return 1 / admittance, ratios

    def _speeds(self, omega: Tensor, upper: Tensor) -> list[Tensor]:
        """|v| at each layer, from the flow down, m/s; ``upper``: at the upper sheet."""
        named = self.named_layers()
        if "septum" not in named:
            return [upper] * len(named)
        first = list(named).index("cavity")
        if self.septum_ratio is not None or self.septum_speed is not None:
            ratio, fixed = (
                real_tensor(rule or 0.0).to(omega.device) for rule in (self.septum_ratio, self.septum_speed)
            )
            return [upper] * first + [ratio * upper + fixed] * (len(named) - first)
        speeds = [upper]
        for ratio in self._stack(omega, [0 * omega] * len(named))[1][:0:-1]:
            speeds.append(ratio.abs() * speeds[-1])
        return speeds

    def numbers(self) -> dict[str, Number]:
        """Those of the layers, as "facesheet.porosity", and the others."""
        of_layers = {
            f"{name}.{key}": number
            for name, layer in self.named_layers().items()
            for key, number in layer.numbers().items()
        }
        return of_layers | super().numbers()

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """See ``LinerModel``."""
        layers = [
            layer.with_numbers({key: values[f"{name}.{key}"] for key in layer.numbers() if f"{name}.{key}" in values})
            for name, layer in self.named_layers().items()
        ]
        others = {name: value for name, value in values.items() if "." not in name}
        return super().with_numbers({**others, "layers": tuple(layers)})

    def facts(self) -> dict[str, Any]:
        """Layers by name, the other arguments, and the resonance, None where there is none."""
        named = {name: layer.describe() for name, layer in self.named_layers().items()}
        facts = super().facts()
        del facts["layers"]
        return {"model": facts.pop("model"), **named, **facts}
