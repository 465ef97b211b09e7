"""Results as one HTML page: what stands on it, that nothing escapes, that bad input is refused."""

import base64
import csv
import dataclasses
import io
import re
import shlex
import sys
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, plane_of, turbulence
from test_cli import run
from test_own_files import noisy
from test_results_out import PLACES, line, made, points

import torchliner as tl
from torchliner.cli.main import BAD_INPUT, DONE, main
from torchliner.records.notes import Note
from torchliner.report.answer import answer_of
from torchliner.report.of_map import main_of
from torchliner.report.table import format_bounds, format_complex

pytest.importorskip("jinja2")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
EVIL = "<script>alert(1)</script> \x1b[2J $\\frac$ & \"'"


class Page(HTMLParser):
    """Elements, their attributes and their text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags, self.open, self.text = [], [], {}
        self.html = path.read_text(encoding="utf-8")
        self.feed(self.html)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.open.append(tag)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        for tag in self.open:
            self.text[tag] = self.text.get(tag, "") + data

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]

    def csv(self, name):
        link = next(a["href"] for a in self.all("a") if a.get("download") == f"{name}.csv")
        text = base64.b64decode(link.partition("base64,")[2]).decode()
        return list(csv.DictReader(io.StringIO(text)))


def page_of(result, folder, *others):
    result.report(folder / "page.html", *others)
    return Page(folder / "page.html")


def report(capsys, *words):
    return run(capsys, "report", *map(str, words))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A map of a shipped plane with its in situ values, and its page."""
    folder = tmp_path_factory.mktemp("report")
    words = ["educe", str(DATA / "slit_n130_y1.0mm.h5"), "-o", f"{folder}/map.h5", "--quiet"]
    assert not main([*words, "--in-situ", str(DATA / "pressure_n130.h5"), "--level-limit", "0.2"])
    assert not main(["report", f"{folder}/map.h5", "-o", f"{folder}/page.html", "--quiet"])
    return folder


@pytest.fixture(scope="module")
def shipped(files):
    return tl.read_map(files / "map.h5")


@pytest.fixture(scope="module")
def page(files):
    return Page(files / "page.html")


def require_whole(page):
    """One heading, no id twice, nothing is asked for outside, every figure has words and numbers."""
    assert [len(page.all(tag)) for tag in ("h1", "main", "header", "script")] == [1, 1, 1, 0]
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    links = [value for _, attrs in page.tags for key, value in attrs.items() if key in ("href", "src", "action")]
    assert all(link.startswith("data:") for link in links)
    assert "default-src 'none'" in page.html
    figures = [attrs["id"] for attrs in page.all("figure")]
    assert len([attrs for attrs in page.all("img") if attrs["alt"]]) == len(figures)
    assert all(page.csv(name) for name in figures)
    return figures


def test_numbers_are_those_of_the_map(page, shipped):
    assert require_whole(page) == ["along_x"]
    wanted = ["answers", "warnings", "pictures", "tables", "origin", "cite"]
    assert [attrs["id"] for attrs in page.all("section")] == wanted
    text = page.text["header"]
    assert format_complex(complex(shipped.answer[0])) in text
    assert format_bounds(shipped.bounds_of_liner(shipped.averaging)) in text
    assert shipped.level_check.verdict(shipped.averaging) in text
    rows = {row["averaging"]: row for row in page.csv("answer")}
    assert [*rows][:3] == ["phase-locked", "admittance", "velocity"]
    for name in shipped.averagings:
        z = complex(float(rows[name]["resistance"]), float(rows[name]["reactance"]))
        assert z == pytest.approx(complex(shipped.liner[name].impedance[0]), rel=1e-8)
        assert float(rows[name]["resistance_low"]) == pytest.approx(shipped.bounds_of_liner(name)[0].real, rel=1e-8)
    assert float(rows["reference"]["reactance"]) == pytest.approx(shipped.reference["true"].imag)
    assert float(rows["in situ (Dean), pressure first"]["resistance_low"]) > 0
    along = page.csv("along_x")
    assert [float(row["reactance"]) for row in along] == pytest.approx(shipped.impedance[:, 0].imag.tolist(), rel=1e-8)
    choices = {row["choice"]: row["value"] for row in page.csv("choices")}
    assert (choices["level limit"], choices["liner, orifice diameter"]) == ("0.2", "0.000684")


def test_the_command_gives_the_map_again(capsys, page, shipped, tmp_path):
    command = shlex.split(unescape(re.search(r"<dd>(torchliner educe.*?)</dd>", page.html)[1]))
    command[command.index("-o") + 1] = str(tmp_path / "again.h5")
    assert run(capsys, *command[1:])[0] == DONE
    again = tl.read_map(tmp_path / "again.h5")
    assert torch.equal(again.answer, shipped.answer)
    assert again.level_check.limit == shipped.level_check.limit == 0.2


def test_references_are_of_the_tone():
    """What a file states is known at its tone alone."""
    plane = tl.read_plane(DATA / "slit_n130_y1.0mm.h5")
    for tone, wanted in ([1000.0, 1400.0], 1), ([1400.0, 700.0], 0), (700.0, None):
        found = tl.educe(plane, tl.load_liner("lbm_slit"), tone, averaging="admittance")
        assert found.tone == wanted
        assert main_of(found) == (wanted or 0)
        rows = answer_of(found).table.rows
        names = {"reference", *found.reference} - {"true"}
        known = {(row["averaging"], row["frequency"]) for row in rows if row["averaging"] in names}
        assert known == {(name, 1400.0) for name in names if wanted is not None}


def test_texts_of_files_are_no_markup(tmp_path):
    """Titles, names, notes, provenance, the liner, methods: all is text, controls written out."""
    places = {"x": np.arange(4) * 1e-3, "z": np.arange(2) * 1e-3}
    about = {"reference": {EVIL: 1 + 0j, "true": 1.1 + 0j}, "provenance": {EVIL: {EVIL: EVIL}}}
    plane = plane_of(turbulence((2, 4, 480)), title=EVIL, **places, **about)
    found = tl.educe(plane, tl.load_liner("polito").replace(name=EVIL))
    found = dataclasses.replace(found, notes=(Note("", EVIL), Note("level-check", EVIL)))
    row = dataclasses.replace(noisy("upstream").at(600.0), title=EVIL, provenance={EVIL: EVIL})
    choices = {EVIL: EVIL, "command": EVIL}
    waves = dataclasses.replace(tl.kumaresan_tufts(row), notes=(EVIL,), choices=choices, method=EVIL)
    for result in (found, waves):
        page = page_of(result, tmp_path)
        assert not page.all("script")
        assert EVIL.split(" ")[0] in page.text["h1"]
        assert "\\x1b[2J" in page.text["h1"]
        assert "\x1b" not in page.html
        assert not [key for _, attrs in page.tags for key in attrs if key.startswith("on")]


ALSO = [place for place in PLACES if place not in ("plane", "scattered", "one probe")]


@pytest.mark.parametrize(
    "place", ["plane", "scattered", "one probe", *(pytest.param(p, marks=pytest.mark.slow) for p in ALSO)]
)
def test_maps_of_every_shape(place, tmp_path):
    page = page_of(made(place, (1400.0, 1000.0) if place == "plane" else (1400.0,)), tmp_path)
    there = require_whole(page)
    assert ("map" in there) == (place in ("plane", "uneven", "scattered", "bare"))
    assert ("along_x" in there) == (place != "one probe")
    assert ("spectrum" in there) == (place == "plane")


@pytest.mark.parametrize("make", [line, points])
def test_lines_and_points(capsys, make, tmp_path):
    found = make()
    found.write(tmp_path / "result.h5")
    code, out, _ = report(capsys, tmp_path / "result.h5", "-o", tmp_path / "page.html")
    page, z = Page(tmp_path / "page.html"), format_complex(complex(found.answer[0]))
    require_whole(page)
    assert (code, z in out, z in page.text["header"]) == (DONE, True, True)


def test_a_map_without_optional_parts(tmp_path):
    plane = plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3, liner="hard wall")
    found = tl.educe(plane, tl.load_liner("polito"), 1400.0, interval=None)
    page = page_of(dataclasses.replace(found, reference={}, choices={}, goodrich=None, alongside=()), tmp_path)
    assert "no interval" in page.text["header"]
    assert "null test of a hard wall, no impedance" in page_of(found, tmp_path).text["header"]


def test_two_sources_of_one_wall(tmp_path):
    walls = torch.tensor([1 + 0.5j, 1 + 1.5j, 1 + 2.5j])
    lines = [dataclasses.replace(noisy("upstream"), wall_impedance=walls), noisy("downstream")]
    found = [tl.kumaresan_tufts(each, draws=20) for each in lines]
    page = page_of(found[0], tmp_path, found[1])
    assert require_whole(page) == ["spectrum", "along_wall"]
    at = int(torch.stack([one.residual for one in found]).max(0).values.argmin())
    z = [complex(one.impedance[at]) for one in found]
    text = page.text["header"]
    for one, value in zip(found, z, strict=True):
        low, high = (complex(end[at]) for end in one.interval())
        assert f"{format_complex(value)} (95 % interval: {format_bounds((low, high))})" in text
        assert f"source {one.source_side}" in text
    assert f"{200 * abs(z[0] - z[1]) / (abs(z[0]) + abs(z[1])):.3g} % apart" in text
    rows = page.csv("answer")
    assert [row["known_reactance"] for row in rows] == ["0.5", "1.5", "2.5", "", "", ""]
    levels = torch.cat([each.level[:, at] for each in lines])
    assert [float(row["spl"]) for row in page.csv("along_wall")] == pytest.approx(levels.tolist())


def test_the_page_of_a_duct(capsys, tmp_path):
    words = "duct solve b2a --profile uniform --frequency 900 1200 --mesh 20 --impedance 1.5-0.5j -o".split()
    assert run(capsys, *words, str(tmp_path / "duct.h5"))[0] == DONE
    solved = tl.read_microphones(tmp_path / "duct.h5")
    assert report(capsys, tmp_path / "duct.h5", "-o", tmp_path / "page.html")[0] == DONE
    page = Page(tmp_path / "page.html")
    require_whole(page)
    loss = [row["transmission loss (dB)"] for row in solved.provenance["plane_mode"]]
    assert [float(row["transmission loss (dB)"]) for row in page.csv("answer")] == pytest.approx(loss)
    assert f"takes {loss[0]:.2f} dB" in page.text["header"]
    levels = [float(row["spl"]) for row in page.csv("along_wall")]
    assert levels == pytest.approx(solved.level.T.flatten().tolist())


def test_a_campaign(capsys, tmp_path):
    for seed in (0, 1):
        plane = plane_of(turbulence((3, 600), seed=seed).float(), x=np.arange(3) * 1e-3, height=1e-3 * (2 - seed))
        plane.write(tmp_path / f"plane {seed}.h5")
    (tmp_path / "broken.h5").write_bytes(b"nothing")
    text = 'title = "<b>all</b>"\nfrequencies = [1400, 1500]\n[[planes]]\nfiles = "*.h5"\nliner = "polito"\n'
    (tmp_path / "c.toml").write_text(text)
    folder = tmp_path / "results"
    main(["run", f"{tmp_path}/c.toml", "--output", str(folder), "--quiet"])
    code, out, err = report(capsys, folder, "-o", tmp_path / "all.html")
    assert (code, err) == (DONE, "")
    assert "3 cases, 2 done and 1 failed" in out
    page = Page(tmp_path / "all.html")
    assert "<b>all</b>" in page.text["h1"]
    found = tl.read_map(sorted((folder / "maps").iterdir())[0])
    rows = page.csv("answer")
    assert len(rows) == 5
    assert float(rows[2]["resistance"]) == pytest.approx(float(found.answer[1].real))
    assert re.search(r"(?i:broken).*?failed", page.html)
    (folder / "index.csv").write_text("a,b\n")
    code, _, err = report(capsys, folder, "-o", tmp_path / "again.html")
    assert (code, "is no index of this version" in err) == (BAD_INPUT, True)


def test_what_cannot_be_is_refused(capsys, files, tmp_path):
    source, out = files / "map.h5", tmp_path / "page.html"
    whole = source.read_bytes()
    (tmp_path / "text.csv").write_text("a")
    (tmp_path / "new.h5").write_bytes(whole)
    with h5py.File(tmp_path / "new.h5", "a") as file:
        file.attrs["schema"] = "torchliner map 9"
    (tmp_path / "half.h5").write_bytes(whole[: len(whole) // 2])
    for typed, message in (
        ((DATA / "slit_n130_y1.0mm.h5", "-o", out), "'torchliner plane 1'"),
        ((tmp_path / "text.csv", "-o", out), "is no result"),
        ((tmp_path / "new.h5", "-o", out), "'torchliner map 9', not one of torchliner map"),
        ((tmp_path / "half.h5", "-o", out), "half.h5 is truncated"),
    ):
        code, _, err = report(capsys, *typed)
        assert (code, message in err) == (BAD_INPUT, True), err
    assert not out.exists()
    out.write_text("old")
    assert report(capsys, source, "-o", out)[0] == DONE
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("name", ["jinja2", "matplotlib"])
def test_what_is_not_installed_is_said_before_the_work(capsys, name, files, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("torchliner.io.own_file.read_map", lambda path: pytest.fail("read"))
    code, _, err = report(capsys, files / "map.h5", "-o", tmp_path / "page.html")
    assert (code, "torchliner[report]" in err) == (BAD_INPUT, True)
    with pytest.raises(ImportError, match=r"torchliner\[report\]"):
        made().report(tmp_path / "page.html")


@pytest.mark.parametrize("width", [1280, 390])
def test_in_a_browser(files, width):
    """Chromium of the system: no error, no request, no overflow, no violation by axe."""
    api = pytest.importorskip("playwright.sync_api")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    if not (chromium := Path("/usr/bin/chromium")).exists():
        pytest.skip(f"{chromium} is not there")
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(chromium), args=["--no-sandbox"])
        view = {"width": width, "height": 900}
        page, said = browser.new_context(viewport=view, bypass_csp=True).new_page(), []
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda asked: asked.url.startswith(("file:", "data:")) or said.append(asked.url))
        page.goto((files / "page.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert [each["id"] for each in axe.run(page).response["violations"]] == []
        assert said == []
        browser.close()
