r"""How far what a warning is about may move R and X, from numbers that the result itself holds.

Warnings are told apart by their codes. Where no such number follows there is no size: none is guessed.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from torchliner.conversions import mean_impedance
from torchliner.liners.model import LinerModel
from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.notes import Note
from torchliner.report.page.subject import MapSubject

ROUNDING = 1e-6  # of a mean velocity, by which a constant one may seem to move
UNRANKED = 4


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


Sizing = Callable[[MapSubject, Note], Size | None]


def passing(result: ImpedanceMap | ImpedanceLine, note: Note) -> Size | None:
    r"""Z' - Z, with Z' the impedance that passes the level check with the velocity as it is.

    The implied pressure is :math:`w V` with :math:`w = (Z + 1)/(2d)` for the incident wave and
    :math:`w = Z/d` for the pressure at the wall, :math:`d = \cos ky + j Z \sin ky` (y = 0 where V
    stays as measured; ``velocity.level_check``). It is q times the known one, so that Z' has
    :math:`w' = w/q`: :math:`Z' = (2 w' c - 1)/(1 - 2 j w' s)` and
    :math:`Z' = w' c/(1 - j w' s)`. Without a known phase that of w is kept.
    """
    check, frequencies = result.level_check, result.frequency.tolist()
    if check is None:
        return None
    texts = [check.sentence(check.averaging, f, i) for i, f in enumerate(frequencies)]
    index = next((i for i, text in enumerate(texts) if text and text in note.text), None)
    if index is None:
        return None
    gap = check.liner.at(check.averagings.index(check.averaging), index)
    # As ``pressure.known_pressure`` has it: plane waves, at normal incidence or split from two.
    moved = result.source_side == "normal" or "incident and reflected wave" in check.known
    height = result.height if isinstance(result, ImpedanceMap) else float(result.y[result.used].nanmean())
    angle = 2 * math.pi * frequencies[index] / float(result.fluid.sound_speed) * (height or 0.0) * moved
    c, s = math.cos(angle), math.sin(angle)
    z, incident = complex(result.answer[index]), 1.0 if check.kind == "incident" else 0.0
    ratio = cmath.rect(10 ** ((gap["level"] or 0.0) / 20), math.radians(gap["phase"] or 0.0))
    wanted = (z + incident) / (c + 1j * z * s) / ratio
    there = (wanted * c - incident) / (1 - 1j * wanted * s)
    beyond = ", to R below 0, which no liner has" if there.real < 0 else ""
    return Size(there - z, f"the change of Z that passes, were the velocity right{beyond}")


def interval(subject: MapSubject, note: Note) -> Size | None:
    """Half the width of the statistical interval: how far a longer record may move Z."""
    bounds = subject.result.bounds_of_liner(subject.result.averaging, subject.main)
    return bounds and Size((bounds[1] - bounds[0]) / 2, "half the statistical interval")


def stated(subject: MapSubject, note: Note) -> Size | None:
    """What the warning itself states, for either part."""
    return None if note.size is None else Size(complex(note.size, note.size), "at most, as the warning says")


def of_reflection(subject: MapSubject, note: Note) -> Size | None:
    r"""Of an error e of R: :math:`|dZ/dR| e = |Z + 1|^2 e/2`, from Z = (1 + R)/(1 - R).

    The direction is not known, so that it bounds both parts.
    """
    if note.size is None:
        return None
    most = abs(complex(subject.result.answer[subject.main]) + 1) ** 2 / 2 * note.size
    return Size(complex(most, most), f"at most, as an error of {note.size:.2g} in R moves Z")


def added(subject: MapSubject, note: Note) -> Size | None:
    """The resistance that the law adds, which is all of it where it counts twice."""
    return None if note.size is None else Size(complex(note.size, 0), "what the law adds for the flow")


def _of_model(subject: MapSubject, other: LinerModel, words: str) -> Size:
    """Z of another model less that of the map's, at the rms of v with its mean."""
    result, f = subject.result, float(subject.result.frequency[subject.main])
    speed = float((result.velocity_rms.square() + result.mean_velocity.square()).nanmean().sqrt())
    with torch.no_grad():
        change = complex(other.impedance(f, speed)) - complex(subject.model.impedance(f, speed))
    return Size(change, f"of the model at the rms of v, with the {words} of the data")


def other_gas(subject: MapSubject, note: Note) -> Size | None:
    """Z of the model with the data's gas, less Z with the liner's own."""
    if subject.model is None or subject.model.fluid is None:
        return None
    gas = subject.result.fluid
    gas = dataclasses.replace(subject.model.fluid, sound_speed=gas.sound_speed, density=gas.density)
    return _of_model(subject, subject.model.replace(fluid=gas), "gas")


def between_averagings(subject: MapSubject, note: Note) -> Size:
    """Averaging ``admittance`` less the answer: what averaging over so long a cell does."""
    result = subject.result
    change = complex((result.liner["admittance"].impedance - result.answer)[subject.main])
    return Size(change, "averaging admittance less the answer")


def left_out(subject: MapSubject, note: Note) -> Size | None:
    """Share s that is left out, times the standard deviation over the probes.

    A mean over all is off that of the rest by s (mean of those left out - mean of the rest), which
    nobody knows; it is s sigma where these two are one standard deviation sigma apart.
    """
    share = float(torch.isnan(subject.result.velocity_rms).double().mean())
    change = share * complex(subject.result.liner_spread[subject.main])
    return Size(change, "if those left out lie one spread over the probes off") if change else None


def still(subject: MapSubject, note: Note) -> Size | None:
    """Averaging ``admittance`` over the probes that move, less that over all."""
    result = subject.result
    if result.wall is not None:
        return None
    moving = result.velocity_rms > ROUNDING * result.mean_velocity.abs()
    return _of_probes(subject, moving, "averaging admittance, without them")


def filtered(subject: MapSubject, note: Note) -> Size | None:
    """Averaging ``admittance`` without the filter, less that with it."""
    every = torch.ones_like(subject.result.velocity_rms, dtype=torch.bool)
    return _of_probes(subject, every, "averaging admittance, without the filter")


def _of_probes(subject: MapSubject, kept: Tensor, words: str) -> Size | None:
    """Mean over some probes of the admittance, as Z, less that of the map."""
    result, index = subject.result, subject.main
    admittance = result.probes["admittance"].admittance[..., index]
    flat = admittance[kept & torch.isfinite(admittance.real)]
    if not len(flat):
        return None
    there = complex(mean_impedance(flat[:, None])[0])
    return Size(there - complex(result.liner["admittance"].impedance[index]), words)


# By code: a rank, and a size. By rank: what makes Z another quantity; what it rests on is wrong; what it rests on is
# doubtful; what a short record does.
KINDS: dict[str, tuple[int, Sizing | None]] = {
    "changed-input": (0, None),
    "null-test": (0, None),
    "level-check": (1, lambda subject, note: passing(subject.result, note)),
    "flow-counted-twice": (2, added),
    "no-mach": (2, None),
    "gas": (2, other_gas),
    "other-tone": (3, stated),
    "model-misfit": (1, None),
    "model-table": (3, of_reflection),
    "no-cell-pitch": (3, between_averagings),
    "excluded-probes": (5, left_out),
    "probes-at-rest": (5, still),
    "constant-probes": (5, still),
    "wall-filter": (5, filtered),
    "biased-mean": (6, stated),
    "few-blocks": (6, interval),
    "no-intervals": (6, None),
    "long-window": (6, None),
}
