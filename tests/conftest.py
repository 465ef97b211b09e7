"""Fixtures that several files share."""

import dataclasses
import importlib.util
import math
import signal
import sys
from pathlib import Path

import hypothesis
import pytest
import torch

import torchliner as tl
from torchliner.liners.model import LinerModel, Number

# The same examples in every run and on every machine, however slow; new ones, and more of them:
# pytest --hypothesis-profile=explore [--hypothesis-seed=N].
hypothesis.settings.register_profile("same", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", max_examples=1000, deadline=None)
hypothesis.settings.load_profile("same")

# Commands in tests are interrupted, also where SIGINT is ignored, as in the background of a shell.
signal.signal(signal.SIGINT, signal.default_int_handler)

DATA = Path(__file__).resolve().parent.parent / "data"
SHARED = Path(__file__).resolve().parents[2] / "shared"
PARAMETERS = {  # of a liner, each to be differentiated
    "facesheet_thickness": 1e-3,
    "orifice_diameter": 1e-3,
    "porosity": 0.06,
    "cavity_depth": 38e-3,
    "cavity_hydraulic_radius": 4e-3,
    "cavity_porosity": 0.9,
    "open_area_fraction": 0.8,
    "vena_contracta": 0.78,
    "impedance_offset": 0.03 - 0.02j,
}
EVERY = [{}, {"averaging": "velocity"}, {"phase": "self-consistent"}, {"drive": "rms"}, {"drive": "running-rms"}]
EVERY += [{"mean": "removed"}, {"background": 1.0}]  # choices of moments
doubtful = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")  # the answer stands, and is what is looked at
RATE, FREQUENCY = 42000.0, 1400.0  # 30 samples a period, so that whole periods are whole samples


@pytest.fixture(autouse=True)
def seeded() -> None:
    """Draws that name no generator do not depend on which tests ran before."""
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def liner() -> tl.SDoFLiner:
    return tl.load_liner("polito")


@pytest.fixture(scope="session")
def onera() -> tl.SDoFLiner:
    return tl.load_liner("onera")


@pytest.fixture
def set_threads():
    """``torch.set_num_threads``, undone after the test."""
    before = torch.get_num_threads()
    yield torch.set_num_threads
    torch.set_num_threads(before)


@pytest.fixture
def unrendered(monkeypatch):
    """Pictures are put together and stay empty files: for tests of which are made, and where."""
    pytest.importorskip("matplotlib")
    save = "matplotlib.figure.Figure.savefig"
    monkeypatch.setattr(save, lambda figure, path, **_: Path(path).touch())


@dataclasses.dataclass(frozen=True)
class Resistive(LinerModel):
    """Z = r0 + a |v| + j (m omega - cot(omega L/c)): a model of one's own, which states numbers."""

    r0: float
    a: float
    m: float
    length: float

    def impedance(self, frequency, speed=0.0):
        omega = 2 * torch.pi * torch.as_tensor(frequency)
        reactance = self.m * omega - 1 / torch.tan(omega * self.length / 343.2)
        return torch.complex(self.r0 + self.a * torch.as_tensor(speed) + 0 * omega, reactance)

    def numbers(self):
        units = {"r0": "1", "a": "s/m", "m": "s", "length": "m"}
        return {name: Number(getattr(self, name), unit) for name, unit in units.items()}


def turbulence(shape: tuple[int, ...], seed: int = 0, rms: float = 3.0) -> torch.Tensor:
    """Low-passed Gaussian noise of a given rms (m/s), float64: smooth like a velocity."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(*shape, generator=generator, dtype=torch.float64)
    spectrum = torch.fft.rfft(noise)
    spectrum[..., spectrum.shape[-1] // 4 :] = 0
    smooth = torch.fft.irfft(spectrum, n=shape[-1])
    return smooth * (rms / smooth.std())


def plane_of(velocity: torch.Tensor, **about: object) -> tl.VelocityPlane:
    about.setdefault("sampling_rate", RATE)
    about.setdefault("frequency", FREQUENCY)
    return tl.VelocityPlane(velocity, **about)


def frozen_plane(speed: float, probes: int = 3, periods: float = 16.0, **about: object):
    samples = math.ceil(periods * RATE / FREQUENCY)
    dtype = about.pop("dtype", torch.float64)
    return plane_of(torch.full((probes, samples), speed, dtype=dtype), **about)


def relative_error(found: torch.Tensor, wanted: torch.Tensor) -> float:
    return float(((found - wanted).abs() / wanted.abs()).max())


def same_bits(one, two):
    """Whether all tensors and values within are the same; names of files and what they say of themselves aside."""
    if isinstance(one, torch.Tensor):
        parts = [torch.view_as_real(each) if each.is_complex() else each for each in (one, two)]
        return one.dtype == two.dtype and torch.equal(*(each.double().nan_to_num(-7e77) for each in parts))
    if dataclasses.is_dataclass(one):
        names = [each.name for each in dataclasses.fields(one) if each.name not in ("velocity", "name", "text")]
        return type(one) is type(two) and all(same_bits(getattr(one, name), getattr(two, name)) for name in names)
    if isinstance(one, dict):
        return list(one) == list(two) and all(same_bits(one[k], two[k]) for k in one if k not in ("source", "inputs"))
    if isinstance(one, tuple):
        return len(one) == len(two) and all(map(same_bits, one, two))
    return one == two


def codes(found) -> list[str]:
    return [note.code for note in found.notes]


def load_script(name: str):
    """A file of scripts/ as a module."""
    path = DATA.parent / "scripts" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
