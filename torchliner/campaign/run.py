"""A campaign from its planes to maps, tables and an index, as often as it takes.

A unit is a plane with a liner and choices. It is done when its map is there with the hash of all that it depends on.
Moments, which units may share, have such a hash in their name; what a killed run has summed of them stays beside.
"""

import contextlib
import dataclasses
import hashlib
import json
import re
import shutil
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from torchliner.campaign.campaign_file import Campaign, Case
from torchliner.campaign.index import DONE, FAILED, full_row, read_index, write_index
from torchliner.campaign.workers import share_out
from torchliner.checks import DataWarning
from torchliner.engine.moments import SETTINGS
from torchliner.io.microphone_file import read_pressure
from torchliner.io.moments_file import read_moments
from torchliner.io.own_file import read_map
from torchliner.io.planes import read_plane
from torchliner.io.whole_file import locked, printable, writable_folder
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import LinerModel
from torchliner.names import __version__
from torchliner.pressure.dean import with_in_situ
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.origin import input_file, with_choices
from torchliner.records.velocity_plane import restated
from torchliner.report.answer import answer_of
from torchliner.report.of_map import map_rows
from torchliner.report.table import Row
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import educe, moments
from torchliner.velocity.reading import Progress

READS = "reads data"
MOST_PLANES = 32  # whose blocks are under way at once
FOLDERS = ("moments", "maps")  # of the results, beside those of figures
REDUCED = (*SETTINGS, "device", "dtype")  # choices that moments are made with
Rows = list[Row]


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
    request: Mapping[str, Any]  # of ``torchliner.moments``
    moments: Path  # their file, which other units may share
    map: Path  # file of the result
    plane: VelocityPlane  # as it is reduced, its velocity still in its file

    def row(self, **known: Any) -> Row:
        """Of the index."""
        about = {"unit": self.name, "file": self.case.shown, "liner": Path(self.liner).stem, "hash": self.hash}
        return full_row(**about, choices=json.dumps(self.choices, sort_keys=True), **known)

    def rows(self, found: ImpedanceMap) -> Rows:
        """Of the index, one a frequency of the map."""
        about = {"status": DONE, "source_side": found.source_side, "notes": len(found.notes)}
        rows = [row for row in map_rows(found) if row["averaging"] == found.averaging]
        checks = [row.get("level check", "").removesuffix("-") for row in rows]
        return [self.row(**about, level_check=check, **row) for check, row in zip(checks, rows, strict=True)]

    def kept_rows(self) -> Rows | None:
        """Of the map, if it is there and of this unit as it is now."""
        with contextlib.suppress(OSError, ValueError):
            found = read_map(self.map)
            return self.rows(found) if found.choices.get("unit") == self.hash else None
        return None


class Plan(NamedTuple):
    """What is to be done: units with their states, and rows of planes that could not be opened."""

    units: list[tuple[Unit, str]]  # up to date, from moments, reads data
    failed: Rows

    @property
    def to_read(self) -> dict[Path, Unit]:
        """A unit for each file of moments that is missing."""
        return {unit.moments: unit for unit, state in self.units if state == READS}


def plan(campaign: Campaign) -> Plan:
    """Units of a campaign, and which of them are done; nothing is written. A ValueError where two units have one name,
    the index is of another version, or results would go elsewhere by a link."""
    output = campaign.output
    for folder in (output / name for name in (*FOLDERS, "figures")):
        if not folder.resolve().is_relative_to(output.resolve()):
            raise ValueError(f"{folder} leads out of {output}, to {folder.resolve()}; remove the link")
    read_index(output / "index.csv")
    units, failed = dict[str, tuple[Unit, str]](), Rows()
    for case in campaign.cases:
        try:
            found = _units_of(case, campaign)
        except Exception as error:
            failed.append(full_row(unit=case.name, file=case.shown, status=FAILED, error=_words(error)))
            continue
        for unit in found:
            if unit.name in units:
                raise ValueError(f"{campaign.path}: two units are called {unit.name}; rename a plane or a liner's file")
            state = "from moments" if unit.moments.exists() else READS
            units[unit.name] = unit, state if unit.kept_rows() is None else "up to date"
    return Plan([*units.values()], failed)


def run_campaign(campaign: Campaign, *, client: Any = None, progress: Progress | None = None) -> Rows:
    """Do what is not done yet, and write the index, whose rows are returned; a unit that failed has its error there.

    ``client`` is of dask.distributed, whose workers read the planes; ``progress`` is called with numbers of samples
    read, 2 T for each of ``Plan.to_read``. An OSError where another run is at work in the folder.
    """
    writable_folder(campaign.output)
    with locked(campaign.output), warnings.catch_warnings(), contextlib.ExitStack() as stack:
        warnings.simplefilter("ignore", DataWarning)  # in the maps, and counted in the index
        found = plan(campaign)
        for folder in FOLDERS:
            (campaign.output / folder).mkdir(exist_ok=True)
        reads = {path: partial(_reduce, unit, progress, client) for path, unit in found.to_read.items()}
        if client is not None:  # all planes are under way at once
            pool = ThreadPoolExecutor(min(MOST_PLANES, sum(client.nthreads().values()) or 1))
            stack.callback(pool.shutdown, wait=False, cancel_futures=True)
            reads = {path: partial(pool.submit(read).result) for path, read in reads.items()}
        rows = Rows()
        for unit, _ in found.units:
            try:
                kept = unit.kept_rows()
                if kept is None:
                    if unit.moments in reads and not unit.moments.exists():
                        reads[unit.moments]()
                    kept = _educed(unit)
                rows += kept
            except Exception as error:
                rows.append(unit.row(status=FAILED, error=_words(error)))
        rows += found.failed
        for parts in campaign.output.glob("moments/*.parts"):  # of other choices, or left by a killed run
            if parts.with_suffix(".h5") not in found.to_read:
                shutil.rmtree(parts, ignore_errors=True)
        rows = [row | {"campaign": campaign.stated.title, "version": __version__} for row in rows]
        write_index(rows, campaign.output / "index.csv")
        return rows


def _reduce(unit: Unit, progress: Progress | None, client: Any) -> None:
    """The moments of a unit's plane; finished blocks stay until these are whole."""
    kept = unit.moments.with_suffix(".parts")
    known = moments(unit.plane, run=share_out(client, kept), progress=progress, **unit.request)
    known.write(unit.moments)
    shutil.rmtree(kept, ignore_errors=True)


def _educed(unit: Unit) -> Rows:
    """Figures and map of a unit, and its rows; the map last, which says that all is there."""
    case = unit.case
    known = read_moments(unit.moments)
    plane = dataclasses.replace(restated(known.plane, case.facts), name=case.shown)
    known = dataclasses.replace(known, plane=plane)
    pressure = None if case.in_situ is None else read_pressure(case.in_situ)
    found = educe(known, unit.model, [*unit.campaign.stated.frequencies] or None, pressure=pressure, **unit.choices)
    if pressure is not None:
        (found,) = with_in_situ([found], [plane], pressure)
    others = [each for each in found.choices["inputs"] if each["what"] != "moments"]
    found = with_choices(found, inputs=[input_file("velocity", case.path), *others], unit=unit.hash)
    if unit.campaign.stated.figures:
        answer_of(found).write_pictures(unit.campaign.output / "figures" / unit.name)
    found.write(unit.map)
    return unit.rows(found)


def _units_of(case: Case, campaign: Campaign) -> list[Unit]:
    """Every liner with every set of choices."""
    # With no other fact than the tone: moments outlive a change of others.
    tone = {name: fact for name, fact in case.facts.items() if name == "frequency"}
    plane = dataclasses.replace(restated(read_plane(case.path, lazy=True, **case.request), tone), name=case.shown)
    if not case.liners and plane.liner not in preset_names():
        fault = f"names {plane.liner!r}, which is no preset" if plane.liner else "names no liner"
        raise ValueError(f"{case.shown} {fault}; state liner in [[planes]], or liners: {', '.join(preset_names())}")
    data = [input_file("", path)["hash"] for path in case.files]
    beside = None if case.in_situ is None else input_file("", case.in_situ)["hash"]
    output, sets, stated, found = campaign.output, campaign.choices, campaign.stated, []
    varied = [key for key in sets[0] if any(one[key] != sets[0][key] for one in sets)]
    for liner in case.liners or (plane.liner,):
        model = load_liner(liner)
        content = _digest(sorted(model.describe().items()), *(Path(name).read_bytes() for name in model.files))
        for choices in sets:
            request = _reduction(plane, model, choices, campaign)
            plain = sorted({**request, "liner": "liner" in request and content}.items())
            sums = (data, sorted(case.request.items()), plane.frequency, plain, __version__)
            facts = (sorted(case.facts.items()), sorted(choices.items()))
            words = [case.name, Path(liner).stem, *(f"{key}={choices[key]}" for key in varied)]
            name = "__".join(re.sub(r"[^\w.=+-]+", "-", word) for word in words)
            own = _digest(sums, facts, content, stated.frequencies, beside, stated.figures)
            files = (output / f"moments/{case.name}-{_digest(*sums)}.h5", output / f"maps/{name}.h5")
            found.append(Unit(name, case, campaign, liner, model, choices, own, request, *files, plane))
    return found


def _reduction(plane: VelocityPlane, model: LinerModel, choices: Any, campaign: Campaign) -> dict[str, Any]:
    """Moments that serve as many units as can share them: those of any liner, if it is smooth in |v|; of the averaging
    that contains those of all units; at the tone unless other lines are needed."""
    chosen, frequencies = Choices(**choices), [*campaign.stated.frequencies]
    locked = any(Choices(**one).averaging == "phase-locked" for one in campaign.choices)
    at_asked = chosen.phase != "averaged" or chosen.wall_filter is not None
    at_asked |= chosen.drive == "running-rms" and chosen.running_window is None  # one period
    return {
        **{name: value for name, value in choices.items() if name in REDUCED},
        "averaging": "phase-locked" if locked else "admittance",
        "frequency": frequencies if frequencies and (at_asked or not plane.frequency) else None,
        **({"cell_pitch": model.cell_pitch} if model.speed_max is None else {"liner": model}),
    }


def _digest(*facts: Any) -> str:
    """Sixteen letters of anything that prints alike each time."""
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]


def _words(error: Exception) -> str:
    """One line of an error."""
    text = " ".join(printable(str(error)).split())
    return text if isinstance(error, (ValueError, OSError, ImportError, TypeError, RuntimeError)) else repr(error)
