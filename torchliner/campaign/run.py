"""A campaign from its planes to maps, tables and an index, as often as it takes."""

from __future__ import annotations

import contextlib
import json
import shutil
import time
import warnings
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from torchliner.campaign.campaign_file import Campaign
from torchliner.campaign.index import DONE, FAILED, full_row, read_index, write_index
from torchliner.campaign.units import Unit, units_of
from torchliner.checks import DataWarning
from torchliner.io.microphone_file import read_pressure
from torchliner.io.whole_file import locked, printable, writable_folder, written_whole
from torchliner.names import __version__
from torchliner.pressure.dean import with_in_situ
from torchliner.records.origin import input_file, with_choices
from torchliner.report.curves import impedance_along_x
from torchliner.report.of_map import draw_pictures
from torchliner.report.table import table_of
from torchliner.velocity.educe import educe, moments
from torchliner.velocity.reading import Progress

READS = "reads data"
MOST_PLANES = 32  # whose blocks are under way at once
FOLDERS = ("moments", "maps", "lines", "units", "figures")  # of the results
Rows = list[dict[str, Any]]


class Plan(NamedTuple):
    """What is to be done: units with their states, and rows of planes that could not be opened."""

    units: list[tuple[Unit, str]]  # up to date, from moments, reads data
    failed: Rows

    @property
    def to_read(self) -> dict[Path, Unit]:
        """A unit for each file of moments that is missing."""
        return {unit.moments: unit for unit, state in self.units if state == READS}


def plan(campaign: Campaign) -> Plan:
    """Units of a campaign, and which of them stand. Nothing is written.

    Raises:
        ValueError: two units of one name; an index of another version; results that would go elsewhere by a link.
    """
    output = campaign.output
    for folder in (output / name for name in FOLDERS):
        if not folder.resolve().is_relative_to(output.resolve()):
            raise ValueError(f"{folder} leads out of {output}, to {folder.resolve()}; remove the link")
    read_index(output)
    units: dict[str, Unit] = {}
    failed: Rows = []
    for case in campaign.cases:
        try:
            found = units_of(case, campaign)
        except Exception as error:
            failed.append(full_row(unit=case.name, file=case.shown, status=FAILED, error=_words(error)))
            continue
        for unit in found:
            if unit.name in units:
                raise ValueError(f"{campaign.path}: two units are called {unit.name}; rename a plane or a liner's file")
            units[unit.name] = unit
    return Plan([(unit, _state(unit)) for unit in units.values()], failed)


def _state(unit: Unit) -> str:
    if _kept_rows(unit) is not None:
        return "up to date"
    return "from moments" if unit.moments.exists() else READS


def run_campaign(campaign: Campaign, *, client: Any = None, progress: Progress | None = None) -> Rows:
    """Do what is not done yet, and write the index, whose rows are returned; a unit that failed has its error there.

    Args:
        campaign: of ``read_campaign``.
        client: of dask.distributed, whose workers read the planes; None: all of it here.
        progress: called with numbers of samples read, 2 T for each of ``Plan.to_read``.
    Raises:
        OSError: the folder cannot be written, or another run is at work in it.
        ValueError: as ``plan``.
    """
    writable_folder(campaign.output)
    with locked(campaign.output), warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # in the maps, and counted in the index
        found = plan(campaign)
        rows: Rows = []
        pool = ThreadPoolExecutor(min(MOST_PLANES, sum(client.nthreads().values()) or 1) if client else 1)
        ahead = found.to_read if client is not None else {}
        under_way: dict[Path, Future[None]] = {
            path: pool.submit(_reduce, unit, progress, client) for path, unit in ahead.items()
        }
        try:
            for unit, _ in found.units:
                try:
                    kept = _kept_rows(unit)
                    if kept is None:
                        if unit.moments in under_way:
                            under_way[unit.moments].result()
                        elif not unit.moments.exists():
                            _reduce(unit, progress)
                        kept = _educed(unit)
                    rows += kept
                except Exception as error:
                    rows.append(_row(unit, status=FAILED, error=_words(error)))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        rows += found.failed
        for parts in campaign.output.glob("moments/*.parts"):  # of other choices, or left by a killed run
            if parts.with_suffix(".h5") not in found.to_read:
                shutil.rmtree(parts, ignore_errors=True)
        write_index(rows, campaign.output, campaign.title, __version__)
        return rows


def _reduce(unit: Unit, progress: Progress | None, client: Any = None) -> None:
    """The moments of a unit's plane; finished blocks stay until these are whole."""
    assert unit.request is not None
    kept = unit.moments.with_suffix(".parts")
    known = moments(unit.plane(), client=client, kept=kept, progress=progress, **unit.request)
    unit.moments.parent.mkdir(parents=True, exist_ok=True)
    known.write(unit.moments)
    shutil.rmtree(kept, ignore_errors=True)


def _result(unit: Unit, folder: str, ending: str) -> Path:
    return unit.campaign.output / folder / f"{unit.name}{ending}"


def _kept_rows(unit: Unit) -> Rows | None:
    """Of the index, if they are those of this unit as it is now."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        rows = [full_row(**row) for row in json.loads(_result(unit, "units", ".json").read_text("utf-8"))]
        if _result(unit, "maps", ".h5").exists() and all(row["hash"] == unit.hash for row in rows):
            return rows
    return None


def _educed(unit: Unit) -> Rows:
    """Map, lines, figures and rows of a unit; the rows last, which say that all is there."""
    start = time.perf_counter()
    output, case, known = unit.campaign.output, unit.case, unit.known()
    pressure = None if case.in_situ is None else read_pressure(case.in_situ)
    found = educe(known, unit.model, [*unit.campaign.frequencies] or None, pressure=pressure, **unit.choices)
    if pressure is not None:
        (found,) = with_in_situ([found], [known.plane], pressure)
    what = "moments" if case.path == unit.moments else "velocity"
    kept = [each for each in found.choices["inputs"] if each["what"] not in ("velocity", "moments")]
    found = with_choices(found, inputs=[input_file(what, case.path), *kept])
    for folder in ("maps", "lines", "units"):
        (output / folder).mkdir(exist_ok=True)
    found.write(_result(unit, "maps", ".h5"))
    about = {"height": found.height, "source_side": found.source_side, "averaging": found.averaging}
    about |= {"notes": len(found.notes), "status": DONE}
    rows = []
    for i, (f, z) in enumerate(zip(found.frequency.tolist(), found.answer.tolist(), strict=True)):
        table_of(impedance_along_x(found, i)).write_csv(_result(unit, "lines", f"_{f:.10g}Hz.csv"))
        values = {"": z} | dict(zip(("_low", "_high"), found.bounds_of_liner(found.averaging, i) or (), strict=False))
        parts = {f"resistance{end}": value.real for end, value in values.items()}
        parts |= {f"reactance{end}": value.imag for end, value in values.items()}
        check = "" if found.level_check is None else found.level_check.words(found.averaging, i).removesuffix("-")
        rows.append(_row(unit, frequency=f, level_check=check, **parts, **about))
    if unit.campaign.figures:
        draw_pictures([found], [known.plane], output / "figures" / unit.name)
    rows = [row | {"seconds": round(time.perf_counter() - start, 3)} for row in rows]
    with written_whole(_result(unit, "units", ".json")) as temporary:
        temporary.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return rows


def _row(unit: Unit, **known: Any) -> dict[str, Any]:
    about = {"unit": unit.name, "file": unit.case.shown, "liner": Path(unit.liner).stem, "hash": unit.hash}
    about["choices"] = json.dumps(unit.choices, sort_keys=True)
    return full_row(**about, **{key: value for key, value in known.items() if value is not None})


def _words(error: Exception) -> str:
    """One line of an error."""
    text = " ".join(printable(str(error)).split())
    expected = isinstance(error, (ValueError, OSError, ImportError, TypeError, RuntimeError))
    return text if text and expected else f"{type(error).__name__}: {text}"
