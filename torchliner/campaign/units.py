"""Units of a campaign: a plane with a liner and choices, and what tells whether it is done."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchliner.campaign.campaign_file import Campaign, Case
from torchliner.campaign.inputs import (
    data_fingerprint,
    digest,
    fingerprint,
    open_moments,
    open_plane,
    with_case_facts,
)
from torchliner.engine.moments import SETTINGS
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.velocity_plane import restated
from torchliner.velocity.choices import Choices
from torchliner.version import __version__

SUMMED = ("frequency",)  # facts that moments depend on
REDUCED = (*SETTINGS, "device", "dtype")


@dataclass(frozen=True)
class Unit:
    """What is educed by itself.

    Args:
        name: of its files.
        case, campaign: that it is of.
        liner: preset or path.
        model: it.
        choices: of ``educe``.
        hash: of everything that its results depend on.
        request: arguments of ``torchliner.moments`` for those that it is educed from, which other
            units may share; None where moments are what the case names.
        moments: their file.
        samples, bytes: of the plane's velocity.
    """

    name: str
    case: Case
    campaign: Campaign
    liner: str
    model: LinerModel
    choices: Mapping[str, Any]
    hash: str
    request: Mapping[str, Any] | None
    moments: Path
    samples: int
    bytes: int

    def plane(self) -> VelocityPlane:
        """Its velocity still in the file, and stated of it what moments depend on: the other facts
        may change while the moments stay."""
        facts = {name: self.case.facts[name] for name in SUMMED if name in self.case.facts}
        return stated_plane(dataclasses.replace(self.case, facts=facts))


def stated_plane(case: Case) -> VelocityPlane:
    """A plane with the facts of the campaign's file, called as that file calls it."""
    plane = open_plane(case.path, case.request)
    return dataclasses.replace(restated(plane, case.facts), name=case.shown)


def units_of(case: Case, campaign: Campaign) -> list[Unit]:
    """Every liner with every set of choices.

    Raises:
        OSError, ValueError: the plane, a liner or a pressure record cannot be read.
    """
    known = open_moments(case.path, case.request)
    plane = (
        stated_plane(case) if known is None
        else with_case_facts(known, case.facts, case.shown).plane
    )  # fmt: skip
    data = data_fingerprint(case.path, case.request)
    if not case.liners and plane.liner not in preset_names():
        fault = f"names {plane.liner!r}, which is no preset" if plane.liner else "names no liner"
        raise ValueError(
            f"{case.shown} {fault}; state liner in [[planes]], or liners: "
            f"{', '.join(preset_names())}, or a .toml or .csv file"
        )
    beside = None if case.in_situ is None else fingerprint(case.in_situ)
    facts, asked = sorted(case.facts.items()), campaign.frequencies
    locked = any(Choices(**one).averaging == "phase-locked" for one, _ in campaign.choices)
    found = []
    for liner in case.liners or (plane.liner,):
        model, content = _loaded(liner)
        for choices, varied in campaign.choices:
            request = None if known else _reduction(plane, model, asked, choices, locked)
            reduced = (data, sorted(case.request.items()), SUMMED, plane.frequency, _plain(request),
                       content if request and request["liner"] else "", __version__)  # fmt: skip
            summed = campaign.output / "moments" / f"{case.name}-{digest(*reduced)}.h5"
            every = (reduced, facts, content, asked, sorted(choices.items()), beside,
                     campaign.figures)  # fmt: skip
            words = [case.name, Path(liner).stem, *(f"{k}={v}" for k, v in varied.items())]
            found.append(Unit(
                "__".join(re.sub(r"[^\w.=+-]+", "-", word) for word in words), case, campaign,
                liner, model, choices, digest(*every), request, case.path if known else summed,
                plane.samples, plane.velocity.dtype.itemsize * plane.samples * plane.probes,
            ))  # fmt: skip
    return found


def _reduction(
    plane: VelocityPlane, model: LinerModel, frequencies: tuple[float, ...],
    choices: Mapping[str, Any], locked: bool,
) -> dict[str, Any]:  # fmt: skip
    """Moments that serve as many units as can share them: those of any liner, if it is smooth in
    |v|; of the averaging that contains the others; at the tone unless other lines are needed."""
    chosen = Choices(**choices)
    kept = {name: value for name, value in choices.items() if name in REDUCED}
    kept["averaging"] = "phase-locked" if locked else "admittance"
    at_asked = chosen.phase != "averaged" or chosen.wall_filter is not None
    at_asked |= chosen.drive == "running-rms" and chosen.running_window is None  # one period
    frequency = list(frequencies) if frequencies and (at_asked or not plane.frequency) else None
    one = model.speed_max is not None
    return {"liner": model if one else None, "frequency": frequency,
            "cell_pitch": None if one else model.cell_pitch, **kept}  # fmt: skip


def _plain(request: Mapping[str, Any] | None) -> Any:
    return request and sorted((name, value) for name, value in request.items() if name != "liner")


def _loaded(liner: str) -> tuple[LinerModel, str]:
    """A liner, and a digest of all it was made of."""
    model = load_liner(liner)
    content = (Path(name).read_bytes() for name in model.files)
    return model, digest(sorted(model.describe().items()), *content)
