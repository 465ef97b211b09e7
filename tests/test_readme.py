"""The README and the pages hold: examples and commands run, shipped data are whole, links lead somewhere."""

from __future__ import annotations

import contextlib
import hashlib
import io
import re
import shlex
from pathlib import Path

import pytest

import torchliner as tl
from torchliner.cli.main import main, parsed

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "site").glob("*.md"))]
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def commands_of(text: str) -> list[str]:
    blocks = "".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    return [
        each.strip() for line in re.findall(r"^torchliner (.+)$", blocks, re.M) for each in line.split("&& torchliner ")
    ]


@pytest.fixture
def beside_data(tmp_path, monkeypatch):
    """A folder of its own with the shipped data."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    (tmp_path / "results").mkdir()
    return tmp_path


def test_python_example_runs(beside_data):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, "README.md", "exec"), {})
    assert "0.174-0.063j" in printed.getvalue()
    assert (beside_data / "map.png").exists()
    assert len(README.splitlines()) <= 80


@pytest.mark.parametrize("command", commands_of(README))
def test_commands_of_the_readme_run(beside_data, command):
    words = [
        name
        for word in shlex.split(command)
        for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    assert main([*words, "--quiet"]) == 0


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_commands_are_understood(page):
    for command in commands_of(page.read_text(encoding="utf-8")):
        assert parsed(shlex.split(command, comments=True))


def test_shipped_data_are_whole():
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
    for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "data" / "README.md"]:
        text = page.read_text(encoding="utf-8")
        targets = re.findall(r"\]\((?!http)([^)#]+)\)|^\[[^\]]+\]: (?!http)([^#\s]+)", text, re.M)
        for target in map("".join, targets):
            made = target.removeprefix("../").startswith(("pictures/", "api/"))
            assert made or (page.parent / target).exists(), f"{page.name}: {target}"
