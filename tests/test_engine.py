"""Laws of the engine: blocks, nodes, the one loop, drives, phase rules, and moments that educe as their plane does."""

import dataclasses
import functools
import math

import pytest
import torch
from conftest import FREQUENCY, RATE, doubtful, plane_of, relative_error, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import torchliner as tl
from torchliner.engine.blocks import Blocks, waves
from torchliner.engine.drives import Drive
from torchliner.engine.moments import ASKED
from torchliner.engine.nodes import ANY_LINER, Chebyshev, Levels, choose_nodes, interpolation_error
from torchliner.engine.sums import Held, Job, linear, reduce, square
from torchliner.engine.survey import survey_sums
from torchliner.liners.catalogue import preset_names
from torchliner.liners.model import LinerModel
from torchliner.velocity.averages import self_consistent

CPU = torch.device("cpu")


def noise(samples: int, probes: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    """Gaussian velocity of 2 m/s rms, (t, P)."""
    return 2 * torch.randn(samples, probes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def held(v: Tensor) -> Held:
    return Held(lambda begin, end: v[begin:end], len(v), v.shape[1], CPU)


@given(st.integers(40, 20_000), st.floats(1e3, 1e6), st.floats(4.0, 300.0))
@settings(max_examples=60)
def test_blocks_hold_all_whole_periods_as_equal_as_can_be(samples: int, rate: float, per_period: float) -> None:
    tone = rate / per_period
    if samples / per_period < 1:
        return
    blocks = Blocks.of(samples, rate, tone)
    assert blocks.borders[0] == 0
    assert blocks.borders[-1] <= samples
    assert blocks.count == min(blocks.periods, 32)
    whole = [round(border / per_period) * per_period for border in blocks.borders[:-1]]
    assert max(abs(border - step) for border, step in zip(blocks.borders, whole, strict=False)) <= 0.5 + 1e-6
    left = samples - blocks.periods * per_period
    assert -0.05 * per_period - 1 <= left <= 0.95 * per_period + 1
    assert float(blocks.lengths.max() - blocks.lengths.min()) <= per_period + 2  # samples of rounding


def every_job(nodes: Chebyshev | Levels) -> list[Job]:
    lines = torch.tensor([FREQUENCY, 1000.0], dtype=torch.float64)
    running = Drive(window=31, samples=3000)
    return [
        Job(Drive(), linear, lines),
        Job(Drive(), square),
        Job(Drive(), nodes.sums, lines),
        Job(running, nodes.sums, reach=16),
        Job(Drive(), survey_sums, lines, largest=1),
    ]


def test_workers_give_the_bits_of_one_reading() -> None:
    v, blocks = noise(3000, 7, dtype=torch.float32), Blocks.of(3000, RATE, 40.0)
    whole = reduce(held(v), blocks, every_job(ANY_LINER))
    parts = [reduce(held(v), blocks, every_job(ANY_LINER), only) for only in (range(1), range(1, blocks.count))]
    for one, first, second in zip(whole, *parts, strict=True):
        assert torch.equal(one, torch.cat([first, second]))


def functions_of(nodes: Chebyshev | Levels, speed: Tensor) -> Tensor:
    """At speeds (V,), (V, K): T_k in closed form; of ``Levels`` sums of one sample each."""
    if isinstance(nodes, Chebyshev):
        angle = ((speed - nodes.centre) / (speed + nodes.centre)).acos()
        return torch.cos(angle[:, None] * torch.arange(nodes.count))
    return nodes.sums(torch.ones(len(speed), 1, 1, dtype=torch.float64), speed[:, None, None])[:, 0, :, 0]


@pytest.mark.parametrize("nodes", [Chebyshev(24, 0.93), Levels((0.0, 1.0, 3.0, 40.0), 4)], ids=["chebyshev", "levels"])
def test_sums_are_those_of_a_plain_loop(nodes: Chebyshev | Levels) -> None:
    v, blocks = noise(1000, 3), Blocks.of(1000, RATE, 150.0)  # blocks of 280 samples: two slabs each
    lines = torch.tensor([FREQUENCY], dtype=torch.float64)
    (found,) = reduce(held(v), blocks, [Job(Drive(), nodes.sums, lines)])
    for s in range(blocks.count):
        begin, end = blocks.borders[s : s + 2]
        rows = waves(lines, RATE, begin, end)
        for probe in range(3):
            wanted = rows @ functions_of(nodes, v[begin:end, probe].abs())
            assert torch.allclose(found[s, :, :, probe], wanted, atol=1e-10)


def test_float32_sums_keep_seven_digits() -> None:
    v, blocks = noise(40_000, 2, dtype=torch.float32).abs() + 3, Blocks.of(40_000, RATE, 1.0)
    (found,) = reduce(held(v), blocks, [Job(Drive(), square)])
    assert torch.allclose(found.sum(0)[0, 0], v[: blocks.borders[-1]].double().square().sum(0), rtol=3e-7)


@pytest.mark.parametrize("preset", tl.preset_names())
def test_nodes_reach_the_tolerance_that_they_are_chosen_for(preset: str) -> None:
    liner = tl.load_liner(preset)
    f = torch.tensor([FREQUENCY], dtype=torch.float64)
    top = liner.speed_max or 100.0
    assert interpolation_error(choose_nodes([liner], f, 1e-6), liner, f, top)[0] <= 1e-6


def test_a_running_rms_is_that_of_a_plain_loop() -> None:
    v, window = noise(200, 2), 15
    drive = Drive(window=window, samples=len(v))
    wanted = torch.stack(
        [v[max(0, t - 7) : min(len(v), t - 7 + window)].square().mean(0).sqrt() for t in range(len(v))]
    )
    assert torch.allclose(drive(v, 0), wanted, atol=1e-12)
    assert torch.allclose(drive(v[50:150], 50)[8:-8], wanted[58:142], atol=1e-12)


DISC = st.complex_numbers(max_magnitude=0.6, allow_nan=False, allow_infinity=False)


@given(DISC, st.complex_numbers(max_magnitude=0.3, allow_nan=False), st.floats(-3, 3), st.floats(0.1, 10))
def test_the_self_consistent_wave_gives_the_measured_velocity(a: complex, b: complex, psi: float, size: float) -> None:
    """(1 - a) X - b X* = V for the wave behind R, whatever V."""
    velocity = torch.tensor(size * complex(math.cos(psi), math.sin(psi)), dtype=torch.complex128)
    mean, turned = torch.tensor(a, dtype=torch.complex128), torch.tensor(b, dtype=torch.complex128)
    found = self_consistent(mean, turned, velocity=velocity)
    wave = ((1 - mean).conj() * velocity + turned * velocity.conj()) / ((1 - mean).abs() ** 2 - turned.abs() ** 2)
    assert complex((1 - mean) * wave - turned * wave.conj()) == pytest.approx(complex(velocity), abs=1e-9)
    assert complex(found) == pytest.approx(complex(mean + turned * wave.conj() / wave), abs=1e-9)


@doubtful
@given(
    st.floats(0.0, 15.0), st.sampled_from(tl.preset_names()), st.sampled_from(["averaged", "given", "self-consistent"])
)
@settings(max_examples=40, deadline=None)
def test_a_frozen_speed_gives_the_model_itself(speed: float, preset: str, phase: str) -> None:
    """With |v| frozen the educed Z is Z(omega, |v|), in every averaging and phase rule."""
    liner = tl.load_liner(preset)
    speed = min(speed, liner.speed_max or speed)
    v = torch.full((900, 3), speed, dtype=torch.float64)
    stated = {"reference_phase": 0.4} if phase == "given" else {}
    found = tl.educe(plane_of(v.T), liner, phase=phase, interval=None, minimum_coherence=0.0, **stated)
    wanted = complex(liner.impedance(FREQUENCY, speed))
    for averaging in found.averagings:
        away = abs(complex(found.liner[averaging].impedance[0]) - wanted)
        assert away < 1e-7 * abs(1 + wanted) ** 2 + found.choices["model_error"] * abs(1 + wanted) ** 2


N = 2100  # 70 periods
CHOICES = [
    {"averaging": "admittance"},
    {"averaging": "velocity", "phase": "self-consistent"},
    {},
    {"mean": "removed"},
    {"drive": "rms"},
    {"drive": "running-rms", "interval": None},
]


def velocity(samples: int = N, probes: int = 5, dtype=torch.float64) -> torch.Tensor:
    """Turbulence and a tone of another size at each probe, m/s."""
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(samples))
    return (turbulence((probes, samples)) + torch.linspace(1, 8, probes)[:, None] * tone).to(dtype)


@doubtful
@pytest.mark.parametrize("known_liner", [True, False])
@pytest.mark.parametrize("choices", CHOICES, ids=str)
def test_moments_educe_as_their_plane(choices, known_liner, liner):
    """R to 1e-6: that is their own table's error and less."""
    plane, about = plane_of(velocity(), x=[0.002 * i for i in range(5)]), dict(choices)
    interval = about.pop("interval", 0.95)
    whole = tl.educe(plane, liner, interval=interval, **about)
    given = {"liner": liner} if known_liner else {"cell_pitch": liner.cell_pitch, "frequency": FREQUENCY}
    known = tl.moments(plane, **given, **about)
    found = known.educe(liner, interval=interval, **about)
    assert found.averagings == whole.averagings
    for averaging in whole.averagings:
        for kind in ("liner", "cells"):
            one, other = (getattr(each, kind)[averaging] for each in (whole, found))
            assert relative_error(other.impedance, one.impedance) < 1e-6
            if interval is not None:
                assert relative_error(other.interval.low, one.interval.low) < 1e-5
    assert torch.equal(found.coherence, whole.coherence)


def test_what_was_taken_at_a_frequency_is_not_asked_for_at_another(liner):
    v, bare = velocity(), liner.replace(cell_pitch=None)
    running = {"drive": "running-rms", "averaging": "admittance"}
    known = tl.moments(plane_of(v), **running)
    with pytest.raises(ValueError, match=r"reduced with running_window 0.000714.*0.00142857.* is asked"):
        known.educe(bare, 700.0, **running)
    own = tl.educe(plane_of(v), bare, running_window=1 / FREQUENCY, frequency=700.0, **running)
    same = known.educe(bare, 700.0, running_window=1 / FREQUENCY, **running)
    assert relative_error(same.answer, own.answer) < 1e-6
    with pytest.raises(ValueError, match=r"coherence of v.* at 1400, .* and not at 700 Hz"):
        tl.moments(plane_of(v)).educe(bare, 700.0, wall_filter=0.5)


@given(
    diameter=st.floats(0.5e-3, 2.5e-3),
    porosity=st.floats(0.03, 0.15),
    thickness=st.floats(0.5e-3, 2e-3),
    depth=st.floats(10e-3, 60e-3),
)
def test_moments_of_any_liner_know_most(diameter, porosity, thickness, depth):
    """R up to 6 kHz and 10 m/s, as docs/moments.md says: to 1e-5 from 5 % open area on; presets to 7e-7."""
    mine = tl.load_liner("polito").replace(
        orifice_diameter=diameter, porosity=porosity, facesheet_thickness=thickness, cavity_depth=depth
    )
    error = functools.partial(interpolation_error, ANY_LINER, frequency=ASKED, top=10.0)
    assert error(mine)[0] < (1e-5 if porosity >= 0.05 else 3e-4)
    assert max(error(tl.load_liner(name))[0] for name in preset_names()) < 7e-7


@dataclasses.dataclass(frozen=True)
class Steep(LinerModel):
    """R rises by 2 about 2 m/s, over a width in m/s."""

    width: float

    def impedance(self, frequency, speed=0.0):
        return (
            0.5 - 0.3j + 2 * torch.sigmoid((torch.as_tensor(speed) - 2) / self.width) + 0 * torch.as_tensor(frequency)
        )


@doubtful
def test_a_response_too_steep_for_moments_of_any_liner_is_refused_and_a_steep_one_noted():
    known = tl.moments(plane_of(velocity()), averaging="admittance")
    with pytest.raises(ValueError, match=r"model-table error in R of Steep is .* at \|v\| = .* m/s, .*with this liner"):
        known.educe(Steep(0.02), averaging="admittance")
    found = known.educe(Steep(0.2), averaging="admittance")
    (note,) = (each for each in found.notes if each.code == "model-table")
    assert note.size == pytest.approx(known.error(Steep(0.2)) * abs(complex(found.answer[0]) + 1) ** 2 / 2)


def test_a_liner_that_the_moments_do_not_know_is_refused(liner):
    bare = liner.replace(cell_pitch=None)
    frequency, speed = torch.linspace(600, 3000, 40), torch.linspace(0, 40, 41)
    table = tl.TabulatedLiner(frequency, bare.impedance(frequency[:, None], speed), speed)
    known = tl.moments(plane_of(velocity()), averaging="admittance")
    for ask in (known.error, functools.partial(known.educe, averaging="admittance")):
        with pytest.raises(ValueError, match=r"moments for any liner.* up to 40 m/s: reduce"):
            ask(table)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"phase": "self-consistent"}, "phase"),
        ({"mean": "removed"}, "reduced with mean 'kept'"),
        ({"drive": "rms"}, "reduced with drive 'instantaneous'"),
        ({"averaging": "phase-locked"}, "reduced with averaging 'admittance'"),
    ],
)
def test_other_choices_are_refused(choices, message, liner):
    known = tl.moments(plane_of(velocity()), liner, averaging="admittance")
    with pytest.raises(ValueError, match=message):
        known.educe(liner, **{"averaging": "admittance"} | choices)


def test_moments_state_their_error(liner):
    plane = plane_of(velocity())
    assert 0 < tl.moments(plane, cell_pitch=liner.cell_pitch, averaging="admittance").error(liner) < 1e-5
    few = tl.moments(plane, liner, averaging="admittance")
    assert few.nodes.count < 64
    assert few.error(liner, FREQUENCY) < 1e-9 < few.error(liner, 6000.0)
