"""Eductions from microphones and solved ducts: files that keep them whole, pages that show them."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
import shlex
import shutil
import sys
from html import unescape

import h5py
import pytest
import torch
from test_cli import run
from test_html_report import EVIL, Page, browser, refused  # noqa: F401
from test_two_wave_fit import both_ways
from test_wall_pressure import FREQUENCY, line_of

import torchliner as tl
from torchliner.cli.main import DONE, main
from torchliner.duct.solved_line import setup_of, solved_line
from torchliner.records.drawn_impedance import fine_places
from torchliner.report.page.of_wall import _joint
from torchliner.report.page.wall_subject import WallSubject
from torchliner.report.table import format_bounds, format_complex

pytest.importorskip("jinja2")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
SIDES = ("upstream", "downstream")


def noisy(side, seed=0, **about):
    """A line of two waves and 1 % of noise, so that methods leave a residual."""
    pressure = both_ways(side)[0]
    draw = torch.Generator().manual_seed(seed)
    noise = torch.randn(pressure.shape, dtype=torch.complex128, generator=draw)
    return line_of(pressure * (1 + 0.01 * noise), side, title=f"{side} case", **about)


def field_fit(line, draws=True):
    """A fit of the field as ``fit_field`` returns it, with numbers at random."""
    draw = torch.Generator().manual_seed(1)
    lead = (3,) if draws is None else ()

    def random(*shape):
        return torch.randn(*lead, *shape, dtype=torch.complex128, generator=draw)

    count, along = len(line.frequency), fine_places(line.x)
    return tl.FieldFit(
        method="LEE fit", frequency=line.frequency, x=line.x, impedance=2 + random(count) / 9,
        covariance=random(count, 2, 2).abs() * 1e-4, rise=random(count), rise_error=random(count),
        amplitude=random(count), end_reflection=random(count),
        pressure=random(line.microphones, count), along=along,
        pressure_along=random(len(along), count), residual=random(count).abs(),
        misfit=random(count).abs(), converged=random(count).real > 0, source_side=line.source_side,
        draws=field_fit(line, None) if draws else None, line=line,
        choices={"method": "field", "variation": "linear", "mach": 0.3},
    )  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Both sources of one wall, what kt makes of them with draws, and its page."""
    folder = tmp_path_factory.mktemp("wall")
    for side in SIDES:
        noisy(side).write(folder / f"{side}.h5")
    words = ["kt", *(str(folder / f"{side}.h5") for side in SIDES)]
    found = str(folder / "found.h5")
    assert main([*words, "--draws", "20", "--seed", "7", "-o", found, "--quiet"]) == DONE
    assert main(["report", found, "-o", str(folder / "page.html"), "--quiet"]) == DONE
    return folder


@pytest.fixture(scope="module")
def duct(tmp_path_factory):
    """Two frequencies of a solved duct on one coarse mesh, and its page."""
    folder = tmp_path_factory.mktemp("duct")
    words = ["duct", "solve", "b2a", "--profile", "uniform", "--frequency", "900", "1200",
             "--mesh", "20", "--impedance", "1.5-0.5j", "-o", str(folder / "duct.h5")]  # fmt: skip
    assert main([*words, "--quiet"]) == DONE
    return folder


def same(one, other):
    """Every tensor of two records to the last bit, draws and line included."""
    for field in dataclasses.fields(one):
        mine, theirs = (getattr(each, field.name) for each in (one, other))
        if isinstance(mine, torch.Tensor):
            assert mine.dtype == theirs.dtype
            assert torch.equal(mine.nan_to_num(-1.0), theirs.nan_to_num(-1.0)), field.name
        elif dataclasses.is_dataclass(mine) and field.name in ("draws", "line"):
            same(mine, theirs)
        elif field.name not in ("choices", "name", "fluid", "coherence", "line"):
            assert mine == theirs, field.name


def test_a_file_keeps_an_eduction_whole(tmp_path):
    """KT with draws and a lost frequency, fits tied and free, the field: all of it, in order."""
    line = noisy("upstream", provenance={"who": "me"}, reference={"true": 1 + 0j})
    lost = tl.kumaresan_tufts(line, draws=3)
    wave = lost.wavenumber.clone()
    wave[1] = complex(math.nan, math.nan)
    found = [dataclasses.replace(lost, wavenumber=wave), tl.two_wave_fit(line, weights="relative"),
             tl.two_wave_fit(line, tied=False),
             field_fit(dataclasses.replace(line, title=""))]  # fmt: skip
    found[0].write(tmp_path / "found.nc", *found[1:])
    again = tl.read_wall(tmp_path / "found.nc")
    assert len(again) == 4
    for one, other in zip(found, again, strict=True):
        same(one, other)
        assert dict(other.choices) == dict(one.choices)
        assert torch.equal(one.interval()[1], other.interval()[1])
        assert other.source_line.name == one.choices.get("source", "microphones")
        assert torch.equal(one.level_along()[1], other.level_along()[1])


def test_other_programs_see_the_table(files):
    """R, X and the bounds of their intervals as variables with units and long names."""
    xarray = pytest.importorskip("xarray")
    found = tl.read_wall(files / "found.h5")[1]
    seen = xarray.open_dataset(files / "found.h5", group="eduction_1", engine="h5netcdf")
    assert seen.resistance.values == pytest.approx(found.impedance.real.numpy())
    assert seen.reactance_high.values == pytest.approx(found.interval()[1].imag.numpy())
    assert "95 % statistical interval" in seen.resistance_low.long_name
    assert seen.wavenumber_real.units == "1/m"


def test_choices_command_and_hashes_are_kept(files):
    """Of each line its own file; the seed; the command that was typed."""
    for one, side in zip(tl.read_wall(files / "found.h5"), SIDES, strict=True):
        path = files / f"{side}.h5"
        (known,) = one.choices["inputs"]
        assert (known["what"], known["name"], known["kind"]) == ("microphones", str(path), "sha256")
        assert known["hash"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert (one.choices["seed"], one.choices["draws"], one.choices["margin"]) == (7, 20, 0.0)
        assert one.choices["version"] == tl.__version__
        assert one.choices["command"][:2] == ["kt", str(path.parent / "upstream.h5")]


def test_the_sentence_has_both_sources_and_their_mismatch(files):
    """At the frequency whose worst residual is the least."""
    page, found = Page(files / "page.html"), tl.read_wall(files / "found.h5")
    at = int(torch.stack([one.residual for one in found]).max(0).values.argmin())
    text = page.text["header"].replace("\N{MINUS SIGN}", "-")
    assert f"At {float(FREQUENCY[at]):g} Hz, the best fitted of 3 frequencies" in text
    values = []
    for one, side in zip(found, SIDES, strict=True):
        values.append(complex(one.impedance[at]))
        low, high = (complex(end[at]) for end in one.interval())
        words = f"{format_complex(values[-1])} (source {side}; 95 % statistical interval: "
        assert words + format_bounds((low, high)) in text
    apart = 100 * abs(values[0] - values[1]) / (abs(values[0]) + abs(values[1])) * 2
    assert f"the two are {apart:.3g} % apart" in text


def test_figures_have_words_captions_and_numbers(files):
    """Spectrum, levels and phases, both planes, each with its CSV."""
    page = Page(files / "page.html")
    figures = [attrs["id"] for attrs in page.all("figure")]
    assert figures == ["spectrum", *(f"along-wall-{i}" for i in range(3)),
                       *(f"{name}-{i}" for i in range(3)
                         for name in ("impedance-plane", "wavenumbers"))]  # fmt: skip
    shown = [attrs["aria-label"] for attrs in page.all("div") if attrs.get("role") == "img"]
    assert len(shown) == len(figures) == len(page.all("figcaption"))
    assert all(re.search(r"\d\.\d", words) for words in shown)
    found = tl.read_wall(files / "found.h5")
    waves = page.csv("wavenumbers-2")
    assert [row["kept"] for row in waves].count("1") == 2
    for row in waves:
        one = found[SIDES.index(row["eduction"].removeprefix("source "))]
        alpha = complex(float(row["real (1/m)"]), float(row["imaginary (1/m)"]))
        assert float((one.modes[:, 2] - alpha).abs().min()) < 1e-12
        assert (row["kept"] == "1") == (alpha == complex(one.wavenumber[2]))
    along = page.csv("along-wall-0")
    measured = [float(row["SPL (dB)"]) for row in along if row["what"] == "measured"]
    levels = torch.cat([one.source_line.level[:, 0] for one in found])
    assert measured == pytest.approx(levels.tolist())
    fitted = [float(row["phase (deg)"]) for row in along if row["what"] == "fitted"]
    assert fitted[:201] == pytest.approx(
        torch.rad2deg(found[0].pressure_at(fine_places(found[0].x))[:, 0].angle()).tolist()
    )


def test_the_comparison_is_of_sources_and_of_what_is_known(files, tmp_path):
    """A row a frequency and pair; a row each for the wall of the duct that a line was solved in."""
    rows = Page(files / "page.html").csv("compared-table")
    found = tl.read_wall(files / "found.h5")
    assert len(rows) == 3
    for i, row in enumerate(rows):
        off = complex(found[0].impedance[i] - found[1].impedance[i])
        assert row["between"] == "source upstream less source downstream"
        assert float(row["impedance_resistance"]) == pytest.approx(off.real, rel=1e-7)
        inside = float(row["low_resistance"]) < 0 < float(row["high_resistance"])
        inside &= float(row["low_reactance"]) < 0 < float(row["high_reactance"])
        assert row["verdict"] == ("not shown" if inside else "yes")
    line = dataclasses.replace(noisy("upstream").at(600.0), reference={"true": 0.8 - 1.2j})
    solved = dataclasses.replace(
        noisy("downstream"),
        wall_impedance=torch.tensor([1 + 0.5j, 1 + 1.5j, 1 + 2.5j]),
    )
    tl.two_wave_fit(line).report(tmp_path / "page.html", tl.two_wave_fit(solved.at(600.0)))
    names = [row["between"] for row in Page(tmp_path / "page.html").csv("compared-table")]
    assert names == ["source upstream less source downstream", "source upstream less true",
                     "source downstream less the solved wall"]  # fmt: skip
    subject = WallSubject([tl.two_wave_fit(solved)])
    assert [subject.known(0, f)["the solved wall"] for f in range(3)] == [
        1 + 0.5j, 1 + 1.5j, 1 + 2.5j]  # fmt: skip


def test_errors_of_two_lines_add_as_squares():
    """3 and 4 make 5, each bound by the distances that lead there."""
    one = {"impedance": 10 + 0j, "low": 7 - 1j, "high": 14 + 2j}
    other = {"impedance": 2 + 0j, "low": -1 - 2j, "high": 6 + 0j}
    low, high = _joint(one, other)
    assert (low, high) == (pytest.approx(8 - 5 - 1j), pytest.approx(8 + 5 + 1j * math.sqrt(8)))


def test_the_command_gives_the_result_again(capsys, files, tmp_path):
    """As it stands on the page; the hashes say whether its inputs are those of then."""
    page = Page(files / "page.html")
    command = shlex.split(unescape(re.search(r"<code>(torchliner kt.*?)</code>", page.html)[1]))
    command[command.index("-o") + 1] = str(tmp_path / "again.h5")
    assert run(capsys, *command[1:])[0] == DONE
    for one, other in zip(*map(tl.read_wall, (files / "found.h5", tmp_path / "again.h5")),
                          strict=True):  # fmt: skip
        assert torch.equal(one.draws.impedance, other.draws.impedance)
    assert page.text["main"].count("unchanged") == 2


def test_inputs_that_changed_are_told(files, tmp_path):
    """Another file of that name; none."""
    path = tmp_path / "upstream.h5"
    shutil.copy(files / path.name, path)
    found = tl.read_wall(files / "found.h5")[0]
    (known,) = found.choices["inputs"]
    inputs = [{**known, "name": str(path)}]
    moved = dataclasses.replace(found, choices={**found.choices, "inputs": inputs})
    for change, words in (
        (lambda: None, "unchanged"),
        (lambda: path.write_bytes(path.read_bytes()[::-1]), "another file of the same size now"),
        (path.unlink, "not there now"),
    ):
        change()
        moved.report(tmp_path / "page.html")
        assert words in Page(tmp_path / "page.html").text["main"]


def test_a_result_without_optional_parts(tmp_path):
    """No draws, no degree of freedom, no command: said; one frequency has no spectrum."""
    line = noisy("upstream").at(1500.0)
    bare = tl.kumaresan_tufts(line.select(range(4)), order=2)
    assert bare.covariance is None
    bare.report(tmp_path / "page.html")
    page = Page(tmp_path / "page.html")
    assert "without a statistical interval" in page.text["header"]
    assert "the waves leave no degree of freedom" in page.text["main"]
    assert "Done in Python" in page.text["main"]
    assert "nothing is known of the case from elsewhere" in page.text["main"]
    assert "frequencies" not in {attrs["id"] for attrs in page.all("section")}


def test_methods_beside_each_other(tmp_path):
    """Waves and a fit of the field of one line: labels are the methods, columns those of both."""
    line = noisy("upstream").at(1500.0)
    found = tl.kumaresan_tufts(line, draws=3), field_fit(line)
    assert WallSubject(found).labels == ["Kumaresan-Tufts", "LEE fit"]
    found[0].report(tmp_path / "page.html", found[1])
    page = Page(tmp_path / "page.html")
    assert "the methods give" in page.text["header"]
    rows = page.csv("answer-table")
    assert [row["method"] for row in rows] == ["Kumaresan-Tufts", "LEE fit"]
    assert rows[0]["wavenumber_real"] != "nan" == rows[1]["wavenumber_real"]
    line, nowhere = noisy("downstream"), complex(math.nan, math.nan)
    beside = tl.kumaresan_tufts(line)
    best = int(beside.residual.argmin())
    assert WallSubject([beside]).main == float(FREQUENCY[best])
    lost = dataclasses.replace(beside, impedance=beside.impedance.index_fill(
        0, torch.tensor(best), nowhere))  # fmt: skip
    assert WallSubject([lost]).main != float(FREQUENCY[best])
    assert WallSubject([beside, found[1]]).labels == ["Kumaresan-Tufts", "LEE fit"]
    alike = WallSubject([found[0], found[0]])
    assert alike.labels == [f"upstream case, source upstream, Kumaresan-Tufts, {i}"
                            for i in (1, 2)]  # fmt: skip


def test_texts_of_files_are_no_markup(tmp_path):
    """Titles, methods, notes, choices, provenance."""
    text = EVIL + " $\\frac$ & \"'"
    line = dataclasses.replace(noisy("upstream").at(600.0), title=text, provenance={text: text})
    other = dataclasses.replace(line, title=text + "2")
    found = dataclasses.replace(
        tl.kumaresan_tufts(line), notes=(text,), choices={text: text, "command": text}, method=text
    )
    found.report(tmp_path / "page.html", tl.kumaresan_tufts(other))
    page = Page(tmp_path / "page.html")
    assert len(page.all("script")) == 1
    assert "alert(1)" not in page.text["script"]
    assert "\x1b" not in page.html
    assert not [k for _, attrs in page.tags for k in attrs if k.startswith("on")]


def damaged(files, tmp_path, change):
    path = tmp_path / "damaged.h5"
    path.write_bytes((files / "found.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    return path


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.attrs.modify("schema", "torchliner wall 9"), "'torchliner wall 9', and this"),
        (lambda f: f["eduction_0"].attrs.modify("schema", "torchliner waves 9"),
         "eduction_0 is no eduction by waves: its schema is 'torchliner waves 9'"),
        (lambda f: f.__delitem__("eduction_1"), ":/eduction_1 is no group"),
        (lambda f: f.__delitem__("eduction_0/reactance"), "eduction_0/reactance is missing"),
        (lambda f: f.__delitem__("eduction_0/microphones"), "eduction_0/microphones is no group"),
        (lambda f: f.__delitem__("eduction_1/draws/residual"), "draws/residual is missing"),
        (lambda f: f.__delitem__("eduction_0/microphones/duct_height"), "duct_height is missing"),
        (lambda f: f["eduction_0/residual"].attrs.modify("units", "m"), "a number is needed"),
        (lambda f: f["eduction_0/draws/reactance"].__setitem__((0, 1), math.inf),
         "draws/resistance or its other part is infinite"),
        (lambda f: f["eduction_0/order"].__setitem__((), 5), "singular_value is (5,) elsewhere"),
        (lambda f: f["eduction_1/frequency"].__setitem__(1, 3.0), "but its microphones'"),
        (lambda f: f.attrs.modify("eductions", 0), "holds 0 eductions"),
        (lambda f: f.attrs.__delitem__("eductions"), "has no attribute 'eductions'"),
        (lambda f: f["eduction_0"].attrs.modify("choices", '{"mach": "fast"}'), "fast"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(capsys, files, tmp_path, change, words):
    """Another version, a missing part, a wrong unit: the place is named, no page is written."""
    path = damaged(files, tmp_path, change)
    err = refused(capsys, path, "-o", tmp_path / "page.html")
    assert words in err
    assert "damaged.h5" in err
    assert not (tmp_path / "page.html").exists()


def test_truncated_files_and_microphones_are_refused(capsys, files, tmp_path):
    """Half a file; a line from which nothing was educed; data and liner, which are of maps."""
    whole, path = (files / "found.h5").read_bytes(), tmp_path / "half.h5"
    path.write_bytes(whole[: len(whole) // 2])
    out = ("-o", tmp_path / "page.html")
    assert "half.h5 is truncated" in refused(capsys, path, *out)
    with pytest.raises(ValueError, match="is no set of impedances educed from microphones"):
        tl.read_wall(files / "upstream.h5")
    err = refused(capsys, files / "upstream.h5", *out)
    assert "holds microphones, from which an impedance is yet to be educed" in err
    assert "--liner is" not in refused(capsys, files / "found.h5", *out, "--liner", "onera")
    found = tl.read_wall(files / "found.h5")[0]
    with pytest.raises(ValueError, match="the line of microphones was not kept"):
        dataclasses.replace(found, line=None).report(tmp_path / "page.html")
    with pytest.raises(ValueError, match=r"holds \(2,\) lines; a file or a page of an eduction"):
        tl.two_wave_fit(line_of(torch.stack([both_ways()[0]] * 2))).write(tmp_path / "two.h5")
    assert not (tmp_path / "two.h5").exists()
    (tmp_path / "page.html").mkdir()
    with pytest.raises(OSError, match="is a folder; name a file"):
        found.report(tmp_path / "page.html")
    with pytest.raises(ValueError, match=r"must be one of \.h5, \.hdf5, \.nc"):
        found.write(tmp_path / "found.csv")


@pytest.mark.parametrize("name", ["jinja2", "matplotlib"])
def test_what_is_not_installed_is_said_before_the_work(name, files, duct, tmp_path, monkeypatch):
    """Of an eduction and of a field in memory."""
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("torchliner.report.page.of_wall.page_of_wall",
                        lambda *_: pytest.fail("work"))  # fmt: skip
    monkeypatch.setattr("torchliner.report.page.of_duct.setup_of", lambda *_: pytest.fail("work"))
    with pytest.raises(ImportError, match=r"torchliner\[report\]"):
        tl.read_wall(files / "found.h5")[0].report(tmp_path / "page.html")
    from torchliner.report.page.of_duct import report_field

    with pytest.raises(ImportError, match=r"torchliner\[report\]"):
        report_field(None, tmp_path / "page.html")


def test_the_page_of_a_duct(capsys, duct, tmp_path):
    """Loss, energy, the impedance asked, levels; the file is still a line for kt."""
    line = tl.read_microphones(duct / "duct.h5")
    assert run(capsys, "report", str(duct / "duct.h5"), "-o", str(tmp_path / "page.html"))[0] == 0
    page = Page(tmp_path / "page.html")
    rows = page.csv("answer-table")
    loss = [row["transmission loss (dB)"] for row in line.provenance["plane_mode"]]
    assert [float(row["transmission loss (dB)"]) for row in rows] == pytest.approx(loss)
    text = page.text["header"].replace("\N{MINUS SIGN}", "-")
    assert f"lined with Z = 1.500-0.500j in units of ρc takes {loss[0]:.2f} dB" in text
    assert "no second mesh was solved" in text
    assert [row["impedance"] for row in page.csv("walls")] == ["1.500-0.500j"] * 2
    levels = [float(row["SPL (dB)"]) for row in page.csv("along-wall")]
    assert levels == pytest.approx(line.level.T.flatten().tolist())
    assert "torchliner duct solve b2a --profile uniform" in page.text["main"]
    assert run(capsys, "kt", str(duct / "duct.h5"), "-o", str(tmp_path / "kt.h5"))[0] == 0
    known = WallSubject(tl.read_wall(tmp_path / "kt.h5")).known(0, 1)
    assert known == {"the solved wall": 1.5 - 0.5j}


def test_fields_in_memory(tmp_path):
    """With the check of the mesh and without; warnings are kept; leading axes have no page."""
    setup = tl.load_duct("b2a", profile="uniform", frequency=[900.0])
    solver = tl.DuctSolver(setup.case, setup.frequency, keep="walls")
    solver.solve([[1.0 + 0j]]).report(tmp_path / "one.html")
    page = Page(tmp_path / "one.html")
    assert "nothing tells its error" in page.text["main"]
    assert page.csv("walls")[0]["impedance"] == "1.000+0.000j"
    settled = tl.solve_settled(setup.case, setup.frequency, -0.5 + 1j)
    assert any("resistance" in note for note in settled.notes)
    settled.report(tmp_path / "two.html")
    page = Page(tmp_path / "two.html")
    moved = f"{float(settled.difference[0]):.2g} dB"
    assert f"a finer mesh moves it by {moved}" in page.text["header"]
    assert f"One of {settled.finer_unknowns} moves" in page.text["main"]
    with pytest.raises(ValueError, match=r"the field has the leading axes \(2,\)"):
        solver.solve(torch.ones(2, 1, 1) + 0j).report(tmp_path / "three.html")
    rigid = solved_line(setup, solver.solve(math.inf))
    assert rigid.provenance["impedance"] == [["rigid"]]
    varying = solver.solve(lambda x, f: torch.ones(len(f), len(x)) + 0j)
    assert solved_line(setup_of(varying), varying).provenance["impedance"] is None
    varying.report(tmp_path / "four.html")
    assert "varies along x" in Page(tmp_path / "four.html").text["main"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p.update(plane_mode=p["plane_mode"][:1]), "has 1 rows of the plane mode for 2"),
        (lambda p: p["plane_mode"][0].pop("energy out"), "is damaged, or of another layout"),
        (
            lambda p: p["plane_mode"][1].update({"transmission loss (dB)": math.nan}),
            "transmission loss (dB) at 1200 Hz is nan",
        ),
        (
            lambda p: p["plane_mode"][1].update({"frequency (Hz)": 1600.0}),
            "told of at 1600 Hz, but the microphones are at 1200 Hz",
        ),
        (lambda p: p.update(impedance=[["x", [1, 2, 3]]] * 2), "duct.h5"),
        (lambda p: p.pop("solved"), "an impedance is yet to be educed"),
    ],
)
def test_damaged_ducts_are_refused(capsys, duct, tmp_path, change, words):
    """What the file says of the solution, changed."""
    line = tl.read_microphones(duct / "duct.h5")
    provenance = {k: list(v) if isinstance(v, list) else v for k, v in line.provenance.items()}
    change(provenance)
    path = tmp_path / "duct.h5"
    dataclasses.replace(line, provenance=provenance).write(path)
    assert words in refused(capsys, path, "-o", tmp_path / "page.html")


@pytest.mark.parametrize(
    ("kind", "width", "scheme"),
    [
        ("wall", 390, "light"), ("duct", 1280, "dark"),
        pytest.param("wall", 1280, "dark", marks=pytest.mark.slow),
        pytest.param("duct", 390, "light", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_in_a_browser(browser, files, duct, kind, width, scheme):  # noqa: F811
    """No error, no request, no overflow, no violation by axe."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    path = files / "page.html" if kind == "wall" else duct / "page.html"
    if kind == "duct":
        assert main(["report", str(duct / "duct.h5"), "-o", str(path), "--quiet"]) == DONE
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme,
                                  bypass_csp=True)  # fmt: skip
    page, said = context.new_page(), []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith(("file:", "data:")) else
            said.append(asked.url))  # fmt: skip
    page.goto(path.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert [each["id"] for each in axe.run(page).response["violations"]] == []
    assert said == []
    context.close()
