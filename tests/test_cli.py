"""The commands as a user meets them: one contract for all, then what each prints, writes and draws."""

import argparse
import csv
import json
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl
from torchliner.cli.gate import passed
from torchliner.cli.main import BAD_INPUT, CHECK_FAILED, COMMANDS, DONE, INTERRUPTED, main
from torchliner.cli.options import Kind, Parser
from torchliner.duct.presets import duct_names
from torchliner.io.result_writers import plain_multipole
from torchliner.studies.heights import study_heights

SLIT = str(DATA / "slit_n130_y2.5mm.h5")
PRESSURE = DATA / "pressure_n130.h5"
CHANNEL = str(DATA / "channel_y1.04mm.h5")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Two heights of a case, few probes and 0.02 s; moments, maps and microphones."""
    folder = tmp_path_factory.mktemp("small")
    tone = 4 * torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(900))
    liner = tl.load_liner("polito")
    for height, rate in ((0.5, RATE), (2.5, 1.3 * RATE)):
        places = {"x": torch.arange(4) * 1e-3, "z": torch.arange(2) * 1e-3, "height": 1e-3 * height}
        about = {"liner": "polito", "reference": {"true": 0.2 - 0.1j}, "provenance": {"case": "small"}}
        v = turbulence((2, 4, 900), seed=int(height)) + tone
        plane = plane_of(v, sampling_rate=rate, **places, **about)
        plane.write(folder / f"y{height}mm.h5")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tl.moments(plane, cell_pitch=liner.cell_pitch).write(folder / f"moments_{height}.h5")
            tl.educe(plane, liner, [800.0, 1200.0, 1600.0, 2000.0]).write(folder / f"map_{height}.h5")
    return folder


def run(capsys, *words: str) -> tuple[int, str, str]:
    try:
        code = main(list(words))
    except SystemExit as stop:
        code = int(stop.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


EVERY = pytest.mark.parametrize(("name", "command"), COMMANDS.items(), ids=COMMANDS)


@EVERY
def test_help_is_complete_and_slips_are_answered(capsys, name, command):
    """--help names every option with a text; a slip gets the nearest option, a missing file one line and code 2."""
    code, out, _ = run(capsys, *name.split(), "--help")
    assert (code, f"{command.summary}." in out) == (DONE, True)
    options = Parser(name, command).options
    for each in options:
        assert each.text
        assert each.flag[:1] != "-" or re.search(rf"^  (-\w( [A-Z]+)?, )?{re.escape(each.flag)}\b", out, re.M), each
    needed = []  # with all that must be given, so that the slip is the only mistake
    for each in options:
        if each.required:
            needed += [each.flag, "1"]
        elif each.flag[:1] != "-" and each.nargs != "?":
            needed = ["nothing", *needed]
    known = max((each.flag for each in options if each.flag[:1] == "-"), key=len)
    code, out, err = run(capsys, *name.split(), *needed, f"{known[:-2]}{known[-1]}")
    assert (code, out, f"did you mean {known!r}" in err) == (BAD_INPUT, "", True), err
    if any(isinstance(each.kind, Kind) and each.kind.part == "read" for each in options if each.flag[:1] != "-"):
        code, out, err = run(capsys, *name.split(), *needed)
        assert (code, out, err) == (BAD_INPUT, "", f"torchliner {name}: nothing: no such file\n")


@EVERY
def test_no_output_takes_the_place_of_an_input(tmp_path, name, command):
    options = [each for each in Parser(name, command).options if isinstance(each.kind, Kind)]
    for source in (each for each in options if each.kind.part in ("read", "named")):
        for target in (each for each in options if each.kind.part in ("written", "drawn")):
            path = tmp_path / f"p{target.kind.endings[0]}"
            path.write_bytes(b"old")
            if source.kind.part == "named" and path.suffix in (".html", ".png"):
                continue  # a name of no file
            other = str(path) if source.kind.part == "named" else path
            words = {target.dest: path, source.dest: [other] if source.many or source.nargs == "+" else other}
            with pytest.raises(ValueError, match=r"is an input|is named twice"):
                passed(name, options, argparse.Namespace(**words)).__enter__()
            assert path.read_bytes() == b"old"


def test_help_is_quick():
    code = f"""
import sys
from torchliner.cli.main import main
main([])
for command in {list(COMMANDS)}:
    try: main([*command.split(), "--help"])
    except SystemExit: pass
print([m for m in ("torch", "numpy", "h5py", "scipy") if m in sys.modules])
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "[]"


def quiet(call, *arguments, **choices):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return call(*arguments, **choices)


GIVEN = {"phase": "given", "reference_phase": 0.5}
JSON = {  # words, and the same in Python: of the plane at 2.5 mm and of its liner
    "educe y2.5mm.h5 --frequency 1000 1400 --drive rms": lambda p, n: tl.educe(p, n, [1e3, 1400.0], drive="rms").answer,
    "educe y2.5mm.h5 --averaging velocity --phase given --reference-phase 0.5 --mean removed --interval none": (
        lambda p, n: tl.educe(p, n, averaging="velocity", mean="removed", interval=None, **GIVEN).answer
    ),
    "replay y2.5mm.h5 --incident noise:300:3500 --levels 50": lambda p, n: (
        tl.replay(p, n, "noise:300:3500", levels=50).answer
    ),
    "educe y2.5mm.h5 --stop 0.01": lambda p, n: tl.educe(tl.read_plane("y2.5mm.h5", stop=0.01), n).answer,
    "audit y2.5mm.h5": lambda p, n: tl.audit(p, n).rows[0].impedance,
    "audit y2.5mm.h5 --background 3": lambda p, n: tl.audit(p, n, background=3.0).rows[0].impedance,
    "height y0.5mm.h5 y2.5mm.h5": lambda p, n: [
        row.impedance["velocity"] for row in study_heights([tl.read_plane("y0.5mm.h5"), p], n).rows
    ],
    "compare map_0.5.h5 map_2.5.h5 --averaging velocity": lambda p, n: [
        row.difference for row in tl.compare(tl.read_map("map_0.5.h5"), tl.read_map("map_2.5.h5"), "velocity").rows
    ],
    "compare-models y2.5mm.h5 --liner polito --liner onera": lambda p, n: [
        row.impedance for row in tl.compare_models(p, {"polito": n, "onera": tl.load_liner("onera")}).rows
    ],
    "sensitivity y2.5mm.h5 --parameters porosity": lambda p, n: (
        tl.sensitivities(p, n, None, ["porosity"]).found.liner["velocity"].impedance
    ),
    "sensitivity y2.5mm.h5 --tolerance orifice_diameter=2e-5 --tolerance porosity=0.001": lambda p, n: tl.sensitivities(
        p, n, tolerances={"orifice_diameter": 2e-5, "porosity": 0.001}
    ).combined["velocity"],
    "calibrate y2.5mm.h5 --free porosity=0.01:0.2": lambda p, n: tl.calibrate(
        p, n, "true", {"porosity": (0.01, 0.2)}
    ).numbers["porosity"],
    "liner polito --frequency 900:1100:100 --speed 2": lambda p, n: [
        complex(n.impedance(f, 2.0)) for f in (900.0, 1000.0, 1100.0)
    ],
    "ir-tdibc polito --level 120 --frequency 1400 --duration 0.02": lambda p, n: (
        tl.ir_tdibc(n, [120.0], [1400.0], duration=0.02).rms_speed
    ),
    "export map_2.5.h5 --poles 2": lambda p, n: plain_multipole(tl.read_map("map_2.5.h5").time_domain(2))["reflection"][
        "complex_poles"
    ],
    f"insitu {DATA / 'pressure_n130.h5'}": lambda p, n: tl.in_situ(tl.read_pressure(DATA / "pressure_n130.h5")).answer,
    "duct modes b2a --frequency 1400": lambda p, n: (
        tl.duct_modes(
            (setup := tl.load_duct("b2a", frequency=[1400.0])).case.profile,
            setup.frequency,
            setup.impedance[..., 0],
            direction="downstream",
            count=4,
            slip_condition=setup.case.slip_condition,
        ).wavenumber.real
    ),
    "liner": lambda p, n: tl.preset_names(),
    "duct solve": lambda p, n: duct_names(),
}


def values(found):
    """Every number and text in a JSON; complex numbers are put together."""
    if isinstance(found, dict) and isinstance(found.get("resistance"), float):
        yield complex(found["resistance"], found["reactance"])
    if isinstance(found, (dict, list)):
        for each in found.values() if isinstance(found, dict) else found:
            yield from values(each)
    else:
        yield found


@pytest.mark.parametrize("words", JSON)
def test_json_is_the_result_of_python(capsys, small, monkeypatch, words):
    """JSON alone on standard output, with the values of the call in Python to the last bit."""
    monkeypatch.chdir(small)
    code, out, err = run(capsys, *words.split(), "--json", "--quiet")
    assert code in (DONE, CHECK_FAILED), err
    known = set(values(json.loads(out)))
    wanted = quiet(JSON[words], tl.read_plane("y2.5mm.h5"), tl.load_liner("polito"))
    wanted = np.ravel(np.asarray(wanted)).tolist()
    assert wanted
    assert set(wanted) <= known


REFUSED = [  # words, and what the one line names
    ("educ", "'educe'"),
    ("duct", "duct solve, duct modes"),
    (f"educe {SLIT} --liner lbm_slot", "'lbm_slit'"),
    (f"educe {CHANNEL}", "'hard wall'.* --liner"),
    (f"educe {SLIT} --frequency 1:1e9:1e-6", "LOW:HIGH:STEP"),
    (f"educe {SLIT} --frequency 500:100:10", "'500:100:10'"),
    (f"educe {SLIT} --device cuda:7", "cuda"),
    (f"info {DATA / 'SHA256SUMS'}", "of no format"),
    (f"replay {SLIT} --segment nan", "'nan'"),
    (f"replay {SLIT} --incident missing.wav", r"missing\.wav: no such file"),
    (f"replay {SLIT} --incident sweep:300", "tones:500,900, sweep:300:6000"),
    (f"replay {SLIT} --reflected y.h5", "complex tones"),
    (f"replay {SLIT} --incident noise:300:3500 --reflected a.h5 -o ./a.h5", "another output"),
    ("duct modes", "required"),
    ("duct modes b2a --liner polito --impedance 1", "--impedance and --liner"),
    ("duct solve b2", "unknown duct 'b2'"),
    ("duct solve b2a --mesh 0", r"mesh column \(m\) is 0"),
    (f"insitu {SLIT}", "torchliner pressure 1"),
    (f"insitu {PRESSURE} --microphones 0 9", "microphones 0 to 4, not 9"),
    (f"educe {SLIT} --in-situ {DATA}/pressure_n115.h5", r"not one case: incident_level is 130\.0 and 115\.0"),
    ("ir-tdibc polito --level 120", "--frequency"),
    (f"sensitivity {SLIT} --tolerance porosity", "NAME=X"),
    (f"calibrate {SLIT} --free porosity=1", r"NAME\[=LOW:HIGH\]"),
    (f"height {DATA}/slit_g03_145_y0.5mm.h5 {DATA}/orifice_o145_y1.0mm.h5", "liners, lbm_orifice, lbm_slit"),
    ("reduce moments_0.5.h5 -o m.h5", "the plane that was reduced"),
    ("reduce y0.5mm.h5", "required"),
    ("reduce y0.5mm.h5 -o m.h5 --liner polito --cell-pitch 0.01", "only where no liner is given"),
    ("educe moments_0.5.h5 --liner lbm_slit", "0.01244 m"),
    ("educe moments_0.5.h5 --phase self-consistent", "phase='averaged'"),
    ("educe moments_0.5.h5 --start 0.01", "--start"),
    ("replay moments_0.5.h5", "samples, which are gone"),
]


@pytest.mark.parametrize(("words", "message"), REFUSED, ids=[words[:50] for words, _ in REFUSED])
def test_mistakes_exit_with_2_and_one_clear_line(capsys, small, monkeypatch, words, message):
    monkeypatch.chdir(small)
    before = set(small.iterdir())
    code, out, err = run(capsys, *words.split())
    assert (code, out, "Traceback" in err) == (BAD_INPUT, "", False)
    assert re.search(message, err), err
    assert set(small.iterdir()) == before


def test_educe_prints_writes_and_draws(capsys, tmp_path):
    folder = tmp_path / "new"
    code, out, err = run(capsys, "educe", SLIT, "-o", str(folder), "--figure", str(folder))
    assert code == DONE
    assert err.count("warning") == err.count("the error bars rest on 4.2 independent blocks") == 1
    assert "0.177-0.063j" in out
    found = tl.read_map(folder / "educe.h5")
    assert abs(complex(found.liner["velocity"].impedance[0]) - (0.174 - 0.063j)) < 1e-3
    made = {p.name for p in folder.iterdir()}
    assert {"along_x.png", "velocity.png", "along_x.csv"} <= made
    rows = list(csv.DictReader((folder / "along_x.csv").read_text().splitlines()))
    assert len(rows) == found.impedance.shape[0]
    assert float(rows[3]["resistance"]) == pytest.approx(float(found.impedance[3, 0].real), rel=1e-6)


def test_liner_prints_geometry_and_draws(capsys, tmp_path):
    figure, copy = tmp_path / "liner.png", tmp_path / "mine.toml"
    code, out, _ = run(capsys, "liner", "onera", "--figure", str(figure), "--copy", str(copy))
    assert code == DONE
    assert "1489.74" in out
    assert "0.000991" in out
    assert figure.stat().st_size > 5000
    assert tl.load_liner(copy).impedance(1500.0) == tl.load_liner("onera").impedance(1500.0)
    code, _, err = run(capsys, "liner", "onera", "--copy", str(copy))
    assert (code, "not overwritten" in err) == (BAD_INPUT, True)


def test_info_describes_and_checks(capsys, tmp_path):
    code, out, _ = run(capsys, "info", CHANNEL)
    assert code == DONE
    for text in ("15x80", "93632", "v0 mean", "|v0| over bulk velocity", "all checks"):
        assert text in out
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


OF_MOMENTS = "educe, educe --averaging velocity --interval none, educe --incident-level 131, sensitivity"


@pytest.mark.parametrize("words", [*OF_MOMENTS.split(", "), "calibrate --free porosity"])
def test_moments_stand_for_a_plane(capsys, small, words):
    """The answer of each command, from moments of any liner: as from the plane, to their error."""
    command, *options = words.split()
    found = []
    for name in ("y0.5mm.h5", "moments_0.5.h5"):
        code, out, _ = run(capsys, command, f"{small}/{name}", *options, "--quiet", "--json")
        assert code in (DONE, CHECK_FAILED)
        found.append([each for each in values(json.loads(out)) if isinstance(each, complex)])
    assert len(found[0]) == len(found[1]) > 0
    assert found[1] == pytest.approx(found[0], rel=1e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ("educe", ["educe", SLIT]),
        ("io.moments_file.fill", ["reduce", SLIT, "-o", "m.h5"]),
        ("duct.solver.DuctSolver.solve", ["duct", "solve", "b2a", "--profile", "uniform"]),
    ],
)
def test_an_interrupt_is_quiet_and_exits_with_130(capsys, tmp_path, monkeypatch, where, words):

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(f"torchliner.{where}", stop)
    code, _, err = run(capsys, *words)
    assert (code, err.splitlines()[-1], list(tmp_path.iterdir())) == (INTERRUPTED, "torchliner: interrupted", [])
