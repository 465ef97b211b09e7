"""Nothing of the user's is lost, what cannot be written is refused before the work, and faults are told in one line."""

import os
import stat
import subprocess
import sys
import warnings

import numpy as np
import pytest
import torch
from conftest import DATA, plane_of, turbulence
from test_cli import run

import torchliner as tl
from torchliner.cli import work
from torchliner.cli.main import BAD_INPUT, DONE, INTERRUPTED
from torchliner.io import whole_file
from torchliner.io.result_writers import write_rows

TOML = 'model = "table"\nname = "mine"\nfile = "table.csv"\n'
TABLE = "frequency, resistance, reactance\n300, 0.5, -1\n3000, 0.5, 1\n"
ROW = [{"a": 1.0}]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Small inputs of every kind, in the working folder."""
    monkeypatch.chdir(tmp_path)
    plane = plane_of(turbulence((4, 600)), x=torch.arange(4) * 1e-3, liner="polito")
    plane.write("plane.h5")
    np.save("v.npy", np.zeros((50, 4)))
    np.save("x.npy", np.arange(4.0))
    (tmp_path / "lt.toml").write_text(TOML)
    (tmp_path / "table.csv").write_text(TABLE)
    (tmp_path / "pressure.h5").write_bytes((DATA / "pressure_n130.h5").read_bytes())
    return tmp_path


ARRAY = "convert v.npy --axes time,x --velocity-units m/s --sampling-rate 5e4"
OVER_INPUTS = [  # words that end in the output, and the input that it is a link to
    (os.link, f"{ARRAY} -o over.h5", "v.npy"),
    (os.symlink, f"{ARRAY} --x x.npy -o over.h5", "x.npy"),
    (os.symlink, "educe plane.h5 -o over.h5", "plane.h5"),
    (os.link, "educe plane.h5 --in-situ pressure.h5 -o over.h5", "pressure.h5"),
]


@pytest.mark.parametrize(("way", "words", "name"), OVER_INPUTS)
def test_no_command_writes_over_an_input(capsys, folder, way, words, name):
    output, old = folder / words.split()[-1], (folder / name).read_bytes()
    way(folder / name, output)
    code, _, err = run(capsys, *words.split())
    assert (code, "is an input" in err) == (BAD_INPUT, True), err
    assert (folder / name).read_bytes() == old


@pytest.mark.parametrize("second", ["plane.h5", "./plane.h5", "link.h5"])
def test_one_file_is_not_two_measurements(capsys, folder, second):
    """Named twice it would count twice: three times halved the uncertainty of a calibration."""
    (folder / "link.h5").symlink_to("plane.h5")
    for words in (["educe"], ["calibrate", "--free", "porosity"], ["height"]):
        code, _, err = run(capsys, words[0], "plane.h5", second, *words[1:])
        assert (code, "is named twice" in err) == (BAD_INPUT, True), err
    words = "calibrate plane.h5 --free porosity --predict plane.h5 --reference 0.5+0.1j"
    assert "named twice" not in run(capsys, *words.split())[2]  # a plane that was fitted may be predicted


def test_what_is_named_later_is_held_against_the_inputs_too(folder):
    """Pictures in a folder have names of their own: the writer knows the inputs."""
    with whole_file.inputs_kept(["table.csv"]):
        with pytest.raises(ValueError, match=r"table\.csv is an input"):
            write_rows(ROW, "table.csv")
        write_rows(ROW, "other.csv")
    write_rows(ROW, "table.csv")


def test_links_are_followed_and_modes_kept(folder):
    old, usual = folder / "old.csv", folder / "new.csv"
    old.write_text("old")
    old.chmod(0o600)
    (folder / "link.csv").symlink_to("old.csv")
    (folder / "ahead.csv").symlink_to("not_yet.csv")
    for name in ("link.csv", "ahead.csv", "new.csv"):
        write_rows(ROW, name)
    assert (folder / "link.csv").is_symlink()
    assert old.read_text().split() == (folder / "not_yet.csv").read_text().split() == ["a", "1.0"]
    assert stat.S_IMODE(old.stat().st_mode) == 0o600
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(usual.stat().st_mode) == 0o666 & ~mask


def test_devices_links_in_circles_and_protected_files_are_refused(folder):
    os.mkfifo("pipe.csv")
    (folder / "loop.csv").symlink_to("loop.csv")
    (folder / "kept.csv").write_text("kept")
    (folder / "kept.csv").chmod(0o444)
    (folder / "null.csv").symlink_to("/dev/null")
    (folder / "folder.csv").mkdir()
    wanted = {
        "pipe.csv": "device or a pipe",
        "null.csv": "device or a pipe",
        "loop.csv": "itself",
        "kept.csv": "write-protected",
        "folder.csv": "is a folder",
        "none/a.csv": "the folder none does not exist",
        "n" * 260 + ".csv": "File name too long",
    }
    for name, message in wanted.items():
        with pytest.raises(OSError, match=message):
            write_rows(ROW, name)
    assert (folder / "kept.csv").read_text() == "kept"
    write_rows(ROW, "n" * 250 + ".csv")


BEFORE = [  # tested before a plane is read
    ("educe --figure table.csv", "it must be one of .png"),
    ("educe -o none/m.h5", "the folder none does not exist"),
    ("educe --liner ltt.toml", "did you mean 'lt.toml'"),
    ("educe --in-situ /dev/null", "is a device or a pipe"),
    ("educe --liner loop.toml", "no such file"),
    *((f"{command} m{end}", "it must be one of") for end in (".json", ".vtk", ".xlsx") for command in ("educe -o",)),
    ("audit --figure m.json", "it must be one of .png"),
    ("audit -o m.h5", "it must be one of .csv"),
]


@pytest.mark.parametrize(("words", "message"), BEFORE)
def test_tested_before_the_work(capsys, folder, monkeypatch, words, message):
    (folder / "loop.toml").symlink_to("loop.toml")
    monkeypatch.setattr(tl, "read_plane", None, raising=False)
    before = set(folder.iterdir())
    command, *options = words.split()
    code, out, err = run(capsys, command, "plane.h5", *options)
    assert (code, message in err, out, set(folder.iterdir())) == (BAD_INPUT, True, "", before), err


def test_an_output_without_an_ending_is_a_folder(capsys, folder):
    (folder / "other.h5").write_bytes((folder / "plane.h5").read_bytes())
    assert run(capsys, "educe", "plane.h5", "other.h5", "-o", "new/maps", "--quiet")[0] == DONE
    assert {path.name for path in (folder / "new/maps").iterdir()} == {"educe_plane.h5", "educe_other.h5"}


@pytest.mark.parametrize("words", ["educe plane.h5 --figure f -o m.h5", "audit plane.h5 --figure p.png"])
def test_without_matplotlib_nothing_is_begun(capsys, folder, monkeypatch, words):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = run(capsys, *words.split())
    assert (code, "figures need matplotlib" in err, out) == (BAD_INPUT, True, "")
    assert not (folder / "m.h5").exists()


def test_unfinished_files_of_killed_runs_are_deleted_with_the_lock(folder):
    (folder / f"{whole_file.PART}abc.part").write_text("part")
    with whole_file.locked(folder):
        assert not list(folder.glob("*.part"))


def test_a_full_disk_names_the_output(folder):
    import resource

    (folder / "p.h5").write_text("old")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    plane = plane_of(torch.randn(64, 4000).double())
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, limit[1]))
    try:
        with pytest.raises(OSError, match=r"^p\.h5 cannot be written: .*File too large$") as caught:
            plane.write("p.h5")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert ".part" not in str(caught.value)
    assert (folder / "p.h5").read_text() == "old"
    assert not list(folder.glob(".*.part"))


@pytest.mark.parametrize("fault", [KeyError("x"), AttributeError("no x"), RecursionError("deep")])
def test_what_nobody_foresaw_is_one_line(capsys, folder, monkeypatch, fault):
    monkeypatch.setattr(work, "read_records", lambda *_: (each for each in ()).throw(fault))
    code, out, err = run(capsys, "info", "plane.h5")
    assert (code, out, len(err.splitlines())) == (BAD_INPUT, "", 1)
    assert err.startswith(f"torchliner info: plane.h5: {type(fault).__name__}: ")
    assert "please report it" in err
    assert "Traceback" in run(capsys, "info", "plane.h5", "--debug")[2]


def test_titles_do_not_steer_a_terminal(capsys, folder):
    evil = "\x1b[2J\x1b]0;owned\x07=1+1"
    plane_of(turbulence((2, 600)), title=evil, liner="polito").write("evil.h5")
    code, out, err = run(capsys, "info", "evil.h5")
    assert (code, "\\x1b[2J" in out) == (DONE, True)
    assert not any(sign in out + err for sign in "\x1b\x07")
    write_rows([{"c": "\x1b[2J", "d": -2.0}], "evil.csv")
    assert (folder / "evil.csv").read_text().split() == ["c,d", "\\x1b[2J,-2.0"]


def test_warnings_come_once_three_at_most_and_are_ours(capsys, folder, monkeypatch):

    def doubtful(*_):
        for _ in range(3):
            warnings.warn("plane.h5: rests on 0.5 blocks; pass quiet=True", tl.DataWarning, stacklevel=2)
        for word in ("two", "three", "four"):
            warnings.warn(f"warned {word}", tl.DataWarning, stacklevel=2)
        warnings.warn("will be removed", DeprecationWarning, stacklevel=2)
        raise ValueError("plane.h5: done")

    monkeypatch.setattr(work, "read_records", doubtful)
    err = run(capsys, "info", "plane.h5")[2].splitlines()
    assert err[0] == "warning: plane.h5: rests on 0.5 blocks; pass quiet=True"
    assert err[1:3] == ["warning: warned two", "warning: warned three"]
    assert "1 more; --verbose" in err[3]
    assert len(err) == 5
    every = run(capsys, "info", "plane.h5", "--verbose")[2].splitlines()
    assert ["warning: warned four" in every, len(every)] == [True, 5]
    assert run(capsys, "info", "plane.h5", "--quiet")[2].count("\n") == 1


IMPATIENT = """
import sys
class Stop:
    def find_spec(self, name, *_):
        if name == {name!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Stop())
from torchliner.cli.main import main
sys.exit(main(["info", "plane.h5"]))
"""


@pytest.mark.parametrize("name", ["torchliner.cli.campaign", "torch", "h5py"])
def test_an_interrupt_while_modules_are_imported(folder, name):
    code = IMPATIENT.format(name=name)
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (found.returncode, "Traceback" in found.stderr) == (INTERRUPTED, False), found.stderr


def test_damage_that_hides_attributes_is_no_absence(capsys, folder):
    """HDF5 says of an attribute in a damaged list that it is not there; the liner was lost so."""
    data = bytearray((folder / "plane.h5").read_bytes())
    at = data.index(b"source_side\0") - 8  # the sizes before the name
    data[at : at + 4] = b"\xff" * 4
    (folder / "plane.h5").write_bytes(data)
    code, out, err = run(capsys, "info", "plane.h5")
    assert (code, out, "plane.h5 is damaged" in err) == (BAD_INPUT, "", True), err
