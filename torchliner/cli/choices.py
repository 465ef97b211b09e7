"""The choices of an eduction, and what is said of plane files, as options: from the functions that take them."""

from __future__ import annotations

from typing import Any

from torchliner import names
from torchliner.cli.options import INDEX, NUMBER, QUIET, Option, group
from torchliner.cli.signatures import of

SHOWN = (  # by --help
    "averaging phase drive mean interval background level_matched wall_filter device dtype kernel window segment"
)
ALL = (
    "averaging phase reference_phase drive running_window mean wall_filter missing background minimum_coherence "
    "interval no_intervals level_limit level_uncertainty level_matched allow_short device dtype"
)
NO_GIVEN_PHASE = {"kind": [rule for rule in names.PHASES if rule != "given"]}


def choices(wanted: str = ALL, **changes: dict[str, Any]) -> list[Option]:
    """Options of ``Choices``; the others than ``SHOWN`` wait for --help-all."""
    about: dict[str, Any] = {"shown": SHOWN, "group": "choices"}
    found: list[Option] = []
    for name in wanted.split():
        if name == "no_intervals":
            found.append(Option("--no-intervals", "no error bars", further=True, group="choices"))
            continue
        home = "velocity.educe:educe" if name == "reference_phase" else "velocity.choices:Choices"
        own = {"reference_phase": {"kind": NUMBER}, "background": {"kind": QUIET, "nargs": "+"}}
        usual: Any = own.get(name, {})
        about[name] = usual | changes.get(name, {})
        found += of(home, name, **about)
    return found


EDUCED = choices()
SELECTION = of("io.planes:read_plane", "start stop every region", group="part of the data")
STATED = of(
    "io.plane_format:PlaneRequest",
    "variable group axes velocity_units length_units sampling_rate normal row wall_normal_component x z points holes "
    "overlap",
    group="missing metadata",
    row={"kind": INDEX},
)
READING = group("part of the data", *SELECTION, further=True) + group("missing metadata", *STATED, further=True)
