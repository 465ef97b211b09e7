"""What surrounds the code says the same as the code."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path

import pytest

import torchliner as tl

ROOT = Path(__file__).resolve().parent.parent
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
