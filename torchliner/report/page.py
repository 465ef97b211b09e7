"""One self-contained HTML page of any answer, by Jinja2."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import math
import platform
import re
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import naming
from torchliner.io.csv_rows import fill_csv
from torchliner.io.hdf5 import open_file, text_attribute
from torchliner.io.microphone_file import read_microphones
from torchliner.io.own_file import read_line, read_map, read_points, read_wall
from torchliner.io.whole_file import HDF5, printable, writable, written_whole
from torchliner.records import ImpedanceLine, ImpedanceMap, MicrophoneLine, PointImpedances, WallEduction
from torchliner.records.notes import Note
from torchliner.records.origin import described, input_file, standing
from torchliner.report.answer import Answer, Grid, Picture, answer_of, ordered
from torchliner.report.figure import require_matplotlib
from torchliner.report.table import Column, Table, table_of
from torchliner.report.typesetting import typeset
from torchliner.version import __version__

ENDING = ".html"
MOST_ROWS, MOST_IN_CSV = 400, 40_000  # of a table on the page, and of its CSV
MOST_LISTED = 8  # numbers of a choice
INPUT = {"what": str, "name": str, "bytes": int, "hash": str}  # of one that is stored
APART = ("inputs", "version", "versions", "command")  # choices that stand under provenance
RESULTS: dict[str, Callable[[Path], Any]] = {
    ImpedanceMap.SCHEMA: read_map,
    ImpedanceLine.SCHEMA: read_line,
    PointImpedances.SCHEMA: read_points,
    WallEduction.GROUPS[0]: read_wall,
    MicrophoneLine.SCHEMA: read_microphones,
}
PAPER = (
    "The method: R. Roncen, L. Ambrosiani, A. Paduano, F. Avallone, F. Méry and E. Piot, Direct time-domain "
    "eduction of acoustic liner impedance in turbulent grazing flows, Journal of Fluid Mechanics "
    "1042 (2026), doi:10.1017/jfm.2026.11969."
)
BIBTEX = f"""@article{{roncen2026,
  author  = {{Roncen, R\\'emi and Ambrosiani, Ludovico and Paduano, Angelo and Avallone, Francesco
             and M\\'ery, Fabien and Piot, Estelle}},
  title   = {{Direct time-domain eduction of acoustic liner impedance in turbulent grazing flows}},
  journal = {{Journal of Fluid Mechanics}}, volume = {{1042}}, year = {{2026}},
  doi     = {{10.1017/jfm.2026.11969}}
}}
@software{{torchliner,
  author  = {{{{The torchliner developers}}}}, title = {{torchliner}}, version = {{{__version__}}}
}}"""


def write_report(result: Any, path: str | Path, *others: Any) -> None:
    """The page of a result in memory, as its ``report``; ``others``: eductions beside the first."""
    require_report()
    writable(path, ENDING)
    write_page(answer_of(result, *others), path)


def report_file(path: Path, output: Path) -> Answer:
    """The page of a file of results, written."""
    result = read_result(path)
    with naming(path):
        found = answer_of(result, source=path)
        write_page(found, output)
    return found


def read_result(path: Path) -> Any:
    """A result of any kind.

    Raises:
        ValueError: the file is none, and what it is; a result of another version.
    """
    if path.suffix.lower() not in HDF5:
        raise ValueError(f"{path} is no result: a page is made of {', '.join(HDF5)}, or of the folder of a campaign")
    with open_file(path) as file:
        schema = text_attribute(file, "schema")
    if schema in RESULTS:
        return RESULTS[schema](path)
    known = ", ".join(RESULTS)
    raise ValueError(f"{path} is no result: its schema is {printable(schema or 'not stated')!r}, not one of {known}")


def write_page(answer: Answer, path: str | Path) -> None:
    """As one file, whole or not at all.

    Raises:
        ImportError: jinja2 or matplotlib is not installed.
        ValueError, OSError: another ending than .html; as ``written_whole``.
    """
    html = page_of(answer)
    with written_whole(path, ENDING) as temporary:
        temporary.write_text(html, encoding="utf-8")


def page_of(answer: Answer) -> str:
    """The whole page."""
    home = resources.files(__package__)
    css, script, template = ((home / f"page.{end}").read_text(encoding="utf-8") for end in ("css", "js", "html"))
    environment = require_report().Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_printable
    )
    choices = answer.choices or (answer.results[0].choices if answer.results else {})
    asked = [{"choice": name, "value": text} for name, text in _flat(choices, "")]
    grids = [Grid("answer-table", answer.caption, answer.table), *answer.grids]
    html = environment.from_string(template).render(
        answer=answer,
        title=shown(answer.title),
        sentence=typeset(" ".join(map(shown, answer.lines))),
        remarks=[typeset(shown(text)) for text in answer.remarks],
        warnings=[
            (typeset(_begun(shown(n.text))), n.size) for n in ordered([*changed(*answer.results), *answer.notes])
        ],
        tables=[_shown_grid(grid) for grid in grids if grid.table.rows],
        pictures=[_shown_picture(picture) for picture in answer.pictures],
        facts_of_case=[(name, shown(value)) for name, value in answer.facts],
        asked=[_shown_grid(Grid("choices", "Every choice behind the result.", table_of(asked, "choice,value")))]
        if asked
        else [],
        origin=list(_origin(answer)),
        commands=list(_commands(answer)),
        paper=PAPER,
        program=f"The program: The torchliner developers, torchliner, version {__version__}.",
        bibtex=BIBTEX,
        footer=f"torchliner {__version__}. Impedances are normalised by ρc, with the time factor e^(+jωt) and the "
        "velocity into the liner.",
        css=css,
        script=script,
        digest=base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii"),
    )
    return str(html)


def require_report() -> Any:
    """The module jinja2; asked for before any work.

    Raises:
        ImportError: it or matplotlib is not installed.
    """
    require_matplotlib()
    try:
        import jinja2
    except ImportError as error:
        raise ImportError('a report needs jinja2: pip install "torchliner[report]"') from error
    return jinja2


def shown(text: Any) -> str:
    """Text from a file in one line; the template escapes it."""
    return text if hasattr(text, "__html__") else " ".join(printable(str(text)).split())


def _printable(value: Any) -> Any:
    """Texts without what would steer a reader's screen; our own markup as it is."""
    return printable(value) if type(value) is str else value


def _begun(text: str) -> str:
    """With a capital, unless it begins with a name of a file."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].strip(",:").isalpha() else text


def _shown_grid(grid: Grid) -> dict[str, Any]:
    """A table as the template takes it: headings, cells with the number they are sorted by, the CSV as a link."""
    columns = grid.table.shown
    return {
        "name": grid.name,
        "caption": grid.caption or "The answer.",
        "headings": [(column.heading, bool(column.text)) for column in columns],
        "rows": [
            [(_cell_text(column, row), _number(column.value(row))) for column in columns]
            for row in grid.table.rows[:MOST_ROWS]
        ],
        "count": len(grid.table.rows),
        "csv": _csv_link(grid.table),
    }


def _shown_picture(picture: Picture) -> dict[str, Any]:
    """A drawing as the template takes it; for those who cannot see it, the extent of each column of its numbers."""
    numbers, extents = picture.numbers(), []
    rows = numbers.as_rows()
    for name in rows[0] if rows else ():
        known = [v for row in rows if isinstance(v := row[name], int | float) and math.isfinite(v)]
        if known:
            extents.append(f"{name} {min(known):.4g} to {max(known):.4g}")
    return {
        "name": picture.name,
        "caption": typeset(picture.caption),
        "alt": typeset(f"{picture.caption} {'; '.join(extents)}."),
        "step": -(-len(rows) // MOST_IN_CSV),
        "svg": inline_svg(picture.draw(None), picture.name),
        "csv": _csv_link(numbers),
    }


def _cell_text(column: Column, row: Any) -> Any:
    """Numbers with true minus signs; texts in one line; markup as it is."""
    value = column.value(row)
    if hasattr(value, "__html__"):
        return value
    return typeset(column.cell(row)) if column.text else shown(column.cell(row))


def _number(value: Any) -> str:
    """For sorting: of a complex number its real part."""
    value = value.real if isinstance(value, complex) else value
    known = isinstance(value, (int, float)) and math.isfinite(value)
    return repr(float(value)) if known else ""


def _csv_link(table: Table) -> str:
    """The columns with a name as a data URI, of long tables every n-th row; "" where there are none."""
    rows = Table(table.rows[:: -(-len(table.rows) // MOST_IN_CSV) or 1], table.columns).as_rows()
    if not rows or not rows[0]:
        return ""
    file = io.StringIO()
    fill_csv(file, rows, table.csv)
    content = base64.b64encode(file.getvalue().encode("utf-8")).decode("ascii")
    return f"data:text/csv;charset=utf-8;base64,{content}"


def inline_svg(figure: Any, name: str) -> str:
    """The ``<svg>`` element, without title, comments and metadata, its ids beginning with ``name``.

    Glyphs are outlines, so no font is needed; the page shows it on white, in the dark too.
    """
    figure.suptitle("")
    file, settings = io.StringIO(), {"svg.hashsalt": name, "svg.fonttype": "path"}
    with require_matplotlib().rc_context(settings), warnings.catch_warnings():
        # Names in scripts that no font at hand has are boxes here and text in table and caption.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format="svg", bbox_inches="tight", pad_inches=0.02, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]*)"', rf'id="{name}-\1"', text)
    text = re.sub(r'(href="|url\()#', rf"\1#{name}-", text)
    box = re.search(r'viewBox="[\d.]+ [\d.]+ ([\d.]+) [\d.]+"', text)
    assert box is not None
    head = f'<svg {box[0]} xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" focusable="false" '
    head += f'style="max-width: {float(box[1]) / 72:.2f}in">'
    return re.sub(r"<svg [^>]*>", head, text, count=1)


def _flat(values: Mapping[str, Any], before: str) -> Iterator[tuple[str, str]]:
    """Every choice in words, those of a mapping behind its name."""
    for key, value in values.items():
        if key in APART:
            continue
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{shown(key)}, ")
        else:
            yield f"{before}{shown(key).replace('_', ' ')}", words(value)


def words(value: Any) -> str:
    """A value in one line; of many numbers their extent."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list | tuple):
        numbers = np.zeros(0, str)
        if len(value) > MOST_LISTED:
            with contextlib.suppress(ValueError):  # lists of unlike lengths
                numbers = np.asarray(value)
        if numbers.size and numbers.dtype.kind in "if":
            return f"{' x '.join(map(str, numbers.shape))} values, {numbers.min():.7g} to {numbers.max():.7g}"
        return ", ".join(map(words, value))
    return shown(value)


def inputs_of(*results: Any) -> list[Mapping[str, Any]]:
    """The inputs that results hold, each once; a file may hold anything of that name."""
    lists = [one.choices.get("inputs") for one in results]
    lists += [data.get("inputs") for one in results if isinstance(data := one.choices.get("data"), Mapping)]
    found = [each for one in lists if isinstance(one, list) for each in one]
    return [
        each
        for i, each in enumerate(found)
        if isinstance(each, Mapping)
        and all(isinstance(each.get(key), kind) for key, kind in INPUT.items())
        and each not in found[:i]
    ]


def changed(*results: Any) -> list[Note]:
    """Warnings of inputs that are no longer what they were."""
    found = [(each, standing(each)) for each in inputs_of(*results)]
    return [
        Note("changed-input", f"{each['what']}: {each['name']} is {now.words}; it is not what the result was made of")
        for each, now in found
        if now.changed
    ]


def _origin(answer: Answer) -> Iterator[tuple[str, str]]:
    """Inputs with their hashes then and now, the file itself, versions."""
    for each in inputs_of(*answer.results):
        yield shown(each["what"]), f"{shown(described(each))}; {standing(each).words}"
    yield "result", "in memory" if answer.source is None else shown(described(input_file("result", answer.source)))
    choices = answer.results[0].choices if answer.results else {}
    made = choices.get("versions")
    made = dict(made) if isinstance(made, Mapping) else {"torchliner": choices.get("version")}
    here = {"torchliner": __version__, "python": platform.python_version()}
    for name in ("torch", "numpy", "scipy", "h5py"):
        with contextlib.suppress(PackageNotFoundError):
            here[name] = version(name)
    for what, own in (("result made by", made), ("page made by", here)):
        yield what, shown(", ".join(f"{k} {v or '(not stated)'}" for k, v in own.items()))


def _commands(answer: Answer) -> Iterator[str]:
    """As they were typed, each once."""
    typed = [one.choices["command"] for one in answer.results if isinstance(one.choices.get("command"), list)]
    yield from dict.fromkeys(shown(shlex.join(["torchliner", *map(str, each)])) for each in typed)
