"""What the scripts share: where things lie, the arguments of a study, the shipped planes."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from torchliner.checks import DataWarning

ROOT = Path(__file__).resolve().parent.parent
DATA, FIGURES, RESULTS = ROOT / "data", ROOT / "docs" / "figures", ROOT / "results"


def parser_of(doc: str | None, output: Path | None = None) -> argparse.ArgumentParser:
    """A parser that says what the script is for; with ``output``, -o names a folder."""
    parser = argparse.ArgumentParser(description=(doc or "").split("\n")[0])
    if output is not None:
        parser.add_argument("-o", "--output", type=Path, default=output, help="folder")
    return parser


def options_of(parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options; the output's folder is made, and what is known of the data not warned of."""
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", DataWarning)
    if getattr(options, "output", None) is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    return options


def plane_files(pattern: str) -> list[Path]:
    """Shipped files, the lowest plane first."""
    found = sorted(DATA.glob(pattern))
    if not found:
        sys.exit(f"{DATA} holds no {pattern}; the clone is not whole")
    return found


def case_files(case: str) -> list[Path]:
    """Shipped planes of a resolved case, n130 or o145 or such, the lowest first."""
    kind = "orifice" if case[0] in "otq" else "slit"
    return plane_files(f"{kind}_{case}_y*.h5")
