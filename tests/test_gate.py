"""Nothing of the user's is lost, and what cannot be written is refused before the work."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
import warnings

import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, plane_of, turbulence
from test_cli import parsers, run
from test_results_out import hand_map

import torchliner as tl
from torchliner.cli import info
from torchliner.cli.main import BAD_INPUT, DONE, INTERRUPTED
from torchliner.io import whole_file
from torchliner.io.csv_rows import text_cell, write_rows

TOML = 'model = "table"\nname = "mine"\nfile = "table.csv"\n'
TABLE = "frequency, resistance, reactance\n300, 0.5, -1\n3000, 0.5, 1\n"


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


ARRAY = "convert v.npy --axes time,x --velocity-units m/s --sampling-rate 5e4".split()
OVER_INPUTS = {
    "array": ([*ARRAY, "-o", "over.h5"], "v.npy"),
    "coordinates": ([*ARRAY, "--x", "x.npy", "-o", "over.h5"], "x.npy"),
    "plane by educe": (["educe", "plane.h5", "-o", "over.h5"], "plane.h5"),
    "plane by truth": (["validate", "plane.h5", "-o", "over.csv"], "plane.h5"),
    "picture of a plane": (["info", "plane.h5", "--figure", "over.png"], "plane.h5"),
    "a table named in a toml": (["educe", "plane.h5", "--liner", "lt.toml", "-o", "over.csv"],
                                "table.csv"),
    "a toml": (["liner", "lt.toml", "--figure", "over.png"], "lt.toml"),
    "a record": (["educe", "plane.h5", "--in-situ", "pressure.h5", "-o", "over.h5"], "pressure.h5"),
}  # fmt: skip


@pytest.mark.parametrize("way", ["hard link", "link"])
@pytest.mark.parametrize("case", OVER_INPUTS)
def test_no_command_writes_over_an_input(capsys, folder, case, way):
    """By no name: the output is a link to the input."""
    words, name = OVER_INPUTS[case]
    output, old = folder / words[-1], (folder / name).read_bytes()
    (os.link if way == "hard link" else os.symlink)(folder / name, output)
    code, _, err = run(capsys, *words)
    assert (code, "is an input" in err) == (BAD_INPUT, True), err
    assert (folder / name).read_bytes() == old


@pytest.mark.parametrize("second", ["plane.h5", "./plane.h5", "link.h5"])
def test_one_file_is_not_two_measurements(capsys, folder, second):
    """Named twice it would count twice: three times halved the uncertainty of a calibration."""
    (folder / "link.h5").symlink_to("plane.h5")
    for words in (["educe"], ["calibrate", "--free", "porosity"], ["validate"], ["height"]):
        code, _, err = run(capsys, words[0], "plane.h5", second, *words[1:])
        assert (code, "is named twice" in err) == (BAD_INPUT, True), err
    code, _, err = run(capsys, "calibrate", "plane.h5", "--free", "porosity", "--draws", "0",
                       "--predict", "plane.h5", "--reference", "0.5+0.1j")  # fmt: skip
    assert "named twice" not in err  # a plane that was fitted may be predicted


def test_what_is_named_later_is_held_against_the_inputs_too(folder):
    """Pictures in a folder have names of their own: the writer knows the inputs."""
    with whole_file.inputs_kept(["table.csv"]):
        with pytest.raises(ValueError, match=r"table\.csv is an input"):
            write_rows([{"a": 1.0}], "table.csv")
        write_rows([{"a": 1.0}], "other.csv")
    write_rows([{"a": 1.0}], "table.csv")


def test_links_are_followed_and_modes_kept(folder):
    """The link stays a link, the file behind it is replaced; a new file has the usual mode."""
    old, usual = folder / "old.csv", folder / "new.csv"
    old.write_text("old")
    old.chmod(0o600)
    (folder / "link.csv").symlink_to("old.csv")
    (folder / "ahead.csv").symlink_to("not_yet.csv")
    for name in ("link.csv", "ahead.csv", "new.csv"):
        write_rows([{"a": 1.0}], name)
    assert (folder / "link.csv").is_symlink()
    assert old.read_text().split() == (folder / "not_yet.csv").read_text().split() == ["a", "1.0"]
    assert stat.S_IMODE(old.stat().st_mode) == 0o600
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(usual.stat().st_mode) == 0o666 & ~mask


def test_devices_links_in_circles_and_protected_files_are_refused(folder):
    """Each with what to do; none is replaced."""
    os.mkfifo("pipe.csv")
    (folder / "loop.csv").symlink_to("loop.csv")
    (folder / "kept.csv").write_text("kept")
    (folder / "kept.csv").chmod(0o444)
    (folder / "null.csv").symlink_to("/dev/null")
    (folder / "folder.csv").mkdir()
    wanted = {
        "pipe.csv": "device or a pipe", "null.csv": "device or a pipe", "loop.csv": "itself",
        "kept.csv": "write-protected", "folder.csv": "is a folder",
        "none/a.csv": "the folder none does not exist", "n" * 260 + ".csv": "more than 255 bytes",
    }  # fmt: skip
    for name, message in wanted.items():
        with pytest.raises(OSError, match=message):
            write_rows([{"a": 1.0}], name)
    assert (folder / "kept.csv").read_text() == "kept"
    write_rows([{"a": 1.0}], "n" * 250 + ".csv")


@pytest.mark.parametrize("ending", [".json", ".vtk", ".xlsx", ""])
def test_an_ending_that_cannot_be_written_is_refused(capsys, folder, ending):
    """By every command, before the work, and by ``write()``."""
    name = f"m{ending}"
    for words in (["educe", "plane.h5", "-o", name], [*ARRAY, "-o", name],
                  ["validate", "plane.h5", "-o", name], ["info", "plane.h5", "--figure", name],
                  ["duct", "modes", "ufsc", "-o", name]):  # fmt: skip
        code, out, err = run(capsys, *words)
        assert (code, "it must be one of" in err, out) == (BAD_INPUT, True, ""), err
    plane = tl.read_plane("plane.h5")
    with pytest.raises(ValueError, match=r"it must be one of \.h5, \.hdf5, \.nc$"):
        plane.write(name)
    with pytest.raises(ValueError, match=r"it must be one of .*\.csv, .*\.vtkhdf, .*\.txt$"):
        hand_map().write(name)
    assert not (folder / name).exists()


BEFORE = [
    (["educe", "--figure", "table.csv"], "is there and no folder"),
    (["educe", "--figure", "table.csv/deeper"], "is there and no folder"),
    (["educe", "-o", "none/m.h5"], "the folder none does not exist"),
    (["educe", "--liner", "ltt.toml"], "no such file (did you mean 'lt.toml'?)"),
    (["educe", "--in-situ", "presure.h5"], "no such file (did you mean 'pressure.h5'?)"),
    (["educe", "--in-situ", "/dev/null"], "is a device or a pipe; a file is needed"),
    (["educe", "--liner", "loop.toml"], "cannot be read"),
    (["replay", "--segment", "nan"], "'nan' cannot be read; a finite number is needed"),
    (["replay", "--levels", "1e20"], "'1e20' cannot be read; a whole number"),
    (["replay", "--levels", "100000000000000000000"], "from 1 to 2^53"),
    (["replay", "--every", "0"], "from 1 to 2^53"),
]


@pytest.mark.parametrize(("words", "message"), BEFORE, ids=[" ".join(w) for w, _ in BEFORE])
def test_tested_before_the_work(capsys, folder, monkeypatch, words, message):
    """No plane is read first."""
    (folder / "loop.toml").symlink_to("loop.toml")
    monkeypatch.setattr("torchliner.cli.educe.read_records", None)
    code, out, err = run(capsys, words[0], "plane.h5", *words[1:])
    assert (code, message in err, out) == (BAD_INPUT, True, ""), err


@pytest.mark.parametrize("words", [["educe", "plane.h5", "--figure", "f", "-o", "m.h5"],
                                   ["info", "plane.h5", "--figure", "p.png"]])  # fmt: skip
def test_without_matplotlib_nothing_is_begun(capsys, folder, monkeypatch, words):
    """No map without its pictures, and no work for nothing."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = run(capsys, *words)
    assert (code, "figures need matplotlib" in err, out) == (BAD_INPUT, True, "")
    assert not (folder / "m.h5").exists()


def test_parts_of_killed_runs_are_deleted_and_those_of_others_kept(folder):
    """A part names its machine and process."""
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    stale = folder / f"{whole_file.PART}{dead.pid}-abc.part"
    alive = folder / f"{whole_file.PART}{os.getpid()}-abc.part"
    elsewhere = folder / f".torchliner-otherhost-{dead.pid}-abc.part"
    for part in (stale, alive, elsewhere):
        part.write_text("part")
    write_rows([{"a": 1.0}], "a.csv")
    assert [part.exists() for part in (stale, alive, elsewhere)] == [False, True, True]


def test_a_full_disk_names_the_output(folder):
    """And leaves the old file; the part is deleted."""
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


@pytest.mark.parametrize("fault", [KeyError("x"), AttributeError("no x"), ZeroDivisionError("0"),
                                   UnboundLocalError("x"), RecursionError("deep")])  # fmt: skip
def test_what_nobody_foresaw_is_one_line(capsys, folder, monkeypatch, fault):
    """The file, the fault, and the wish for a report; --debug shows where."""
    monkeypatch.setattr(info, "read_records", lambda *_: (each for each in ()).throw(fault))
    code, out, err = run(capsys, "info", "plane.h5")
    assert (code, out, len(err.splitlines())) == (BAD_INPUT, "", 1)
    assert err.startswith(f"torchliner info: plane.h5: {type(fault).__name__}: ")
    assert "please report it" in err
    for words in (["--debug", "info"], ["info", "--debug"]):
        assert "Traceback" in run(capsys, *words, "plane.h5")[2]


def test_texts_of_libraries_get_the_file(capsys, folder, monkeypatch):
    """An OSError from elsewhere names nothing; memory that is not there has a remedy."""

    def of_a_library(*_):
        np.frombuffer(b"abc", dtype=np.float64)

    monkeypatch.setattr(info, "read_records", of_a_library)
    assert "torchliner info: plane.h5: buffer size" in run(capsys, "info", "plane.h5")[2]
    monkeypatch.setattr(info, "read_records", lambda *_: np.empty(1 << 50))
    assert "plane.h5: not enough memory: " in run(capsys, "info", "plane.h5")[2]


def test_options_are_named_as_the_command_has_them(capsys, folder):
    """Not as Python has them."""
    plane_of(turbulence((2, 100)), liner="polito").write("short.h5")
    code, _, err = run(capsys, "educe", "short.h5")
    assert (code, "pass --allow-short" in err, "allow_short" in err) == (BAD_INPUT, True, False)
    parser = dict(parsers())["educe"]
    wanted = {
        "use device='cpu'": "use --device cpu",
        "give frequency=..., in Hz": "give --frequency ..., in Hz",
        "try interval=None.": "try --no-intervals.",
        "y(t) = cos(2 pi f t), q=3, a==b": "y(t) = cos(2 pi f t), q=3, a==b",
    }
    assert {text: parser.in_words(text) for text in wanted} == wanted


def test_titles_do_not_steer_a_terminal_nor_a_spreadsheet(capsys, folder):
    """Neither in a table, nor in a warning, nor in a CSV."""
    evil = "\x1b[2J\x1b]0;owned\x07=1+1"
    plane_of(turbulence((2, 600)), title=evil, liner="polito").write("evil.h5")
    code, out, err = run(capsys, "info", "evil.h5")
    assert (code, "\\x1b[2J" in out) == (DONE, True)
    assert not any(sign in out + err for sign in "\x1b\x07")
    write_rows([{"=cmd": "=1+1", "b": "-0.5", "c": "\x1b[2J", "d": -2.0}], "evil.csv")
    assert (folder / "evil.csv").read_text().split() == ["'=cmd,b,c,d", "'=1+1,-0.5,\\x1b[2J,-2.0"]
    assert [text_cell(text) for text in ("@a", "+1e3", "a=b", "")] == ["'@a", "+1e3", "a=b", ""]


def test_a_warning_that_planes_share_is_said_once(capsys, folder, monkeypatch):
    """With the names of the others, whose numbers differ."""

    def doubtful(*_):
        for i in range(3):
            warnings.warn(f"p{i}.h5:/v: rests on {i}.5 blocks, few", tl.DataWarning, stacklevel=2)
        raise ValueError("done")

    for i in range(3):
        (folder / f"p{i}.h5").write_bytes(b"")
    monkeypatch.setattr("torchliner.cli.educe.read_records", doubtful)
    err = run(capsys, "educe", "p0.h5", "p1.h5", "p2.h5")[2].splitlines()
    assert err[0] == "warning: p0.h5:/v: rests on 0.5 blocks, few"
    assert err[1].endswith("'rests on # blocks, few ...' also applies to 2 more: p1.h5, p2.h5")
    assert len(err) == 3


def test_warnings_come_once_and_are_ours(capsys, folder, monkeypatch):
    """A doubt that several planes share is said once; what libraries plan is left to --debug."""

    def doubtful(*_):
        for _ in range(3):
            warnings.warn("a doubt; pass quiet=True", tl.DataWarning, stacklevel=2)
        warnings.warn("will be removed", DeprecationWarning, stacklevel=2)
        raise ValueError("done")

    monkeypatch.setattr(info, "read_records", doubtful)
    err = run(capsys, "info", "plane.h5")[2]
    assert err == "warning: a doubt; pass --quiet\ntorchliner info: plane.h5: done\n"
    assert "will be removed" in run(capsys, "info", "plane.h5", "--debug")[2]


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


@pytest.mark.parametrize("name", ["torchliner.cli.gate", "torchliner.cli.info", "torch", "h5py"])
def test_an_interrupt_while_modules_are_imported(folder, name):
    """In the first second a command does little else."""
    code = IMPATIENT.format(name=name)
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (found.returncode, "Traceback" in found.stderr) == (INTERRUPTED, False), found.stderr


def test_info_tells_what_educe_refuses(capsys, folder):
    """Too few periods; a Mach number of 0 is stated, and said once."""
    plane = plane_of(turbulence((2, 119)), mach=0.0, incident_level=0.0, liner="polito")
    plane.write("short.h5")
    code, out, _ = run(capsys, "info", "short.h5")
    assert (code, "3.97 periods of the tone, fewer than 4: educe refuses" in out) == (1, True)
    assert len(re.findall(r"\bmach\b", out)) == 1
    assert run(capsys, "educe", "short.h5")[0] == BAD_INPUT


def test_arrays_in_groups_are_found(capsys, folder):
    """By their path; where there is none, that is said."""
    with h5py.File("groups.h5", "w") as file:
        file["run/velocity"] = np.zeros((50, 4))
        file["run/pressure"] = np.zeros((50, 4))
    words = ["convert", "groups.h5", *ARRAY[2:], "-o", "p.h5"]
    code, _, err = run(capsys, *words)
    assert (code, "run/velocity (50x4); name it: --variable" in err) == (BAD_INPUT, True), err
    assert run(capsys, *words, "--variable", "run/velocity")[0] == DONE


def test_damage_that_hides_attributes_is_no_absence(capsys, folder):
    """HDF5 says of an attribute in a damaged list that it is not there; the liner was lost so."""
    data = bytearray((folder / "plane.h5").read_bytes())
    at = data.index(b"source_side\0") - 8  # the sizes before the name
    data[at : at + 4] = b"\xff" * 4
    (folder / "plane.h5").write_bytes(data)
    code, out, err = run(capsys, "info", "plane.h5")
    assert (code, out, "plane.h5 is damaged" in err) == (BAD_INPUT, "", True), err


@pytest.mark.parametrize("cell", ["1_000", "\u0661\u0662"])
def test_numbers_that_python_alone_reads_are_refused(capsys, folder, cell):
    """A slip of the keyboard, in every table of text."""
    (folder / "table.csv").write_text(TABLE.replace("300,", f"{cell},", 1), encoding="utf-8")
    code, _, err = run(capsys, "liner", "lt.toml")
    assert (code, "a number is needed" in err) == (BAD_INPUT, True), err
