"""The commands as a user meets them: one contract for all, then what each prints, writes and draws."""

from __future__ import annotations

import argparse
import csv
import json
import re
import shlex
import subprocess
import sys
import warnings
from inspect import signature

import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.cli.gate import passed
from torchliner.cli.main import BAD_INPUT, CHECK_FAILED, COMMANDS, DONE, GROUPS, INTERRUPTED, build_parser, main
from torchliner.cli.options import Kind
from torchliner.cli.signatures import parameters
from torchliner.velocity.choices import Choices

SLIT = str(DATA / "slit_n130_y2.5mm.h5")
CHANNEL = str(DATA / "channel_y1.04mm.h5")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Folder of two heights of a case, few probes and 0.02 s: quick to educe and to draw."""
    folder = tmp_path_factory.mktemp("small")
    for height, rate in ((0.5, RATE), (2.5, 1.3 * RATE)):
        plane_of(
            turbulence((2, 4, 900), seed=int(height)), sampling_rate=rate, height=1e-3 * height,
            x=torch.arange(4) * 1e-3, z=torch.arange(2) * 1e-3, liner="polito",
            reference={"true": 0.2 - 0.1j}, provenance={"case": "small"},
        ).write(folder / f"y{height}mm.h5")  # fmt: skip
    return folder


def run(capsys, *words: str) -> tuple[int, str, str]:
    try:
        code = main(list(words))
    except SystemExit as stop:
        code = int(stop.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


def parsers(parser=None, name=""):
    """Every parser with options, by the words of its command."""
    if parser is None:
        return [each for word, p in build_parser()[1].items() for each in parsers(p, word)]
    tasks = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    below = [each for a in tasks for t, p in a.choices.items() for each in parsers(p, f"{name} {t}")]
    return below or [(name, parser)]


EVERY = pytest.mark.parametrize(("name", "parser"), parsers(), ids=[name for name, _ in parsers()])


@EVERY
def test_help_is_complete(capsys, name, parser):
    """--help-all names every option with a text, and --help those that are shown; the examples parse."""
    code, short, _ = run(capsys, *name.split(), "--help")
    assert code == DONE
    code, whole, _ = run(capsys, *name.split(), "--help-all")
    assert code == DONE
    assert ("--help-all" in short) == (short != whole)
    for action in parser._actions:
        text = parser.whole.get(action, action.help)
        if text != argparse.SUPPRESS:
            flag = (action.option_strings or [action.metavar])[-1]
            assert text
            assert re.search(rf"^  (-\w( [A-Z]+)?, )?{re.escape(flag)}\b", whole, re.M), flag
    told = re.findall(rf"^  torchliner ({name}\b.*)$", whole, re.M)
    assert told
    for words in told:
        assert build_parser()[0].parse_known_args(shlex.split(words))[1] == []


@EVERY
def test_slips_are_answered_with_the_nearest_option(capsys, name, parser):
    """With all that must be given, so that the slip is the only mistake."""
    needed = []
    for action in parser._actions:
        if action.required or (not action.option_strings and action.nargs not in ("?", "*")):
            needed += [*action.option_strings[-1:], "1"]
    known = max((option for a in parser._actions for option in a.option_strings), key=len)
    code, out, err = run(capsys, *name.split(), *needed, known[:-2] + known[-1])
    assert (code, out, f"did you mean {known!r}" in err) == (BAD_INPUT, "", True), err


@EVERY
def test_no_output_takes_the_place_of_an_input(tmp_path, name, parser):
    """Whatever is read, by whatever is written: the gate refuses before the command begins."""
    part = {each: [a for a in parser._actions if isinstance(a.type, Kind) and a.type.part == each]
            for each in ("read", "named", "written")}  # fmt: skip
    assert all(a.type.endings for a in part["written"])
    for source in part["read"] + part["named"]:
        for target in part["written"]:
            path = tmp_path / f"p{target.type.endings[0]}"
            path.write_bytes(b"old")
            other = str(path) if source in part["named"] else path
            values = {a.dest: None for a in parser._actions} | {target.dest: path}
            many = source.nargs in ("+", "*") or isinstance(source, argparse._AppendAction)
            options = argparse.Namespace(**values | {source.dest: [other] if many else other})
            if source in part["named"] and path.suffix in (".html", ".png"):
                continue  # a name of no file
            with pytest.raises(ValueError, match=r"is an input|is named twice"), passed(parser, options):
                pass
            assert path.read_bytes() == b"old"


def test_help_is_quick():
    """It imports neither torch nor numpy, of any command, and parses no more sources than it must."""
    code = f"""
import sys
import warnings
from torchliner.cli.main import main
for command in {list(COMMANDS)}:
    try: main([command, "--help-all"])
    except SystemExit: pass
print([m for m in ("torch", "numpy", "h5py", "scipy") if m in sys.modules])
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "[]"


JSON = {
    "educe y2.5mm.h5 --frequency 1000 1400 --drive rms": lambda plane, liner: tl.educe(
        plane, liner, [1000.0, 1400.0], drive="rms"
    ).answer,
    "educe y2.5mm.h5 --averaging velocity --phase given --reference-phase 0.5 --mean removed --no-intervals": (
        lambda plane, liner: tl.educe(
            plane, liner, averaging="velocity", phase="given", reference_phase=0.5, mean="removed", interval=None
        ).answer
    ),
    "replay y2.5mm.h5 --incident noise:300:3500 --levels 50": lambda plane, liner: tl.replay(
        plane, liner, "noise:300:3500", levels=50
    ).answer,
    "compare-models y2.5mm.h5 --liner polito --liner onera": lambda plane, liner: [
        row.impedance for row in tl.compare_models(plane, {"polito": liner, "onera": tl.load_liner("onera")}).rows
    ],
    "liner polito --frequency 900:1100:100 --speed 2": lambda plane, liner: [
        complex(liner.impedance(f, 2.0)) for f in (900.0, 1000.0, 1100.0)],
}  # fmt: skip


def impedances(value):
    """Every complex number in a JSON."""
    if isinstance(value, dict) and {*value} >= {"resistance", "reactance"}:
        if None not in (value["resistance"], value["reactance"]):
            yield complex(value["resistance"], value["reactance"])
    elif isinstance(value, (dict, list)):
        for each in value.values() if isinstance(value, dict) else value:
            yield from impedances(each)


@pytest.mark.parametrize("words", JSON)
def test_json_is_the_result_of_python(capsys, small, monkeypatch, words):
    """JSON alone on standard output, with the values of the call in Python to the last bit."""
    monkeypatch.chdir(small)
    code, out, _ = run(capsys, *words.split(), "--json", "--quiet")
    assert code == DONE
    known = set(impedances(json.loads(out)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wanted = JSON[words](tl.read_plane(small / "y2.5mm.h5"), tl.load_liner("polito"))
    wanted = np.ravel(np.asarray(wanted)).tolist()
    assert wanted
    assert set(wanted) <= known


@pytest.mark.parametrize("columns", ["80", "100"])
def test_overview_fits(capsys, monkeypatch, columns):
    """Every command, by group, with two examples, which parse; `torchliner` alone asks for it."""
    monkeypatch.setenv("COLUMNS", columns)
    code, out, _ = run(capsys, "--help")
    assert code == DONE
    assert run(capsys) == run(capsys, "help") == (DONE, out, "")
    assert all(f"\n{title}:\n" in out for title in GROUPS)
    assert all(re.search(rf"^  {name} +{re.escape(text)}$", out, re.M) for name, text in COMMANDS.items())
    for words in re.findall(r"^  torchliner (.*)$", out, re.M):
        assert build_parser()[0].parse_known_args(words.split())[1] == []
    assert max(map(len, out.splitlines())) <= 80


def test_help_takes_a_command(capsys):
    """As --help after it; of a slip the nearest command."""
    assert run(capsys, "help", "duct", "modes") == run(capsys, "duct", "modes", "--help")
    code, _, err = run(capsys, "help", "edcue")
    assert code == BAD_INPUT
    assert "did you mean 'educe'?" in err


@pytest.mark.parametrize(
    ("home", "taken"),
    [
        ("velocity.choices:Choices", Choices),
        ("velocity.replay:replay", tl.replay),
        ("io.planes:read_plane", tl.read_plane),
        ("pressure.kumaresan_tufts:kumaresan_tufts", tl.kumaresan_tufts),
    ],
)
def test_options_are_read_as_python_has_them(home, taken):
    """Names, defaults and a text of each parameter, from the source alone."""
    found, known = parameters(home), signature(taken).parameters
    named = [name for name, each in known.items() if each.kind is not each.VAR_KEYWORD and name != "_"]
    assert set(found) >= set(named) - {"choices"}
    for name, one in found.items():
        assert one.text, name
        default = known[name].default if name in known else vars(Choices())[name]
        assert one.default is None or one.default == default


def test_completion_knows_commands_tasks_choices_and_files(capsys, tmp_path):
    """As bash completes with the script that is printed."""
    pytest.importorskip("shtab")
    code, script, _ = run(capsys, "--print-completion", "bash")
    assert code == DONE
    (tmp_path / "complete.bash").write_text(script)
    (tmp_path / "plane.h5").touch()
    for words, wanted in {
        "ed": "educe", "educe --phas": "--phase", "educe --mea": "--mean", "ldv ": "educe",
        "educe --phase self": "self-consistent", "educe pla": "plane.h5", "help-a": "",
    }.items():  # fmt: skip
        line = ["torchliner", *words.split(" ")]
        call = f"""source complete.bash
        COMP_WORDS=({" ".join(f'"{word}"' for word in line)}); COMP_CWORD={len(line) - 1}
        _shtab_torchliner torchliner "{line[-1]}" "{line[-2]}"; echo "${{COMPREPLY[@]}}" """
        found = subprocess.run(["bash", "-c", call], capture_output=True, text=True, cwd=tmp_path, check=True).stdout
        assert wanted in found.split() if wanted else found.split() == [], words


def test_completion_without_shtab_says_what_to_install(capsys, monkeypatch):
    """Exit code 2."""
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, _, err = run(capsys, "--print-completion", "zsh")
    assert code == BAD_INPUT
    assert 'pip install "torchliner[completion]"' in err


MISTAKES = [
    (["educ"], "did you mean 'educe'"),
    (["educe", SLIT, "--frequncy", "1400"], "--frequncy (did you mean '--frequency'?)"),
    (["educe", SLIT, "--phase", "avraged"], "did you mean 'averaged'"),
    (["educe", SLIT, "--liner", "lbm_slot"], "unknown liner 'lbm_slot' (did you mean 'lbm_slit'?)"),
    (["educe", "nothing.h5"], "nothing.h5: no such file"),
    (["educe", CHANNEL], "names 'hard wall', which is no preset; choose a model with --liner"),
    (["educe", SLIT, "--frequency", "60000"], "at or above Nyquist"),
    (["educe", SLIT, "-o", "no/such/folder/map.h5"], "the folder no/such/folder does not exist"),
    (["educe", SLIT, "--device", "cuda:7"], "cuda"),
    (["info", str(DATA / "SHA256SUMS")], "is of no format of planes that is known"),
    (["info", str(DATA)], "is a folder"),
    (["liner", "polyto"], "did you mean 'polito'"),
    (["validate", CHANNEL, "--liner", "polito"], "states no"),
]


@pytest.mark.parametrize(("words", "message"), MISTAKES, ids=[" ".join(w[:3]) for w, _ in MISTAKES])
def test_mistakes_exit_with_2_and_one_clear_line(capsys, words, message):
    """No traceback: what is wrong, and the remedy."""
    code, out, err = run(capsys, *words)
    assert code == BAD_INPUT
    assert message in err
    assert "Traceback" not in err
    assert out == ""


def test_educe_prints_writes_and_draws(capsys, tmp_path):
    """Table with all averagings and the reference; map, pictures and their numbers."""
    map_file = tmp_path / "map.h5"
    code, out, err = run(capsys, "educe", SLIT, "-o", str(map_file), "--figure", str(tmp_path / "f"))
    assert code == DONE
    assert err.count("warning:") == err.count("the error bars rest on 4.2 independent blocks") == 1
    assert "0.174-0.063j" in out
    assert "true: 0.168-0.066j" in out
    assert "phase averaged" in out
    found = tl.read_map(map_file)
    assert abs(complex(found.liner["velocity"].impedance[0]) - (0.174 - 0.063j)) < 1e-3
    made = {p.name for p in (tmp_path / "f").iterdir()}
    assert {"along_x.png", "velocity.png", "along_x_slit_n130_y2.5mm.csv"} <= made
    rows = list(csv.DictReader((tmp_path / "f" / "along_x_slit_n130_y2.5mm.csv").read_text().splitlines()))
    assert len(rows) == found.impedance.shape[0]
    assert float(rows[3]["resistance"]) == pytest.approx(float(found.resistance[3, 0]), rel=1e-6)


def test_several_planes_are_several_heights(capsys, tmp_path, small):
    """One row and one map a plane, and the picture against height."""
    planes = [str(small / f"y{y}mm.h5") for y in ("2.5", "0.5")]
    code, out, _ = run(capsys, "educe", *planes, "-o", str(tmp_path / "m.csv"),
                       "--figure", str(tmp_path), "--quiet")  # fmt: skip
    assert code == DONE
    assert [line.split()[0] for line in out.splitlines()[1:3]] == ["0.50", "2.50"]
    assert (tmp_path / "m_y0.5mm.csv").exists()
    assert (tmp_path / "height.png").stat().st_size > 5000


def test_null_test_is_labelled(capsys):
    """A hard wall under the data is said in the output."""
    code, out, err = run(capsys, "educe", CHANNEL, "--liner", "polito", "--frequency", "1400")
    assert code == DONE
    assert "NULL TEST" in out
    assert "warning: null test" in err
    assert "warning:" in err


def test_liner_prints_geometry_and_draws(capsys, tmp_path):
    """Geometry, resonance, table; figure 3; a preset to edit."""
    figure, copy = tmp_path / "liner.png", tmp_path / "mine.toml"
    code, out, _ = run(capsys, "liner", "onera", "--figure", str(figure), "--copy", str(copy))
    assert code == DONE
    assert "1489.74" in out
    assert "0.000991 m" in out
    assert figure.stat().st_size > 5000
    assert tl.load_liner(copy).impedance(1500.0) == tl.load_liner("onera").impedance(1500.0)
    code, _, err = run(capsys, "liner", "onera", "--copy", str(copy))
    assert (code, "not overwritten" in err) == (BAD_INPUT, True)
    code, out, _ = run(capsys, "liner")
    assert "lbm_slit" in out
    both = tmp_path / "both.png"
    code, out, _ = run(capsys, "liner", "onera", "polito", "--figure", str(both))
    assert (code, out.count("resonance_hz"), both.exists()) == (DONE, 2, True)
    code, out, _ = run(capsys, "liner", "polito_as_printed", "--json")
    assert json.loads(out)["liner"]["resonance_hz"] == pytest.approx(1409.0, abs=0.01)


def test_info_describes_and_checks(capsys, tmp_path):
    """Sizes, v0, v', u', spectrum peak, alignment; exit 1 if a check fails."""
    code, out, _ = run(capsys, "info", CHANNEL, "--figure", str(tmp_path / "v.png"))
    assert code == DONE
    for text in ("15x80", "93632", "v0 mean", "u' rms", "|v0| over bulk velocity", "all checks"):
        assert text in out
    code, out, _ = run(capsys, "info", str(DATA / "channel_tone_y1.04mm.h5"), "--json")
    assert json.loads(out)["facts"]["spectrum peak of v (Hz)"] == pytest.approx(1400, abs=70)
    v = np.full((2, 300), 9.0, np.float32)
    v[1] += np.random.default_rng(0).normal(size=300)
    v[1, 7] = np.nan
    bad = tmp_path / "bad.h5"
    tl.VelocityPlane(v, sampling_rate=5e4, mach=0.3, frequency=1400.0).write(bad)
    code, out, _ = run(capsys, "info", str(bad))
    assert code == CHECK_FAILED
    assert "1 nan or inf at 1 of 2 probes, the first at probe 1, sample 7" in out
    assert "1 of 2 probes are constant" in out
    assert "misaligned" in out


def test_convert_array_and_scale(capsys, tmp_path):
    """An array with stated axes and units; time scales by length over velocity."""
    v = np.random.default_rng(1).normal(size=(200, 3, 4)).astype(np.float32)
    np.save(tmp_path / "v.npy", v)
    np.save(tmp_path / "x.npy", np.arange(4) * 1.0)
    out = tmp_path / "plane.h5"
    code, text, _ = run(
        capsys, "convert", str(tmp_path / "v.npy"), "--axes", "time,z,x",
        "--velocity-units", "mm/s", "--sampling-rate", "50000",
        "--x", str(tmp_path / "x.npy"), "--length-units", "mm",
        "--height", "1e-3", "--normal=-y", "--scale-length", "2", "--scale-velocity", "4",
        "-o", str(out),
    )  # fmt: skip
    assert code == DONE
    assert "3x4 probes, 200 samples at 100000 Hz" in text
    plane = tl.read_plane(out)
    assert np.allclose(plane.velocity.numpy(), -4e-3 * np.moveaxis(v, 0, -1), atol=1e-8)
    assert plane.x.tolist() == pytest.approx([0, 0.002, 0.004, 0.006])
    assert plane.height == pytest.approx(1e-3)  # of the plane as written


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ("velocity.educe.educe", ["educe", SLIT]),
        ("duct.solver.DuctSolver.solve", ["duct", "solve", "b2a", "--profile", "uniform"]),
    ],
)
def test_an_interrupt_is_quiet_and_exits_with_130(capsys, monkeypatch, where, words):
    """Ctrl-C in the middle: one line, no traceback."""

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"torchliner.{where}", stop)
    code, _, err = run(capsys, *words)
    assert code == INTERRUPTED
    assert err.strip().endswith("interrupted")


def test_truth_table(capsys, tmp_path, small):
    """Every drive x phase x averaging, as text, CSV and JSON, with the reference beside."""
    target = tmp_path / "truth.csv"
    code, out, _ = run(capsys, "validate", str(small / "y0.5mm.h5"), "-o", str(target))
    assert code == DONE
    assert "case small: reference Z = 0.200-0.100j" in out
    rows = list(csv.DictReader((target).read_text().splitlines()))
    assert len(rows) == 4 * 3 * 3
    for row in rows:
        educed, true = (
            complex(float(row[f"{name}_resistance"]), float(row[f"{name}_reactance"])) for name in ("educed", "true")
        )
        error = abs(educed - true)
        assert float(row["error"]) == pytest.approx(error)


def test_the_module_is_the_same_program():
    """`python -m torchliner`, with its exit code."""
    found = subprocess.run([sys.executable, "-m", "torchliner", "inf"], capture_output=True, text=True)
    assert (found.returncode, "did you mean 'info'" in found.stderr) == (BAD_INPUT, True)


def test_nothing_is_overwritten(capsys, tmp_path, small):
    """Neither an input nor one map by another."""
    one, other = tmp_path / "a" / "p.h5", tmp_path / "b" / "p.h5"
    for path in (one, other):
        path.parent.mkdir()
        path.write_bytes((small / "y0.5mm.h5").read_bytes())
    code, _, err = run(capsys, "educe", str(one), "-o", str(one))
    assert (code, "is an input" in err) == (BAD_INPUT, True)
    code, _, err = run(capsys, "educe", str(one), str(other), "-o", str(tmp_path / "m.h5"))
    assert (code, "share one map file" in err) == (BAD_INPUT, True)
    tl.read_plane(one)


def test_a_file_held_open_with_locks_can_be_read(tmp_path):
    """HDF5 wants equal locking flags within a process."""
    held = tmp_path / "held.h5"
    held.write_bytes((DATA / "slit_n130_y2.5mm.h5").read_bytes())
    with h5py.File(held, "r"):
        assert tl.read_plane(held).samples > 0


def test_incident_signals_from_the_command_line(capsys, tmp_path, small):
    """A generated signal, the same as a .npy file; as the call in Python; ranges of frequencies."""
    path, y = str(small / "y0.5mm.h5"), tmp_path / "y.h5"
    noise = ["--incident", "noise:300:3500", "--json", "--quiet"]
    code, out, _ = run(capsys, "replay", path, *noise, "--reflected", str(y))
    assert code == DONE
    (result,) = json.loads(out)
    assert len(result["rows"]) == 3500 * 900 // 42000 - 300 * 900 // 42000  # lines of 0.0214 s
    assert y.exists()
    plane = tl.read_plane(path)
    python = tl.replay(plane, tl.load_liner("polito"), "noise:300:3500")
    assert [row["frequency"] for row in result["rows"]] == python.frequency.tolist()
    values = tl.BandNoise(300, 3500).sampled(plane.samples, plane.sampling_rate)
    np.save(tmp_path / "s.npy", values.numpy())
    same = ["--incident", str(tmp_path / "s.npy"), "--incident-rate", repr(plane.sampling_rate)]
    frequencies = [str(row["frequency"]) for row in result["rows"][3:6]]
    code, out, _ = run(capsys, "replay", path, *same, "--json", "--quiet", "--frequency", *frequencies)
    assert code == DONE
    (again,) = json.loads(out)
    assert [row["frequency"] for row in again["rows"]] == [float(f) for f in frequencies]
    code, out, _ = run(capsys, "educe", path, "--frequency", "500:1500:250", "900", "--json",
                       "--quiet")  # fmt: skip
    found = [row["frequency"] for row in json.loads(out)[0]["rows"]]
    assert found == [500.0, 750.0, 1000.0, 1250.0, 1500.0, 900.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["replay", "--incident", "noise:300:60000"], "Nyquist"),
        (["replay", "--incident", "nois:300:6000"], "nois:300:6000: no such file"),
        (["replay", "--incident", "missing.wav"], r"missing\.wav: no such file"),
        (["replay", "--incident", "noise:300"], "cannot be read"),
        (["replay", "--reflected", "y.h5"], "complex tones have no one signal"),
        (["replay", "--incident", "noise:300:3500", "--reflected", SLIT], "is an input"),
        (["replay", "--incident", "noise:300:3500", "--reflected", "a.h5", "-o", "./a.h5"], "another output"),
        (["replay", "--incident-rate", "100"], "--incident-rate is the rate of an --incident file"),
        (["replay", "--incident", "tones:500", "--incident-rate", "100"], "rate of an --incident file"),
        (["replay", "--incident", ""], "has no name"),
        (["replay", "--incident", "sweep:300"], "cannot be read .*write tones:500,900, sweep:300:6000"),
        (["replay", "--averaging", "phase-locked"], "invalid choice"),
        (["educe", "--frequency", "1:1e9:1e-6"], "LOW:HIGH:STEP"),
        (["educe", "--frequency", "500:100:10"], "'500:100:10' cannot be read"),
        (["educe", "--no-intervals", "--interval", "0.9"], "--no-intervals leaves out what --interval is"),
    ],
)
def test_signals_and_limits_that_cannot_be(capsys, options, message):
    """Exit code 2 and one clear line."""
    code, _, err = run(capsys, options[0], SLIT, *options[1:])
    assert code == BAD_INPUT
    assert re.search(message, err)


def test_files_of_two_planes_or_frequencies_are_told_apart(capsys, tmp_path, small, unrendered):
    """Planes called alike, and frequencies alike in six digits: one took the place of the other."""
    planes = [tmp_path / name / "p.h5" for name in ("low", "high")]
    for height, path in zip(("0.5", "2.5"), planes, strict=True):
        path.parent.mkdir()
        path.write_bytes((small / f"y{height}mm.h5").read_bytes())
    words = ["--frequency", "1400:1401:1", "1400", "1400.0001", "--quiet", "--no-intervals"]
    code, out, _ = run(capsys, "educe", *map(str, planes), *words, "--figure", str(tmp_path / "f"))
    assert (code, out.count("1400.0 "), out.count("1401.0 ")) == (DONE, 4, 2)
    made = {path.name for path in (tmp_path / "f").iterdir()}
    assert {"velocity_low_p.csv", "velocity_high_p.csv", "along_x_low_p_1400Hz.csv"} <= made
    assert "along_x_high_p_1400.0001Hz.csv" in made
    code, _, _ = run(capsys, "educe", str(planes[0]), *words, "-o", str(tmp_path / "m.vtkhdf"))
    with h5py.File(tmp_path / "m.vtkhdf") as file:
        fields = file["VTKHDF/PointData"]
        names = {f"resistance_{f}Hz" for f in ("1400", "1401", "1400.0001")}
        assert names <= set(fields)
        assert fields["resistance_1400Hz"].size == 8
