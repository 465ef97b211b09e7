"""Averaging ``phase-locked``: the phase-locked velocity of the cell, the incoherent of the place."""

import dataclasses
import warnings

import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, relative_error, turbulence
from scipy.signal import lfilter

import torchliner as tl

PROBES, PITCH = 8, 12.44e-3
PERIODS = 20


def times(samples: int) -> torch.Tensor:
    return torch.arange(samples, dtype=torch.float64) / RATE


def sound(samples: int, cells: int = 2, tones=(FREQUENCY,), seed: int = 3) -> torch.Tensor:
    """Mean and three harmonics, other ones at every probe, (P, n)."""
    generator = torch.Generator().manual_seed(seed)
    found = torch.zeros(cells * PROBES, samples, dtype=torch.float64)
    for tone in tones:
        for harmonic in range(4):
            size, phase = torch.rand(2, len(found), 1, generator=generator, dtype=torch.float64)
            turning = 2 * torch.pi * (harmonic * tone * times(samples) + phase)
            found += (size + 0.5) * torch.cos(turning) / (1 + harmonic)
    return found


def on_cells(velocity: torch.Tensor, **about) -> tl.VelocityPlane:
    spacing = PITCH / PROBES
    x = spacing * (torch.arange(len(velocity), dtype=torch.float64) + 0.5)
    return plane_of(velocity, x=x, height=1e-3, **about)


def educed(plane, liner, **choices):
    return tl.educe(plane, liner, **{"interval": None, **choices})


def harmonics_of(samples: int) -> np.ndarray:
    """Mean, cosines and sines of eight harmonics, (17, T)."""
    turning = 2 * np.pi * FREQUENCY * times(samples).numpy()
    return np.stack([np.ones_like(turning), *(f(h * turning) for f in (np.cos, np.sin) for h in range(1, 9))])


def test_slow_turbulence_is_not_taken_for_a_mean(onera):
    """Blocks of a period that vary together scatter less than their mean does from run to run: with
    two periods of correlation R of 40 periods was 4 % below that of probes first, now 1 %."""
    generator = np.random.default_rng(7)
    fall, apart = np.exp(-1 / 60), []
    for _ in range(8):
        white = generator.normal(size=(4 * PROBES, 1700))
        slow = 3 * lfilter([np.sqrt(1 - fall**2)], [1, -fall], white)[:, 500:]
        found = educed(on_cells(torch.from_numpy(slow)), onera)
        apart.append(found.liner["phase-locked"].impedance.real / found.liner["admittance"].impedance.real - 1)
    assert abs(float(torch.cat(apart).mean())) < 0.02


def mixed(samples: int = 600, seed: int = 0) -> torch.Tensor:
    return sound(samples) + turbulence((2 * PROBES, samples), seed, rms=1.5)


def by_hand(velocity: torch.Tensor) -> torch.Tensor:
    """v* of whole periods with the formula as it stands, fits block by block for the share."""
    basis = harmonics_of(velocity.shape[1])
    v = velocity.numpy().reshape(-1, PROBES, velocity.shape[1])

    def away(part: slice) -> np.ndarray:
        flat = v[..., part].reshape(-1, basis[0, part].size).T
        fits = np.linalg.lstsq(basis[:, part].T, flat, rcond=None)[0].reshape(len(basis), -1, PROBES)
        return fits - fits.mean(-1, keepdims=True)

    whole, length = away(slice(None)), velocity.shape[1] // PERIODS
    each = np.stack([away(slice(i * length, (i + 1) * length)) for i in range(PERIODS)])
    noise, left = each.var(0, ddof=1) / PERIODS, each - each.mean(0)
    lines = [[0], *([h, 8 + h] for h in range(1, 9))]
    taken = np.zeros_like(whole)
    for line in lines:
        power, cross = ((left[i:, line] * left[: PERIODS - i, line]).sum((0, 1, 3)) for i in (0, 1))
        rho = cross / power + (1 + 4 * cross / power) / PERIODS  # of neighbouring blocks
        rho = rho.clip(0, 0.9)
        varies = noise[line].sum((0, 2)) * (1 + rho) / (1 - rho)
        share = 1 - varies / (whole[line] ** 2).sum((0, 2))
        taken[line] = np.maximum(share, 0)[:, None] * whole[line]
    return torch.from_numpy(v - np.einsum("kcp,kt->cpt", taken, basis)).reshape(velocity.shape)


CHOSEN = [
    {},
    {"phase": "given", "reference_phase": 0.6},
    {"phase": "self-consistent"},
    {"drive": "rms"},
    {"drive": "running-rms", "running_window": 2e-3},
    {"mean": "removed"},
    {"drive": "rms", "mean": "removed"},
]


@pytest.mark.parametrize("choices", CHOSEN, ids=str)
def test_it_is_an_eduction_of_the_velocity_of_the_formula(onera, choices):
    velocity = mixed()
    if choices.get("phase") == "self-consistent":
        choices = choices | {"minimum_coherence": 0.0}
    found = educed(on_cells(velocity), onera, **choices)
    wanted = educed(on_cells(by_hand(velocity)), onera, averaging="admittance", **choices)
    assert relative_error(found.probes["phase-locked"].reflection, wanted.probes["admittance"].reflection) < 1e-9
    assert relative_error(found.cells["phase-locked"].reflection, wanted.cells["admittance"].reflection) < 1e-9
    assert relative_error(found.answer, wanted.liner["admittance"].impedance) < 1e-9


@pytest.mark.parametrize("choices", [{}, {"drive": "rms"}, {"mean": "removed"}], ids=str)
def test_oncoming_turbulence_of_a_known_rms(onera, choices):
    """Each cell's incoherent part, and what its fits keep of it, brought down to it; never up."""
    velocity = mixed()
    star, basis = by_hand(velocity), harmonics_of(600)
    in_step = torch.from_numpy(np.linalg.lstsq(basis.T, velocity.numpy().T, rcond=None)[0].T @ basis)
    cell = in_step.reshape(-1, PROBES, 600).mean(1).repeat_interleave(PROBES, 0)
    coherent = cell + (velocity - star)  # v' = <v_per> + g d
    own = (velocity - coherent).reshape(-1, PROBES, 600).square().mean((1, 2)).sqrt()
    assert float(own.max()) < 2.0
    less = star - (1 - 0.5 / own).repeat_interleave(PROBES)[:, None] * (velocity - coherent)
    wanted = educed(on_cells(less), onera, averaging="admittance", **choices)
    found = educed(on_cells(velocity), onera, background=0.5, **choices)
    assert relative_error(found.answer, wanted.liner["admittance"].impedance) < 1e-9
    assert found.choices["incoherent_scale"] == pytest.approx(float((0.5 / own).mean()), rel=1e-9)
    whole = educed(on_cells(velocity), onera, background=2.0, **choices)
    assert torch.equal(whole.answer, educed(on_cells(velocity), onera, **choices).answer)
    with pytest.raises(ValueError, match="background"):
        educed(on_cells(velocity), onera, background=1.0, averaging="velocity")


def test_probes_left_out_and_probes_of_no_cell(onera):
    velocity = torch.cat([mixed(), sound(600)[:3]])  # three probes of a third tile
    broken = velocity.clone()
    broken[2, 100] = torch.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)  # of the excluded probe
        found = educed(on_cells(broken), onera, missing="exclude")
    kept = torch.arange(len(velocity)) != 2
    plane = on_cells(velocity)
    fewer = dataclasses.replace(plane, velocity=velocity[kept], x=plane.x[kept])
    wanted = educed(fewer, onera)
    assert bool(torch.isnan(found.probes["phase-locked"].reflection[2].real).all())
    locked = found.probes["phase-locked"].reflection
    assert relative_error(locked[kept], wanted.probes["phase-locked"].reflection) < 1e-12
    assert relative_error(locked[-3:], found.probes["admittance"].reflection[-3:]) < 1e-12


def in_turbulence(onera, samples: int, generator: np.random.Generator, **choices):
    """Eight probes of one cell under a tone of 3 m/s and noise of 2.5 m/s up to 1.5 kHz."""
    fall = np.exp(-2 * np.pi * 1500.0 / RATE)
    white = generator.normal(size=(PROBES, samples + 500))
    noise = 2.5 * lfilter([np.sqrt(1 - fall**2)], [1, -fall], white)[:, 500:]
    tone = 3 * np.cos(2 * np.pi * FREQUENCY * times(samples).numpy())
    return tl.educe(on_cells(torch.from_numpy(noise + tone)), onera, background=1.0, **choices)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_bounds_hold_where_the_incoherent_part_is_brought_down(onera):
    """The tone is known no better for that: of 60 records of 40 periods nine in ten hold R."""
    generator = np.random.default_rng(5)
    long = in_turbulence(onera, 120_000, generator, interval=None).answer.real
    ends = [in_turbulence(onera, 1200, generator).bounds_of_liner("phase-locked") for _ in range(60)]
    held = [bool(low.real <= long <= high.real) for low, high in ends]
    assert sum(held) >= 52


@pytest.mark.parametrize("phase", ["averaged", "self-consistent"])
def test_intervals_are_those_of_that_velocity(onera, phase):
    """The lines taken out are themselves known only so well, so these are wider than of v* taken as exact."""
    velocity = mixed()
    choices = {"phase": phase, "minimum_coherence": 0.0}
    found = tl.educe(on_cells(velocity), onera, **choices)
    wanted = tl.educe(on_cells(by_hand(velocity)), onera, averaging="admittance", **choices)
    for mine, theirs in ((found.liner, wanted.liner), (found.cells, wanted.cells)):
        errors = mine["phase-locked"].interval.standard_error, theirs["admittance"].interval.standard_error
        ratio = errors[0].real / errors[1].real
        assert 0.9 < float(ratio.mean()) < 1.5
