"""The worked examples of CONTRIBUTING.md: what it adds as printed is used as a user would."""

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import plane_of, relative_error, turbulence

import torchliner as tl
from torchliner import names
from torchliner.cli.main import main
from torchliner.liners.catalogue import liner_text
from torchliner.velocity import averages
from torchliner.velocity.educe import educe

PAGE = Path(__file__).resolve().parent.parent / "CONTRIBUTING.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
FILES = {text.splitlines()[0][2:]: text for text in BLOCKS if text.startswith("# torchliner/")}
ROWS = [text for text in BLOCKS if not text.startswith("# torchliner/")]


@pytest.fixture(scope="module")
def added(tmp_path_factory):
    """Each example as a module of the package, and its row in the table; both go again."""
    tables = {n: type(v)(v) for n, v in vars(names).items() if n.isupper() and isinstance(v, dict | set)}
    rules = dict(averages.PHASE_RULES)
    for place, text in FILES.items():
        if (PAGE.parent / place).exists():  # a function that joins others
            exec(compile(text, place, "exec"), vars(averages))
            continue
        module, path = place.removesuffix(".py").replace("/", "."), tmp_path_factory.mktemp("added")
        (path / "module.py").write_text(text, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(module, path / "module.py")
        sys.modules[module] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[module])
    for row in ROWS:
        exec(compile(row, "CONTRIBUTING.md", "exec"), vars(names))
    yield
    for name, value in tables.items():
        getattr(names, name).clear()
        getattr(names, name).update(value)
    averages.PHASE_RULES.clear()
    averages.PHASE_RULES.update(rules)
    for place in FILES:
        if not (PAGE.parent / place).exists():
            del sys.modules[place.removesuffix(".py").replace("/", ".")]


def test_each_addition_is_one_file_and_one_row():
    assert len(FILES) == len(ROWS) == 4
    tables = [row.split("[")[0] for row in ROWS]
    assert all(isinstance(getattr(names, table), dict) for table in tables)


PLATE = """
model = "mpp"
thickness = 0.5e-3
diameter = 0.3e-3
porosity = 0.01
depth = 40e-3
cell_pitch = 5e-3
"""


@pytest.fixture
def plate(added, tmp_path):
    path = tmp_path / "plate.toml"
    path.write_text(PLATE)
    return path


def test_a_liner_is_read_refused_written_educed_and_differentiated(plate):
    liner = tl.load_liner(plate)
    assert liner.name == "plate"
    plate.write_text(PLATE.replace("porosity = 0.01", "porosty = 0.01"))
    with pytest.raises(ValueError, match=r"porosty.*did you mean 'porosity'"):
        tl.load_liner(plate)
    plate.write_text(liner_text(liner, "Maa (1998)"))
    assert tl.load_liner(plate).describe() == liner.describe()
    # A tone over whole periods and a model that knows no |v|: the educed Z is the model's own.
    x = (torch.arange(8, dtype=torch.float64) + 0.5) * 10e-3 / 8
    plane = plane_of(turbulence((8, 420)), x=x)
    found = tl.educe(plane, liner, dtype="float64", interval=None)
    wanted = liner.impedance(plane.frequency)
    assert relative_error(found.cells["admittance"].impedance[:, 0], wanted.expand(2)) < 1e-12
    assert found.choices["liner"]["model"] == "mpp"
    slopes = tl.sensitivities(plane, liner)
    assert tuple(slopes.numbers) == ("thickness", "diameter", "porosity", "depth")
    assert [each.unit for each in slopes.numbers.values()] == ["m", "m", "1", "m"]


def test_a_format_is_read(added, tmp_path):
    velocity = np.random.default_rng(0).normal(size=(50, 3))
    np.savez(tmp_path / "v.data.npz", v=velocity, x=[0.001, 0.002, 0.004], rate=1e4)
    with pytest.raises(ValueError, match="states no unit of velocity"):
        tl.read_plane(tmp_path / "v.data.npz")
    plane = tl.read_plane(tmp_path / "v.data.npz", velocity_units="cm/s")
    assert torch.allclose(plane.velocity, torch.from_numpy(velocity.T) / 100, rtol=1e-12)
    assert plane.sampling_rate == pytest.approx(1e4)
    assert plane.x.tolist() == [0.001, 0.002, 0.004]


def test_a_method_finds_a_single_wave(added, tmp_path, capsys):
    """The wave of a known wall, sampled along it, and nothing else: exactly."""
    frequency, wall = 1500.0, 1.2 - 0.4j
    duct = {"height": 0.05, "mach": 0.2, "sound_speed": 343.0}
    alpha = tl.wavenumber_from_impedance(torch.tensor(wall, dtype=torch.complex128), frequency, **duct)
    x = torch.arange(10, dtype=torch.float64) * 0.012
    about = {"duct_height": 0.05, "mach": 0.2, "source_side": "upstream", "fluid": tl.Fluid(sound_speed=343.0)}
    line = tl.MicrophoneLine(x, (20 * torch.exp(-1j * alpha * x))[:, None], [frequency], **about)
    line.write(tmp_path / "line.h5")
    words = ["kt", str(tmp_path / "line.h5"), "--method", "phase-gradient", "--json"]
    assert main([*words, "--draws", "20"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["impedance"]["resistance"] == pytest.approx(wall.real, abs=1e-9)
    assert row["impedance"]["reactance"] == pytest.approx(wall.imag, abs=1e-9)
    assert main([*words, "--rank", "2"]) == 2
    assert "--rank is no option of --method phase-gradient" in capsys.readouterr().err


def test_a_phase_rule_bounds_the_others(added, liner, tmp_path):
    """Of all phases the least |R|, with error bars; the given phase that makes it agrees."""
    plane = plane_of(turbulence((3, 1200)))
    found = educe(plane, liner, phase="most-absorbing", dtype="float64")
    turns = torch.linspace(0, torch.pi, 181, dtype=torch.float64)
    given = [
        educe(plane, liner, phase="given", reference_phase=float(psi), dtype="float64", interval=None)
        for psi in turns[::6]
    ]
    least = torch.stack([each.probes["admittance"].reflection.abs() for each in given]).amin(0)
    probes = found.probes["admittance"]
    assert bool((probes.reflection.abs() <= least + 1e-12).all())
    assert bool((probes.reflection.abs() > least - 5e-3).all())
    assert bool((probes.low.real < probes.impedance.real).all())
    plane.write(tmp_path / "p.h5")
    words = ["educe", str(tmp_path / "p.h5"), "--liner", "polito", "--quiet"]
    assert main([*words, "--phase", "most-absorbing", "-o", str(tmp_path / "m.h5")]) == 0
    assert tl.read_map(tmp_path / "m.h5").choices["phase"] == "most-absorbing"
