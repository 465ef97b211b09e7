"""Every choice between bursts and averages, in one validated place; those of the eduction itself are a plane's."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from torchliner.bursts.stations import BurstFilters
from torchliner.checks import make_plain, require_choice, require_positive
from torchliner.names import CORRECTIONS, FLAGGED, GRID_METHODS, STATION_WINDOWS
from torchliner.velocity.choices import Choices

NAMED = {"method": GRID_METHODS, "correction": CORRECTIONS, "window": STATION_WINDOWS, "flagged": FLAGGED}
MOST_DRAWS = 1_000_000
OF_PLANES = {"averaging": "admittance", "background": None, "missing": "refuse"}  # what a single place has


@dataclass(frozen=True)
class StationChoices:
    """From bursts to segments and from segments to averages.

    Args:
        method: of the reconstruction between arrivals: ``linear`` (the paper), ``hold`` or ``band-limited``.
        grid_rate: Hz; default twice the mean rate, with a tone at least 16 whole steps a period.
        band_limit: of ``band-limited``, Hz; default a quarter of the station's mean rate.
        correction: what is put back of what the reconstruction took from the stated tone, else from a single frequency
            asked for: ``tone``, its line; ``tone-and-noise``, also the noise made of it is taken out; ``none`` (the
            paper).
        segment: length of a segment, s (the paper: 1).
        overlap: share of a segment that the next one covers too (the paper: 0.5).
        window: of a segment: ``whole-periods``, each of which weighs alike, or ``hann`` on the reflected signal (the
            paper).
        flagged: stations with doubtful bursts: ``exclude`` from the averages or ``use`` them.
        monte_carlo: draws of (5.2) (the paper: 5000).
        filters: which bursts count.
    """

    method: str = "linear"
    grid_rate: float | None = None
    band_limit: float | None = None
    correction: str = "tone"
    segment: float = 1.0
    overlap: float = 0.5
    window: str = "whole-periods"
    flagged: str = "exclude"
    monte_carlo: int = 5000
    filters: BurstFilters = field(default_factory=BurstFilters)

    def __post_init__(self) -> None:
        make_plain(self)
        for name, known in NAMED.items():
            require_choice(name, getattr(self, name), known)
        require_positive("segment (s)", self.segment)
        if self.band_limit is not None and self.method != "band-limited":
            raise ValueError(f"band_limit is for method 'band-limited', not {self.method!r}; leave it out")
        if not 0 <= self.overlap < 1:
            raise ValueError(f"overlap is {self.overlap:g}; it is a share of a segment, 0 to below 1")
        if not 2 <= self.monte_carlo <= MOST_DRAWS:
            raise ValueError(f"monte_carlo is {self.monte_carlo}; it is 2 to {MOST_DRAWS} draws")


def split_choices(options: dict[str, Any]) -> tuple[StationChoices, Choices]:
    """Those of stations, and those of the eduction of a single place.

    Raises:
        ValueError: a choice that is for planes of many probes.
    """
    of_stations = {key: options[key] for key in options.keys() & StationChoices.__dataclass_fields__.keys()}
    rest = OF_PLANES | {key: value for key, value in options.items() if key not in of_stations}
    for name, only in OF_PLANES.items():
        if rest[name] != only:
            raise ValueError(f"{name} is {rest[name]!r}; it is for planes of many probes: leave {name} out")
    return StationChoices(**of_stations), Choices(**rest)
