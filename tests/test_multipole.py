"""Poles and residues: exact where R is rational, stable, passive, and met by the recursion in time."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import torch
from torch import Tensor

import torchliner as tl
from torchliner.conversions import admittance_from_reflection
from torchliner.liners.multipole import Multipole

FREQUENCY = torch.linspace(500.0, 4000.0, 36, dtype=torch.float64)
EVERYWHERE = torch.cat([torch.linspace(0, 2e4, 100_001), torch.logspace(4.3, 7, 3001)]).double()


def resonator(f: Tensor, *, resistance: float = 0.6, mass: float = 2e-4, stiffness: float = 6e3) -> Tensor:
    """Z = R + s m + k/s: R has two poles exactly."""
    s = 2j * torch.pi * f
    return resistance + s * mass + stiffness / s


def excess(model: Multipole) -> float:
    """Largest |R| - 1 from 0 to 100 MHz, looked for closely around each pole."""
    around = torch.tan(torch.linspace(-1.57, 1.57, 10_001)).double()
    near = [(p.imag - p.real * around).abs() / (2 * math.pi) for p in model.poles]
    return float(model.reflection(torch.cat([EVERYWHERE, *near])).abs().max()) - 1


def of(liner: str = "onera", poles: int = 8) -> Multipole:
    return tl.fit_multipole(FREQUENCY, tl.load_liner(liner).impedance(FREQUENCY, torch.tensor(3.0).double()), poles)


@pytest.mark.parametrize("resistance", [0.6, 4.0])  # conjugate poles, and two real ones
@pytest.mark.parametrize("poles", [2, 3])
def test_a_resonator_is_found_exactly(resistance: float, poles: int) -> None:
    model = tl.fit_multipole(FREQUENCY, resonator(FREQUENCY, resistance=resistance), poles)
    if poles == 2:  # s^2 m + s (R + 1) + k = 0
        root = torch.sqrt(torch.tensor((resistance + 1) ** 2 - 4 * 2e-4 * 6e3).to(torch.complex128))
        wanted = torch.stack([-(resistance + 1) + root, -(resistance + 1) - root]) / (2 * 2e-4)
        nearest = (model.poles[:, None] - wanted).abs().amin(0) / wanted.abs()
        assert float(nearest.max()) < 1e-6
    assert model.error < 1e-6
    beyond = torch.tensor([100.0, 10e3]).double()
    torch.testing.assert_close(model.impedance(beyond), resonator(beyond, resistance=resistance), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("liner", ["onera", "lbm_slit"])
@pytest.mark.parametrize(("poles", "error"), [(4, 0.03), (7, 0.015), (8, 0.01)])
def test_a_perforated_liner_is_met_by_a_stable_and_passive_model(liner: str, poles: int, error: float) -> None:
    model = of(liner, poles)
    assert len(model.poles) == len(model.residues) == poles
    assert float(model.poles.real.max()) < 0
    assert excess(model) < 1e-11
    assert model.error < error
    stated = (
        (
            model.reflection(FREQUENCY)
            - tl.reflection_from_impedance(tl.load_liner(liner).impedance(FREQUENCY, torch.tensor(3.0).double()))
        )
        .abs()
        .max()
    )
    assert float(stated) == pytest.approx(model.error, rel=1e-6)
    conjugates = (model.poles[:, None] - model.poles.conj()).abs().amin(0)
    assert float((conjugates / model.poles.abs()).max()) < 1e-12


def test_a_wall_that_gives_energy_becomes_passive_and_says_what_that_cost() -> None:
    z = resonator(FREQUENCY, resistance=0.05)
    z[10:14] -= 0.2  # |R| > 1 there
    model = tl.fit_multipole(FREQUENCY, z, 6)
    assert excess(model) < 1e-11
    assert model.correction > 1e-3
    assert model.error > 0.01


@pytest.mark.parametrize("frequency", [700.0, 2100.0])
def test_a_tone_through_the_recursion_meets_r_to_second_order(frequency: float) -> None:
    model, off = of(), []
    for rate in (100e3, 200e3):
        time = torch.arange(int(0.1 * rate)) / rate
        wave = torch.exp(2j * torch.pi * frequency * time.double())
        back = torch.complex(model.reflect(wave.real, rate), model.reflect(wave.imag, rate))
        off.append(abs(complex((back / wave)[-1]) - complex(model.reflection(torch.tensor(frequency)))))
    assert off[1] < 1e-3
    assert off[0] / off[1] == pytest.approx(4, rel=0.05)


def test_a_pulse_through_the_recursion_meets_r_and_gains_no_energy() -> None:
    model, rate = of(), 400e3
    time = (torch.arange(1 << 15) - 400) / rate
    pulse = torch.exp(-((time * 2 * math.pi * 2000) ** 2).double())
    back = model.reflect(torch.stack([pulse, 2 * pulse]), rate)
    torch.testing.assert_close(back[1], 2 * back[0])
    assert float(back[0].square().sum()) < float(pulse.square().sum())
    spectra, lines = torch.fft.rfft(torch.stack([pulse, back[0]])), torch.fft.rfftfreq(len(pulse), 1 / rate).double()
    band = (lines > 500) & (lines < 4000)
    found, wanted = (spectra[1] / spectra[0])[band], model.reflection(lines[band])
    assert float((found - wanted).abs().max()) < 2e-3


def read_back(text: str, name: str) -> Tensor:
    """R or the admittance at ``FREQUENCY`` from a file of coefficient lists, by the formula in its head."""
    own = text[text.index(f"\n{name}\n") :]
    own = own[: own.index("}")]
    constant = float(re.search(r"constant\s+(\S+);", own)[1])  # type: ignore[index]
    rows = [[float(each) for each in row.split()] for row in re.findall(r"\(([^()\n]+)\)", own)]
    s = 2j * torch.pi * FREQUENCY
    found = torch.full_like(s, constant)
    for row in rows:
        if len(row) == 2:
            found += row[1] / (s + row[0])
        else:
            alpha, beta, b, c = row
            found += ((b + 1j * c) / (s + alpha + 1j * beta) + (b - 1j * c) / (s + alpha - 1j * beta)) / 2
    return found


@pytest.mark.parametrize("poles", [7, 8])
def test_coefficient_lists_give_r_and_the_admittance(tmp_path: Path, poles: int) -> None:
    model = of(poles=poles)
    model.write(tmp_path / "liner.txt")
    text = (tmp_path / "liner.txt").read_text()
    r = model.reflection(FREQUENCY)
    torch.testing.assert_close(read_back(text, "reflection"), r)
    torch.testing.assert_close(read_back(text, "admittance"), admittance_from_reflection(r))
    assert float(model.admittance()[0].real.max()) < 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poles": 36}, "36 poles .* 36 frequencies"),
        ({"poles": 0}, "0 poles"),
        ({"impedance": resonator(FREQUENCY)[:5]}, r"shape \(5,\)"),
        ({"impedance": torch.where(FREQUENCY == 1000, math.nan, resonator(FREQUENCY))}, "nan, inf or -1 at 1000 Hz"),
        ({"impedance": torch.where(FREQUENCY == 1000, -1, resonator(FREQUENCY))}, "nan, inf or -1 at 1000 Hz"),
        ({"impedance": -resonator(FREQUENCY)}, "negative at every frequency"),
    ],
)
def test_what_cannot_be_fitted_is_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"frequency": FREQUENCY, "impedance": resonator(FREQUENCY), "poles": 4} | change
    with pytest.raises(ValueError, match=message):
        tl.fit_multipole(**arguments)
