"""What a notebook, an editor and a new installation show."""

from __future__ import annotations

import ast
import hashlib
import re
import subprocess
import sys
import zipfile
from importlib import resources
from pathlib import Path

import pytest
import torch
from conftest import DATA, load_script, plane_of, turbulence

import torchliner as tl
from torchliner.cli.files import DEMO_PLANES
from torchliner.cli.main import DONE, main
from torchliner.report.maps import over_surface

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
PLACES = {
    "grid": ((3, 4), {"x": [0.0, 0.01, 0.02, 0.03], "z": [0.0, 0.01, 0.02]}),
    "line": ((4,), {"x": [0.0, 0.01, 0.02, 0.03]}),
    "slanted": ((4,), {"x": [0.0, 0.01, 0.02, 0.03], "z": [0.0, 0.005, 0.01, 0.015]}),
    "scattered": ((5,), {"x": [0.0, 0.01, 0.0, 0.011, 0.005], "z": [0.0, 0.0, 0.01, 0.01, 0.004]}),
}


def plane_at(place, **about):
    shape, where = PLACES[place]
    title = about.pop("title", "a <b>plane</b>")
    return plane_of(turbulence((*shape, 450)), height=1e-3, title=title, **where, **about)


@pytest.fixture(scope="module")
def maps():
    liner = tl.load_liner("polito")
    with pytest.warns(tl.DataWarning):
        return {place: tl.educe(plane_at(place), liner, [1400.0, 1000.0]) for place in PLACES}


def records(maps):
    plane = plane_at("grid")
    return [plane, maps["grid"], tl.moments(plane, cell_pitch=0.01)]


def test_notebooks_get_a_table_whose_titles_are_text(maps):
    for record in records(maps):
        html = record._repr_html_()
        assert "&lt;b&gt;plane" in html
        assert "<b>plane" not in html
    assert maps["grid"]._repr_html_().count("<tr>") == 2
    frequency = torch.linspace(1000, 2000, 30, dtype=torch.float64)
    html = tl.educe(plane_at("grid"), tl.load_liner("polito"), frequency, interval=None)._repr_html_()
    assert (html.count("<tr>"), "18 more" in html) == (13, True)


def test_scattered_probes_make_a_map(maps):
    assert [over_surface(maps[place]) for place in PLACES] == [True, False, False, True]
    figure = maps["scattered"].plot(frequency=1400.0)
    assert figure._repr_png_().startswith(b"\x89PNG")
    drawn = figure.axes[0].collections[0]
    low, high = drawn.get_clim()
    assert low < float(maps["scattered"].resistance[4, 0]) < high
    assert drawn.get_array().shape[0] == 5


def test_plots_go_into_given_axes_at_a_given_frequency(maps, tmp_path):
    from matplotlib.figure import Figure

    for place in PLACES:
        axes = Figure().subplots(1, 2)
        assert maps[place].plot(frequency=1000.0, ax=axes) is axes
        assert axes[0].has_data()
        assert axes[1].has_data()
    one = Figure().subplots()
    assert maps["line"].plot(ax=one, frequency=1000.0) is one
    (curve, *_) = one.get_lines()
    assert curve.get_ydata() == pytest.approx(maps["line"].resistance[:, 1].numpy())
    with pytest.raises(ValueError, match=r"frequency is 1200 Hz; the record has 1400, 1000 Hz"):
        maps["line"].plot(frequency=1200.0)
    with pytest.raises(ValueError, match=r"3 axes are given; 2 panels need 2, or one"):
        maps["line"].plot(ax=Figure().subplots(1, 3))
    with pytest.raises(ValueError, match=r"m.png: give a path or axes"):
        maps["line"].plot(tmp_path / "m.png", ax=one)


# Types.


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


# What comes with the program.


def test_the_demo_planes_are_the_shipped_ones_and_small():
    folder = resources.files("torchliner") / "demo_planes"
    names = sorted(each.name for each in folder.iterdir())
    assert names == sorted(DEMO_PLANES)
    content = [(folder / name).read_bytes() for name in names]
    assert sum(map(len, content)) < 2e6
    for name, each in zip(names, content, strict=True):
        wanted = hashlib.sha256((DATA / name).read_bytes()).hexdigest()
        assert hashlib.sha256(each).hexdigest() == wanted


def test_the_demo_educes_near_the_truth(tmp_path, monkeypatch, capsys, unrendered):
    monkeypatch.chdir(tmp_path)
    assert main(["educe", str(DATA / "slit_n130_y0.5mm.h5"), "--quiet", "--verbose"]) == DONE
    assert re.search(r"true +0\.168-0\.066j", capsys.readouterr().out)
    assert main(["demo"]) == DONE
    out = capsys.readouterr().out
    assert "0.174-0.063j" in out
    assert list(tmp_path.iterdir()) == []
    assert main(["demo", "--folder", "new/my folder"]) == DONE
    assert "-o 'new/my folder'" in capsys.readouterr().out  # to be typed as it stands
    there = {each.name for each in Path("new/my folder").iterdir()}
    assert {"educe_slit_n130_y0.5mm.h5", "along_x.png", "height.png"} <= there


@pytest.mark.slow
def test_the_wheel_carries_the_demo(tmp_path):
    """Built as pip builds them, where the build backend can be had: the demo runs from it alone."""
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(tmp_path), "."]
    made = subprocess.run(build, cwd=DATA.parent, capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no wheel can be built here: {made.stderr[-200:]}")
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 3e6
    with zipfile.ZipFile(wheel) as whole:
        names = whole.namelist()
        whole.extractall(tmp_path / "site")
    assert {f"torchliner/demo_planes/{name}" for name in DEMO_PLANES} <= set(names)
    assert "torchliner/__init__.pyi" in names
    assert not any(name.startswith(("data/", "tests/")) for name in names)
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r}); import torchliner; "
        "assert 'site' in torchliner.__file__; from torchliner.cli.main import main; "
        "sys.exit(main(['demo']))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, env={"PATH": ""}
    )
    assert "0.174-0.063j" in found.stdout, found.stderr
