"""One self-contained HTML page of any answer, by Jinja2."""

import base64
import io
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from torchliner.file_checks import naming
from torchliner.io.hdf5 import open_file, text_attribute
from torchliner.io.microphone_file import read_microphones
from torchliner.io.own_file import read_line, read_map, read_points, read_wall
from torchliner.io.result_writers import fill_csv
from torchliner.io.whole_file import HDF5, printable, writable, written_whole
from torchliner.names import __version__
from torchliner.records import ImpedanceLine, ImpedanceMap, MicrophoneLine, PointImpedances, WallEduction
from torchliner.records.origin import input_file
from torchliner.report.answer import Answer, Grid, answer_of, ordered
from torchliner.report.figure import require_matplotlib
from torchliner.report.table import DIGITS, flat_words, table_of

ENDING = ".html"
MOST_ROWS, MOST_IN_CSV = 400, 40_000  # of a table on the page, and of its CSV
APART = ("inputs", "version", "versions", "command")  # choices that stand under provenance
RESULTS: dict[str, Callable[[Path], Any]] = {
    ImpedanceMap.SCHEMA: read_map,
    ImpedanceLine.SCHEMA: read_line,
    PointImpedances.SCHEMA: read_points,
    WallEduction.GROUPS[0]: read_wall,
    MicrophoneLine.SCHEMA: read_microphones,
}
CITE = (
    "The method: R. Roncen, L. Ambrosiani, A. Paduano, F. Avallone, F. Méry and E. Piot, Direct time-domain "
    "eduction of acoustic liner impedance in turbulent grazing flows, Journal of Fluid Mechanics "
    "1042 (2026), doi:10.1017/jfm.2026.11969.",
    f"The program: The torchliner developers, torchliner, version {__version__}.",
)


def write_report(result: Any, path: str | Path, *others: Any) -> None:
    """The page of a result in memory, as its ``report``; ``others``: eductions beside the first."""
    require_report()
    writable(path, ENDING)
    write_page(answer_of(result, *others), path)


def report_file(path: Path, output: Path) -> Answer:
    """The page of a file of results, written; a ValueError says what the file is, if it is none."""
    if path.suffix.lower() not in HDF5:
        raise ValueError(f"{path} is no result: a page is made of {', '.join(HDF5)}, or of the folder of a campaign")
    with open_file(path) as file:
        schema = text_attribute(file, "schema")
    if schema not in RESULTS:
        known, schema = ", ".join(RESULTS), printable(schema or "not stated")
        raise ValueError(f"{path} is no result: its schema is {schema!r}, not one of {known}")
    result = RESULTS[schema](path)
    with naming(path):
        found = answer_of(result, source=path)
        write_page(found, output)
    return found


def write_page(answer: Answer, path: str | Path) -> None:
    """As one file, whole or not at all."""
    css, template = (Path(__file__).with_name(f"page.{end}").read_text(encoding="utf-8") for end in ("css", "html"))
    environment = require_report().Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_shown)
    environment.globals.update(csv=csv_link, svg=svg_link)
    stated = {name: value for name, value in answer.choices.items() if name not in APART}
    rows = [{"choice": name.replace("_", " "), "value": text} for name, text in flat_words(stated)]
    inputs = inputs_of(*answer.results)
    html = environment.from_string(template).render(
        answer=answer,
        warnings=ordered(answer.notes),
        choices=[Grid("choices", "Every choice behind the result.", table_of(rows, "choice,value"))] if rows else [],
        origin=[
            *((each["what"], _described(each)) for each in inputs),
            *_made_by(answer),
        ],
        cite=CITE,
        most=MOST_ROWS,
        css=css,
    )
    with written_whole(path, ENDING) as temporary:
        temporary.write_text(html, encoding="utf-8")


def require_report() -> Any:
    """The module jinja2, asked for before any work; an ImportError where it or matplotlib is not installed."""
    require_matplotlib()
    try:
        import jinja2
    except ImportError as error:
        raise ImportError('a report needs jinja2: pip install "torchliner[report]"') from error
    return jinja2


def _shown(value: Any) -> Any:
    """Without what would steer a reader's screen; markup of the page itself as it is."""
    return value if hasattr(value, "__html__") else printable(str(value))


def csv_link(rows: Sequence[Mapping[str, Any]]) -> str:
    """A table as a data URI, of long ones every n-th row."""
    file = io.StringIO()
    fill_csv(file, table_of(rows[:: -(-len(rows) // MOST_IN_CSV)]).as_rows(), DIGITS)
    return _data("text/csv;charset=utf-8", file.getvalue().encode("utf-8"))


def svg_link(figure: Any) -> str:
    """The drawing as a data URI; glyphs are outlines, so no font is needed."""
    file, settings = io.BytesIO(), {"svg.hashsalt": "torchliner", "svg.fonttype": "path"}
    with require_matplotlib().rc_context(settings), warnings.catch_warnings():
        # Names in scripts that no font at hand has are boxes here and text in table and caption.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format="svg", bbox_inches="tight", pad_inches=0.02, metadata={"Date": None})
    return _data("image/svg+xml", file.getvalue())


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def inputs_of(*results: Any) -> list[Mapping[str, Any]]:
    """The inputs that results, and the data that they are of, name: each once."""
    choices = [one.choices for one in results]
    choices += [data for each in choices if isinstance(data := each.get("data"), Mapping)]
    every = [each for some in choices for each in some.get("inputs", ())]
    return [each for i, each in enumerate(every) if each not in every[:i]]


def _described(stored: Mapping[str, Any]) -> str:
    return f"{stored['name']}, {stored['bytes']:,} bytes; SHA-256: {stored['hash']}"


def _made_by(answer: Answer) -> Iterator[tuple[str, str]]:
    """The file itself, versions, commands as they were typed."""
    yield "result", "in memory" if answer.source is None else _described(input_file("result", answer.source))
    for one in answer.results[:1]:
        made = one.choices.get("versions", {"torchliner": one.choices.get("version", "not stated")})
        yield "made by", ", ".join(f"{name} {version}" for name, version in made.items())
    typed = [command for one in answer.results if (command := one.choices.get("command"))]
    for text in dict.fromkeys(shlex.join(["torchliner", *map(str, each)]) for each in typed):
        yield "command", text
    if not typed:
        yield "command", "none: done in Python, with the choices above"
