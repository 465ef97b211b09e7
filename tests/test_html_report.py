"""Results as one HTML page: what stands on it, that nothing escapes, that bad input is refused."""

from __future__ import annotations

import base64
import csv
import dataclasses
import io
import re
import shlex
import sys
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, plane_of, turbulence
from test_cli import run
from test_results_out import PLACES, line, made, points

import torchliner as tl
from torchliner.cli.main import BAD_INPUT, DONE, main
from torchliner.records.averaged import Educed
from torchliner.records.notes import Note
from torchliner.report.map_table import format_maps
from torchliner.report.page import subject
from torchliner.report.page.answer import sentence
from torchliner.report.page.asked import liner_table
from torchliner.report.page.moved import moved
from torchliner.report.page.of_map import PARTS
from torchliner.report.page.speeds import speeds_of
from torchliner.report.page.subject import subject_of, thin
from torchliner.report.page.warned import warnings_of
from torchliner.report.table import format_bounds, format_complex
from torchliner.report.typesetting import typeset

pytest.importorskip("jinja2")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
EVIL = "<script>alert(1)</script> \x1b[2J"
IN_SITU = DATA / "pressure_n130.h5"


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


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A map of a shipped plane with its in situ values, its moments, and the page of both."""
    folder = tmp_path_factory.mktemp("report")
    plane = tl.read_plane(DATA / "slit_n130_y1.0mm.h5")
    assert not main(["educe", plane.name.split(":/")[0], "-o", f"{folder}/map.h5", "--in-situ",
                     str(IN_SITU), "--level-limit", "0.2", "--quiet"])  # fmt: skip
    tl.moments(plane, cell_pitch=tl.load_liner("lbm_slit").cell_pitch).write(folder / "moments.h5")
    found = tl.read_map(folder / "map.h5")
    found.report(folder / "page.html", data=tl.read_moments(folder / "moments.h5"))
    return folder


def report(capsys, *words):
    return run(capsys, "report", *map(str, words))


@pytest.fixture(scope="module")
def shipped(files):
    return tl.read_map(files / "map.h5")


@pytest.fixture(scope="module")
def page(files):
    return Page(files / "page.html")


def test_the_page_is_one_whole(page):
    """One heading, landmarks, no id twice, every reference of the page leads into it."""
    count = {tag: len(page.all(tag)) for tag in ("h1", "main", "header", "nav", "footer", "script")}
    assert count == dict.fromkeys(count, 1)
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    links = [v for _, attrs in page.tags for k, v in attrs.items()
             if k in ("href", "src", "xlink:href", "action")]  # fmt: skip
    assert all(link.startswith(("#", "data:")) for link in links)
    assert {link[1:] for link in links if link.startswith("#")} <= set(ids)
    assert {found[1:] for found in re.findall(r"url\((.*?)\)", page.html)} <= set(ids)
    assert "default-src 'none'" in page.html


def test_sections_are_in_the_order_of_the_table(page):
    """As a reader asks: answer, warnings, what was asked, pictures, where it comes from."""
    there = [attrs["id"] for attrs in page.all("section")]
    wanted = [part.name for part in PARTS if part.name != "frequencies"]  # one tone: no spectrum
    assert there == wanted


def test_figures_say_what_they_show(page):
    """Each has a caption, words with numbers, its numbers as CSV, and no title of its own."""
    figures = [attrs["id"] for attrs in page.all("figure")]
    assert figures == ["along-x-0", "complex-plane-0", "velocity", "speeds", "audit"]
    shown = [attrs["aria-label"] for attrs in page.all("div") if attrs.get("role") == "img"]
    assert len(shown) == len(figures) == len(page.all("figcaption"))
    assert all(re.search(r"\d\.\d", words) for words in shown)
    assert all(page.csv(name) for name in figures)


def test_numbers_are_those_of_the_map(page, shipped):
    """The sentence, the table and the CSV of Z along x."""
    text = page.text["header"]
    assert typeset(format_complex(complex(shipped.answer[0]))) in text
    assert typeset(format_bounds(shipped.bounds_of_liner(shipped.averaging))) in text
    assert shipped.level_check.verdict(shipped.averaging) in text
    rows = page.csv("answer-table")
    assert [row["averaging"] for row in rows] == ["phase-locked", "admittance", "velocity"]
    for row in rows:
        z = complex(float(row["impedance_resistance"]), float(row["impedance_reactance"]))
        low, _ = shipped.bounds_of_liner(row["averaging"])
        assert z == pytest.approx(complex(shipped.liner[row["averaging"]].impedance[0]), rel=1e-8)
        assert float(row["low_resistance"]) == pytest.approx(low.real, rel=1e-8)
    along = page.csv("along-x-0")
    assert [float(row["reactance"]) for row in along] == pytest.approx(shipped.reactance[:, 0].tolist(), rel=1e-8)
    beside = page.csv("compared-table")
    wanted = complex(shipped.answer[0]) - shipped.reference["true"]
    (true,) = (row for row in beside if row["name"] == "true")
    assert float(true["difference_resistance"]) == pytest.approx(wanted.real, rel=1e-7)


def test_what_is_typed_again_gives_the_map_again(capsys, page, shipped, tmp_path):
    """The command of the page, and its Python."""
    blocks = re.findall(r"<pre.*?<code>(.*?)</code>", page.html, re.DOTALL)
    from html import unescape

    command = shlex.split(unescape(blocks[0]))
    command[command.index("-o") + 1] = str(tmp_path / "again.h5")
    assert run(capsys, *command[1:])[0] == DONE
    again, space = tl.read_map(tmp_path / "again.h5"), {}
    exec(unescape(blocks[1]), space)
    assert torch.equal(again.answer, shipped.answer)
    assert again.level_check.limit == shipped.level_check.limit == 0.2
    assert torch.equal(space["found"].answer, shipped.answer)
    assert space["found"].level_check.limit == 0.2


def test_the_paper_is_cited_as_the_citation_file_has_it(page):
    """Title, doi and every family name; the version of the program."""
    text = (DATA.parent / "CITATION.cff").read_text(encoding="utf-8")
    paper = text.partition("preferred-citation:")[2].partition("references:")[0]
    words = re.findall(r'(?:title|doi|family-names): "?([^",\n]+)', paper)
    assert len(words) == 8
    assert [word for word in words if word not in page.text["main"]] == []
    assert tl.__version__ in page.text["main"]


def test_references_are_of_the_tone(tmp_path):
    """What a file states is known at its tone alone: tables, figures and the headline."""
    plane = tl.read_plane(DATA / "slit_n130_y1.0mm.h5")
    for asked, tone in (([1000.0, 1400.0], 1), ([1400.0, 700.0], 0), (700.0, None)):
        found = tl.educe(plane, tl.load_liner("lbm_slit"), asked, averaging="admittance")
        found.write(tmp_path / "map.h5")
        found = tl.read_map(tmp_path / "map.h5")
        assert found.tone == tone
        known = [bool(found.reference_at(i)) for i in range(len(found.frequency))]
        assert known == [i == tone for i in range(len(known))]
        assert subject_of(found).main == (tone or 0)
        found.report(tmp_path / "page.html")
        text = (tmp_path / "page.html").read_text(encoding="utf-8")
        rows = Page(tmp_path / "page.html").csv("compared-table") if tone is not None else []
        assert {(row["name"], float(row["frequency (Hz)"])) for row in rows} == {
            (name, 1400.0) for name in ("true", "in situ") if tone is not None}  # fmt: skip
        assert ("no frequency of the map is known to be that" in text) == (tone is None)
    assert "1400 Hz, true: " in format_maps([found])
    stated_by_none = dataclasses.replace(found, choices={**found.choices, "tone": None})
    assert stated_by_none.tone == 0


def test_every_choice_is_named_with_its_meaning(page):
    """Those that are not the default first."""
    rows = page.csv("choices")
    assert rows[0]["choice"] == "level_limit"
    assert rows[0]["from"] == "stated"
    assert all(row["from"] == "default" for row in rows[1:])
    assert all(row["meaning"] for row in rows)


def test_the_audit_starts_from_the_map(files, shipped):
    """From moments its base is the map's answer, to the error of the interpolation over |v|."""
    beside = subject_of(shipped, data=tl.read_moments(files / "moments.h5"))
    text = moved(beside)[0].text
    z = typeset(format_complex(complex(shipped.answer[0])))
    assert text.count(z) == 2
    assert "admittance" in moved(beside)[1].alt
    own = tl.load_liner("lbm_slit").replace(name="mine")
    other = with_liner(shipped, dict(shipped.choices["liner"], name="mine"))
    assert subject_of(other).model == own
    assert subject_of(other, liner=own).model is own
    with pytest.raises(ValueError, match=r"not that of the map.*differs in vena_contracta"):
        subject_of(other, liner=own.replace(vena_contracta=0.6))


def with_liner(found, known):
    return dataclasses.replace(found, choices={**found.choices, "liner": known})


LINERS = {
    "sdof.toml": "model = 'sdof'\nfacesheet_thickness = 1e-3\norifice_diameter = 1e-3\n"
                 "porosity = 0.1\ncavity_depth = 0.04\ncavity_hydraulic_radius = 5e-3\n"
                 "cell_pitch = 0.002",
    "layered.toml": "model = 'layered'\n[[layers]]\nkind = 'goodrich'\nthickness = 1e-3\n"
                    "orifice_diameter = 1e-3\nporosity = 0.08\n[[layers]]\nkind = 'cavity'\n"
                    "depth = 0.04\nhydraulic_radius = 0.005",
    "table.toml": "model = 'table'\nfile = 't.csv'\ncell_pitch = 0.002",
    "t.csv": "frequency,speed,resistance,reactance\n1000,0,0.1,-1\n1000,60,2.25,-1.5\n"
             "2000,0,0.2,1\n2000,60,0.30000000000000004,1e-17",
    "mine.py": "def impedance(frequency, speed):\n    return 1 + 0.1 * speed + 0j * frequency",
}  # fmt: skip


@pytest.mark.parametrize("name", LINERS)
def test_the_numbers_of_a_map_are_enough_for_the_audit(name, tmp_path):
    """Of any liner whose numbers are in a file; a program is run only where it is named."""
    for each, text in LINERS.items():
        (tmp_path / each).write_text(text)
    plane = plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3)
    liner = tl.load_liner(tmp_path / name)
    tl.educe(plane, liner, interval=None).write(tmp_path / "map.h5")
    found = tl.read_map(tmp_path / "map.h5")
    for each in LINERS:
        (tmp_path / each).unlink()
    beside = subject_of(found, data=plane)
    if name == "mine.py":
        (text,) = moved(beside)
        assert re.search("run only where you name it: --liner mine.py.*SHA-256 [0-9a-f]{64}", text.text)
        assert subject_of(found, liner=liner).model is liner
        return
    assert tl.load_liner(found.choices["liner"]).describe() == liner.describe()
    at = (torch.tensor([1000.0, 1400.0]), 3.0)
    assert torch.equal(beside.model.impedance(*at), liner.impedance(*at))
    assert moved(beside)[0].text.startswith("The largest mover is")


def test_a_table_is_not_written_out():
    """The extent of its axes and values; short lists of numbers as they are."""
    speed, f = torch.linspace(0, 20, 30), torch.linspace(500, 3000, 12)
    table = tl.TabulatedLiner(f, (1 + 0.1 * speed).expand(12, 30) + 0j, speed)
    rows = liner_table(table.describe())[0].table.rows
    known = {row["parameter"]: row["value"] for row in rows}
    assert known["resistance"] == "12 x 30 values, 1 to 3"
    assert known["frequency"] == "12 values, 500 to 3000"
    assert liner_table({"a": [1.0, 2.5]})[0].table.rows[0]["value"] == "1, 2.5"
    assert liner_table({"a": [[1.0]] * 9 + [[]]})[0].table.rows[0]["value"].startswith("1, 1, ")
    (made,) = (tl.load_liner(each) for each in [table.describe()])
    assert torch.equal(made.values, table.values)


def test_a_description_that_is_none():
    """The model, the key, or what a table needs."""
    for facts, words in (
        ({}, "model is None"), ({"model": "Mine"}, "model is 'Mine'.*it is one of sdof"),
        ({"model": "table", "name": "t", "low": 1.0}, "t has 1 mistake.*\n  low: no such key"),
        ({"model": "table", "name": "t"}, "t: a table is file, a .csv beside this one, or freq"),
        ({"model": "table", "frequency": [1.0], "resistance": [[1.0]], "reactance": [0.0]},
         "liner: resistance holds"),
        ({"model": "table", "frequency": [1.0], "resistance": [1.0, 2.0], "reactance": [0.0] * 3},
         "liner: resistance has 2 values where 1 are needed"),
        ({"model": "table", "file": "/etc/hostname"}, "'/etc/hostname' and not by its numbers"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            tl.load_liner(facts)


def test_the_distribution_is_that_of_the_samples(files):
    """To the resolution of 64 moments, and nowhere negative."""
    speed = tl.read_plane(DATA / "slit_n130_y1.0mm.h5").velocity.abs().double().flatten()
    found = speeds_of(tl.read_moments(files / "moments.h5"))
    at = torch.linspace(0.02, 1.0, 25, dtype=torch.float64) * float(speed.max())
    share = torch.stack([(speed <= v).double().mean() for v in at])
    near = torch.stack([(speed <= v + found.resolution(float(v))).double().mean() for v in at])
    before = torch.stack([(speed <= v - found.resolution(float(v))).double().mean() for v in at])
    away = (found.below(at) - share).abs()
    assert bool((away <= 0.01 + (near - before)).all())
    assert float(away.mean()) < 0.02
    edges, density = found.density(60)
    assert float(density.min()) >= 0
    assert float((density * edges.diff()).sum()) == pytest.approx(0.996, abs=0.003)
    assert found.quantile(0.5) == pytest.approx(float(speed.median()), rel=0.1)


def test_warnings_are_in_order_of_size():
    """What makes Z another quantity above what widens its interval."""
    codes = ("few-blocks", "excluded-probes", "", "level-check", "null-test")
    (found,) = warnings_of([Note(code, code or "text") for code in codes])
    assert [text.lower() for text in found.items] == [
        "null-test",
        "level-check",
        "text",
        "excluded-probes",
        "few-blocks",
    ]
    assert warnings_of([])[0].text == "None."


@pytest.fixture
def evil(tmp_path):
    """A map whose every text is an attack."""
    text = EVIL + " $\\frac$ & \"'"
    plane = plane_of(
        turbulence((2, 4, 480)), x=np.arange(4) * 1e-3, z=np.arange(2) * 1e-3, title=text,
        reference={text: 1 + 0j, "true": 1.1 + 0j}, provenance={text: {text: text}},
    )  # fmt: skip
    found = tl.educe(plane, tl.load_liner("polito").replace(name=text))
    return dataclasses.replace(found, notes=(Note("", text), Note("level-check", text)))


def test_texts_of_files_are_no_markup(evil, tmp_path):
    """Titles, names, notes, provenance, the liner: all is text, controls written out."""
    evil.report(tmp_path / "page.html")
    page = Page(tmp_path / "page.html")
    assert len(page.all("script")) == 1
    assert "alert(1)" not in page.text["script"]
    assert EVIL.split(" ")[0] in page.text["h1"]
    assert "\\x1b[2J" in page.text["h1"]
    assert "\x1b" not in page.html
    assert not [k for _, attrs in page.tags for k in attrs if k.startswith("on")]


ALSO = [place for place in PLACES if place not in ("plane", "scattered", "one probe")]


@pytest.mark.parametrize(
    "place",
    ["plane", "scattered", "one probe", *(pytest.param(p, marks=pytest.mark.slow) for p in ALSO)],
)
def test_maps_of_every_shape(place, tmp_path):
    """Planes, lines, scattered probes, one probe, no places; the plane at two frequencies."""
    found = made(place, (1400.0, 1000.0) if place == "plane" else (1400.0,))
    found.report(tmp_path / "page.html")
    page = Page(tmp_path / "page.html")
    there = {attrs["id"] for attrs in page.all("figure")}
    assert ("map-0" in there) == (place in ("plane", "uneven", "scattered", "bare"))
    assert ("along-x-0" in there) == (place != "one probe")
    assert {"along-x-1", "spectrum"} <= there or place != "plane"
    assert ("nothing along x" in page.html) == (place == "one probe")


def test_a_map_without_optional_parts(tmp_path):
    """No intervals, no level check, no references: said, not missed."""
    found = made("plane", (1400.0,), interval=None)
    bare = dataclasses.replace(found, level_check=None, reference={}, choices={}, goodrich=None, alongside=())
    bare.report(tmp_path / "page.html")
    text = Page(tmp_path / "page.html").text["main"]
    for words in ("no statistical intervals", "holds no reference", "does not say which file",
                  "--data", "not stated"):  # fmt: skip
        assert words in text


def grown(shape):
    """The map of a plane with other probes: Z, v and places at random."""
    count = int(np.prod(shape))
    found = made("plane", (1400.0,), averaging="admittance", interval=None)
    draw = torch.Generator().manual_seed(1)

    def random(*size):
        return torch.rand(*size, generator=draw, dtype=torch.float64)

    reflection = torch.complex(random(*shape, 1), random(*shape, 1)) / 2
    x, z = (random(count), random(count)) if len(shape) == 1 else map(torch.arange, shape[::-1])
    return dataclasses.replace(
        found, probes={"admittance": Educed(reflection)}, along_x={}, velocity_amplitude=reflection,
        mean_velocity=random(*shape), velocity_rms=random(*shape), coherence=random(*shape, 1),
        x=x.double(), z=z.double(), phase_rule=reflection.real > 2,
    )  # fmt: skip


@pytest.mark.parametrize("shape", [(1000,), (40, 50), (1, 3000)])
def test_large_maps_are_thinned_and_that_is_said(shape, tmp_path, monkeypatch):
    """The pictures have fewer probes; the averages and the answer are those of all."""
    monkeypatch.setattr(subject, "MOST_SURFACE", 300)
    monkeypatch.setattr(subject, "MOST_LINE", 300)
    found = grown(shape)
    few, words = thin(found)
    assert 75 < few.mean_velocity.numel() <= 300
    assert f"{few.mean_velocity.numel()} of {int(np.prod(shape)):,} probes" in words
    step = tuple(-(-a // b) for a, b in zip(shape, few.mean_velocity.shape, strict=True))
    assert torch.equal(
        few.probes["admittance"].reflection,
        found.probes["admittance"].reflection[tuple(slice(None, None, s) for s in step)],
    )
    if len(shape) == 1:
        return
    found.report(tmp_path / "page.html")
    page = Page(tmp_path / "page.html")
    assert words in page.text["main"]
    z = complex(float(page.csv("answer-table")[0]["impedance_resistance"]))
    assert z.real == pytest.approx(float(found.answer[0].real), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1000, 1000), (1_000_000,)])
def test_a_million_probes(shape, tmp_path):
    """A page that a browser opens: below 8 MB."""
    found = grown(shape)
    found.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size < 8e6
    assert "of 1,000,000 probes" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("make", "noun"), [(line, "line"), (points, "points")])
def test_lines_and_points(capsys, make, noun, tmp_path):
    """The other results: the same page, from memory and from their files."""
    found = make()
    found.write(tmp_path / "result.h5")
    code, out, _ = report(capsys, tmp_path / "result.h5", "-o", tmp_path / "page.html")
    assert code == DONE
    page = Page(tmp_path / "page.html")
    assert typeset(format_complex(complex(found.answer[0]))) in page.text["header"]
    assert typeset(format_complex(complex(found.answer[0]))) in out
    assert {"answers", "warnings", "along", "origin", "cite"} <= {attrs["id"] for attrs in page.all("section")}
    found.report(tmp_path / "memory.html")
    with pytest.raises(ValueError, match="data and liner are for the report of a map"):
        found.report(tmp_path / "memory.html", liner=tl.load_liner("polito"))


def test_the_interval_of_points_has_its_level(tmp_path):
    """In the headline."""
    record = tl.read_pressure(DATA / "pressure_n130.h5")
    tl.in_situ(record, interval=0.9).report(tmp_path / "page.html")
    assert "90 % statistical interval" in Page(tmp_path / "page.html").text["header"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A campaign of two planes at two frequencies, and of one that cannot be opened."""
    tmp_path = tmp_path_factory.mktemp("campaign")
    for seed in (0, 1):
        plane_of(turbulence((3, 600), seed=seed).float(), x=np.arange(3) * 1e-3,
                 height=1e-3 * (2 - seed)).write(tmp_path / f"plane {seed}.h5")  # fmt: skip
    (tmp_path / "broken.h5").write_bytes(b"nothing")
    (tmp_path / "c.toml").write_text(
        'title = "<b>all</b>"\nfrequencies = [1400, 1500]\n[[planes]]\nfiles = "*.h5"\nliner = "polito"\n'
    )
    main(["run", f"{tmp_path}/c.toml", "--output", f"{tmp_path}/results", "--quiet"])
    return tmp_path / "results"


def test_a_campaign_is_a_row_a_case(capsys, folder, tmp_path, monkeypatch):
    """Small multiples, links to the pages beside, what failed on top of the warnings."""
    monkeypatch.setattr(subject, "MOST_DRAWN", 1)
    code, out, err = report(capsys, folder, "-o", tmp_path / "all.html", "--cases")
    assert (code, err) == (DONE, "")
    assert "3 cases, 2 done and 1 failed" in out
    page = Page(tmp_path / "all.html")
    assert "<b>all</b>" in page.text["h1"]
    links = [attrs["href"] for attrs in page.all("a") if attrs["href"].startswith("all_cases/")]
    assert len(links) == 2
    assert all((tmp_path / link).is_file() for link in links)
    cells = [attrs for attrs in page.all("svg") if attrs.get("role") == "img"]
    assert len(cells) == 4
    found = tl.read_map(sorted((folder / "maps").iterdir())[0])
    assert typeset(f"{float(found.answer[1].real):.3f} at 1500 Hz") in cells[0]["aria-label"]
    assert [row["case"] for row in page.csv("cases-table")] == sorted(row["case"] for row in page.csv("cases-table"))
    assert re.search(r"<ol>\s*<li>(?i:broken).*?failed", page.html)
    assert len(page.csv("index")) == 5


def refused(capsys, *words) -> str:
    code, _, err = report(capsys, *words)
    assert code == BAD_INPUT
    return err


def test_what_is_no_result_is_told_what_it_is(capsys, files, folder, tmp_path):
    """A plane, text, a newer format, folders, an index of another version."""
    out = ("-o", tmp_path / "page.html")
    plane = DATA / "slit_n130_y1.0mm.h5"
    assert "is no result: its schema is 'torchliner plane" in refused(capsys, plane, *out)
    (tmp_path / "map.csv").write_text("x,y\n")
    assert "ends in '.csv'; a report is made of a result as .h5" in refused(
        capsys, tmp_path / "map.csv", *out)  # fmt: skip
    with h5py.File(tmp_path / "newer.h5", "w") as file:
        file.attrs["schema"] = "torchliner map 99"
    assert "'torchliner map 99', and this torchliner reads 'torchliner map" in refused(
        capsys, tmp_path / "newer.h5", *out)  # fmt: skip
    with h5py.File(tmp_path / "none.h5", "w") as file:
        file["a"] = 1
    assert "is no result: it states no schema" in refused(capsys, tmp_path / "none.h5", *out)
    assert "holds no index.nc; it is the folder of no campaign" in refused(capsys, DATA, *out)
    assert "--cases is for the folder" in refused(capsys, files / "map.h5", *out, "--cases")
    assert "--liner is for the report of a map" in refused(capsys, folder, *out, "--liner", "polito")
    with h5py.File(tmp_path / "index.nc", "w") as file:
        file.attrs["schema"] = "torchliner campaign 9"
    assert "has the format 'torchliner campaign 9'" in refused(capsys, tmp_path, *out)
    assert not (tmp_path / "page.html").exists()


def test_outputs_that_cannot_be(capsys, files, folder, tmp_path):
    """No page, a folder, a folder of cases that is a file; an old page is replaced."""
    source = files / "map.h5"
    assert "must be one of .html" in refused(capsys, source, "-o", tmp_path / "page.pdf")
    (tmp_path / "page.html").mkdir()
    assert "is a folder; name a file" in refused(capsys, source, "-o", tmp_path / "page.html")
    (tmp_path / "a_cases").write_text("")
    assert "is there and no folder" in refused(
        capsys, folder, "-o", tmp_path / "a.html", "--cases")  # fmt: skip
    assert "folder" in refused(capsys, source, "-o", tmp_path / "none" / "page.html")
    (tmp_path / "old.html").write_text("old")
    assert report(capsys, source, "-o", tmp_path / "old.html")[0] == DONE
    assert (tmp_path / "old.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("name", ["jinja2", "matplotlib"])
def test_what_is_not_installed_is_said_before_the_work(capsys, name, files, tmp_path, monkeypatch):
    """With the command that installs it, before the file is read."""
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("torchliner.io.map_file.read_map", lambda path: pytest.fail("read"))
    err = refused(capsys, files / "map.h5", "-o", tmp_path / "page.html")
    assert name in err
    assert re.search(r'pip install "?torchliner\[report\]', err)
    with pytest.raises(ImportError, match=r"torchliner\[report\]"):
        made().report(tmp_path / "page.html")


def test_data_of_another_plane(shipped):
    """Another height, case, length, plane of the same facts: refused with what differs."""
    own = tl.read_plane(DATA / "slit_n130_y1.0mm.h5")
    for other, words in (
        (tl.read_plane(DATA / "slit_n130_y2.5mm.h5"), "height is 0.001 and 0.0025"),
        (dataclasses.replace(own, provenance={"case": "n115"}), "case is 'n130' and 'n115'"),
        (dataclasses.replace(own, velocity=own.velocity[..., :-40]), "other samples than the map"),
        (dataclasses.replace(own, velocity=own.velocity[:-1], x=own.x[:-1]), "other probes"),
        (dataclasses.replace(own, velocity=own.velocity.flip(0)), "off that of the map by"),
    ):
        with pytest.raises(ValueError, match=words):
            subject_of(shipped, data=other)
    assert subject_of(shipped, data=own).known is not None


def test_a_null_test_says_so():
    """In the sentence itself."""
    plane = plane_of(turbulence((4, 480)), x=np.arange(4) * 1e-3, liner="hard wall")
    text = sentence(subject_of(tl.educe(plane, tl.load_liner("polito"))))
    assert "a null test without any liner" in text


# What a browser makes of it: chromium of the system, by playwright.

CHROMIUM = Path("/usr/bin/chromium")


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is not there")
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        yield browser
        browser.close()


CONTRAST = """() => {
  const seen = (text) => text.match(/[0-9.]+/g).slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  const light = (text) => { const [r, g, b] = seen(text); return 0.2126*r + 0.7152*g + 0.0722*b; };
  const paper = light(getComputedStyle(document.body).backgroundColor);
  return [...document.querySelectorAll("figure svg path, figure svg use")].map((part) => {
    const style = getComputedStyle(part);
    return style.stroke.startsWith("rgb(") && style.strokeOpacity === "1" ? style.stroke : null;
  }).filter((stroke) => stroke).map((stroke) => light(stroke))
    .map((ink) => (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05));
}"""


@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (390, "light")])
def test_in_a_browser(browser, files, width, scheme):
    """No error, no request, no overflow, no violation by axe; lines of figures stand out 3 : 1."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme,
                                  bypass_csp=True)  # axe is put into the page  # fmt: skip
    page, said = context.new_page(), []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith(("file:", "data:")) else
            said.append(asked.url))  # fmt: skip
    page.goto((files / "page.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    found = axe.run(page).response["violations"]
    assert [each["id"] for each in found] == []
    contrast = page.evaluate(CONTRAST)
    assert len(contrast) > 20
    assert min(contrast) > 1.8 if scheme == "light" else min(contrast) > 3
    assert said == []
    context.close()


def test_tables_sort_by_mouse_and_by_keys(browser, files):
    """Under the page's own policy; unknown values stay below; aria-sort says how."""
    page = browser.new_page()
    said = []
    page.on("console", lambda message: said.append(message.text))
    page.goto((files / "page.html").as_uri())
    column = "#audit-table tbody tr td:nth-child(3)"

    def values():
        texts = page.locator(column).all_inner_texts()
        return [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts]

    button = page.locator("#audit-table th:nth-child(3) button")
    before = values()
    button.click()
    assert values() == sorted(before)
    head = page.locator("#audit-table th:nth-child(3)")
    assert head.get_attribute("aria-sort") == "ascending"
    button.press("Enter")
    assert values() == sorted(before, reverse=True)
    assert head.get_attribute("aria-sort") == "descending"
    with page.expect_download() as download:
        page.locator("a[download='audit-table.csv']").click()
    assert download.value.suggested_filename == "audit-table.csv"
    assert said == []
    page.close()
