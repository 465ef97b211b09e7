"""Laws of the engine: blocks, nodes, the one loop, drives, phase rules."""

from __future__ import annotations

import math
import warnings

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import torchliner as tl
from torchliner.engine.blocks import Blocks, waves
from torchliner.engine.drives import Drive
from torchliner.engine.nodes import (
    ANY_LINER,
    Chebyshev,
    Levels,
    choose_nodes,
    interpolation_error,
)
from torchliner.engine.sums import Held, Job, largest, linear, reduce, square
from torchliner.engine.survey import survey_sums
from torchliner.velocity.averages import self_consistent

RATE, TONE = 42e3, 1400.0
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
    lines = torch.tensor([TONE, 1000.0], dtype=torch.float64)
    running = Drive(window=31, samples=3000)
    return [
        Job(Drive(), linear, lines),
        Job(Drive(), square),
        Job(Drive(), largest, largest=1),
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
    lines = torch.tensor([TONE], dtype=torch.float64)
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
    f = torch.tensor([TONE], dtype=torch.float64)
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
    found = self_consistent(mean, turned, velocity=velocity, held=torch.tensor(True))
    wave = ((1 - mean).conj() * velocity + turned * velocity.conj()) / ((1 - mean).abs() ** 2 - turned.abs() ** 2)
    assert complex((1 - mean) * wave - turned * wave.conj()) == pytest.approx(complex(velocity), abs=1e-9)
    assert complex(found) == pytest.approx(complex(mean + turned * wave.conj() / wave), abs=1e-9)


def plane_of(v: Tensor, **facts: object) -> tl.VelocityPlane:
    return tl.VelocityPlane(v.T, sampling_rate=RATE, frequency=TONE, **facts)


@given(
    st.floats(0.0, 15.0), st.sampled_from(tl.preset_names()), st.sampled_from(["averaged", "given", "self-consistent"])
)
@settings(max_examples=40, deadline=None)
def test_a_frozen_speed_gives_the_model_itself(speed: float, preset: str, phase: str) -> None:
    """With |v| frozen the educed Z is Z(omega, |v|), in every averaging and phase rule."""
    liner = tl.load_liner(preset)
    speed = min(speed, liner.speed_max or speed)
    v = torch.full((900, 3), speed, dtype=torch.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stated = {"reference_phase": 0.4} if phase == "given" else {}
        found = tl.educe(plane_of(v), liner, phase=phase, interval=None, minimum_coherence=0.0, **stated)
    wanted = complex(liner.impedance(torch.tensor(TONE, dtype=torch.float64), torch.tensor(speed, dtype=torch.float64)))
    for averaging in found.averagings:
        away = abs(complex(found.liner[averaging].impedance[0]) - wanted)
        assert away < 1e-7 * abs(1 + wanted) ** 2 + found.choices["model_error"] * abs(1 + wanted) ** 2
