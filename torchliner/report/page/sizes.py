r"""How far what a warning is about may move R and X, from numbers that the result itself holds.

Each function gives one kind of warning its size and says what that number is; the derivation
stands in its docstring. A warning that no such number follows from has no size: none is guessed.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchliner.conversions import mean_impedance
from torchliner.liners.model import LinerModel
from torchliner.names import ORDERS
from torchliner.records import Closure, ImpedanceLine, ImpedanceMap
from torchliner.report.page.subject import MapSubject

Bounds = Callable[[int], tuple[complex, complex] | None]
ROUNDING = 1e-6  # of a mean velocity, by which a constant one may seem to move
PRINTED = 1e-4  # relative, to which warnings print frequencies


class Size(NamedTuple):
    """Of a warning.

    Args:
        change: of Z, over rho c; the sizes of its parts count.
        words: what that number is.
    """

    change: complex
    words: str

    @property
    def largest(self) -> float:
        """Of its two parts."""
        return max(abs(self.change.real), abs(self.change.imag))

    def text(self) -> str:
        """As it stands beside the warning."""
        real, imaginary = abs(self.change.real), abs(self.change.imag)
        return f"size: R {real:.2g}, X {imaginary:.2g} ({self.words})"


@dataclass(frozen=True)
class Whole:
    """The impedance of a whole liner or line, and what belongs to it.

    Args:
        frequency: Hz, (F,).  main: index of the frequency that the page is about.
        answer: Z, (F,).
        of_order: Z, (F,), by order of averaging.
        bounds: statistical interval at an index of frequency.
        closure: None without.
        height: m, of the velocity; None where unknown.  sound_speed: m/s.
        moved: whether its closure moves the velocity to the wall.
        of_map: the map itself; None for other results.
        model: of the liner; None where unknown.
    """

    frequency: Tensor
    main: int
    answer: Tensor
    of_order: Callable[[str], Tensor]
    bounds: Bounds
    closure: Closure | None = None
    height: float | None = None
    sound_speed: float = math.nan
    moved: bool = False
    of_map: ImpedanceMap | None = None
    model: LinerModel | None = None

    def at(self, frequency: str) -> int | None:
        """Index of a frequency as a warning prints it."""
        away = (self.frequency / float(frequency) - 1).abs()
        return int(away.argmin()) if float(away.min()) < PRINTED else None


def whole_map(subject: MapSubject) -> Whole:
    """Of a map."""
    result = subject.result
    known = "" if result.closure is None else result.closure.known
    # As ``tdibc.known_pressure`` has it: plane waves, at normal incidence or split from two.
    moved = result.source_side == "normal" or "incident and reflected wave" in known
    return Whole(
        result.frequency, subject.main, result.answer, result.of_liner,
        lambda index: result.bounds_of_liner(result.order, index), result.closure, result.height,
        float(result.fluid.sound_speed), moved, result, subject.model,
    )  # fmt: skip


def whole_line(line: ImpedanceLine) -> Whole | None:
    """Of a line; None where its stations have not been joined."""
    average = line.average
    if average is None:
        return None
    interval = average.interval
    return Whole(
        line.frequency, 0, average.impedance, lambda _: average.impedance,
        lambda index: None if interval is None else interval.bounds(index), line.closure,
        float(line.y[line.used].nanmean()), float(line.fluid.sound_speed),
        line.source_side == "normal",
    )  # fmt: skip


def whole_points(found: Any) -> Whole:
    """Of impedances at points."""
    return Whole(found.frequency, 0, found.answer, lambda _: found.answer,
                 lambda index: found.bounds_of_liner("", index))  # fmt: skip


def closing(known: Whole, said: re.Match[str]) -> Size | None:
    r"""Z' - Z, with Z' the impedance that closes with the velocity as it is.

    The implied pressure is :math:`w V` with :math:`w = (Z + 1)/(2d)` for the incident wave and
    :math:`w = Z/d` for the pressure at the wall, :math:`d = \cos ky + j Z \sin ky` (y = 0 where V
    stays as measured; ``tdibc.closure``). It is q times the known one, so that Z' has
    :math:`w' = w/q`: :math:`Z' = (2 w' c - 1)/(1 - 2 j w' s)` and
    :math:`Z' = w' c/(1 - j w' s)`. Without a known phase that of w is kept.
    """
    closure, index = known.closure, known.at(said["f"])
    if closure is None or index is None or said["order"] not in closure.orders:
        return None
    gap = closure.liner.at(closure.orders.index(said["order"]), index)
    z = complex(known.of_order(said["order"])[index])
    if gap["level"] is None:
        return None
    ratio = cmath.rect(10 ** (gap["level"] / 20), math.radians(gap["phase"] or 0.0))
    height = known.height or 0.0 if known.moved else 0.0
    angle = 2 * math.pi * float(known.frequency[index]) / known.sound_speed * height
    c, s = math.cos(angle), math.sin(angle)
    incident = 1.0 if closure.kind == "incident" else 0.0
    wanted = (z + incident) / (c + 1j * z * s) / ratio
    there = (wanted * c - incident) / (1 - 1j * wanted * s)
    beyond = ", to R below 0, which no liner has" if there.real < 0 else ""
    return Size(there - z, f"the change of Z that closes, were the velocity right{beyond}")


def interval(known: Whole, said: re.Match[str]) -> Size | None:
    """Half the width of the statistical interval: how far a longer record may move Z."""
    bounds = known.bounds(known.main)
    return bounds and Size((bounds[1] - bounds[0]) / 2, "half the statistical interval")


def of_reflection(known: Whole, said: re.Match[str]) -> Size:
    r"""Of an error e of R: :math:`|dZ/dR| e = |Z + 1|^2 e/2`, from Z = (1 + R)/(1 - R).

    The direction is not known, so that it bounds both parts.
    """
    z = complex(known.answer[known.main])
    most = abs(z + 1) ** 2 / 2 * float(said["e"])
    return Size(complex(most, most), f"at most, as an error of {said['e']} in R moves Z")


def stated(known: Whole, said: re.Match[str]) -> Size:
    """The change of Z that the warning itself states."""
    return Size(complex(said["z"]), "as the warning says")


def other_tone(known: Whole, said: re.Match[str]) -> Size:
    """Difference of the two impedances that the warning states."""
    return Size(complex(said["without"]) - complex(said["beside"]), "with the tone less without it")


def added(known: Whole, said: re.Match[str]) -> Size:
    """The resistance that the law adds, which is all of it where it counts twice."""
    return Size(complex(float(said["r"]), 0), "what the law adds for the flow")


def _of_model(known: Whole, other: LinerModel) -> complex:
    """Z of another model less that of the map's, at the rms of v with its mean."""
    result, f = known.of_map, float(known.frequency[known.main])
    assert result is not None and known.model is not None  # noqa: PT018
    square = result.velocity_rms.square() + result.mean_velocity.square()
    speed = float(square.nanmean().sqrt())
    with torch.no_grad():
        return complex(other.impedance(f, speed)) - complex(known.model.impedance(f, speed))


def other_gas(known: Whole, said: re.Match[str]) -> Size | None:
    """Z of the model with that property of the data's gas, less Z with the liner's own."""
    name = said["what"].replace(" ", "_")
    if known.of_map is None or known.model is None or known.model.fluid is None:
        return None
    gas = dataclasses.replace(known.model.fluid, **{name: getattr(known.of_map.fluid, name)})
    change = _of_model(known, known.model.replace(fluid=gas))
    return Size(change, f"of the model at the rms of v, with the {said['what']} of the data")


def other_flow(known: Whole, said: re.Match[str]) -> Size | None:
    """Z of the model with the Mach number of the data, less Z with its own."""
    if known.of_map is None or known.model is None or known.of_map.mach is None:
        return None
    change = _of_model(known, known.model.with_numbers({"mach": known.of_map.mach}))
    return Size(change, "of the model at the rms of v, with the Mach number of the data")


def between_orders(known: Whole, said: re.Match[str]) -> Size | None:
    """Z with probes first less the answer: what averaging over so long a cell does."""
    if known.of_map is None:
        return None
    change = complex(known.of_order(ORDERS[0])[known.main] - known.answer[known.main])
    return Size(change, "probes first less the answer")


def left_out(known: Whole, said: re.Match[str]) -> Size | None:
    """Share s that is left out, times the standard deviation over the probes.

    A mean over all is off that of the rest by s (mean of those left out - mean of the rest), which
    nobody knows; it is s sigma where these two are one standard deviation sigma apart.
    """
    if known.of_map is None:
        return None
    share = float(said["n"]) / float(said["of"])
    change = share * complex(known.of_map.liner_spread[known.main])
    if not change:  # of one probe there is no spread
        return None
    return Size(change, "if those left out lie one spread over the probes off")


def still(known: Whole, said: re.Match[str]) -> Size | None:
    """Z with probes first of the probes that move, less that of all."""
    result = known.of_map
    if result is None:
        return None
    moving = result.velocity_rms > ROUNDING * result.mean_velocity.abs()
    return _of_probes(known, known.main, moving.reshape(-1), result.averaged_admittance,
                      "probes first, without them")  # fmt: skip


def filtered(known: Whole, said: re.Match[str]) -> Size | None:
    """Z with probes first without the filter, less that with it."""
    result, index = known.of_map, known.at(said["f"])
    if result is None or index is None:
        return None
    every = torch.ones(result.velocity_rms.numel(), dtype=torch.bool)
    return _of_probes(known, index, every, result.admittance, "probes first, without the filter")


def _of_probes(known: Whole, index: int, kept: Tensor, admittance: Tensor, words: str) -> Size | None:
    """Mean over some probes of an admittance, as Z, less that of the map."""
    assert known.of_map is not None
    flat = admittance.reshape(len(kept), -1)[:, index]
    flat = flat[kept & torch.isfinite(flat.real)]
    if not len(flat):
        return None
    there = complex(mean_impedance(flat[:, None])[0])
    return Size(there - complex(known.of_map.liner_impedance[index]), words)


def unknown(known: Whole, said: re.Match[str]) -> None:
    """Nothing that the result holds says how much."""


class Kind(NamedTuple):
    """Warnings of one kind: a rank of what they mean, their words, their size."""

    rank: int
    words: str
    size: Callable[[Whole, re.Match[str]], Size | None]


# The first whose words are in a warning is its kind. By rank: what makes Z another quantity; what
# it rests on is wrong; what it rests on is doubtful; what a short record does.
KINDS: Sequence[Kind] = (
    Kind(0, "another file now|: failed: |null test", unknown),
    Kind(1, r"closure at (?P<f>\S+) Hz fails, (?P<order>[^:]+):", closing),
    Kind(1, "closure at .* fails", unknown),
    Kind(2, r"law of liner .* adds (?P<r>\S+) rho c of resistance", added),
    Kind(2, r"(?P<what>sound speed|density) is \S+ \S+ in the liner and", other_gas),
    Kind(2, "mach is .* in the liner and", other_flow),
    Kind(3, r"closure at (?P<f>\S+) Hz is open, (?P<order>[^:]+):", closing),
    Kind(4, r"it would be about (?P<without>\S+j) instead of (?P<beside>\S+j) at", other_tone),
    Kind(4, r"off by up to (?P<e>[\d.e+-]*\d)", of_reflection),
    Kind(4, r"may move R by as much", unknown),
    Kind(4, r"gives R off by (?P<e>[\d.e+-]*\d) at", of_reflection),
    Kind(4, "counts as one cell", between_orders),
    Kind(7, "error bars rest on", interval),
    Kind(7, "no error bars|no statistical interval", unknown),
    Kind(4, "fewer than .*periods|samples per period|beyond|wavelengths|too short", unknown),
    Kind(5, r"(?P<n>\d+) of (?P<of>\d+) probes hold nan or inf; excluded", left_out),
    Kind(5, "probes are (exactly 0|constant)", still),
    Kind(5, r"wall filter: .* with (?P<f>\S+) Hz and count as wall", filtered),
    Kind(5, "excluded|no probe|lost", unknown),
    Kind(6, r"admittances is off by about (?P<z>\S+j) in Z at", stated),
    Kind(7, "error bars|interval|blocks", unknown),
    Kind(6, "", unknown),
)
