"""What a calibration is held to: references, their noise, bounds, priors; checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.calibration.misfit import SpeedWeights
from torchliner.checks import SAME_FREQUENCY, require_choice
from torchliner.liners.model import LinerModel, named_numbers
from torchliner.pressure.known_pressure import Case, known_pressure
from torchliner.velocity.level_check import ratio_of_pressures


def bounds_of(
    parameters: Mapping[str, tuple[float, float]], liner: LinerModel
) -> tuple[tuple[str, ...], Tensor, Tensor]:
    """Names and bounds, SI.

    Raises:
        ValueError: no parameter, an unknown one, or bounds that are reversed or that no liner has.
    """
    numbers = named_numbers(liner, parameters)
    if not numbers:
        raise ValueError("no parameter is free; name at least one with its bounds")
    bounds = {each: pair for name, pair in parameters.items() for each in liner.groups.get(name, (name,))}
    for name, number in numbers.items():
        low, high = bounds[name]
        unit = "" if number.unit == "1" else f" {number.unit}"
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"bounds of {name} are {low:g} to {high:g}{unit}; finite ones are needed, the lower first")
        refused = low == number.low == 0 and not number.low_included
        if low < number.low or refused or high > number.high:
            least = "at least" if number.low_included else "above"
            raise ValueError(
                f"bounds of {name} are {low:g} to {high:g}{unit}; it is {least} {number.low:g} and "
                f"at most {number.high:g}{unit}"
            )
    pairs = torch.tensor([bounds[name] for name in numbers], dtype=torch.float64)
    return tuple(numbers), pairs[:, 0], pairs[:, 1]


def held_reference(one: SpeedWeights, name: str) -> Tensor:
    """An impedance that a plane holds by name, at its tone, (1,).

    Raises:
        ValueError: it holds none of that name, or another frequency is asked for.
    """
    plane = one.plane
    if name not in plane.reference:
        there = ", ".join(plane.reference) or "none"
        raise ValueError(f"{plane.name} holds no reference {name!r} (it holds: {there}); give the values")
    if plane.frequency is not None:
        asked = one.frequency.tolist()
        if len(asked) > 1 or abs(asked[0] / plane.frequency - 1) > SAME_FREQUENCY:
            raise ValueError(
                f"{plane.name} holds its reference {name!r} at {plane.frequency:g} Hz, and "
                f"{', '.join(f'{f:g}' for f in asked)} Hz is asked for; leave frequency out, or "
                "give the values there"
            )
    return torch.tensor([complex(plane.reference[name])], dtype=torch.complex128)


def references_of(ready: Sequence[SpeedWeights], references: Any) -> Tensor:
    """Reference impedances of all planes, (D,), by name or by values of each plane."""
    if isinstance(references, str):
        values: list[Any] = [held_reference(one, references) for one in ready]
    elif references is None:
        raise ValueError("no reference is given; name one of the planes' or give values")
    else:
        values = [references] if isinstance(references, (int, float, complex)) else list(references)
    if len(values) != len(ready):
        raise ValueError(f"{len(values)} references for {len(ready)} planes; one each")
    found = []
    for one, value in zip(ready, values, strict=True):
        plane, count = one.plane, len(one.frequency)
        each = torch.as_tensor(value, dtype=torch.complex128).reshape(-1)
        if len(each) != count:
            raise ValueError(f"{plane.name} has {count} frequencies and {len(each)} reference impedances; one each")
        if not bool(torch.isfinite(each.abs()).all()):
            raise ValueError(f"{plane.name}: a reference impedance is not finite")
        found.append(each)
    return torch.cat(found)


def noise_of(noise: Any, counts: Sequence[int]) -> Tensor:
    """u(R) + j u(X) of every reference, (D,); 1 + 1j where it is unknown."""
    if noise is None:
        return torch.full((sum(counts),), 1 + 1j, dtype=torch.complex128)
    stated = [noise] if isinstance(noise, (int, float, complex)) else list(noise)
    if len(stated) == 1:
        stated = stated * len(counts)
    if len(stated) != len(counts):
        raise ValueError(f"noise has {len(stated)} values for {len(counts)} planes; one, or one each")
    rows = []
    for value, count in zip(stated, counts, strict=True):
        each = complex(value) if isinstance(value, complex) else complex(value, value)
        if not (0 < each.real < math.inf and 0 < each.imag < math.inf):
            raise ValueError(
                f"noise is {value}; u(R) and u(X), normalised by rho c, are finite and above 0 (None if unknown)"
            )
        rows += [each] * count
    return torch.tensor(rows, dtype=torch.complex128)


def prior_of(
    prior: Mapping[str, tuple[float, float]] | None, names: tuple[str, ...], noise_is_known: bool
) -> dict[str, tuple[float, float]]:
    """Priors by parameter: mean and standard deviation, SI."""
    if not prior:
        return {}
    if not noise_is_known:
        raise ValueError("a prior weighs against data of known uncertainty; state noise too")
    for name, (mean, spread) in prior.items():
        require_choice("parameter of a prior", name, names)
        if not (math.isfinite(mean) and 0 < spread < math.inf):
            raise ValueError(
                f"prior of {name} is {mean:g} +- {spread:g}; a mean and a standard deviation above 0 are needed"
            )
    return dict(prior)


def ties_of(
    ready: Sequence[SpeedWeights], references: Any, pressure: Any
) -> tuple[list[Callable[[Tensor], Tensor]], list[bool]]:
    """What the level check holds each plane to: implied over known pressure, and whether it has a phase.

    Raises:
        ValueError: references are given as well, pressures do not fit the planes, or nothing is
            known of a plane.
    """
    if references is not None:
        raise ValueError("a fit to levels needs no references; leave them out, or leave level_check out")
    given = list(pressure) if isinstance(pressure, (list, tuple)) else [pressure] * len(ready)
    if len(given) != len(ready):
        raise ValueError(f"{len(given)} pressures for {len(ready)} planes; one each, or None")
    ratios, phases = [], []
    for one, record in zip(ready, given, strict=True):
        moments = one.known
        case = Case(one.plane, one.frequency, moments.cells, moments.cell_pitch, moments.survey.blocks)
        known = known_pressure(case, record)
        if isinstance(known, str) or not bool(torch.isfinite(known.liner.abs()).all()):
            words = known if isinstance(known, str) else f"not at all frequencies: {known.words}"
            raise ValueError(f"{one.plane.name} cannot be fitted to its level: {words}")
        ratios.append(ratio_of_pressures(moments, case, known))
        phases.append(known.has_phase)
    return ratios, phases


def nepers_of(decibels: Any) -> Any:
    """Noise of levels, dB, as that of logarithms.

    Raises:
        ValueError: a complex number, which is of R and X.
    """
    stated = [decibels] if isinstance(decibels, (int, float, complex)) else list(decibels)
    if any(isinstance(value, complex) for value in stated):
        raise ValueError(
            f"noise is {decibels}, and with level_check it is of levels: state dB, one number, or one by plane"
        )
    return [value * math.log(10) / 20 for value in stated]
