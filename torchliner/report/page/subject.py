"""What a report of a map is about: the map, where it was, the data behind it, its liner."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from torchliner.engine.moments import SETTINGS, Moments
from torchliner.liners.catalogue import load_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.same_case import require_same_case
from torchliner.report.page.blocks import shown
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments

MOST_DRAWN = 3  # frequencies with figures of their own
MOST_SURFACE = 40_000  # probes of a picture over (x, z)
MOST_LINE = 4_000  # probes of a line, or scattered ones
INPUT = {"what": str, "name": str, "bytes": int, "kind": str, "hash": str}  # of one that is stored
SAME_STATISTICS = 1e-3  # of v, relative to its rms: two records of a flow never agree as well
PROBES = ("mean_velocity", "velocity_rms", "velocity_amplitude", "coherence", "phase_rule", "wall")


@dataclass(frozen=True)
class MapSubject:
    """A map and what is known beside it.

    Args:
        result: the map.  path: of its file; None where it is in memory alone.
        known: moments of the data behind it; None where they are not given.
        data: file of these.
        model: the liner as a model; None where it cannot be made of what the map holds.
        without: why not, and what is needed.
    """

    result: ImpedanceMap
    path: Path | None = None
    known: Moments | None = None
    data: Path | None = None
    model: Any = None
    without: str = ""

    @functools.cached_property
    def main(self) -> int:
        """Index of the frequency of the data's tone, else of that at which v is most coherent."""
        if self.result.tone is not None:
            return self.result.tone
        flat = self.result.coherence.reshape(-1, len(self.result.frequency)).double()
        median = flat.nanmedian(0).values.nan_to_num(-1)
        return int(median.argmax()) if bool((median > 0).any()) else 0

    @property
    def drawn(self) -> Sequence[int]:
        """Indices of the frequencies that have figures of their own."""
        count = len(self.result.frequency)
        return range(count) if count <= MOST_DRAWN else (self.main,)

    @functools.cached_property
    def thinned(self) -> tuple[ImpedanceMap, str]:
        """The map with probes few enough to draw, and words where some were left out."""
        return thin(drawable(self.result))


def subject_of(result: ImpedanceMap, path: Path | None = None, data: Any = None, liner: Any = None) -> MapSubject:
    """A map with the data behind it.

    Args:
        result: the map.  path: of its file.
        data: the plane that it was educed from, or its moments; None for neither.
        liner: model of the map; default the preset of its name, if that has the same numbers.
    Raises:
        ValueError: the data are not those of the map; the liner is another one.
    """
    model, without = _model_of(result, liner)
    known = None if data is None else _known(result, data, model)
    name = None if known is None else Path(known.plane.name.split(":/")[0])
    return MapSubject(result, path, known, name, model, without)


def inputs_of(result: Any) -> list[Mapping[str, Any]]:
    """The inputs that a result, and what stands beside it, hold."""
    every = (result, *getattr(result, "alongside", ()))
    lists = [each.choices.get("inputs") for each in every]
    if isinstance(data := result.choices.get("data"), Mapping):
        lists.append(data.get("inputs"))  # behind moments
    found = [each for one in lists if isinstance(one, list) for each in one]
    return [each for i, each in enumerate(found) if isinstance(each, Mapping)
            and all(isinstance(each.get(key), kind) for key, kind in INPUT.items())
            and each not in found[:i]]  # fmt: skip


def _model_of(result: ImpedanceMap, liner: Any) -> tuple[Any, str]:
    """The model of a map: that given, else one of the numbers that the map holds; or why none."""
    stated = plain(dict(result.choices.get("liner") or {}))
    name = shown(stated.get("name", ""))
    if liner is None:
        if stated.get("model") == "python":
            return None, (
                f"The liner {name!r} is a Python file, which is run only where you name it: "
                f"--liner {shown(stated.get('file', ''))}, or liner= in Python, as it was with the "
                f"SHA-256 {shown(stated.get('sha256', ''))}."
            )
        try:
            found = load_liner(stated)
        except (ValueError, TypeError, KeyError) as error:
            return None, (
                f"The map does not hold all numbers of the liner {name!r}, of the model "
                f"{shown(stated.get('model', 'not stated'))!r}; name its file (--liner), or give "
                f"the model in Python (liner=). {shown(error)}."
            )
        return found, ""
    found = plain(liner.describe())
    off = [key for key in found if key in stated and found[key] != stated[key] and key != "name"]
    if off or not stated:
        raise ValueError(
            f"the liner {found.get('name', '')!r} is not that of the map, {name!r}: it differs in "
            f"{', '.join(off)}; name the one that the map was educed with, or leave it out"
        )
    return liner, ""


def plain(value: Any) -> Any:
    """As it comes back from JSON."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def _known(result: ImpedanceMap, data: VelocityPlane | Moments, model: Any) -> Moments:
    """Moments of the data that the map was educed from."""
    plane = data.plane if isinstance(data, Moments) else data
    label = SimpleNamespace(
        name=result.title or "the map", height=result.height,
        provenance=dict(result.choices.get("data") or {}),
    )  # fmt: skip
    remedy = "name the plane, or its moments, that the map was educed from"
    require_same_case(label, plane, ("height",), remedy)
    shape = tuple(result.mean_velocity.shape)
    pairs: list[tuple[str, Any, Any]] = [("probes", shape, tuple(plane.probe_shape))]
    pairs += [("samples", result.choices.get("samples", plane.samples), plane.samples)]
    for what, mine, theirs in pairs:
        if mine != theirs:
            raise ValueError(f"{plane.name} has other {what} than the map, {theirs} for {mine}; "
                             f"{remedy}")  # fmt: skip
    if isinstance(data, VelocityPlane):
        kept = {key: result.choices.get(key) for key in (*SETTINGS, "dtype")}
        if result.choices.get("incident") is not None:  # replayed, with the phase of its own signal
            del kept["phase"]
        kept = {key: value for key, value in kept.items() if value is not None}
        smooth = model is None or model.speed_max is None
        pitch = (result.choices.get("liner") or {}).get("cell_pitch")
        asked = None if plane.frequency else result.frequency
        data = moments(data, None if smooth else model, asked,
                       **({"cell_pitch": pitch} if smooth else {}), **kept)  # fmt: skip
    seen = data.survey
    rms = result.velocity_rms.reshape(-1).double()
    away = [(a - b.reshape(-1)).abs().cpu() / rms.square().nanmean().sqrt()
            for a, b in ((seen.rms, rms), (seen.mean, result.mean_velocity))]  # fmt: skip
    worst = max(float(each.nan_to_num(0).max()) for each in away)
    if worst > SAME_STATISTICS:
        raise ValueError(
            f"{plane.name}: mean or rms of v is off that of the map by {worst:.2g} of its rms at some probe; {remedy}"
        )
    return data


def base_choices(result: ImpedanceMap, without: Sequence[str] = ()) -> dict[str, Any]:
    """Choices of ``educe`` that lead to the map and are not the defaults, without those named."""
    usual = Choices().describe()
    return {
        key: value
        for key, value in result.choices.items()
        if key in usual and key not in without and value != usual[key]
    }


def drawable(result: ImpedanceMap) -> ImpedanceMap:
    """Names from the file as printable text, not as formulas of the drawing library."""

    def printed(text: str) -> str:
        return shown(text).replace("$", r"\$")

    return dataclasses.replace(
        result,
        title=printed(result.title),
        reference={printed(name): value for name, value in result.reference.items()},
        alongside=tuple(dataclasses.replace(o, name=printed(o.name)) for o in result.alongside),
    )


def thin(result: ImpedanceMap) -> tuple[ImpedanceMap, str]:
    """Every n-th probe, of rows and of columns of a grid; the averages stay those of all."""
    shape = tuple(result.mean_velocity.shape)
    most = MOST_SURFACE if len(shape) == 2 and min(shape) > 1 else MOST_LINE
    steps = [1] * len(shape)
    while math.prod(-(-n // s) for n, s in zip(shape, steps, strict=True)) > most:
        longest = max(range(len(shape)), key=lambda axis: shape[axis] / steps[axis])
        steps[longest] += 1
    if max(steps, default=1) == 1:
        return result, ""
    cut = tuple(slice(None, None, step) for step in steps)

    def some(value: Tensor | None) -> Tensor | None:
        return None if value is None else value[cut]

    fields: Any = {name: some(getattr(result, name)) for name in PROBES}
    left = dataclasses.replace(
        result,
        **fields,
        probes={name: each.map(lambda value: value[cut]) for name, each in result.probes.items()},
        along_x={name: each.map(lambda value: value[cut[-1]]) for name, each in result.along_x.items()},
        x=None if result.x is None else result.x[cut[-1]],
        z=None if result.z is None else result.z[cut[0]],
    )
    few, words = left.mean_velocity.numel(), " x ".join(map(str, steps))
    return left, (
        f"Drawn and listed: {few:,} of {math.prod(shape):,} probes, one of each {words}; all of "
        "them are in the map's file, and all averages are of all."
    )


def at_probes(value: Tensor) -> Tensor:
    """Finite values of all probes, flat, float64."""
    flat = value.detach().cpu().reshape(-1).to(torch.float64)
    return flat[torch.isfinite(flat)]
