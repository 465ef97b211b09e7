"""Units of a campaign: a plane with a liner and choices, and what tells whether it is done."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.campaign.campaign_file import Campaign, Case
from torchliner.engine.moments import SETTINGS, Moments
from torchliner.io.moments_file import holds_moments, read_moments
from torchliner.io.planes import read_plane
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import LinerModel
from torchliner.names import __version__
from torchliner.records import VelocityPlane
from torchliner.records.origin import input_file
from torchliner.records.velocity_plane import restated
from torchliner.velocity.choices import Choices

REDUCED = (*SETTINGS, "device", "dtype")


@dataclass(frozen=True)
class Unit:
    """What is educed by itself."""

    name: str  # of its files
    case: Case
    campaign: Campaign
    liner: str  # preset or path
    model: LinerModel
    choices: Mapping[str, Any]  # of ``educe``
    hash: str  # of everything that its results depend on
    request: Mapping[str, Any] | None  # of ``torchliner.moments``; None where moments are what the case names
    moments: Path  # their file, which other units may share
    samples: int  # of the plane
    bytes: int  # of its velocity

    def plane(self) -> VelocityPlane:
        """Its velocity still in the file, with its tone alone stated: moments outlive a change of other facts."""
        tone = {name: value for name, value in self.case.facts.items() if name == "frequency"}
        return _plane_of(dataclasses.replace(self.case, facts=tone))

    def known(self) -> Moments:
        """The moments, with the facts of the campaign's file."""
        return _moments_of(self.case, self.moments)


def units_of(case: Case, campaign: Campaign) -> list[Unit]:
    """Every liner with every set of choices.

    Raises:
        OSError, ValueError: the plane, a liner or a pressure record cannot be read.
    """
    reduced = holds_moments(case.path)
    if reduced and case.request:
        raise ValueError(f"{case.path} holds moments, which are read as they are: leave out {', '.join(case.request)}")
    plane = _moments_of(case, case.path).plane if reduced else _plane_of(case)
    if not case.liners and plane.liner not in preset_names():
        fault = f"names {plane.liner!r}, which is no preset" if plane.liner else "names no liner"
        raise ValueError(f"{case.shown} {fault}; state liner in [[planes]], or liners: {', '.join(preset_names())}")
    data = [input_file("", path)["hash"] for path in case.files()]
    beside = None if case.in_situ is None else input_file("", case.in_situ)["hash"]
    asked = campaign.frequencies
    locked = any(Choices(**one).averaging == "phase-locked" for one, _ in campaign.choices)
    found = []
    for liner in case.liners or (plane.liner,):
        model = load_liner(liner)
        content = _digest(sorted(model.describe().items()), *(Path(name).read_bytes() for name in model.files))
        for choices, varied in campaign.choices:
            request = None if reduced else _reduction(plane, model, asked, choices, locked)
            plain = request and sorted((name, value) for name, value in request.items() if name != "liner")
            of_liner = content if request and request["liner"] else ""
            sums = (data, sorted(case.request.items()), plane.frequency, plain, of_liner, __version__)
            facts = (sorted(case.facts.items()), sorted(choices.items()))
            words = [case.name, Path(liner).stem, *(f"{k}={v}" for k, v in varied.items())]
            unit = Unit(
                name="__".join(re.sub(r"[^\w.=+-]+", "-", word) for word in words),
                case=case,
                campaign=campaign,
                liner=liner,
                model=model,
                choices=choices,
                hash=_digest(sums, facts, content, asked, beside, campaign.figures),
                request=request,
                moments=case.path if reduced else campaign.output / "moments" / f"{case.name}-{_digest(*sums)}.h5",
                samples=plane.samples,
                bytes=plane.velocity.dtype.itemsize * plane.samples * plane.probes,
            )
            found.append(unit)
    return found


def _plane_of(case: Case) -> VelocityPlane:
    """With the facts of the campaign's file, called as that file calls it; velocity stays in its file."""
    plane = read_plane(case.path, lazy=True, **case.request)
    return dataclasses.replace(restated(plane, case.facts), name=case.shown)


def _moments_of(case: Case, path: Path) -> Moments:
    """The same of moments.

    Raises:
        ValueError: another tone than the one that their blocks were cut for.
    """
    known = read_moments(path)
    tone, made = case.facts.get("frequency"), known.plane.frequency
    if tone is not None and tone != made:
        raise ValueError(
            f"{case.shown} holds moments that were reduced with {made or 0:g} Hz, and frequency = {tone:g} is stated: "
            "leave it out, or name the plane that was reduced"
        )
    return dataclasses.replace(known, plane=dataclasses.replace(restated(known.plane, case.facts), name=case.shown))


def _reduction(
    plane: VelocityPlane, model: LinerModel, frequencies: tuple[float, ...], choices: Mapping[str, Any], locked: bool
) -> dict[str, Any]:
    """Moments that serve as many units as can share them: those of any liner, if it is smooth in |v|; of the averaging
    that contains the others; at the tone unless other lines are needed."""
    chosen = Choices(**choices)
    kept = {name: value for name, value in choices.items() if name in REDUCED}
    kept["averaging"] = "phase-locked" if locked else "admittance"
    at_asked = chosen.phase != "averaged" or chosen.wall_filter is not None
    at_asked |= chosen.drive == "running-rms" and chosen.running_window is None  # one period
    kept["frequency"] = list(frequencies) if frequencies and (at_asked or not plane.frequency) else None
    if model.speed_max is not None:
        return {"liner": model, **kept}
    return {"liner": None, "cell_pitch": model.cell_pitch, **kept}


def _digest(*facts: Any) -> str:
    """Sixteen letters of anything that prints alike each time."""
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]
