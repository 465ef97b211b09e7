"""README, pages and recipes: examples and commands run, shipped data are whole, links lead somewhere."""

import ast
import contextlib
import doctest
import hashlib
import io
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import torch
from conftest import doubtful, load_script

import torchliner as tl
from oracles.periodic_wall import fixed_impedance
from torchliner.cli.main import main, parsed

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "site").glob("*.md"))]


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


# Examples


def slits() -> dict[str, object]:
    found = {case: tl.read_plane(f"data/slit_{case}_y2.5mm.h5") for case in ("n115", "n130")}
    g01 = tl.read_plane("data/slit_g01_145_y2.5mm.h5")
    return {**found, "g01": g01, "tl": tl, "plane": found["n130"], "liner": tl.load_liner("lbm_slit")}


def microphones() -> dict[str, object]:
    assert main(["duct", "solve", "b2a", "-o", "up.h5", "--quiet"]) == 0
    return {}


def examples(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


NAMES = {"calibration": slits, "identify": slits, "liners": lambda: {"tl": tl}, "wall_pressure": microphones}
SLOW = {"calibration": pytest.mark.slow}  # all parameters of a liner, two fits, a prediction
EXAMPLES = [page for page in PAGES[1:] if examples(page) and page.stem != "campaigns"]  # test_campaign.py


@doubtful
@pytest.mark.parametrize("page", [pytest.param(page, marks=SLOW.get(page.stem, ()), id=page.stem) for page in EXAMPLES])
def test_the_examples_of_a_page_run(page, beside_data):
    """One after another, in one namespace, as a reader would paste them."""
    names = NAMES.get(page.stem, dict)()
    for example in examples(page):
        exec(compile(example, page.name, "exec"), names)


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
    assert tried >= 7


# docs/liners.md


def block(kind: str) -> str:
    page = (ROOT / "docs" / "liners.md").read_text(encoding="utf-8")
    return re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL)[-1]


def test_the_command_prints_what_the_page_shows(beside_data, capsys):
    Path("goodrich.toml").write_text(block("toml"), encoding="utf-8")
    Path("mine.py").write_text(block("py"), encoding="utf-8")
    command = block("sh").replace("\\\n", " ").split()[1:]
    assert main([*command, "--quiet"]) == 0
    assert capsys.readouterr().out == block("text")


def test_the_measured_sample_says_what_the_page_says():
    """Both presets against the measured Z, from 500 and from 800 to 2500 Hz: docs/validation.md."""
    measured = tl.load_liner(ROOT / "data" / "ufsc_measured.csv")
    frequency, rows = measured.frequency, []
    for name in ("polito", "polito_as_printed"):
        liner = tl.load_liner(name)
        driven = [fixed_impedance(liner, 130.0, f) for f in frequency.tolist()]
        both = liner.impedance(frequency), torch.tensor(driven, dtype=torch.complex128)
        for low in (500, 800):
            off = []
            for impedance in both:
                away = (impedance - measured.impedance(frequency))[frequency >= low]
                off += [f"{float(part.square().mean().sqrt()):.3f}" for part in (away.real, away.imag)]
            rows.append(f"| `{name}` | {low}–2500 | {' | '.join(off)} |")
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    assert "\n".join(rows) in page, "\n".join(rows)


# Recipes, workflows and forms

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
yaml = pytest.importorskip("yaml")


def read(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for():
    recipe = read(".ci/conda/recipe.yaml")
    wheel = {re.sub(r"^torch(?=>)", "pytorch", each) for each in PROJECT["dependencies"]}
    asked = {each.replace(" ", "") for each in recipe["requirements"]["run"]}
    assert asked == wheel | {f"python{PROJECT['requires-python']}"}
    assert recipe["context"]["version"] == tl.__version__
    ((name, home),) = PROJECT["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [f"{name} = {home}"]


def test_the_citation_has_the_version_and_the_paper():
    citation = read("CITATION.cff")
    assert citation["version"] == tl.__version__
    assert citation["preferred-citation"]["doi"] in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_workflow_calls_the_same_script_as_everybody():
    (job,) = read(".github/workflows/test.yml")["jobs"].values()
    assert [step["run"] for step in job["steps"] if "run" in step] == [".ci/run"]
    (python,) = [step["with"]["python-version"] for step in job["steps"] if "with" in step]
    assert f">={python}" == PROJECT["requires-python"]
    assert os.access(ROOT / ".ci/run", os.X_OK)


@pytest.mark.parametrize("form", sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")))
def test_every_form_asks_for_something(form):
    body = read(form.relative_to(ROOT))["body"]
    assert all(each["attributes"]["label"] for each in body)
    assert any(each.get("validations", {}).get("required") for each in body)


# The site builds without a warning or the network; its scripts and notebooks run

DOCS = ROOT / "docs"
GALLERY = sorted((DOCS / "gallery").glob("plot_*.py"))
SCRIPTS = sorted((DOCS / "examples").glob("*.py"))
ELSEWHERE = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*\bsrc="(?:https?:)?//"""
    r"""|<link\b[^>]*\brel="(?:stylesheet|preload|icon|preconnect)"[^>]*\bhref="(?:https?:)?//"""
    r"""|url\(["']?(?:https?:)?//"""
)


@pytest.fixture
def pictures(monkeypatch):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    load_script("../docs/gallery_style").apply()
    monkeypatch.chdir(DOCS / "gallery")
    yield pyplot
    pyplot.close("all")
    pyplot.rcdefaults()


@doubtful
@pytest.mark.slow
@pytest.mark.parametrize("script", GALLERY, ids=lambda path: path.stem)
def test_a_script_of_the_gallery_draws_a_picture(script, pictures):
    exec(compile(script.read_text(encoding="utf-8"), script.name, "exec"), {"__name__": "__main__"})
    (number,) = pictures.get_fignums()
    assert pictures.figure(number).axes


@doubtful
@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_of_the_reference_runs(script, beside_data):
    exec(compile(script.read_text(encoding="utf-8"), script.name, "exec"), {})


def test_every_public_name_stands_in_one_group_of_the_reference_and_in_its_example(monkeypatch):
    reference = load_script("../docs/reference")
    reference.check_groups()
    texts = {path.stem: path.read_text(encoding="utf-8") for path in SCRIPTS}
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


# What an editor and a new installation show


def test_the_stub_is_what_the_code_says():
    stub = load_script("make_stub")
    assert stub.STUB.read_text(encoding="utf-8") == stub.text()
    named = set()
    for node in ast.parse(stub.text()).body:
        if isinstance(node, ast.ImportFrom):
            named |= {each.asname for each in node.names if each.asname == each.name}
        elif isinstance(node, ast.FunctionDef):
            named.add(node.name)
    assert named == set(tl.__all__)


@pytest.mark.slow
def test_mypy_knows_the_options(tmp_path):
    mypy = pytest.importorskip("mypy.api")
    text = """import torchliner as tl
p, l = tl.read_plane("p.h5"), tl.load_liner("onera")
good: tl.ImpedanceMap = tl.educe(p, l, frequency=3.0, averaging="phase-locked")
tl.educe(p, l, frequncy=3)
"""
    (tmp_path / "slip.py").write_text(text)
    out, _, _ = mypy.run(["--strict", "--cache-dir", str(tmp_path / "c"), str(tmp_path / "slip.py")])
    assert 'slip.py:4: error: Unexpected keyword argument "frequncy"' in out
    assert {line.split(":")[1] for line in out.splitlines() if "slip.py" in line} == {"4"}
