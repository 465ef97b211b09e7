"""Mutated files and options: an error that names the file, or the clean answer (see fuzzing.py).

2000 inputs; ``TORCHLINER_FUZZ=20000`` in the environment takes so many. Seeded: the same inputs in
every run.
"""

import dataclasses
import json
import os
import random
from pathlib import Path

import fuzzing
import h5py
import numpy as np
import pytest
import torch
from conftest import DATA, plane_of, turbulence
from fuzzing import Case, Outcome, call, command
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.io import wavfile
from test_burst_files import write_burst_csv
from test_liner_files import table_rows
from test_stations import station
from test_wall_pressure import both_ways, line_of

import torchliner as tl
from torchliner.cli.options import Parser
from torchliner.cli.table import COMMANDS as TABLE
from torchliner.duct.presets import duct_text
from torchliner.io.microphone_file import STATED

pytestmark = pytest.mark.slow
INPUTS = int(os.environ.get("TORCHLINER_FUZZ", "2000"))
RATE = ["--velocity-units", "m/s", "--sampling-rate", "42000"]


def plain(value):
    """A record as lists and numbers."""
    if isinstance(value, torch.Tensor):
        parts = torch.view_as_real(value.resolve_conj()) if value.is_complex() else value
        return parts.tolist()
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [*map(plain, value)]
    return [value.real, value.imag] if isinstance(value, complex) else value


def reader(read, path):
    """A reader of Python as if it were a command."""

    def work():
        try:
            return Outcome(0, plain(read(path)))
        except (ValueError, TypeError, OSError) as error:
            return Outcome(2, said=str(error))

    return lambda: call(work)


def written(path):
    """The velocity in a file that convert wrote."""
    with h5py.File(path) as file:
        return file["wall_normal_velocity"][()].tolist()


def plane_file(path: Path, tone: float = 0.0) -> Path:
    """``tone``: amplitude at 1400 Hz, m/s."""
    about = {"x": torch.arange(4) * 1e-3, "liner": "polito", "height": 1e-3, "mach": 0.12, "incident_level": 130.0}
    about |= {"reference": {"true": 0.2 - 0.1j}, "source_side": "upstream", "title": "fuzz"}
    v = turbulence((4, 260)) + tone * torch.cos(2 * torch.pi * 1400 / 42000 * torch.arange(260))
    plane_of(v, **about).write(path)
    return path


def write_microphone_csv(line, path):
    """As a laboratory writes it: what is stated, then a header, then a row each microphone and frequency."""
    known = {name: getattr(line, name, getattr(line.fluid, name, None)) for name in STATED}
    about = {name: f"{value!r} {STATED[name]}" for name, value in known.items() if isinstance(value, float)}
    about |= {name: value for name, value in known.items() if isinstance(value, str) and value}
    text = [f"# {name} = {value}" for name, value in about.items()] + ["x [m],frequency [Hz],SPL [dB],phase [deg]"]
    for n, x in enumerate(line.x.tolist()):
        for i, f in enumerate(line.frequency.tolist()):
            text.append(",".join(map(repr, (x, f, float(line.level[n, i]), float(line.phase[n, i])))))
    path.write_text("\n".join(text))


def convert(path, folder):
    out = folder / "out.h5"
    words = ["convert", str(path), "-o", str(out), "--axes", "time,x", *RATE, "--json", "--quiet"]
    return lambda: command(words, lambda: written(out))


def wall_line():
    return line_of(both_ways("upstream")[0], "upstream", title="fuzz")


def moments_file(path):
    plane = tl.read_plane(plane_file(path, tone=5.0))
    tl.moments(plane, tl.load_liner("polito"), phase="self-consistent").write(path)


def line_file(path):
    bursts = [station(seed, seconds=0.2) for seed in range(2)]
    tl.educe_bursts(bursts, tl.load_liner("onera"), segment=0.04, monte_carlo=100).write(path)


def sound_file(path):
    wavfile.write(path, 42000, np.random.default_rng(0).normal(size=260).astype(np.float32))
    plane_file(path.parent / "plane.h5")


def pressure_file(path):
    path.write_bytes((DATA / "pressure_n130.h5").read_bytes())


def preset_file(name):
    return lambda path: path.write_text(tl.liners.catalogue.preset_text(name), encoding="utf-8")


AT = ["--frequency", "800", "1500", "--speed", "0", "1"]
NAMES = {  # ending and command: what writes the file, and the words behind it, or the reader in Python
    ".h5 educe": (plane_file, ["--interval", "none"]),
    ".h5 educe moments": (moments_file, ["--interval", "none", "--phase", "self-consistent"]),
    ".csv kt": (lambda path: write_microphone_csv(wall_line(), path), []),
    ".h5 kt": (lambda path: wall_line().write(path), []),
    ".h5 insitu": (pressure_file, []),
    ".csv ldv educe": (
        lambda path: write_burst_csv(station(0, seconds=0.2), path),
        ["--segment", "0.04", "--liner", "onera"],
    ),
    ".csv liner": (lambda path: path.write_text("\n".join(table_rows()) + "\n"), AT),
    ".toml liner": (preset_file("onera"), AT),
    ".toml liner layers": (preset_file("double_layer_example"), AT),
    ".toml duct modes": (lambda path: path.write_text(duct_text("b2a"), encoding="utf-8"), ["--count", "1"]),
    ".npy convert": (lambda path: np.save(path, np.random.default_rng(0).normal(size=(60, 4))), None),
    ".wav incident": (sound_file, ["--frequency", "1400"]),
    ".h5 read_map": (
        lambda path: tl.educe(tl.read_plane(plane_file(path)), tl.load_liner("polito")).write(path),
        tl.read_map,
    ),
    ".h5 read_line": (line_file, tl.read_line),
    ".h5 read_points": (
        lambda path: tl.in_situ(tl.read_pressure(DATA / "pressure_n130.h5"), [1400.0]).write(path),
        tl.read_points,
    ),
    ".h5 read_wall": (
        lambda path: tl.kumaresan_tufts(wall_line(), draws=2).write(path, tl.two_wave_fit(wall_line())),
        tl.read_wall,
    ),
}


def make(name: str, folder: Path) -> Case:
    """One command with one file."""
    (ending, kind), (write, more) = name.split(" ", 1), NAMES[name]
    path = folder / f"input{ending}"
    write(path)
    if kind == "convert":
        return Case(name, path, convert(path, folder))
    if callable(more):
        return Case(name, path, reader(more, path))
    words = [*kind.removesuffix(" moments").removesuffix(" layers").split(), str(path)]
    if kind == "incident":
        words = ["replay", str(folder / "plane.h5"), "--incident", str(path)]
    return Case(name, path, lambda: command([*words, *more, "--json", "--quiet"]))


SHARE = INPUTS / (len(NAMES) + 1)


def explore(name, count, one):
    """``one`` with a random number generator, ``count`` times, seeded by hypothesis."""

    @settings(
        max_examples=count,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**63))
    def run(seed):
        one(random.Random(f"{name} {seed}"))

    run()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", NAMES)
def test_mutated_files(tmp_path, name, record_property, set_threads):
    """No traceback, no hang, no silent wrong answer."""
    set_threads(1)
    case = make(name, tmp_path)

    def one(draw):
        case.path.write_bytes(case.clean)
        if case.path.suffix == ".h5":
            case.judge(fuzzing.hdf5_structure(case.path, draw), may_change=False)
        elif case.path.suffix == ".csv" and draw.random() < 0.6:
            case.judge(fuzzing.table_cells(case.path, draw), may_change=True)
        else:
            case.judge(fuzzing.flip_bytes(case.path, draw), may_change=True)

    explore(name, round(SHARE), one)
    report(name, case.counts, case.faults)


VALUES = [
    *"nan inf -inf 0 -1 1 2 0.5 1e20 1e300 -1e300 1e-300 x 1,5 \x1b[2J 100000000000000000000 1400 1400:1e9:1".split(
        " "
    ),
    *"0:0:0 nan:1:1 a=b porosity=nan 1+2j nan+1j auto all 1GB -1GB 1e400GB hann tones:0 noise:1:2:3".split(),
    *("", " ", "porosity=2 %", "nothing.h5", "nothing/x.png", "/", "."),
]
COMMANDS = {
    "educe": ["plane.h5", "--interval", "none"],
    "info": ["plane.h5"],
    "sensitivity": ["plane.h5"],
    "kt": ["line.h5"],
    "liner": ["onera"],
    "ldv info": ["bursts.csv"],
    "ldv educe": ["bursts.csv", "--segment", "0.04", "--liner", "onera"],
    "duct modes": ["b2a", "--count", "1"],
    "insitu": ["record.h5"],
    "convert": ["v.npy", "-o", "out.h5", "--axes", "time,x", *RATE],
    "replay": ["plane.h5"],
    "compare-models": ["plane.h5", "--liner", "onera", "--liner", "mesh_example"],
}


@pytest.mark.filterwarnings("ignore")
def test_mutated_options(tmp_path, monkeypatch, set_threads):
    """An answer, or an error that names the option or its value; never a nan that is taken."""
    monkeypatch.chdir(tmp_path)
    set_threads(1)
    plane_file(Path("plane.h5"))
    wall_line().write("line.h5")
    write_burst_csv(station(0, seconds=0.2), Path("bursts.csv"))
    np.save("v.npy", np.random.default_rng(0).normal(size=(60, 4)))
    pressure_file(Path("record.h5"))
    counts, faults = {}, []

    def one(draw):
        name = draw.choice(list(COMMANDS))
        words = [*name.split(), *COMMANDS[name]]
        given_now = [
            a
            for a in Parser(name, TABLE[name])._actions
            if a.option_strings
            and a.metavar not in ("FILE", "PICTURE", "FOLDER")
            and a.dest not in ("help", "debug")  # which asks for a traceback
        ]
        said = []
        for action in draw.sample(given_now, draw.choice((1, 1, 2))):
            said.append(action.option_strings[-1])
            if action.nargs == 0:
                continue
            several = action.nargs if isinstance(action.nargs, int) else 1
            pool = [*VALUES, *list(action.choices or [])] * (1 if draw.random() < 0.7 else 0)
            said += [draw.choice(pool or list(action.choices or VALUES)) for _ in range(several)]
        found = command([*words, *said, "--json", "--quiet"])
        fault = found.fault()
        if not fault and found.code == 0 and {"nan", "inf", "-inf"} & set(said):
            texts = {"--title", "--liner", "--variable", "--case"}
            fault = "" if texts & set(said) else "silent wrong"
        if not fault and found.code > 1 and not found.said.strip():
            fault = "no message"
        kind = fault or ("refused" if found.code > 1 else "answer")
        counts[kind] = counts.get(kind, 0) + 1
        if fault:
            faults.append(f"{' '.join(words + said)!r}: {fault} {found.said.strip()[-300:]}")

    explore("options", round(SHARE), one)
    report("options", counts, faults)


def report(name, counts, faults):
    """Counts for the curious, faults for all."""
    log = os.environ.get("TORCHLINER_FUZZ_LOG")
    if log:
        with open(log, "a", encoding="utf-8") as file:
            file.write(json.dumps({"name": name, "counts": counts, "faults": faults}) + "\n")
    assert not faults, f"{len(faults)} of {sum(counts.values())}:\n" + "\n".join(faults[:20])
