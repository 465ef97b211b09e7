"""What a result holds of where it comes from, and what a page makes of it."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import platform
import re
import shlex

import h5py
import numpy as np
import pytest
import torch
from conftest import FREQUENCY, plane_of, turbulence
from test_cli import run

import torchliner as tl
from torchliner.cli.main import DONE
from torchliner.records import origin
from torchliner.records.origin import (
    BLOCKWISE,
    KINDS,
    WHOLE,
    input_file,
    named_file,
    origin_of,
    standing,
    with_whole_hashes,
)
from torchliner.records.velocity_plane import restated
from torchliner.report.page.origin import files_of, stated_origin
from torchliner.report.page.origin import origin as section
from torchliner.report.page.repeat import JOINS, UNTOLD
from torchliner.report.page.subject import inputs_of, subject_of
from torchliner.report.page.warned import of_map

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
CSV = "frequency,speed,resistance,reactance\n" + "\n".join(
    f"{f},{v},{1 + 0.1 * v},{f / 1000 - 2}" for f in (300, 3500) for v in (0, 20)
)


@pytest.fixture
def small(monkeypatch):
    """Blocks of 8 bytes, four of them: 32 bytes are a large file."""
    monkeypatch.setattr(origin, "BLOCK", 8)
    monkeypatch.setattr(origin, "BLOCKS", 4)


def write(path, content: bytes, time=[0]):  # noqa: B006  a clock that goes on
    path.write_bytes(content)
    time[0] += 1
    os.utime(path, (time[0], time[0]))  # a change within the clock's tick is a change too


def test_a_small_file_has_the_hash_that_sha256sum_prints(tmp_path):
    """And its size, and its name as given."""
    path = tmp_path / "a.h5"
    write(path, b"velocity" * 999)
    wanted = hashlib.sha256(b"velocity" * 999).hexdigest()
    assert input_file("velocity", path) == {
        "what": "velocity", "name": str(path), "bytes": 7992, "kind": WHOLE, "hash": wanted,
    }  # fmt: skip


def test_of_a_large_file_blocks_count(small, tmp_path):
    """Begin, end and blocks between; what lies between these does not, and is read on demand."""
    path, content = tmp_path / "a.h5", bytes(range(100))
    write(path, content)
    first = input_file("velocity", path)
    assert first["kind"] == BLOCKWISE
    seen = []
    for place in range(100):
        write(path, content[:place] + b"\xff" + content[place + 1 :])
        seen.append(input_file("velocity", path)["hash"] != first["hash"])
        assert standing(first).changed == seen[-1]
        assert input_file("velocity", path, WHOLE)["hash"] == hashlib.sha256(
            path.read_bytes()).hexdigest()  # fmt: skip
    starts = [0, 30, 61, 92]
    assert seen == [any(s <= place < s + 8 for s in starts) for place in range(100)]
    write(path, content + b"a")
    assert standing(first).words == "another file now, of 101 bytes"


def test_a_large_file_is_not_read_again(tmp_path, monkeypatch):
    """32 MiB of one that would take the disk a minute; of a sparse one, in no time."""
    path, read = tmp_path / "a.h5", []
    with path.open("wb") as file:
        file.truncate(20 << 30)
    pieces = origin._read
    monkeypatch.setattr(origin, "_read", lambda *given: (read.append(p) or p for p in pieces(*given)))
    found = input_file("velocity", path)
    assert found["bytes"] == 20 << 30
    assert sum(map(len, read)) == 32 << 20
    whole = {**found, "kind": WHOLE}
    assert standing(whole).words == "of the same size now; not compared, 21.5 GB"
    assert not standing(whole).changed


def test_a_folder_is_its_files_with_their_names(small, tmp_path):
    """Whatever the order they were written in; a name, a size and a value count."""
    one, other = tmp_path / "one", tmp_path / "other"
    for folder, names in ((one, "ba"), (other, "ab")):
        folder.mkdir()
        for name in names:
            write(folder / name, name.encode() * 30)
    hashes = [input_file("velocity", folder)["hash"] for folder in (one, other)]
    assert hashes[0] == hashes[1]
    assert input_file("velocity", one)["bytes"] == 60
    (one / "b").rename(one / "c")
    assert input_file("velocity", one)["hash"] != hashes[0]
    write(other / "a", b"a" * 20 + b"x" + b"a" * 9)
    assert input_file("velocity", other)["hash"] != hashes[0]
    assert input_file("velocity", other, WHOLE)["kind"] == WHOLE
    frames = tmp_path / "frames"
    frames.mkdir()
    for i in range(3):
        write(frames / f"t{i}.vtk", bytes([i]) * 9)
    assert input_file("velocity", frames / "t0.vtk")["bytes"] == 27  # any stands for all


def test_names_that_are_no_files(tmp_path, monkeypatch):
    """Data in memory; a folder that is called as they are by default."""
    monkeypatch.chdir(tmp_path)
    for name in ("velocity", "reference"):
        (tmp_path / name).mkdir()
        assert named_file(name) is None
    assert str(named_file("velocity:/points")) == "velocity"
    for name in ("", "no\0name", "a" * 5000, "none.h5:/v"):
        assert named_file(name) is None
    assert origin_of([("velocity", "velocity"), ("liner", "")])["inputs"] == []


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two parts of a plane, a pressure record, and a liner whose table is a file of its own."""
    monkeypatch.chdir(tmp_path)
    velocity = turbulence((3, 1200))
    x = np.arange(3) * 1e-3
    for i, part in enumerate(velocity.split(600, 1)):
        plane_of(part, x=x, start=i * 600 / 42e3, source_side="upstream").write(f"p{i}.h5")
    tone = torch.cos(2 * torch.pi * torch.arange(1200, dtype=torch.float64) / 30)
    tl.PressureRecord(facesheet=tone.expand(3, -1), backplate=tone, sampling_rate=42e3,
                      frequency=FREQUENCY, x=x, cavity_depth=0.04).write("w.h5")  # fmt: skip
    (tmp_path / "t.csv").write_text(CSV)
    (tmp_path / "l.toml").write_text("model = 'table'\nfile = 't.csv'")
    return tmp_path


def held(result):
    return [(each["what"], each["name"]) for each in result.choices["inputs"]]


def test_a_map_in_python_holds_its_inputs_and_phases(files):
    """Every file by name, all versions, the phases as they were given; through a file too."""
    plane = tl.read_plane(["p0.h5", "p1.h5"], lazy=True)
    liner, phase = tl.load_liner("l.toml"), torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
    found = tl.educe(plane, liner, phase="given", reference_phase=phase, interval=None,
                     pressure=tl.read_pressure("w.h5"))  # fmt: skip
    found.write("map.h5")
    found = tl.read_map("map.h5")
    assert held(found) == [("velocity", "p0.h5"), ("velocity", "p1.h5"), ("liner", "l.toml"),
                           ("liner", "t.csv"), ("wall pressure", "w.h5")]  # fmt: skip
    assert [each["hash"] for each in found.choices["inputs"]] == [
        hashlib.sha256((files / name).read_bytes()).hexdigest() for _, name in held(found)
    ]
    assert found.choices["reference_phase"] == [0.1, 0.2, 0.3]
    assert "command" not in found.choices
    assert found.choices["versions"] == {
        "torchliner": tl.__version__, "torch": torch.__version__, "numpy": np.__version__,
        "python": platform.python_version(),
    }  # fmt: skip
    found = tl.educe(plane, liner.replace(name="mine"), interval=None)
    assert ("liner", "l.toml") not in held(found)  # a changed copy is not the file's
    tl.moments(plane, cell_pitch=None).write("m.h5")
    again = tl.educe(tl.read_moments("m.h5"), tl.load_liner("polito").replace(cell_pitch=None))
    assert held(again) == [("moments", "m.h5")]
    known = [(each["what"], each["name"]) for each in inputs_of(again)]
    assert known == [("moments", "m.h5"), ("velocity", "p0.h5"), ("velocity", "p1.h5")]
    assert not any(key == "inputs" for key, _ in stated_origin(again.choices["data"]).pairs)
    (kept,) = again.choices["inputs"]
    again = with_whole_hashes(again)
    assert again.choices["inputs"] == [kept]  # small: it was whole before


def program(subject):
    return next(b.text for b in section(subject) if getattr(b, "label", "") == "Python")


@pytest.mark.parametrize("kind", ["phases", "moments", "part"])
def test_the_program_of_the_page_gives_the_map_again(kind, files):
    """From data, liner and phases that the map holds or names."""
    liner, more = tl.load_liner("l.toml"), {"interval": None}
    data = tl.read_plane("p0.h5", lazy=True)
    if kind == "phases":
        more |= {"phase": "given", "reference_phase": [0.1, 0.2, 0.3],
                 "pressure": tl.read_pressure("w.h5")}  # fmt: skip
        data = tl.read_plane(["p0.h5", "p1.h5"], lazy=True)
    elif kind == "moments":
        tl.moments(data, liner).write("m.h5")
        data = tl.read_moments("m.h5")
    else:
        data = tl.read_plane("p0.h5", lazy=True, start=0.001, stop=0.013, region="0:0.0015")
    found = tl.educe(data, liner, **more)
    found.write("map.h5")
    found, space = tl.read_map("map.h5"), {}
    exec(program(subject_of(found, path=files / "map.h5")), space)
    assert torch.equal(space["found"].impedance, found.impedance)
    assert set(held(space["found"])) == {each for each in held(found) if each[0] != "liner"}


def test_a_replay_is_repeated_by_its_command(capsys, files):
    """As it was typed; of a map made in Python the choices say what was sent."""
    typed = ["replay", "p0.h5", "--liner", "l.toml", "--incident", "tones:1400", "-o", "map.h5"]
    assert run(capsys, *typed)[0] == DONE
    found = tl.read_map("map.h5")
    (code,) = (block for block in section(subject_of(found)) if hasattr(block, "label"))
    words = shlex.split(code.text)[1:]
    assert words == typed
    assert run(capsys, *words[:-1], "again.h5")[0] == DONE
    assert torch.equal(tl.read_map("again.h5").impedance, found.impedance)
    untyped = {key: value for key, value in found.choices.items() if key != "command"}
    text = str(section(subject_of(dataclasses.replace(found, choices=untyped))))
    assert "of a replayed wave" in text
    assert "1400" in str(found.choices["incident"])


def two_variables(path):
    """A plane of two velocities."""
    with h5py.File(path, "w") as file:
        for name, values, unit in (
            ("time", np.arange(600) / 42e3, "s"),
            ("x", np.arange(3.0), "mm"),
        ):
            file[name] = values
            file[name].attrs["units"] = unit
            file[name].make_scale(name)
        for name, seed in (("v", 1), ("filtered", 2)):
            file[name] = turbulence((3, 600), seed=seed).numpy()
            file[name].attrs["units"] = "m/s"
            for axis, scale in zip(file[name].dims, ("x", "time"), strict=True):
                axis.attach_scale(file[scale])


@pytest.mark.parametrize("kind", ["stated", "converted", "variable", "arrays", "joined", "facts",
                                  "facts of moments"])  # fmt: skip
def test_page_and_command_repeat_how_a_plane_was_read(capsys, kind, files):
    """What was stated and selected in this reading; what a converted file tells of its own making
    is no part of it."""
    told, data = {}, "p0.h5"
    if kind == "stated":
        told = {"start": 0.001, "stop": 0.012, "region": [(-0.1, 0.0015)]}
    elif kind == "converted":
        words = ("convert", data, "-o", "c.h5", "--start", "0.001", "--every", "2")
        assert run(capsys, *words)[0] == DONE
        data, told = "c.h5", {"every": 2}
    elif kind == "variable":
        two_variables("two.h5")
        data, told = "two.h5", {"variable": "filtered"}
    elif kind == "arrays":
        np.save("v.npy", turbulence((3, 600)).numpy())
        data, told = "v.npy", {"axes": ["probe", "time"], "velocity_units": "m/s",
                               "sampling_rate": 42e3}  # fmt: skip
    elif kind == "joined":
        assert run(capsys, "convert", "p?.h5", "-o", "c.h5")[0] == DONE
        data = "c.h5"
    elif kind == "facts of moments":
        tl.moments(tl.read_plane(data), tl.load_liner("l.toml")).write("m.h5")
        data = "m.h5"
    if kind.startswith("facts"):
        assert run(capsys, "educe", data, "--liner", "l.toml", "--incident-level", "150", "-o",
                   "map.h5", "--no-intervals")[0] == DONE  # fmt: skip
    else:
        plane = tl.read_plane(data, lazy=True, **told)
        tl.educe(plane, tl.load_liner("l.toml"), 1400.0, interval=None).write("map.h5")
    found, space = tl.read_map("map.h5"), {}
    subject = subject_of(found, path=files / "map.h5")
    exec(program(subject), space)
    assert torch.equal(space["found"].impedance, found.impedance)
    for one, other in zip((space["found"], found), (found, space["found"]), strict=True):
        assert one.level_check is None or torch.equal(one.level_check.liner.level, other.level_check.liner.level)
    assert (found.level_check is None) == (not kind.startswith("facts"))
    assert held(space["found"])[:1] == held(found)[:1] == [
        ("moments" if data == "m.h5" else "velocity", data)]  # fmt: skip
    words = shlex.split(next(b.text for b in section(subject) if hasattr(b, "label")))[1:]
    out = words.index("-o") + 1
    words[out] = "again.h5"
    assert run(capsys, *words)[0] == DONE
    assert torch.equal(tl.read_map("again.h5").impedance, found.impedance)
    assert (UNTOLD in str(section(subject))) == (not kind.startswith("facts"))


def test_what_no_command_can_repeat_is_said(files):
    """Several files, arrays, facts that no option states."""
    plane = tl.read_plane(["p0.h5", "p1.h5"], x=[0.0, 1e-3, 2e-3], length_units="m")
    plane = restated(plane, {"mach": 0.3, "incident_level": 140.0})
    found = tl.educe(plane, tl.load_liner("l.toml"), interval=None)
    text = str(section(subject_of(found)))
    for words in (JOINS, UNTOLD, "does not hold x as it was stated", "cannot state mach = 0.3,"):
        assert words in text
    assert "--incident-level 140 " in text
    assert "lazy=True, length_units='m', x=X)" in program(subject_of(found))


def test_the_command_is_kept_as_it_was_typed(capsys, files, monkeypatch):
    """With its phase, its pressure and what is read of the plane; --hash hashes all of it."""
    words = ("educe", "p0.h5", "--liner", "l.toml", "--phase", "given", "--reference-phase",
             "-0.5", "--every", "2", "--wall-pressure", "w.h5", "--no-intervals", "--quiet",
             "-o", "map.h5")  # fmt: skip
    monkeypatch.setattr(origin, "BLOCK", 64)
    assert run(capsys, *words)[0] == DONE
    found = tl.read_map("map.h5")
    assert found.choices["command"] == list(words)
    assert found.choices["reference_phase"] == -0.5
    assert found.choices["inputs"][0]["kind"] == BLOCKWISE
    assert run(capsys, *words, "--hash")[0] == DONE
    again = tl.read_map("map.h5")
    assert [each["kind"] for each in again.choices["inputs"]] == [WHOLE] * 4
    blocks = [b for b in section(subject_of(found)) if hasattr(b, "label")]
    assert blocks[0].text == "torchliner " + " ".join(words)
    assert run(capsys, "insitu", "w.h5", "-o", "points.h5")[0] == DONE
    points = tl.read_points("points.h5")
    assert points.choices["command"] == ["insitu", "w.h5", "-o", "points.h5"]
    assert held(points) == [("in situ", "w.h5")]


def test_a_line_holds_its_bursts(capsys, files):
    """Each file once, the command, the phases of its stations."""
    time = torch.arange(4000, dtype=torch.float64) / 12e3
    wave = torch.cos(2 * torch.pi * 1500 * time)
    (files / "b").mkdir()
    for i in range(2):
        tl.BurstRecord(time, wall_normal=wave, x=0.01 * i, y=1e-3, z=0.0, frequency=1500.0,
                       liner="onera").write(f"b/s{i}.h5")  # fmt: skip
    words = ("ldv", "educe", "b", "--segment", "0.1", "--phase", "given", "--reference-phase",
             "0.5", "-o", "line.h5", "--quiet")  # fmt: skip
    assert run(capsys, *words)[0] == DONE
    line = tl.read_line("line.h5")
    assert held(line) == [("bursts", "b/s0.h5"), ("bursts", "b/s1.h5")]
    assert line.choices["command"] == list(words)
    assert line.choices["reference_phase"] == [0.5, 0.5]
    facts = files_of(inputs_of(line), [("line", files / "line.h5", "")])[1].pairs
    assert [what for what, _ in facts] == ["bursts", "bursts", "line"]
    assert facts[0][1].endswith("; unchanged")


def test_a_file_that_is_another_now_is_warned_of(files):
    """On top of the warnings, and beside the file; one that is gone is no warning."""
    found = tl.educe(tl.read_plane("p0.h5"), tl.load_liner("l.toml"), interval=None)
    assert of_map(subject_of(found))[-1].text == "None."
    with h5py.File("p0.h5", "a") as file:
        file.attrs["title"] = "another"
    (files / "t.csv").unlink()
    words = of_map(subject_of(found))[-1].items
    assert re.search("velocity: p0.h5 is another file now.*not what the result was made", words[0], re.I)
    facts = dict(files_of(inputs_of(found), [])[1].pairs)
    assert "another file now" in facts["velocity"]
    assert facts["liner"].endswith("not there now")
    size = (files / "p0.h5").stat().st_size
    later = {**found.choices["inputs"][0], "kind": "of later versions", "bytes": size}
    assert standing(later).words.startswith("of the same size now; not compared")


WRONG = {"what": "velocity", "name": "p", "bytes": "3", "kind": [], "hash": 1}


def test_maps_of_others_hold_none(files):
    """Said; what a stranger wrote there instead is passed over."""
    found = tl.educe(tl.read_plane("p0.h5"), tl.load_liner("l.toml"), interval=None)
    old = dataclasses.replace(found, choices={k: v for k, v in found.choices.items() if k != "inputs"})
    assert "does not hold the hashes of its inputs" in section(subject_of(old))[0].text
    for other in (3, "text", [3, {"name": "x"}, WRONG], {"a": 1}):
        strange = dataclasses.replace(old, choices={**old.choices, "inputs": other, "versions": 1})
        assert "does not hold" in section(subject_of(strange))[0].text


def test_kinds_are_told_apart():
    """A page never shows one for the other."""
    assert KINDS[WHOLE] == "SHA-256"
    assert KINDS[BLOCKWISE].startswith("SHA-256 of size and 32 blocks of 1 MiB")


def test_a_collection_stands_for_the_files_that_it_names(tmp_path):
    """Wherever they lie, and for no others beside it; numbered files for those of their name."""
    from torchliner.records.origin import series_of

    (tmp_path / "a").mkdir()
    (tmp_path / "elsewhere").mkdir()
    frames = [tmp_path / "elsewhere" / f"f{n}.vtp" for n in (1, 2)]
    other = tmp_path / "a" / "other.vtp"
    for path in (*frames, other):
        path.write_text("one")
    pvd = tmp_path / "a" / "s.pvd"
    pvd.write_text("".join(f'<DataSet timestep="{n}" file="../elsewhere/f{n}.vtp"/>' for n in (1, 2)))
    known = input_file("velocity", pvd)
    assert len(series_of(pvd)) == 3
    other.write_text("another")
    assert standing(known).words == "unchanged"
    frames[1].write_text("two")
    assert standing(known).changed
    assert series_of(frames[0]) == frames


def test_a_page_tells_no_hash_of_what_a_result_names(tmp_path):
    """A result may name any file of its reader; a folder without end is not walked through."""
    path = tmp_path / "secret"
    path.write_text("secret")
    found = standing({**input_file("velocity", path), "hash": "0" * 64})
    assert found == ("another file of the same size now", True)
    assert "more than" in standing({**input_file("velocity", path), "name": "/"}).words
