"""What a result holds of where it comes from, and what a page makes of it."""

import hashlib
import os
import platform
import subprocess
import sys

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, plane_of, turbulence
from test_cli import run

import torchliner as tl
from torchliner.cli.main import DONE
from torchliner.records import origin
from torchliner.records.origin import input_file
from torchliner.report.page import inputs_of

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
LINER = """model = "table"
frequency = [300, 3500]
speed = [0, 20]
values = [[[1, -1.7], [3, -1.7]], [[1, 1.5], [3, 1.5]]]
"""


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
    path = tmp_path / "a.h5"
    write(path, b"velocity" * 999)
    wanted = hashlib.sha256(b"velocity" * 999).hexdigest()
    assert input_file("velocity", path) == {"what": "velocity", "name": str(path), "bytes": 7992, "hash": wanted}


def test_of_a_large_file_blocks_count(small, tmp_path):
    """Begin, end and blocks between; what lies between these does not."""
    path, content = tmp_path / "a.h5", bytes(range(100))
    write(path, content)
    first = input_file("velocity", path)
    seen = []
    for place in range(100):
        write(path, content[:place] + b"\xff" + content[place + 1 :])
        seen.append(input_file("velocity", path)["hash"] != first["hash"])
    starts = [0, 30, 61, 92]
    assert seen == [any(s <= place < s + 8 for s in starts) for place in range(100)]
    write(path, content + b"a")
    assert input_file("velocity", path)["hash"] != first["hash"]


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
    write(other / "a", b"x" + b"a" * 29)
    assert input_file("velocity", other)["hash"] != hashes[0]
    frames = tmp_path / "frames"
    frames.mkdir()
    for i in range(3):
        write(frames / f"t{i}.vtk", bytes([i]) * 9)
    assert input_file("velocity", frames / "t0.vtk")["bytes"] == 27  # any stands for all


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two parts of a plane, a pressure record, and a liner of a file."""
    monkeypatch.chdir(tmp_path)
    velocity = turbulence((3, 1200))
    x = np.arange(3) * 1e-3
    for i, part in enumerate(velocity.split(600, 1)):
        plane_of(part, x=x, start=i * 600 / 42e3, source_side="upstream").write(f"p{i}.h5")
    tone = torch.cos(2 * torch.pi * torch.arange(1200, dtype=torch.float64) / 30)
    tl.PressureRecord(
        facesheet=tone.expand(3, -1), backplate=tone, sampling_rate=42e3, frequency=FREQUENCY, x=x, cavity_depth=0.04
    ).write("w.h5")
    (tmp_path / "l.toml").write_text(LINER)
    return tmp_path


def held(result):
    return [(each["what"], each["name"]) for each in result.choices["inputs"]]


def test_a_map_in_python_holds_its_inputs_and_phases(files):
    """Every file by name, all versions, the phases as they were given; through a file too."""
    plane = tl.read_plane(["p0.h5", "p1.h5"], lazy=True)
    liner, phase = tl.load_liner("l.toml"), torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
    found = tl.educe(
        plane, liner, phase="given", reference_phase=phase, interval=None, pressure=tl.read_pressure("w.h5")
    )
    found.write("map.h5")
    found = tl.read_map("map.h5")
    files_of = [("velocity", "p0.h5"), ("velocity", "p1.h5"), ("liner", "l.toml")]
    assert held(found) == [*files_of, ("wall pressure", "w.h5")]
    assert [each["hash"] for each in found.choices["inputs"]] == [
        hashlib.sha256((files / name).read_bytes()).hexdigest() for _, name in held(found)
    ]
    assert found.choices["reference_phase"] == [0.1, 0.2, 0.3]
    assert "command" not in found.choices
    versions = {"torchliner": tl.__version__, "torch": torch.__version__, "numpy": np.__version__}
    assert found.choices["versions"] == versions | {"python": platform.python_version()}
    found = tl.educe(plane, liner.replace(name="mine"), interval=None)
    assert ("liner", "l.toml") not in held(found)  # a changed copy is not the file's
    tl.moments(plane, cell_pitch=None).write("m.h5")
    again = tl.educe(tl.read_moments("m.h5"), tl.load_liner("polito").replace(cell_pitch=None))
    assert held(again) == [("moments", "m.h5")]
    known = [(each["what"], each["name"]) for each in inputs_of(again)]
    assert known == [("moments", "m.h5"), ("velocity", "p0.h5"), ("velocity", "p1.h5")]


def alone(*words):
    """A command in a process of its own."""
    done = subprocess.run([sys.executable, "-m", "torchliner", *words], capture_output=True, text=True, check=False)
    assert done.returncode == DONE, done.stderr


def test_the_command_is_kept_as_it_was_typed(files):
    words = (
        "educe p0.h5 --liner l.toml --phase given --reference-phase -0.5 --wall-pressure w.h5 "
        "--interval none --quiet -o map.h5"
    ).split()
    alone(*words)
    found = tl.read_map("map.h5")
    assert found.choices["command"] == words
    assert found.choices["reference_phase"] == -0.5
    alone("insitu", "w.h5", "-o", "points.h5")
    points = tl.read_points("points.h5")
    assert points.choices["command"] == ["insitu", "w.h5", "-o", "points.h5"]
    assert held(points) == [("in situ", "w.h5")]


def test_a_line_holds_its_bursts(capsys, files):
    time = torch.arange(4000, dtype=torch.float64) / 12e3
    wave = torch.cos(2 * torch.pi * 1500 * time)
    (files / "b").mkdir()
    for i in range(2):
        tl.BurstRecord(time, wall_normal=wave, x=0.01 * i, y=1e-3, z=0.0, frequency=1500.0, liner="onera").write(
            f"b/s{i}.h5"
        )
    words = "ldv educe b --segment 0.1 -o line.h5 --quiet".split()
    assert run(capsys, *words)[0] == DONE
    line = tl.read_line("line.h5")
    assert held(line) == [("bursts", "b/s0.h5"), ("bursts", "b/s1.h5")]
    assert line.choices["command"] == words


def test_a_collection_stands_for_the_files_that_it_names(tmp_path):
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
    assert input_file("velocity", pvd) == known
    frames[1].write_text("two")
    assert input_file("velocity", pvd) != known
    assert series_of(frames[0]) == frames
