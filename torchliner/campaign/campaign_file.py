"""A campaign as the user states it: planes by name patterns, liners, frequencies, choices."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, create_model, model_validator

from torchliner import ranges
from torchliner.campaign.inputs import NAMED
from torchliner.file_names import unique_names
from torchliner.io.plane_format import PlaneRequest
from torchliner.names import SOURCE_SIDES
from torchliner.records.origin import series_of
from torchliner.toml_files import Strict, one_of, parse_toml, read_text, validated
from torchliner.velocity.choices import Choices

REQUEST = tuple(field.name for field in fields(PlaneRequest))


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _in_hertz(value: Any) -> Any:
    found = (f for each in _listed(value) for f in ranges.frequencies(str(each)))
    return list(dict.fromkeys(found))  # ranges may overlap


Texts = Annotated[list[str], BeforeValidator(_listed)]


class PlanesTable(Strict):
    """A table ``[[planes]]``: files, and what they do not say; SI units."""

    files: Annotated[Texts, Field(min_length=1)]
    liner: str | None = None
    in_situ: str | None = None
    title: str | None = None
    height: float | None = Field(None, gt=0)
    frequency: float | None = Field(None, gt=0)
    source_side: Annotated[str, one_of(*SOURCE_SIDES)] | None = None
    incident_level: float | None = None
    mach: float | None = None
    displacement_thickness: float | None = Field(None, ge=0)
    variable: str | None = None
    group: str | None = None
    axes: list[str] | None = None
    velocity_units: str | None = None
    length_units: str | None = None
    sampling_rate: float | None = Field(None, gt=0)
    normal: str | None = None
    wall_normal_component: bool | None = None
    x: str | None = None
    z: str | None = None
    points: str | None = None


FACTS = tuple(name for name in PlanesTable.model_fields
              if name not in ("files", "liner", "in_situ", *REQUEST))  # fmt: skip
_NAMES = [field.name for field in fields(Choices)]
ChoicesTable: type[Strict] = create_model(
    "ChoicesTable", __base__=Strict, **dict.fromkeys(_NAMES, (Any, None))  # type: ignore[call-overload]
)  # fmt: skip


class CampaignTable(Strict):
    """The whole file."""

    title: str = ""
    output: str | None = None
    figures: bool = False
    planes: list[PlanesTable] = Field(min_length=1)
    liners: Texts = Field(default_factory=list)
    frequencies: Annotated[list[float], BeforeValidator(_in_hertz)] = Field(default_factory=list)
    choices: ChoicesTable = ChoicesTable()  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _check_choices(self) -> CampaignTable:
        for each in choice_sets(self.choices.model_dump(exclude_unset=True)):  # type: ignore[attr-defined]
            try:
                Choices(**each)
            except TypeError as error:
                raise ValueError(f"choices: {error}") from None
        return self


@dataclass(frozen=True)
class Case:
    """One plane of a campaign.

    Args:
        path: absolute.
        name: in files and tables; no other case has it.
        shown: the path as seen from the campaign's file.
        facts: of ``VelocityPlane``, stated in the place of the file's.
        request: of ``PlaneRequest``.
        liners: presets or paths; none: the one that the file names.
        in_situ: pressure record of the same run.
    """

    path: Path
    name: str
    shown: str
    facts: Mapping[str, Any]
    request: Mapping[str, Any]
    liners: tuple[str, ...]
    in_situ: Path | None


@dataclass(frozen=True)
class Campaign:
    """What ``read_campaign`` finds.

    Args:
        path: of the file.
        output: folder for the results.
        cases: the planes.
        frequencies: Hz; none: the tone of each plane.
        choices: sets of them, each with what varies between the sets.
        title, figures: as stated.
    """

    path: Path
    output: Path
    cases: tuple[Case, ...]
    frequencies: tuple[float, ...]
    choices: tuple[tuple[dict[str, Any], dict[str, Any]], ...]
    title: str
    figures: bool


def choice_sets(stated: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the choices of which several values are stated."""
    lists = {key: _listed(value) for key, value in stated.items()}
    sets = [dict(zip(lists, each, strict=True)) for each in itertools.product(*lists.values())]
    # TOML has no word for nothing.
    return [{k: None if k == "interval" and v is False else v for k, v in each.items()}
            for each in sets]  # fmt: skip


def read_campaign(path: str | Path, output: str | Path | None = None) -> Campaign:
    """A campaign from its TOML file; paths in it begin at its folder.

    Args:
        path: TOML.
        output: folder for the results, in the place of the one stated; default ``NAME_results``
            beside the file.
    Raises:
        FileNotFoundError: no such file; a pattern that no file matches.
        ValueError: mistakes, all of them listed; a file that is named twice.
    """
    path = Path(path)
    tables: dict[str, type[Strict]] = {"planes": PlanesTable, "choices": ChoicesTable}
    table = validated(CampaignTable, parse_toml(read_text(path), path), path, tables)
    folder = path.absolute().parent
    target = Path(output or folder / (table.output or f"{path.stem}_results"))
    found = [
        (match, each) for each in table.planes for pattern in each.files
        for match in _one_a_series(_matches(folder, pattern, path, target))
    ]  # fmt: skip
    paths = [match for match, _ in found]
    twice = next((p for p in paths if paths.count(p) > 1), None)
    if twice is not None:
        raise ValueError(f"{path}: {twice} is named twice among the planes; name it once")
    cases = []
    for (match, each), name in zip(found, unique_names(paths), strict=True):
        stated = each.model_dump(exclude_none=True)
        cases.append(Case(
            match, name, _seen_from(folder, match),
            {key: stated[key] for key in FACTS if key in stated},
            {key: _beside(folder, stated[key]) if key in NAMED else stated[key]
             for key in REQUEST if key in stated},
            tuple(_liner(folder, liner) for liner in
                  (table.liners or ([] if each.liner is None else [each.liner]))),
            None if each.in_situ is None else folder / each.in_situ,
        ))  # fmt: skip
    sets = choice_sets(table.choices.model_dump(exclude_unset=True))  # type: ignore[attr-defined]
    varied = {key for key in sets[0] if len({repr(one[key]) for one in sets}) > 1}
    return Campaign(
        path, target, tuple(cases), tuple(table.frequencies),
        tuple((one, {key: one[key] for key in one if key in varied}) for one in sets),
        table.title, table.figures,
    )  # fmt: skip


def _matches(folder: Path, pattern: str, path: Path, output: Path) -> list[Path]:
    """Files of a pattern, sorted, but for what earlier runs have written.

    Raises:
        FileNotFoundError: none; files of the same ending that are there are named.
        ValueError: all of them lie in the folder of the results.
    """
    found = sorted(glob.glob(os.path.join(glob.escape(str(folder)), pattern), recursive=True))
    if not found:
        place = (folder / pattern).parent
        there = sorted(p.name for p in place.glob(f"*{Path(pattern).suffix}")) if place.is_dir() else []
        words = f"; {place} holds {', '.join(there[:4])}" + (" ..." if len(there) > 4 else "")
        raise FileNotFoundError(
            f"{path}: planes.files = {pattern!r} matches nothing in {folder}"
            + (words if there else f"; there is no such folder as {place}" * (not place.is_dir()))
        )
    results = output.absolute()
    planes = [p for each in found if not (p := Path(each)).absolute().is_relative_to(results)]
    if not planes:
        raise ValueError(
            f"{path}: planes.files = {pattern!r}: all that it matches, {found[0]} first, lies in "
            f"the folder of the results, {output}; name another --output"
        )
    return planes


def _one_a_series(found: list[Path]) -> list[Path]:
    """Planes, of which a file of a series stands for all of it."""
    kept: list[Path] = []
    covered: set[Path] = set()
    for each in found:
        if each not in covered:
            kept.append(each)
            covered |= set(series_of(each))
    return kept


def _seen_from(folder: Path, path: Path) -> str:
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _beside(folder: Path, name: Any) -> Any:
    """FILE or FILE:VARIABLE that is beside the campaign's file, by its whole path."""
    path = Path(str(name))
    there = any((folder / each).is_file() for each in (path, str(name).rpartition(":")[0]))
    return str(folder / path) if there else name


def _liner(folder: Path, name: str) -> str:
    """A preset, or a file beside the campaign's.

    Raises:
        ValueError: a program, which runs only where a user names it.
    """
    if Path(name).suffix.lower() == ".py":
        raise ValueError(
            f"liner {name} is a program, which no campaign runs; give its values as .csv "
            "(frequency, speed, resistance, reactance), or name it on the command line of educe"
        )
    return str(folder / name) if Path(name).suffix.lower() in (".toml", ".csv") else name
