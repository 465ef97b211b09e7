"""The pages' Python examples run as printed, on data made for them."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest
import torch

import torchliner as tl

ROOT = Path(__file__).resolve().parent.parent


def slits() -> dict[str, object]:
    found = {case: tl.read_plane(f"data/slit_{case}_y2.5mm.h5") for case in ("n115", "n130")}
    g01 = tl.read_plane("data/slit_g01_145_y2.5mm.h5")
    return {**found, "g01": g01, "tl": tl, "plane": found["n130"], "liner": tl.load_liner("lbm_slit")}


def microphones() -> dict[str, object]:
    from torchliner.cli.main import main

    assert main(["duct", "solve", "b2a", "-o", "up.h5", "--quiet"]) == 0
    return {}


PAGES = {
    "calibration": slits,
    "duct": dict,
    "formats": dict,
    "frequencies": dict,
    "identify": slits,
    "in_situ": dict,
    "ir_tdibc": dict,
    "ldv": dict,
    "liners": lambda: {"tl": tl},
    "method": dict,
    "moments": dict,
    "package": dict,
    "report": dict,
    "results": dict,
    "wall_pressure": microphones,
}

SLOW = {"calibration": pytest.mark.slow}  # all parameters of a liner, two fits, a prediction


def examples(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_no_page_is_forgotten():
    """The README's example has its own test, as have campaigns (test_campaign.py)."""
    found = {page.stem for page in (ROOT / "docs").glob("*.md") if examples(page)}
    assert found == {*PAGES, "campaigns"}


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize("page", [pytest.param(page, marks=SLOW.get(page, ())) for page in PAGES])
def test_the_examples_of_a_page_run(page, tmp_path, monkeypatch):
    """One after another, in one namespace, as a reader would paste them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    names = PAGES[page]()
    for example in examples(ROOT / "docs" / f"{page}.md"):
        exec(compile(example, f"docs/{page}.md", "exec"), names)


def test_the_examples_of_docstrings_run():
    """Those of the public names, as printed, with ``tl`` and ``torch`` imported."""
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    tried = 0
    for name in tl.__all__:
        value = getattr(tl, name)
        if isinstance(value, type) or callable(value):
            for example in finder.find(value, name, globs={"tl": tl, "torch": torch}):
                tried += bool(example.examples)
                assert runner.run(example).failed == 0
    assert tried >= 10
