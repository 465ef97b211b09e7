"""What the scripts share: where things lie, the arguments of a study, tables of pages, the shipped planes."""

import argparse
import csv
import re
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torchliner as tl

ROOT = Path(__file__).resolve().parent.parent
DATA, FIGURES, RESULTS = ROOT / "data", ROOT / "docs" / "figures", ROOT / "results"
BLOCK = re.compile(r"<!-- table (\w+) -->\n(.*?)\n?<!-- end -->", re.DOTALL)  # of a page: name, table


def parser_of(doc: str | None, output: Path | None = None, **numbers: Any) -> argparse.ArgumentParser:
    """A parser that says what the script is for; with ``output``, -o names a folder; ``numbers``: options by name with
    their default, a number or a list of them."""
    parser = argparse.ArgumentParser(description=(doc or "").split("\n")[0])
    if output is not None:
        parser.add_argument("-o", "--output", type=Path, default=output, help="folder")
    for name, value in numbers.items():
        several = isinstance(value, list)
        how: Any = {"type": type(value[0] if several else value), "nargs": "+" if several else None}
        parser.add_argument(f"--{name}", default=value, help=f"default {value}", **how)
    return parser


def options_of(parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options; the output's folder is made, and what is known of the data not warned of."""
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", tl.DataWarning)
    if getattr(options, "output", None) is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    return options


def case_files(case: str) -> list[Path]:
    """Shipped planes of a resolved case, n130 or o145 or such, the lowest first."""
    return plane_files(f"{'orifice' if case[0] in 'otq' else 'slit'}_{case}_y*.h5")


def planes_of(case: str) -> list[tl.VelocityPlane]:
    """Shipped planes of a case, the lowest first."""
    return [tl.read_plane(path) for path in case_files(case)]


def plane_files(pattern: str) -> list[Path]:
    """Shipped files, the lowest plane first."""
    found = sorted(DATA.glob(pattern))
    if not found:
        sys.exit(f"{DATA} holds no {pattern}; the clone is not whole")
    return found


def page_table(header: str, lines: Sequence[Sequence[str]]) -> str:
    """Markdown, columns parted by |, with minus signs, at which a browser breaks no value."""
    rows = [[part.strip() for part in header.split("|")], *lines]
    text = [f"| {' | '.join(row)} |" for row in rows]
    return re.sub(r"-(?=\d)", "−", "\n".join([text[0], "|" + "---|" * len(rows[0]), *text[1:]]))


def tables_of(page: Path) -> dict[str, str]:
    """The tables of a page by name."""
    return dict(BLOCK.findall(page.read_text(encoding="utf-8")))


def publish(tables: Mapping[str, str], folder: Path, *pages: str) -> None:
    """Print tables by name; where the folder of a study is docs/figures, put them into their pages of docs/, too."""

    def put(found: re.Match[str]) -> str:
        return f"<!-- table {found[1]} -->\n{tables.get(found[1], found[2])}\n<!-- end -->"

    print("", *(f"{name}\n{text}\n" for name, text in tables.items()), sep="\n")
    for page in (ROOT / "docs" / each for each in pages if folder == FIGURES):
        page.write_text(BLOCK.sub(put, page.read_text(encoding="utf-8")), encoding="utf-8")


def run_study(
    doc: str | None,
    stem: str,
    rows_of: Callable[[], Sequence[Mapping[str, Any]]],
    draw: Callable[[Sequence[Any], Path], Any] | None = None,
    arguments: Sequence[str] | None = None,
    tables: Callable[[Sequence[Any]], Mapping[str, str]] | None = None,
) -> int:
    """A study: rows to STEM.csv and a picture of them, or with ``--check`` the rows beside those in docs/figures.

    ``tables``, made of the rows, are printed and put into docs/STEM.md, unless the output is another folder.
    """
    from torchliner.report.table import table_of

    parser = parser_of(doc, FIGURES)
    parser.add_argument("--check", action="store_true", help="compare with docs/figures, write nothing")
    options, rows = options_of(parser, arguments), rows_of()
    table = table_of(rows, "")
    if options.check:
        return check_rows(table.as_rows(), FIGURES / f"{stem}.csv")
    table.write_csv(options.output / f"{stem}.csv")
    if draw is not None:
        draw(rows, options.output / f"{stem}.png")
    if tables is not None:
        publish(tables(rows), options.output, f"{stem}.md")
    print(f"{len(rows)} rows are in {options.output / stem}.csv")
    return 0


def check_rows(rows: Sequence[Mapping[str, Any]], path: Path, share: float = 2e-3) -> int:
    """Say which rows differ from those of a file by more than a share, or 0.002; how many do."""
    with path.open(newline="") as file:
        kept = list(csv.DictReader(file))
    off = abs(len(rows) - len(kept))
    for i, (row, old) in enumerate(zip(rows, kept, strict=False)):
        for name, value in row.items():
            if isinstance(value, float) and value == value:
                same = abs(value - float(old[name] or "nan")) <= max(share * abs(value), share)
            else:
                same = isinstance(value, float) or value is None or str(value) in (old[name], str(int(value == "True")))
            if not same and not isinstance(value, bool):
                print(f"row {i}, {name}: {value} now, {old[name]} in {path.name}")
                off += 1
    print(f"{path.name}: {off} differences in {len(kept)} rows")
    return min(off, 1)
