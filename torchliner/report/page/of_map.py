"""The page of an impedance map: its sections, in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torchliner.report.page import asked, compared, moved, origin, seen, velocity, warned
from torchliner.report.page.answer import answers, sentence, state
from torchliner.report.page.blocks import Block, Section, Text
from torchliner.report.page.render import Page
from torchliner.report.page.subject import MapSubject
from torchliner.version import __version__


@dataclass(frozen=True)
class Part:
    """One section: its anchor, its title and what makes its blocks of a subject."""

    name: str
    title: str
    blocks: Callable[[Any], list[Block]]


def error_bars(subject: MapSubject) -> list[Block]:
    """In one line."""
    result = subject.result
    if result.level is None:
        return [Text("The map has no statistical intervals.")]
    return [Text(
        f"Each interval holds the impedance that a record without end would give in {100 * result.level:g} % of "
        f"such records, by a jackknife over {result.choices.get('blocks', '?')} blocks of time; it says nothing of "
        "how Z differs from place to place, of a wrong model or of a wrong pressure."
    )]  # fmt: skip


PARTS = (
    Part("answers", "Answer", answers),
    Part("warnings", "Warnings", warned.of_map),
    Part("asked", "What was asked", asked.asked),
    Part("map", "Map of resistance and reactance", seen.over_liner),
    Part("along", "Along x", seen.along_x),
    Part("cells-section", "Cells", compared.cells),
    Part("complex", "Complex plane", seen.in_complex_plane),
    Part("frequencies", "Spectrum", seen.spectrum),
    Part("speeds-section", "Velocity", velocity.velocity),
    Part("moves", "Which choices move the result", moved.moved),
    Part("bars", "Error bars", error_bars),
    Part("comparison", "Comparison", compared.compared),
    Part("origin", "Inputs and provenance", origin.origin),
    Part("cite", "Citation", origin.citation),
)


def page_of_map(subject: MapSubject) -> Page:
    """The whole page."""
    result = subject.result
    name = result.title or (subject.path.name if subject.path else "")
    return Page(
        f"Impedance map: {name}" if name else "Impedance map",
        sentence(subject), state(result, subject.main),
        [Section(part.name, part.title, part.blocks(subject)) for part in PARTS],
        FOOTER,
    )  # fmt: skip


FOOTER = (
    f"torchliner {__version__}. Impedances are normalised by ρc, with the time factor e^(+jωt) and "
    "the velocity into the liner."
)
