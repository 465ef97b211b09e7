"""The site builds without a warning or the network; its scripts and notebooks run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import load_script

import torchliner as tl

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
GALLERY = sorted((DOCS / "gallery").glob("plot_*.py"))
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))
PAGES = ("start", "errata")
ELSEWHERE = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*\bsrc="(?:https?:)?//"""
    r"""|<link\b[^>]*\brel="(?:stylesheet|preload|icon|preconnect)"[^>]*\bhref="(?:https?:)?//"""
    r"""|url\(["']?(?:https?:)?//"""
)
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture
def pictures(monkeypatch):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    load_script("../docs/gallery_style").apply()
    monkeypatch.chdir(DOCS / "gallery")
    yield pyplot
    pyplot.close("all")
    pyplot.rcdefaults()


@pytest.mark.slow
@pytest.mark.parametrize("script", GALLERY, ids=lambda path: path.stem)
def test_a_script_of_the_gallery_draws_a_picture(script, pictures):
    exec(compile(script.read_text(encoding="utf-8"), script.name, "exec"), {"__name__": "__main__"})
    (number,) = pictures.get_fignums()
    assert pictures.figure(number).axes


@pytest.mark.slow
@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_of_the_reference_runs(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    exec(compile(script.read_text(encoding="utf-8"), script.name, "exec"), {})


@pytest.mark.parametrize("page", PAGES)
def test_the_examples_of_a_page_of_the_site_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "site" / f"{page}.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for example in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(example, page, "exec"), names)
    assert "tl" in names


def test_every_public_name_stands_in_one_group_of_the_reference_and_in_its_example(monkeypatch):
    reference = load_script("../docs/reference")
    reference.check_groups()
    texts = {path.stem: path.read_text(encoding="utf-8") for path in EXAMPLES}
    for title, (_, names) in reference.GROUPS.items():
        example = texts.pop(title.lower().replace(" ", "_"))
        left = [name for name in names.split() if not re.search(rf"tl\.{name}\b", example)]
        assert not left, title
    assert not texts
    monkeypatch.setattr(tl, "__all__", [*tl.__all__, "a_new_name"])
    with pytest.raises(ValueError, match="not once in the groups: a_new_name"):
        reference.check_groups()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plane", "laser_doppler"])
def test_a_notebook_runs(name, monkeypatch):
    nbformat, nbclient = (pytest.importorskip(each) for each in ("nbformat", "nbclient"))
    pytest.importorskip("ipykernel")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    book = nbformat.read(DOCS / "notebooks" / f"{name}.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells)
    folder = {"metadata": {"path": str(DOCS / "notebooks")}}
    nbclient.NotebookClient(book, timeout=120, resources=folder).execute()
    shown = [output for cell in book.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in shown)


@pytest.mark.slow
def test_the_site_builds_without_a_warning_or_the_network(tmp_path):
    for module in ("sphinx", "myst_parser", "sphinx_gallery", "furo"):
        pytest.importorskip(module)
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", tmp_path / "trees"]
    made = subprocess.run([*build, DOCS, tmp_path / "html"], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr[-3000:]
    pages = list((tmp_path / "html").rglob("*.html"))
    assert len(pages) > 60
    for page in (*pages, *(tmp_path / "html" / "_static").rglob("*.css")):
        assert not ELSEWHERE.search(page.read_text(encoding="utf-8")), page
    reference = "".join(page.read_text() for page in pages if page.parent.name == "api")
    for name in set(tl.__all__) - {"__version__"}:
        assert f'id="torchliner.{name}"' in reference, name
