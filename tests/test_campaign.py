"""torchliner run: what is done, done again, taken up again, and refused."""

import csv
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence
from test_cli import run

import torchliner as tl
from torchliner.campaign import workers
from torchliner.campaign.campaign_file import read_campaign
from torchliner.campaign.index import COLUMNS
from torchliner.io.whole_file import locked

Z = [name for name in COLUMNS if name.startswith(("resistance", "reactance"))]
PAGE = DATA.parent / "docs" / "campaigns.md"
SAMPLES, PROBES = 900, 6
SHARES = 3  # a plane
TOML = """
title = "a test"
frequencies = ["1400:1600:200"]

[[planes]]
files = ["a/*.h5", "b.h5"]
liner = "polito"

[choices]
averaging = ["admittance", "phase-locked"]
"""
CHILD = f"""
import sys, warnings
warnings.simplefilter("ignore")
from torchliner.campaign import workers
workers.SHARE = {SAMPLES * PROBES // SHARES}
from torchliner.cli.main import main
sys.exit(main(["run", *sys.argv[1:], "--quiet"]))
"""
pytestmark = pytest.mark.filterwarnings("ignore:.*a weak second tone:torchliner.DataWarning")


def write_plane(path: Path, seed: int) -> None:
    path.parent.mkdir(exist_ok=True)
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(SAMPLES))
    v = (turbulence((PROBES, SAMPLES), seed=seed) + 2 * tone).float()
    plane_of(v, x=2e-3 * torch.arange(PROBES), height=1e-3 * (1 + seed)).write(path)


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Two planes, two averagings: four units of two frequencies, three shares a plane."""
    monkeypatch.setattr(workers, "SHARE", SAMPLES * PROBES // SHARES)
    for seed, name in enumerate(("a/one.h5", "b.h5")):
        write_plane(tmp_path / name, seed)
    (tmp_path / "c.toml").write_text(TOML)
    return tmp_path / "c.toml"


@pytest.fixture
def smallest(campaign):
    """One unit of it, at one frequency, without error bars."""
    both = 'averaging = ["admittance", "phase-locked"]'
    text = TOML.replace('"a/*.h5", ', "").replace('"1400:1600:200"', "1400")
    campaign.write_text(text.replace(both, 'averaging = "admittance"\ninterval = false'))
    return campaign


@pytest.fixture
def readings(monkeypatch):
    """Names of the planes of which shares are read, as they are."""
    seen, whole = [], workers._rows
    monkeypatch.setattr(workers, "_rows", lambda sent, share: seen.append(sent[0].plane.name) or whole(sent, share))
    return seen


def done(capsys, *words: object) -> tuple[int, list[dict], str]:
    """Exit code, rows, errors."""
    code, out, err = run(capsys, "run", *map(str, words), "--json", "--quiet")
    return code, json.loads(out) if out else [], err


def table_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def require_same(one: Path, other: Path) -> None:
    """The files, the bits of moments, and the index, to the last few digits of what follows."""
    mine, theirs = (
        {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file() and p.name[0] != "."}
        for folder in (one, other)
    )
    assert mine == theirs
    assert all((one / name).read_bytes() == (other / name).read_bytes() for name in mine if name.startswith("moments"))
    for a, b in zip(table_of(one / "index.csv"), table_of(other / "index.csv"), strict=True):
        for name in set(a) - {*Z}:
            assert a[name] == b[name]
        assert [float(a[name]) for name in Z] == pytest.approx([float(b[name]) for name in Z], rel=1e-8, abs=1e-12)


def test_a_campaign_is_its_eductions(capsys, campaign):
    code, rows, _ = done(capsys, campaign)
    assert (code, len(rows)) == (0, 8)
    folder = campaign.parent / "c_results"
    row = next(r for r in rows if r["unit"] == "one__polito__averaging=phase-locked" and r["frequency"] == 1600)
    plane, liner = tl.read_plane(campaign.parent / "a" / "one.h5"), tl.load_liner("polito")
    wanted = tl.educe(plane, liner, [1400, 1600], averaging="phase-locked")
    assert row["resistance"] == pytest.approx(float(wanted.answer[1].real), abs=1e-4)
    assert row["reactance_high"] == pytest.approx(wanted.bounds_of_liner("phase-locked", 1)[1].imag, abs=1e-3)
    assert (row["height"], row["file"], row["status"]) == (1e-3, "a/one.h5", "done")
    found = tl.read_map(folder / "maps" / f"{row['unit']}.h5")
    assert complex(found.answer[1]) == complex(row["resistance"], row["reactance"])
    table = table_of(folder / "index.csv")
    assert [float(r["resistance"]) for r in table] == [r["resistance"] for r in rows]
    assert [*table[0]] == [*COLUMNS]
    assert {r["campaign"] for r in table} == {"a test"}


def test_only_what_changed_is_done_again(capsys, campaign, readings, monkeypatch):
    toml = TOML.replace("averaging =", "interval = false\naveraging =")
    campaign.write_text(toml)
    done(capsys, campaign)
    assert len(readings) == 2 * 2 * SHARES  # averaging ``phase-locked`` takes two
    maps = campaign.parent / "c_results" / "maps"
    before = {path: path.stat().st_mtime_ns for path in maps.iterdir()}
    readings.clear()
    code, out, _ = run(capsys, "run", str(campaign), "--dry-run")
    assert out.startswith("4 units; 0 planes to read, 0 GB\n")
    done(capsys, campaign)
    assert {path: path.stat().st_mtime_ns for path in maps.iterdir()} == before
    more = toml.replace('["1400:1600:200"]', "[1400, 1500]").replace('liner = "polito"', "")
    campaign.write_text(f'liners = ["polito", "mine.toml"]\n{more}')
    polito = campaign.parent / "mine.toml"
    run(capsys, "liner", "polito", "--copy", str(polito))
    code, rows, _ = done(capsys, campaign)
    assert (code, len(rows), readings) == (0, 16, [])
    polito.write_text(re.sub(r"porosity = .*", "porosity = 0.1", polito.read_text(), count=1))
    units = json.loads(run(capsys, "run", str(campaign), "--dry-run", "--json")[1])
    assert {u["unit"].split("__")[1] for u in units if u["state"] == "from moments"} == {"mine"}
    write_plane(campaign.parent / "b.h5", 7)
    done(capsys, campaign)
    assert {*readings} == {"b.h5"}
    monkeypatch.setattr("torchliner.campaign.run.__version__", "9.9")
    assert "8 units; 2 planes to read" in run(capsys, "run", str(campaign), "--dry-run")[1]


def test_an_interrupt_is_clean_and_costs_one_share(capsys, campaign, readings, monkeypatch):
    """No half file, no lock; what was summed is not summed again; the files are the same."""
    done(capsys, campaign, "--output", campaign.parent / "wanted")
    readings.clear()
    save = workers.np.savez

    def save_or_stop(file, *rows):
        if len(readings) == 8:  # in the first reading of the second plane
            raise KeyboardInterrupt
        save(file, *rows)

    monkeypatch.setattr(workers.np, "savez", save_or_stop)
    code, _, err = run(capsys, "run", str(campaign), "--quiet")
    assert (code, err) == (130, "torchliner: interrupted\n")
    output = campaign.parent / "c_results"
    assert not list(output.rglob(".torchliner-*"))
    monkeypatch.setattr(workers.np, "savez", save)
    readings.clear()
    code, rows, _ = done(capsys, campaign)
    assert (code, len(rows), len(readings)) == (0, 8, 2 * 2 * SHARES - 7)
    require_same(output, campaign.parent / "wanted")


@pytest.mark.parametrize("kills", [pytest.param(20, marks=pytest.mark.slow), pytest.param(2)], ids=str)
def test_kill_9_at_any_moment(capsys, campaign, kills):
    """Files as of an uninterrupted run, moments to the bit; some kill left something half done."""
    done(capsys, campaign, "--output", campaign.parent / "a_results")
    draw, output, halfway = random.Random(kills), campaign.parent / "b", 0
    words = [sys.executable, "-c", CHILD, str(campaign), "--output", str(output)]
    for number in range(kills):
        if (output / "index.csv").exists():
            shutil.rmtree(output)
        child, lock = subprocess.Popen(words, stdout=subprocess.DEVNULL), output / ".lock.held"
        # Imports are not worth a kill: it holds the lock first.
        while child.poll() is None and not (lock.exists() and f"process {child.pid} on " in lock.read_text()):
            time.sleep(0.02)
        try:  # The first kills come early on any machine, the last ones after the end of most.
            child.wait(draw.uniform(0, 0.1 * (number + 1)))
        except subprocess.TimeoutExpired:
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
        halfway += not (output / "index.csv").exists()
    assert subprocess.run(words, stdout=subprocess.DEVNULL, check=False).returncode == 0
    assert halfway
    require_same(output, campaign.parent / "a_results")


def test_a_failing_unit_stops_no_other(capsys, campaign):
    (campaign.parent / "a" / "broken.h5").write_bytes(b"no HDF5")
    v = turbulence((PROBES, SAMPLES)).float()
    v[2, 5] = torch.nan
    plane_of(v).write(campaign.parent / "a" / "faulty.h5")
    code, rows, _ = done(capsys, campaign)
    assert code == 1
    failed = {row["unit"]: row["error"] for row in rows if row["status"] == "failed"}
    assert "is of no format of planes" in failed.pop("broken")
    assert len(failed) == 2
    assert all("nan or inf" in text for text in failed.values())
    assert sum(row["status"] == "done" for row in rows) == 8
    table = table_of(campaign.parent / "c_results" / "index.csv")
    assert [r["resistance"] for r in table if r["status"] == "failed"] == ["", "", ""]
    write_plane(campaign.parent / "a" / "faulty.h5", 3)
    (campaign.parent / "a" / "broken.h5").unlink()
    code, rows, _ = done(capsys, campaign)
    assert (code, len(rows)) == (0, 12)


def test_facts_that_leave_the_file_are_gone(capsys, smallest, readings):
    """What was stated of a plane is not kept with its moments, which are not read again."""
    text = smallest.read_text()
    (wanted,) = done(capsys, smallest, "--output", smallest.parent / "fresh")[1]
    for facts in ("height = 5e-3", 'source_side = "upstream"\nmach = 0.3\nincident_level = 103'):
        smallest.write_text(text.replace("liner =", f"{facts}\nliner ="))
        (row,) = done(capsys, smallest)[1]
        assert row["hash"] != wanted["hash"]
    readings.clear()
    smallest.write_text(text)
    (row,) = done(capsys, smallest)[1]
    assert row == wanted
    assert not readings
    maps = [tl.read_map(next((smallest.parent / name / "maps").glob("*.h5"))) for name in ("fresh", "c_results")]
    for name in ("mach", "height", "source_side", "notes"):
        assert getattr(maps[0], name) == getattr(maps[1], name)


def test_a_pressure_record_stands_beside(capsys, tmp_path, unrendered):
    (tmp_path / "c.toml").write_text(f"""
figures = true
[[planes]]
files = "{DATA}/slit_n130_y0.5mm.h5"
in_situ = "{DATA}/pressure_n130.h5"
title = "a slit"
""")
    code, (row,), _ = done(capsys, tmp_path / "c.toml")
    found = tl.read_map(tmp_path / "c_results" / "maps" / f"{row['unit']}.h5")
    assert (code, found.title, bool(found.alongside)) == (0, "a slit", True)
    assert row["level_check"].endswith(("passes", "inconclusive", "fails"))
    assert (tmp_path / "c_results" / "figures" / row["unit"] / "along_x.png").exists()


MISTAKES = [
    (TOML.replace("averaging =", "avraging ="), "choices.avraging: no such key (did you mean 'averaging'?)"),
    (TOML.replace("locked", "loked"), "(did you mean 'phase-locked'?)"),
    (TOML.replace("1400:1600:200", "14oo"), "frequencies"),
    (TOML.replace("a/*.h5", "a/*.hdf"), "planes.files = 'a/*.hdf' matches nothing in"),
    (f"output = '.'{TOML}", "but results in"),
    (f'output = "../elsewhere"\n{TOML}', "leads out of"),
    (TOML.replace("a/*.h5", "*.h5"), "b.h5 is named twice"),
    (TOML.replace("liner =", "height = -1\nsource_side = 'left'\nliner ="), "has 2 mistake(s)"),
    (TOML.replace("[[planes]]", "[planes]"), "planes"),
    (TOML.replace("liner =", "mach = true\nliner ="), "planes.0.mach = True: Input should be a valid number"),
    (TOML.replace("liner =", "mach = '0.3'\nliner ="), "planes.0.mach = '0.3': Input should be a valid number"),
    (TOML.replace('liner = "polito"', ""), "one names no liner; state liner in [[planes]]"),
    (TOML.replace("polito", "polyto"), "did you mean 'polito'"),
    (TOML.replace("liner =", "variable = 'v'\nliner ="), "has no variable 'v'"),
    (TOML.replace("averaging =", "kernel = 'causal'\naveraging ="), "choices.kernel: no such key"),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_mistakes_in_the_file_are_all_told(capsys, campaign, text, words):
    campaign.write_text(text)
    code, rows, err = done(capsys, campaign)
    assert code in (1, 2)
    told = err + " ".join(row["error"] for row in rows)
    assert words in told.replace("a/one.h5", "one")


def test_folders_that_cannot_serve(capsys, smallest, tmp_path):
    output = smallest.parent / "c_results"
    with locked(output):
        code, _, err = done(capsys, smallest)
        assert code == 2
        assert re.search(r"c_results is in use by another run \(process \d+ on ", err)
    assert done(capsys, smallest)[0] == 0  # a lock that is left means nothing
    (output / "index.csv").write_text("mine,theirs\n1,2\n")
    code, _, err = done(capsys, smallest)
    assert (code, "is no index of this version" in err, "name another --output" in err) == (2, True, True), err
    shutil.rmtree(output / "maps")
    (output / "maps").symlink_to(tmp_path)
    code, _, err = done(capsys, smallest)
    assert (code, "remove the link" in err) == (2, True)


def test_what_a_pattern_stands_for(tmp_path):
    for name in ("v[Y].csv", "vY.csv", "vZ.csv", "a_1.vti", "a_2.vti", "b_1.vti", "b_2.vti"):
        (tmp_path / name).touch()
    (tmp_path / "c.toml").write_text('[[planes]]\nfiles = ["v[Y].csv", "v[Z].csv", "a*.vti", "b_2.vti"]\n')
    found = read_campaign(tmp_path / "c.toml")
    assert [case.path.name for case in found.cases] == ["v[Y].csv", "vZ.csv", "a_1.vti", "b_2.vti"]


def test_the_example_of_the_page_runs(capsys, tmp_path):
    example = re.search(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    (tmp_path / "data").symlink_to(DATA)
    (tmp_path / "campaign.toml").write_text(example)
    code, rows, err = done(capsys, tmp_path / "campaign.toml")
    assert code == 0, err
    assert len({row["unit"] for row in rows}) == len(read_campaign(tmp_path / "campaign.toml").cases) * 2
    assert not any(row["error"] for row in rows)
