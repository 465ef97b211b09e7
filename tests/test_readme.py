"""The README's example, commands and numbers are those of the code."""

from __future__ import annotations

import contextlib
import hashlib
import io
import re
import shlex
from pathlib import Path

import pytest

import torchliner as tl
from torchliner.cli.main import build_parser

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [
    ROOT / "README.md",
    *(
        ROOT / "docs" / f"{n}.md"
        for n in (
            "formats",
            "liners",
            "calibration",
            "ldv",
            "duct",
            "wall_pressure",
            "moments",
            "results",
            "package",
            "campaigns",
        )
    ),
]


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_python_example_runs(tmp_path, monkeypatch):
    """As printed, in a folder with the shipped data, it gives the printed kind of answer."""
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, "README.md", "exec"), {})
    assert "0.174" in printed.getvalue()
    assert (tmp_path / "map.h5").exists()
    assert (tmp_path / "map.png").exists()
    assert len([line for line in example.splitlines() if line.strip()]) <= 15


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_commands_are_understood(page):
    """Every command line of the page parses: no option has been renamed."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    commands = re.findall(r"^torchliner (.+)$", text, re.MULTILINE)
    assert commands
    for command in commands:
        parser, _ = build_parser()
        options, extras = parser.parse_known_args(shlex.split(command))
        assert options.command
        assert extras == []


def rows() -> list[list[str]]:
    table = re.findall(r"^\| (\w+) \| (\S+j) \| (\S+) \| (\S+j) \| (\S+j) \| (\S+j) \|$", README, re.MULTILINE)
    return [list(row) for row in table]


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row[0]}-{row[2]}mm")
def test_truth_table_is_current(row):
    """Each row of the README's table is what educe returns today, to the printed digits."""
    case, true, height, *values = row
    kind = "orifice" if case[0] in "ot" else "slit"
    plane = tl.read_plane(ROOT / "data" / f"{kind}_{case}_y{float(height):.1f}mm.h5")
    found = tl.educe(plane, tl.load_liner(plane.liner), interval=None, allow_short=True)
    assert abs(complex(true) - plane.reference["true"]) < 1e-3
    for averaging, value in zip(found.averagings, values, strict=True):
        assert abs(complex(value) - complex(found.liner[averaging].impedance[0])) < 1e-3, averaging


def test_the_table_has_every_case():
    """Eleven cases, two heights each."""
    assert len(rows()) == 22


def test_shipped_data_are_whole():
    """Checksums, size, and every file of the list opens."""
    lines = (ROOT / "data" / "SHA256SUMS").read_text().splitlines()
    listed = dict(reversed(line.split("  ")) for line in lines)
    files = sorted((ROOT / "data").glob("*.h5"))
    assert sorted(listed) == [path.name for path in files]
    assert sum(path.stat().st_size for path in files) < 39e6
    for path in files:
        assert hashlib.sha256(path.read_bytes()).hexdigest() == listed[path.name]
        pressure = path.name.startswith("pressure_")
        record = tl.read_pressure(path) if pressure else tl.read_plane(path, lazy=True)
        assert record.provenance


def test_links_lead_somewhere():
    """Relative links and pictures exist, but for what the site makes: its build checks those."""
    docs, sites = (ROOT / "docs").glob("*.md"), (ROOT / "docs" / "site").glob("*.md")
    for page in [*PAGES, *docs, *sites, ROOT / "CONTRIBUTING.md", ROOT / "data" / "README.md"]:
        text = page.read_text(encoding="utf-8")
        targets = re.findall(r"\]\((?!http)([^)#]+)\)|^\[[^\]]+\]: (?!http)([^#\s]+)", text, re.M)
        for target in map("".join, targets):
            made = target.removeprefix("../").startswith(("pictures/", "api/"))
            assert made or (page.parent / target).exists(), f"{page.name}: {target}"
