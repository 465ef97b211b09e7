"""Laws of the engine: blocks, nodes, the one loop, drives, phase rules."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import torchliner as tl
from torchliner.engine.blocks import SLAB, Blocks, geometric, waves
from torchliner.engine.drives import Drive, phase_locked, survey_of_locked
from torchliner.engine.nodes import (
    ANY_LINER,
    Chebyshev,
    Levels,
    OfOneLiner,
    choose_nodes,
    interpolation_error,
    response,
)
from torchliner.engine.phase import Sound, averaged, self_consistent
from torchliner.engine.phase import given as given_phase
from torchliner.engine.sums import Held, Job, largest, linear, reduce, square
from torchliner.engine.survey import Membership, gram_of, harmonics_of, merged_lines, survey_of, survey_sums
from torchliner.velocity.background import Background

RATE, TONE = 42e3, 1400.0
CPU = torch.device("cpu")


def noise(samples: int, probes: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    """Gaussian velocity of 2 m/s rms, (t, P)."""
    return 2 * torch.randn(samples, probes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def held(v: Tensor) -> Held:
    return Held(lambda begin, end: v[begin:end], len(v), v.shape[1], CPU)


# ---------------------------------------------------------------------------------------------------- blocks


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


def test_slabs_cover_each_block_once_whatever_the_batch() -> None:
    blocks = Blocks.of(9000, RATE, 20.0)
    for rows in (1, 300, 10**6):
        slabs = [slab for batch in blocks.batches(rows) for slab in batch]
        assert [slab.begin for slab in slabs[1:]] == [slab.end for slab in slabs[:-1]]
        assert max(slab.end - slab.begin for slab in slabs) <= SLAB
        for place in range(blocks.count):
            own = [slab for slab in slabs if slab.place == place]
            assert (own[0].begin, own[-1].end) == blocks.borders[place : place + 2]


def test_sums_of_waves_have_a_closed_form() -> None:
    f = torch.tensor([0.0, 1400.0, 333.3, RATE / 2, -500.0], dtype=torch.float64)
    time = torch.arange(17, 460, dtype=torch.float64)
    wanted = torch.exp(-2j * torch.pi / RATE * f[:, None] * time).sum(1)
    assert torch.allclose(geometric(f, RATE, 17, 460), wanted, atol=1e-10)
    lines = torch.tensor([1400.0, 2800.0, 1000.0], dtype=torch.float64)
    blocks = Blocks.of(700, RATE, TONE)
    rows = waves(lines, RATE, *blocks.borders[3:5])
    assert torch.allclose(gram_of(blocks, lines)[3], rows @ rows.T, atol=1e-11)


# ---------------------------------------------------------------------------------------------------- the one loop


def every_job(nodes: Chebyshev | Levels) -> list[Job]:
    lines = torch.tensor([TONE, 1000.0], dtype=torch.float64)
    running = Drive(window=31, samples=3000)
    return [
        Job(Drive(), linear, lines),
        Job(Drive(), square),
        Job(Drive(), largest, largest=1),
        Job(Drive(), nodes.sums, lines),
        Job(running, nodes.sums, reach=running.reach),
        Job(Drive(), survey_sums, lines, largest=1),
    ]


def test_workers_give_the_bits_of_one_reading() -> None:
    v, blocks = noise(3000, 7, dtype=torch.float32), Blocks.of(3000, RATE, 40.0)
    whole = reduce(held(v), blocks, every_job(ANY_LINER))
    parts = [reduce(held(v), blocks, every_job(ANY_LINER), only) for only in (range(1), range(1, blocks.count))]
    for one, first, second in zip(whole, *parts, strict=True):
        assert torch.equal(one, torch.cat([first, second]))


@pytest.mark.parametrize("nodes", [Chebyshev(24, 0.93), Levels((0.0, 1.0, 3.0, 40.0), 4)], ids=["chebyshev", "levels"])
def test_sums_are_those_of_a_plain_loop(nodes: Chebyshev | Levels) -> None:
    v, blocks = noise(1000, 3), Blocks.of(1000, RATE, 150.0)  # blocks of 280 samples: two slabs each
    lines = torch.tensor([TONE], dtype=torch.float64)
    (found,) = reduce(held(v), blocks, [Job(Drive(), nodes.sums, lines)])
    for s in range(blocks.count):
        begin, end = blocks.borders[s : s + 2]
        rows = waves(lines, RATE, begin, end)
        for probe in range(3):
            wanted = rows @ nodes.functions(v[begin:end, probe].abs())
            assert torch.allclose(found[s, :, :, probe], wanted, atol=1e-10)


def test_float32_sums_keep_seven_digits() -> None:
    v, blocks = noise(40_000, 2, dtype=torch.float32).abs() + 3, Blocks.of(40_000, RATE, 1.0)
    (found,) = reduce(held(v), blocks, [Job(Drive(), square)])
    assert torch.allclose(found.sum(0)[0, 0], v[: blocks.borders[-1]].double().square().sum(0), rtol=3e-7)


# ---------------------------------------------------------------------------------------------------- nodes


@pytest.mark.parametrize("preset", tl.preset_names())
def test_nodes_reach_the_tolerance_that_they_are_chosen_for(preset: str) -> None:
    liner = tl.load_liner(preset)
    f = torch.tensor([TONE], dtype=torch.float64)
    top = liner.speed_max or 100.0
    assert interpolation_error(choose_nodes([liner], f, 1e-6), liner, f, top)[0] <= 1e-6


def test_coefficients_give_back_any_mean() -> None:
    """sum_k c_k m_k is the sum of R over the record, for any liner after the fact."""
    liner, f = tl.load_liner("onera"), torch.tensor([1000.0, TONE], dtype=torch.float64)
    v, blocks, nodes = noise(900, 4), Blocks.of(900, RATE, TONE), Chebyshev(64, 1.5)
    (sums,) = reduce(held(v), blocks, [Job(Drive(), nodes.sums)])
    c = nodes.coefficients(response(liner, f, nodes.speeds))
    found = torch.einsum("fk,skn->fn", c, sums[:, 0].to(c))
    end = blocks.borders[-1]
    wanted = response(liner, f, v[:end].abs().flatten()).unflatten(1, (end, 4)).sum(1)
    assert float((found - wanted).abs().max()) / end < 1e-7
    of_one = OfOneLiner.of(nodes, c, f)
    (parts,) = reduce(held(v), blocks, [Job(Drive(), of_one.sums)])
    assert torch.allclose(torch.einsum("fk,skn->fn", of_one.coefficients(c), parts[:, 0].to(c)), found, atol=1e-9)


# ---------------------------------------------------------------------------------------------------- survey and drives


def surveyed(v: Tensor, tone: float = TONE) -> object:
    harmonics = harmonics_of(tone, RATE)
    lines = torch.tensor(merged_lines(harmonics, [tone, 1000.0]), dtype=torch.float64)
    blocks = Blocks.of(len(v), RATE, tone)
    return survey_of(
        reduce(held(v), blocks, [Job(Drive(), survey_sums, lines, largest=1)])[0], blocks, lines, len(harmonics)
    )


def test_a_survey_knows_mean_rms_peak_and_coherence() -> None:
    time = torch.arange(2100, dtype=torch.float64) / RATE
    v = torch.stack([0.3 + 2 * torch.cos(2 * math.pi * TONE * time), noise(2100, 1)[:, 0]], 1)
    seen = surveyed(v)
    assert torch.allclose(seen.mean, v.mean(0), atol=1e-12)
    assert torch.allclose(seen.rms, v.std(0, correction=0), atol=1e-12)
    assert torch.equal(seen.peak, v.abs().amax(0))
    coherence = seen.coherence(torch.tensor([TONE], dtype=torch.float64))
    assert float(coherence[0]) == pytest.approx(1, abs=1e-9)
    assert float(coherence[1]) < 0.2  # of 32 blocks: 1/32 in the mean


def cells_of(*labels: int) -> Membership:
    return Membership.of(torch.tensor(labels), max(labels) + 1, CPU)


def test_membership_averages_and_spreads() -> None:
    cells, values = cells_of(1, 0, -1, 1, 1), torch.tensor([[1.0, 2.0, 50.0, 4.0, 7.0]])
    assert cells.mean(values).tolist() == [[2.0, 4.0]]
    assert cells.spread(cells.mean(values)).tolist() == [[4.0, 2.0, 0.0, 4.0, 4.0]]
    assert cells_of(0, 0, 1, 1).ordered
    assert not cells.ordered


def locked_velocity(v: Tensor, cells: Membership, background: float | None = None) -> tuple[Drive, Tensor]:
    seen = surveyed(v)
    scale = None if background is None else Background((background,)).scale(seen, cells)
    drive = phase_locked(seen, cells, scale)
    return drive, drive(v, 0)


def test_without_turbulence_phase_locked_is_the_velocity_of_the_cell() -> None:
    time = torch.arange(2100, dtype=torch.float64) / RATE
    phase = torch.tensor([0.1, 0.7, -0.4, 2.0], dtype=torch.float64)
    v = 0.2 + (1 + phase) * torch.cos(2 * math.pi * TONE * time[:, None] + phase)
    cells = cells_of(0, 0, 1, 1)
    _, star = locked_velocity(v, cells)
    assert torch.allclose(star, cells.spread(cells.mean(v)), atol=1e-9)


def test_without_a_tone_phase_locked_is_the_velocity_of_the_probe() -> None:
    v, cells = noise(21_000, 8), cells_of(*[0] * 8)
    drive, star = locked_velocity(v, cells)
    assert float(drive.share.max()) < 0.4
    assert float((star - v).square().mean() / v.square().mean()) < 0.01


def test_the_survey_of_the_phase_locked_velocity_is_exact() -> None:
    time = torch.arange(2100, dtype=torch.float64) / RATE
    v = noise(2100, 6) + torch.cos(2 * math.pi * TONE * time)[:, None] * torch.arange(6)
    cells = cells_of(0, 0, 0, 1, 1, -1)
    drive, star = locked_velocity(v, cells, background=0.5)
    derived, direct = survey_of_locked(drive, surveyed(v)), surveyed(star)
    assert torch.allclose(derived.sums, direct.sums, atol=1e-8)
    assert torch.allclose(derived.squares, direct.squares, atol=1e-8)
    assert bool((derived.peaks >= direct.peaks - 1e-9).all())


def test_a_background_scales_the_incoherent_velocity_of_a_cell() -> None:
    time = torch.arange(21_000, dtype=torch.float64) / RATE
    v = noise(21_000, 8) + 3 * torch.cos(2 * math.pi * TONE * time)[:, None]
    drive, star = locked_velocity(v, cells_of(*[0] * 8), background=0.5)
    rows = waves(drive.lines, RATE, 0, len(v)).T
    incoherent = star - rows @ torch.linalg.lstsq(rows, star).solution
    assert float(incoherent.square().mean().sqrt()) == pytest.approx(0.5, rel=0.02)
    quiet, same = locked_velocity(v, cells_of(*[0] * 8), background=50.0)  # never up
    assert torch.allclose(same, locked_velocity(v, cells_of(*[0] * 8))[1])
    assert float(quiet.scale.min()) == 1


def test_a_running_rms_is_that_of_a_plain_loop() -> None:
    v, window = noise(200, 2), 15
    drive = Drive(window=window, samples=len(v))
    wanted = torch.stack(
        [v[max(0, t - 7) : min(len(v), t - 7 + window)].square().mean(0).sqrt() for t in range(len(v))]
    )
    assert torch.allclose(drive(v, 0), wanted, atol=1e-12)
    inner = drive(v[50:150], 50)[drive.reach : -drive.reach]
    assert torch.allclose(inner, wanted[50 + drive.reach : 150 - drive.reach], atol=1e-12)


# ---------------------------------------------------------------------------------------------------- phase rules

DISC = st.complex_numbers(max_magnitude=0.6, allow_nan=False, allow_infinity=False)


@given(DISC, st.complex_numbers(max_magnitude=0.3, allow_nan=False), st.floats(-3, 3), st.floats(0.1, 10))
def test_the_self_consistent_wave_gives_the_measured_velocity(a: complex, b: complex, psi: float, size: float) -> None:
    """(1 - a) X - b X* = V for the wave behind R, whatever V."""
    velocity = torch.tensor(size * complex(math.cos(psi), math.sin(psi)), dtype=torch.complex128)
    mean, turned = torch.tensor(a, dtype=torch.complex128), torch.tensor(b, dtype=torch.complex128)
    found = self_consistent(mean, turned, Sound(velocity, torch.tensor(True)))
    wave = ((1 - mean).conj() * velocity + turned * velocity.conj()) / ((1 - mean).abs() ** 2 - turned.abs() ** 2)
    assert complex((1 - mean) * wave - turned * wave.conj()) == pytest.approx(complex(velocity), abs=1e-9)
    assert complex(found) == pytest.approx(complex(mean + turned * wave.conj() / wave), abs=1e-9)


def test_phase_rules_agree_where_the_phase_cannot_matter() -> None:
    a, zero = torch.tensor([0.3 + 0.2j]), torch.zeros(1, dtype=torch.complex64)
    sound = Sound(torch.tensor([1j]), torch.tensor([True]), torch.tensor([0.7]))
    for rule in (averaged, given_phase, self_consistent):
        assert torch.allclose(rule(a, zero, sound), a)
    b = torch.tensor([0.1 + 0.0j])
    turned = given_phase(a, b, replace(sound, phase=torch.tensor([0.7 + math.pi])))
    assert torch.allclose(turned, given_phase(a, b, sound))  # twice the phase enters
    assert torch.allclose(self_consistent(a, b, replace(sound, held=torch.tensor([False]))), a)


# ---------------------------------------------------------------------------------------------------- Z


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
