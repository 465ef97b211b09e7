"""The table of sheet laws: a new law is a function, as in ``laws.py``, and a row here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from torch import Tensor

from torchliner.liners.sheets.laws import goodrich, goodrich_discharge, guess, maa, melling, mesh, two_parameter
from torchliner.liners.sheets.perforate import perforate, require_mass
from torchliner.liners.sheets.terms import goodrich_resistance


@dataclass(frozen=True)
class Law:
    """A row of the table.

    Args:
        impedance: the law.
        flow_resistance: what it adds itself for grazing flow, normalised, from its parameters by name; None: nothing.
        check: refuses what the ranges of single parameters do not, from a name for messages and the parameters.
    """

    impedance: Callable[..., Tensor]
    flow_resistance: Callable[[Mapping[str, float]], float] | None = None
    check: Callable[[str, Mapping[str, float]], None] | None = None


def _grazed(n: Mapping[str, float]) -> float:
    return goodrich_resistance(n["mach"], n["porosity"], n["displacement_thickness"], n["orifice_diameter"])


def _require_layer(name: str, n: Mapping[str, float]) -> None:
    if n["mach"] > 0 and n["displacement_thickness"] == 0:
        raise ValueError(
            f"{name}: mach is {n['mach']:g} and displacement_thickness is 0 m; state it, 1e-3 to 5e-3 m in most ducts: "
            "the added resistance falls with it"
        )


def _require_discharge(name: str, n: Mapping[str, float]) -> None:
    _require_layer(name, n)
    found = float(goodrich_discharge(n["thickness"] / n["orifice_diameter"], n["porosity"]))
    if found > 1:
        raise ValueError(
            f"{name}: the correlation gives a discharge coefficient of {found:.3g} for this thickness over diameter "
            "and porosity; it holds to 1, law 'two-parameter' takes a stated one"
        )


LAWS = {  # by the ``kind`` of a layer in liner files
    "perforate": Law(
        perforate, check=lambda name, n: require_mass(name, n["thickness"], n["orifice_diameter"], n["porosity"])
    ),
    "guess": Law(guess, lambda n: 0.3 * (1 - n["porosity"] ** 2) / n["porosity"] * n["mach"]),
    "goodrich": Law(goodrich, _grazed, _require_discharge),
    "two-parameter": Law(two_parameter, _grazed, _require_layer),
    "maa": Law(maa),
    "melling": Law(melling),
    "mesh": Law(mesh),
}
