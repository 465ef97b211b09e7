"""Kumaresan and Tufts on synthetic lines: exact without noise, errors as they are drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from conftest import relative_error

import torchliner as tl
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.names import CONDITIONS
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import MicrophoneLine

HEIGHT, SPACING, COUNT = 0.05, 0.012, 12
FREQUENCY = torch.tensor([600.0, 1000.0, 1500.0], dtype=torch.float64)
WALLS = torch.tensor([0.8 - 1.2j, 1.5 + 0.3j, 2.33 - 0.3j], dtype=torch.complex128)
X = torch.arange(COUNT, dtype=torch.float64) * SPACING
OTHER = {"upstream": "downstream", "downstream": "upstream"}


def wave(side: str, x=X, *, mach=0.3, walls=WALLS, condition="ingard-myers", mode=0, back=False):
    """e^{-j alpha x} of the mode that runs away from a source on one side, 1 at its end of x;
    ``back`` is the one that runs towards it, 1 at the other end."""
    direction = side if back else OTHER[side]
    alpha = wavenumber_from_impedance(
        walls,
        FREQUENCY,
        height=HEIGHT,
        mach=mach,
        condition=condition,
        direction=direction,
        mode=mode,
    )
    origin = x[0] if (side == "upstream") != back else x[-1]
    return torch.exp(-1j * alpha * (x[:, None] - origin)), alpha


def line_of(pressure, side="upstream", x=X, **about) -> MicrophoneLine:
    about = {"duct_height": HEIGHT, "mach": 0.3, "source_side": side, **about}
    return MicrophoneLine(x, pressure, about.pop("frequency", FREQUENCY), **about)


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize(("rank", "order"), [(1, 1), (1, 6), (2, 2), (2, 4), (3, 6), (6, 6)])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_one_wave_is_exact(side, rank, order, condition):
    """Z in is Z out to 1e-10 at any order, and a rank above the one wave that is there."""
    pressure, alpha = wave(side, condition=condition)
    found = kumaresan_tufts(line_of(100 * pressure, side), rank=rank, order=order, condition=condition)
    assert relative_error(found.impedance, WALLS) < 1e-10
    assert relative_error(found.wavenumber, alpha) < 1e-11
    assert float(found.residual.max()) < 1e-12
    assert found.singular_values.shape == (order, 3)
    if order > 1:  # one wave, one singular value
        assert float((found.singular_values[1:] / found.singular_values[0]).max()) < 1e-13
    assert relative_error(found.pressure_at(X), 100 * pressure) < 1e-10
    assert float((spl_from_pressure_amplitude(found.pressure_at(X)) - line_of(100 * pressure).level).abs().max()) < 1e-9


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize(("rank", "order"), [(2, 2), (2, 3), (2, 6), (3, 6)])
def test_incident_and_reflected(side, rank, order):
    """Both waves come out with their amplitudes; the impedance is that of the one from the source,
    even where it has less energy over the array."""
    there, alpha = wave(side)
    back, beta = wave(side, back=True)
    amplitude = 600 * np.exp(0.7j)
    line = line_of(100 * there + amplitude * back, side)
    with pytest.warns(tl.DataWarning, match="of the energy of the strongest wave: the source may"):
        found = kumaresan_tufts(line, rank=rank, order=order)
    # Both waves are of one wall: the impedance alone could not tell which was taken.
    assert relative_error(found.wavenumber, alpha) < 1e-9
    assert relative_error(found.impedance, WALLS) < 1e-9
    strongest = found.amplitudes.abs().argsort(0, descending=True)[:2]
    modes = found.modes.gather(0, strongest)
    for f in range(len(FREQUENCY)):
        wanted = {complex(alpha[f]), complex(beta[f])}
        for mode in modes[:, f].tolist():
            assert min(abs(mode - each) for each in wanted) < 1e-9
    assert relative_error(found.pressure_at(X), 100 * there + amplitude * back) < 1e-9


def test_of_two_modes_the_stronger_one():
    """Mode 1 beside mode 0: their energies over the array decide, not their order."""
    plane, first = wave("upstream")[0], wave("upstream", mode=1)[0]
    for weights, mode in (((100, 30), 0), ((0.3, 100), 1)):
        pressure = weights[0] * plane + weights[1] * first
        found = kumaresan_tufts(line_of(pressure), rank=2, order=4)
        wanted = wave("upstream", mode=mode)[1]
        assert relative_error(found.wavenumber, wanted) < 1e-8
        assert relative_error(found.impedance, WALLS) < 1e-7


def test_microphones_over_the_liner_alone_are_used():
    """Those before and behind it see other waves; ``margin`` keeps off its ends."""
    pressure = wave("upstream")[0].clone()
    pressure[:2] = 50.0
    pressure[-1] = 9j
    line = line_of(pressure, liner_start=float(X[2]) - 1e-3, liner_end=float(X[-2]) + 1e-3)
    found = kumaresan_tufts(line)
    assert found.x.tolist() == X[2:-1].tolist()
    assert found.order == 4
    assert relative_error(found.impedance, WALLS) < 1e-10
    assert len(kumaresan_tufts(line, margin=2e-3).x) == 7


def noisy(pressure, count: int, seed: int):
    """Independent realisations, through levels and phases, 0.1 dB and 0.1 degrees."""
    random = np.random.default_rng(seed)
    line = line_of(pressure)
    level = line.level.numpy() + 0.1 * random.standard_normal((count, *line.pressure.shape))
    phase = line.phase.numpy() + 0.1 * random.standard_normal((count, *line.pressure.shape))
    return MicrophoneLine.from_levels(X, level, phase, FREQUENCY, duct_height=HEIGHT, mach=0.3, source_side="upstream")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"order": 7}, "12 microphones are fewer than twice the order, 7; the most is 6"),
        (
            {"rank": 7},
            "12 microphones allow an order of 6, half of them, below the rank, 7",
        ),
        ({"rank": 7, "order": 6}, "rank is 7; it must be 1 to the order, 6"),
        ({"source_side": "left"}, "source_side is 'left'; give 'upstream' or 'downstream'"),
        ({"condition": "myers"}, "unknown condition 'myers' .did you mean 'ingard-myers'"),
        ({"draws": -1}, "draws is -1; 0 for none, or at least 2"),
        ({"draws": 5, "phase_error": math.nan}, r"phase_error \(degrees\) is nan"),
        ({"margin": 0.2}, "0 microphones lie over the liner"),
    ],
)
def test_refusals(options, match):
    line = line_of(wave("upstream")[0], liner_start=-0.01, liner_end=0.15)
    with pytest.raises(ValueError, match=match):
        kumaresan_tufts(line, **options)


LIMIT = cut_on_frequency(UniformProfile(0.3, HEIGHT, tl.Fluid().sound_speed))
DOUBTS = [
    (lambda: line_of(wave("upstream")[0], frequency=[1000.0, 1500.0, LIMIT + 1]), f"{LIMIT:.4g} Hz .* 50 mm"),
    (lambda: line_of(wave("upstream")[0], duct_width=0.15), "width, 150 mm"),
    (lambda: line_of(torch.exp(-1j * (5 - 0.5j) * APART[:, None]).expand(-1, 3), x=APART), "1115 Hz .* 200 mm"),
    (lambda: line_of(torch.exp(-1j * (20 + 0.5j) * X[:, None]).expand(-1, 3)), "at 3 of 3 .* resistance is negative"),
]
APART = 0.2 * torch.arange(12, dtype=torch.float64)


@pytest.mark.parametrize(("line", "words"), DOUBTS)
def test_doubts_are_warned_of(line, words):
    """Higher modes, half a wavelength, a wave that gains."""
    with pytest.warns(tl.DataWarning, match=words):
        kumaresan_tufts(line())


@pytest.mark.filterwarnings("ignore:.*draws have no impedance")
def test_a_frequency_without_a_wave_is_kept_and_told():
    mixed = wave("upstream")[0].clone()
    mixed[:, 1] = mixed[:, 1].conj()
    with pytest.warns(tl.DataWarning, match="at 1 of 3 values, first at 1000 Hz, no wave"):
        found = kumaresan_tufts(line_of(mixed), rank=1, draws=10)
    assert torch.isnan(found.impedance[1].real)
    assert found.failed.tolist() == [0, 10, 0]
    assert "lost-draws" in {note.code for note in found.notes}
    assert torch.isfinite(found.mean[[0, 2]]).all()
