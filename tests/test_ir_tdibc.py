"""The wave alone drives the liner: laws of the time stepping, of the period, of the fixed point."""

import dataclasses
import itertools
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import torchliner as tl
from oracles.periodic_wall import driven_impedance, fixed_speed, settle_period
from torchliner.engine.kernels import KernelTable, build_kernels, interpolate
from torchliner.liners.model import LinerModel
from torchliner.names import STEP_KERNELS
from torchliner.velocity.ir_tdibc import STEPPED, step_in_time

RATE = 24000.0
FAST = {"sampling_rate": 14000.0, "duration": 0.02, "after": 0.004}  # of 1400 Hz, 16 samples
literal = pytest.mark.filterwarnings("ignore::torchliner.checks.DataWarning")  # of its error
IMPEDANCE = 1.204 * 343.2  # rho c, of the models below


class Wall(LinerModel):
    """Z = law(|v|) at all frequencies: no memory at all."""

    def __init__(self, law) -> None:
        self.law = law

    def impedance(self, frequency, speed=0.0):
        return (self.law(torch.as_tensor(speed, dtype=torch.float64)) + 0 * frequency).to(torch.complex128)


@pytest.fixture(scope="module")
def slit() -> tl.SDoFLiner:
    return tl.load_liner("lbm_slit")


def kernels_of(liner, kind="causal", after=0.004, **options) -> KernelTable:
    return build_kernels(liner, RATE, velocity_max=20.0, kind=kind, after=after, **options)


def noise(columns: int, samples: int, size: float = 1.0) -> torch.Tensor:
    random = torch.Generator().manual_seed(3)
    return size * torch.randn(columns, samples, generator=random, dtype=torch.float64)


def one(curve: tl.LevelCurve) -> complex:
    return complex(curve.impedance[0, 0])


@settings(max_examples=60)
@given(
    taps=st.lists(st.floats(-2, 2), min_size=8, max_size=8),
    sent=st.floats(-3, 3),
    memory=st.floats(-3, 3),
    spacing=st.sampled_from(["sqrt", "uniform"]),
    interpolation=st.sampled_from(["cubic", "linear"]),
)
def test_the_newest_tap_is_solved(taps, sent, memory, spacing, interpolation):
    """The equation holds to rounding, whatever the table; the least root is that of bisection. A first emission of 1
    leaves the second tap, the same at all levels, as the memory."""
    grid = tl.VelocityGrid(60.0, 8, spacing, interpolation)
    both = torch.tensor([taps, 8 * [memory]], dtype=torch.float64).T
    table = KernelTable(both, 0, RATE, grid, (300.0, 3500.0), "causal", 0.0, 0.0, 0.0)

    def left(speed: float) -> float:
        index, weights = grid.locate(torch.tensor(speed, dtype=torch.float64))
        tap = sum(float(w) * taps[int(index) + i] for i, w in enumerate(weights))
        return speed - abs(sent - memory - sent * tap)

    found = abs(sent - float(step_in_time(torch.tensor([[1.0, sent]], dtype=torch.float64), table)[0, 1]))
    speeds = grid.speeds.numpy()
    least = next(s for s in speeds if left(float(s)) >= 0)  # a level at or behind the root
    assert found <= least + 1e-9
    # sqrt|v| of the table's places is as steep as it likes towards rest.
    assert abs(left(found)) < (1e-6 if spacing == "sqrt" else 1e-10)


def test_a_wall_without_memory_by_hand():
    """Z = k |v|: the pressure p = k v |v| and p + v = 2 x give v at each moment."""
    slope, level, wall = 2.0, 150.0, Wall(lambda s: 2.0 * s)
    peak = 2**0.5 * 20e-6 * 10 ** (level / 20) / IMPEDANCE
    wave = peak * torch.cos(2 * torch.pi * torch.arange(16, dtype=torch.float64) / 16)
    v = torch.sign(wave) * ((1 + 8 * slope * wave.abs()).sqrt() - 1) / (2 * slope)
    x, v = torch.fft.rfft(wave)[1], torch.fft.rfft(v)[1]
    # R(0) = 1 of a kernel of finite length leaks into the band: 1e-3; the period has none.
    assert abs(one(tl.ir_tdibc(wall, level, 1400.0, kernel="causal", **FAST)) - complex((2 * x - v) / v)) < 0.02
    assert abs(driven_impedance(wall, level, 1400.0, 16) - complex((2 * x - v) / v)) < 1e-4


def test_replaying_the_velocity_found_returns_the_reflected_wave(slit):
    """DIR-TDIBC driven by the v of IR-TDIBC is IR-TDIBC: the sum over emissions, one after another."""
    kernels, sent = kernels_of(slit), noise(2, 400)
    reflected = step_in_time(sent, kernels)
    for x, y, v in zip(sent, reflected, sent - reflected, strict=True):
        taps = interpolate(kernels.taps, *kernels.grid.locate(v.abs()))
        again = torch.zeros_like(y)
        for k in range(400):
            part = taps[k, : 400 - k]
            again[k : k + len(part)] += x[k] * part
        assert float((again - y).abs().max()) < 1e-11


def test_steps_and_period_agree(slit):
    kernels, n = kernels_of(slit, "two-sided", before=0.0, regularisation=1e-2), 240
    period = 1.2 * torch.cos(2 * torch.pi * 1400 / 28000 * torch.arange(n, dtype=torch.float64))
    period = torch.stack([period, 0.2 * period, 0.1 * noise(1, n)[0]])
    found = step_in_time(period.repeat(1, 6), kernels)[:, -n:]
    lines = kernels.response(torch.fft.rfftfreq(n, 1 / RATE, dtype=torch.float64))
    wanted = torch.stack([settle_period(each, lines, kernels.grid) for each in period])
    assert float((found - wanted).abs().max()) < 1e-8


@literal
@pytest.mark.parametrize("kernel", ["least-squares", "causal"])
def test_low_levels_are_linear(slit, kernel):
    """Z of the kernel's own response at rest, of each of several tones as of one alone."""
    tones = [700.0, 1050.0, 1400.0]
    several = tl.ir_tdibc(slit, 20.0, tones, kernel=kernel, **FAST)
    how = {"after": FAST["after"], "band": several.choices["kernel_band"]} | STEPPED[kernel]
    kernels = build_kernels(slit, several.choices["sampling_rate"], velocity_max=20.0, **how)
    at_rest = tl.impedance_from_reflection(kernels.response(several.frequency)[0])
    assert float((several.impedance[0] - at_rest).abs().max()) < 1e-6
    alone = tl.ir_tdibc(slit, 20.0, 1400.0, kernel=kernel, **FAST)
    assert abs(one(alone) - complex(several.impedance[0, 2])) < 1e-6


def test_fixed_point_by_hand():
    """Z = k s: k s^2 + s = 2 x, of one tone and of two alike; and the least of three roots of a bent wall."""
    slope, rms = 3.0, 0.7
    wanted = (math.sqrt(1 + 8 * slope * rms) - 1) / (2 * slope)
    for shares in ([1.0], [0.36, 0.64]):
        power = rms**2 * torch.tensor(shares, dtype=torch.float64)
        found = fixed_speed(Wall(lambda s: slope * s), 1000.0 + 0 * power, power, 20.0)
        assert found == pytest.approx(wanted, rel=1e-9)

    def bent(s):
        return 0.2 + 5 / (1 + (s / 0.5) ** 8)

    found = fixed_speed(Wall(bent), torch.tensor([1000.0]), torch.tensor([1.0]).double(), 20.0)
    assert found < 0.5
    assert abs(found - 2 / (1 + bent(found))) < 1e-9


def test_a_level_does_not_know_the_others(slit):
    both = tl.ir_tdibc(slit, [120, 140], 1400.0, **FAST)
    alone = tl.ir_tdibc(slit, 140, 1400.0, **FAST)
    assert float((both.reflection[1] - alone.reflection[0]).abs().max()) < 1e-12


@literal
def test_kernel_length_and_rate_converge(onera):
    """Twice the kernel's length: its tail falls by 3; twice the samples a period: the harmonics of v fall by 10."""

    def steps(found):
        return [abs(after - before) for before, after in itertools.pairwise(found)]

    about = {"kernel": "causal", "sampling_rate": 14000.0}
    length = steps([one(tl.ir_tdibc(onera, 140, 1400.0, after=t, **about)) for t in (0.0025, 0.005, 0.01)])
    assert length[1] < 0.3 * length[0]
    rate = steps([driven_impedance(onera, 140, 1400.0, n) for n in (8, 16, 32)])
    assert rate[1] < 0.1 * rate[0]
    assert rate[1] < 1e-3


@literal
@pytest.mark.slow
@pytest.mark.parametrize("name", tl.preset_names())
@pytest.mark.parametrize("kernel", STEP_KERNELS)
def test_every_preset_up_to_160_db(name, kernel):
    """No wall gives back more than it gets."""
    how = {"band": (300.0, 3500.0)} | STEPPED[kernel]
    kernels = build_kernels(tl.load_liner(name), 28000.0, velocity_max=20.0, **how)
    tone, hiss = (wave.sampled(1400, 28000.0) for wave in (tl.Tones(1400.0), tl.BandNoise(500, 3000)))
    for wave in (2**0.5 * tone, hiss):
        sent = wave * 20e-6 * 10 ** (torch.tensor([[100.0], [145.0], [160.0]]) / 20) / IMPEDANCE
        assert float((step_in_time(sent, kernels).square().sum(1) / sent.square().sum(1)).max()) < 1


@pytest.mark.parametrize(
    ("level", "incident", "options", "message"),
    [
        (math.nan, 1400.0, {}, "level is nan dB .* must be finite"),
        (356.0, 1400.0, {}, "level is 356 dB"),
        ([130, 190], 1400.0, FAST, "at 190 dB .* exceeds 20 m/s"),
        (130, 1400.0, {"sampling_rate": -9000.0}, "sampling_rate .* -9000"),
        (130, 1400.0, {"duration": math.nan}, "duration .* nan"),
        (130, [1400.0, 1400.1], {}, "tones 1400 1400.1 Hz.* repeats 0.1 times in a second, .*; round"),
        (130, "noise:500:3000", {}, "band noise 500-3000 Hz.* sends tones"),
    ],
)
def test_bad_input(slit, level, incident, options, message):
    with pytest.raises(ValueError, match=message):
        tl.ir_tdibc(slit, level, incident, **options)


def test_tables_that_end(slit):
    f, v = torch.linspace(500, 3000, 26).double(), torch.linspace(0, 1, 21).double()
    table = tl.TabulatedLiner(f, slit.impedance(f[:, None], v[None]), v)
    for level, tones, options, words in (
        (120, 1400.0, {"kernel": "causal"}, "500-3000 Hz"),
        (120, [1400.0, 3200.0], {}, "3200 Hz; the kernels hold from 500 to 3000 Hz"),
        (150, 1400.0, FAST, r"at 150 dB .* exceeds 1 m/s"),
    ):
        with pytest.raises(ValueError, match=words):
            tl.ir_tdibc(table, level, tones, **options)
    found = tl.ir_tdibc(table, 120, 1400.0, **FAST)
    assert found.choices["kernel_band"] == [500.0, 3000.0]
    assert 0.05 < one(found).real < 0.3


def test_what_does_not_settle_is_refused(slit):
    curve = tl.ir_tdibc(slit, [120, 130], 1400.0, **FAST)
    with pytest.raises(ValueError, match=r"at 130 dB y still changes by 0\.3 of its rms"):
        list(dataclasses.replace(curve, drift=torch.tensor([0.0, 0.3])).warnings())
    (words,) = dataclasses.replace(curve, drift=torch.tensor([0.0, 0.01])).warnings()
    assert "at 130 dB" in words
