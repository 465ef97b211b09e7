"""Two waves of one wall, fitted: exact without noise, least deviation with it; sorted waves."""

from __future__ import annotations

import cmath
import dataclasses
import math

import pytest
import torch
from conftest import relative_error
from test_wall_pressure import FREQUENCY, HEIGHT, OTHER, WALLS, X, line_of, noisy, wave

from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.names import CONDITIONS
from torchliner.pressure.plane_waves import sort_waves
from torchliner.pressure.two_waves import two_wave_fit
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import MicrophoneLine

UNEVEN = torch.tensor([0.0, 0.011, 0.03, 0.037, 0.064, 0.083, 0.1, 0.13], dtype=torch.float64)


def both_ways(side="upstream", x=X, share=0.3 + 0.2j, **about):
    """100 Pa away from the source and a share of it back, with their wavenumbers."""
    there, alpha = wave(side, x, **about)
    back, beta = wave(side, x, back=True, **about)
    return 100 * (there + share * back), alpha, beta


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_known_walls_come_back(side, tied, condition):
    """Z, both wavenumbers and amplitudes, from microphones at uneven places."""
    pressure, alpha, beta = both_ways(side, UNEVEN, condition=condition)
    found = two_wave_fit(line_of(pressure, side, UNEVEN), tied=tied, condition=condition)
    assert relative_error(found.impedance, WALLS) < 1e-9
    assert relative_error(found.modes, torch.stack([alpha, beta])) < 1e-9
    assert relative_error(found.pressure_at(UNEVEN), pressure) < 1e-9
    assert float(found.residual.max()) < 1e-11
    assert found.choices["unsettled"] == 0
    assert found.singular_values is None


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("side", OTHER)
def test_no_guess_is_needed(side, condition):
    """60 walls with resistances of 0.1 to 6 and reactances of -4 to 4, without a start."""
    random = torch.Generator().manual_seed(4)
    draws = torch.rand(2, 60, generator=random, dtype=torch.float64)
    walls = torch.complex(0.1 * 60 ** draws[0], 8 * draws[1] - 4)
    alphas = [
        wavenumber_from_impedance(walls, 1200.0, height=HEIGHT, mach=0.3, condition=condition, direction=d)
        for d in ("downstream", "upstream")
    ]
    ends = (X[0], X[-1])
    parts = [torch.exp(-1j * alpha[:, None] * (X - end)) for alpha, end in zip(alphas, ends, strict=True)]
    mix = (1.0, 0.2) if side == "upstream" else (0.2, 1.0)
    pressure = (mix[0] * parts[0] + mix[1] * parts[1])[..., None]
    found = two_wave_fit(line_of(pressure, side, frequency=1200.0), condition=condition)
    wrong = (found.impedance[:, 0] / walls - 1).abs() > 1e-6
    # One microphone alone sees a wave back that decays within a spacing: then the valley of the
    # residual is too narrow to follow, and Z is good to 1e-2 instead.
    back = alphas[1 if side == "upstream" else 0]
    assert bool((back.imag[wrong].abs() * 0.012 > 2).all())
    assert int(wrong.sum()) <= 1
    assert relative_error(found.impedance[:, 0], walls) < 1e-2


def test_tied_waves_belong_to_one_wall_whatever_the_noise():
    """Both wavenumbers give the same Z when tied, two when free; free fits leave less."""
    line = noisy(both_ways()[0], 20, seed=11)
    about = {"height": HEIGHT, "mach": 0.3}
    tied, free = (two_wave_fit(line, tied=t) for t in (True, False))
    for found, limit in ((tied, 1e-9), (free, math.inf)):
        walls = impedance_from_wavenumber(found.modes, FREQUENCY, **about)
        apart = (walls[:, 0] - walls[:, 1]).abs() / walls[:, 0].abs()
        assert float(apart.max()) < limit
    assert float(apart.min()) > 1e-4
    assert bool((free.residual <= tied.residual * (1 + 1e-9)).all())


def test_ties_and_drawn_errors():
    """Deviations: drawn ones are the scatter of realisations, and a tie lowers them. The mean is
    unbiased within its own error; that of Kumaresan and Tufts need not be."""
    pressure = both_ways()[0]
    scatter = two_wave_fit(noisy(pressure, 300, seed=1)).impedance
    one = noisy(pressure, 1, seed=2)
    line = dataclasses.replace(one, pressure=one.pressure[0])
    found = two_wave_fit(line, draws=300, generator=torch.Generator().manual_seed(3))
    for part in ("real", "imag"):
        drawn, seen = getattr(found.standard_deviation, part), getattr(scatter, part).std(0)
        # 4 % for each deviation from 300 values; the slope at a noisy line differs by a few %.
        assert drawn.tolist() == pytest.approx(seen.tolist(), rel=0.2)
        bias = getattr(scatter.mean(0) - WALLS, part).abs()
        assert bool((bias < 4 * seen / math.sqrt(300)).all())
    free = two_wave_fit(line, tied=False, draws=100)
    others = kumaresan_tufts(line, draws=100)
    assert bool((found.standard_deviation.abs() < free.standard_deviation.abs()).all())
    assert bool((found.standard_deviation.abs() < others.standard_deviation.abs()).all())


def rigid_line(mach=0.25, side="upstream", **about) -> MicrophoneLine:
    """120 dB downstream and half of it back at x = 0, before a liner from 0.2 to 0.6 m."""
    x = torch.tensor([-0.3, -0.11, -0.05, 0.3, 0.5, 0.9, 1.15], dtype=torch.float64)[:, None]
    k = 2 * math.pi * FREQUENCY / 343.2
    size = 2**0.5 * 20.0
    pressure = size * (torch.exp(-1j * k * x / (1 + mach)) + 0.5j * torch.exp(1j * k * x / (1 - mach)))
    about = {"liner_start": 0.2, "liner_end": 0.6, **about}
    return line_of(pressure, side, x[:, 0], mach=mach, **about)


def test_two_flush_microphones_set_the_level():
    """120 dB at the liner's edge, reflection turned there; the side of the source decides which
    wave is the incident one."""
    line = rigid_line()
    for some in ([1, 2], [0, 2], None):
        found = sort_waves(line, some)
        assert found.incident_level.tolist() == pytest.approx([120.0] * 3, abs=1e-9)
        assert found.at == 0.2
        for f, hertz in enumerate(FREQUENCY.tolist()):
            k = 2 * math.pi * hertz / 343.2
            turn = cmath.exp(1j * k * 0.2 / 0.75) / cmath.exp(-1j * k * 0.2 / 1.25)
            assert complex(found.reflection[f]) == pytest.approx(0.5j * turn, abs=1e-9)
    assert found.microphones.tolist() == [-0.3, -0.11, -0.05]
    with pytest.raises(ValueError, match="at is nan m; it must be finite"):
        sort_waves(line, at=math.nan)
    at_zero = sort_waves(line, at=0.0)
    assert at_zero.reflection.tolist() == pytest.approx([0.5j] * 3, abs=1e-9)
    behind = sort_waves(rigid_line(side="downstream"))
    assert behind.microphones.tolist() == [0.9, 1.15]
    assert behind.incident_level.tolist() == pytest.approx([120 + 20 * math.log10(0.5)] * 3)
    assert behind.at == 0.6
    drawn = dataclasses.replace(line, pressure=torch.stack([line.pressure, 2 * line.pressure]))
    assert sort_waves(drawn).incident_level[1].tolist() == pytest.approx([126.0206] * 3, abs=1e-4)


def test_refusals():
    line = line_of(both_ways(x=UNEVEN)[0], x=UNEVEN)
    for tied, count, words in ((True, 3, "tied waves need at least 4"), (False, 4, "free waves need at least 5")):
        with pytest.raises(ValueError, match=rf"{count} microphones are used; two {words}"):
            two_wave_fit(line.select(range(count)), tied=tied)
    with pytest.raises(ValueError, match="source_side is 'unknown'"):
        two_wave_fit(dataclasses.replace(line, source_side="unknown"))
    with pytest.raises(ValueError, match="does not say where its liner is"):
        sort_waves(dataclasses.replace(rigid_line(), liner_start=None, liner_end=None))
    with pytest.raises(ValueError, match="0 microphones stand before the liner"):
        sort_waves(dataclasses.replace(rigid_line(), liner_start=-0.5))
    x = torch.tensor([0.0, 343.2 * (1 - 0.25**2) / 2000.0], dtype=torch.float64)
    with pytest.raises(ValueError, match="spacing is 1 times half a wavelength"):
        sort_waves(line_of(torch.ones(2, 1) + 0j, x=x, mach=0.25, frequency=1000.0), [0, 1])
