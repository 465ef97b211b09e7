"""A duct says when its answer cannot be right: energy, growing waves, a second mesh, units."""

from __future__ import annotations

import json
import math
import warnings

import numpy as np
import pytest
import torch
from test_duct_command import MESH
from test_modes import B2A, HEIGHT, SPEED, TANH, UNIFORM, k_of, shoot

import torchliner as tl
from torchliner.cli.main import main
from torchliner.duct import settled as lee_settled
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import ParabolicProfile, TanhProfile, UniformProfile
from torchliner.duct.mesh import build_mesh
from torchliner.duct.modes import PridmoreBrown
from torchliner.duct.numerics import with_slopes
from torchliner.duct.settled import growing_wave, solve_settled
from torchliner.duct.solver import solve_duct
from torchliner.names import DIRECTIONS

MYERS, VELOCITY = "ingard-myers", "continuous-velocity"
STILL = UniformProfile(0.0, HEIGHT, SPEED)
COARSE = {"frequency": 1500.0, "column": 0.02, "row": 0.01}


def case_of(profile, liner=(0.0, 0.06), **about):
    return DuctCase(profile, -0.13, 0.19, liner, **about)


def coarse(case, impedance, **about):
    return solve_duct(case, 1500.0, impedance, build_mesh(case, **COARSE, **about))


@pytest.mark.parametrize(
    ("profile", "condition", "impedance", "within"),
    [
        (STILL, None, B2A, 1e-5),
        (STILL, None, [0.3 - 0.6j], 1e-4),
        (STILL, None, -0.5, 1e-3),  # a wall that gives
        (TANH, None, math.inf, 1e-6),
        (UNIFORM, MYERS, B2A, 0.03),  # the edges shed some
    ],
)
@pytest.mark.parametrize("source", DIRECTIONS)
@pytest.mark.filterwarnings("ignore:impedance has a negative resistance")
def test_energy_is_kept(profile, condition, impedance, within, source):
    """In = out + absorbed where the mean flow exchanges none."""
    case = case_of(profile, source=source, slip_condition=condition, end_reflection=0.3j)
    balance = coarse(case, impedance).energy
    assert abs(float(balance.missing)) < within
    if impedance == -0.5:
        assert float(balance.absorbed) < -0.1
    elif impedance == math.inf:
        assert float(balance.out) == pytest.approx(1, abs=1e-6)
    else:
        assert float(balance.absorbed) > 0.1


@pytest.mark.parametrize("wall", [B2A, 0.3 + 0j, 1.0 - 0.5j])
def test_the_growing_wave_of_a_vortex_sheet(wall):
    """A root of the dispersion relation in closed form."""
    alpha = growing_wave(UNIFORM, 1500.0, wall, MYERS)
    about = {"height": HEIGHT, "mach": 0.3, "sound_speed": SPEED}
    assert complex(tl.impedance_from_wavenumber(alpha, 1500.0, **about)) == pytest.approx(wall)
    assert float(alpha.imag) > 10


@pytest.mark.parametrize(
    ("profile", "frequency", "wall"),
    [(TANH, 1000.0, 0.3), (TANH, 1500.0, 0.3), (TanhProfile(0.3, HEIGHT, 0.05, SPEED), 1500.0, 1.0)],
)
def test_the_growing_wave_of_a_layer(profile, frequency, wall):
    """The Euler equations integrated from the rigid wall by another method meet the wall's law."""
    alpha = complex(growing_wave(profile, frequency, wall))
    p, v = shoot(profile, alpha, k_of(frequency))
    assert -p / v == pytest.approx(wall, rel=1e-4)
    assert alpha.imag > 10


def test_the_growing_wave_runs_downstream():
    """Briggs: with a source that is switched on ever faster it decays on its own side."""
    alpha = growing_wave(TANH, 1000.0, 0.3)
    a, wall = alpha * HEIGHT, torch.tensor((0.3 - 1) / (0.3 + 1), dtype=torch.complex128)
    equation = PridmoreBrown(TANH, split=6)
    for s in np.linspace(0, 2, 41):
        kappa = torch.tensor([k_of(1000.0) * HEIGHT * (1 - 1j * s)])
        for _ in range(4):
            value, slope = with_slopes(lambda z, k=kappa: equation.residual(z, k, wall)[0], a)
            a = a - value / slope
    assert float(a.imag) < -0.5


@pytest.mark.parametrize(
    ("profile", "wall", "condition"),
    [
        (TANH, B2A, None),
        (TANH, math.inf, None),
        (STILL, 0.3, None),
        (UNIFORM, 0.3, VELOCITY),
        (ParabolicProfile(0.3, HEIGHT, SPEED), 0.3, None),
    ],
)
def test_ducts_without_a_growing_wave(profile, wall, condition):
    assert bool(torch.isnan(growing_wave(profile, 1500.0, wall, condition).real).all())


def test_a_mesh_that_was_fine_enough_keeps_its_numbers():
    case = case_of(TANH)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solve_settled(case, 1500.0, B2A, places=[-0.1, 0.02, 0.15])
    wanted = solve_duct(case, 1500.0, B2A)
    assert complex(found.transmission) == complex(wanted.transmission)
    assert 0 < float(found.difference) < 0.05
    assert found.finer_unknowns > wanted.mesh.unknowns


def test_fields_of_no_meaning_are_refused(monkeypatch):
    """Growth above 100 dB over the liner; meshes that differ."""
    said = r"grows along the liner, alpha = 227\.4\+38\.07j 1/m, by 165 dB over it, above 100 dB"
    with pytest.raises(RuntimeError, match=said):
        solve_settled(DuctCase(TANH, -0.13, 0.7, (0.0, 0.5)), 1500.0, 0.3)
    monkeypatch.setattr(lee_settled, "SETTLED", 1e-9)
    with pytest.warns(tl.DataWarning, match=r"not settled: \d+ unknowns move that of \d+ by"):
        solve_settled(case_of(STILL), 1500.0, B2A)
    monkeypatch.setattr(lee_settled, "REFUSED", 1e-9)
    with pytest.raises(RuntimeError, match="the field is noise of the mesh"):
        solve_settled(case_of(STILL), 1500.0, B2A)


def told(words, capsys):
    assert main(["duct", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_solve_states_its_doubts(tmp_path, capsys):
    """Growth, energy and the meshes in the table, JSON and the file of microphones."""
    words = ["solve", "b2a", "--impedance", "0.3", "--mesh", "0.02", "0.0005"]
    assert main(["duct", *words, "-o", str(tmp_path / "m.h5")]) == 0
    row = tl.read_microphones(tmp_path / "m.h5").provenance["plane_mode"][0]
    assert row["growth over the liner (dB)"] == pytest.approx(49.65, abs=0.01)
    assert row["energy out"] > 1
    assert row["mesh difference (dB)"] is None
    total = row["energy out"] + row["energy absorbed"] + row["energy missing"]
    assert total == pytest.approx(1)
    assert f"{row['energy out']:.3g} times" in capsys.readouterr().err


def test_a_liner_is_a_ducts_wall(tmp_path, capsys):
    """Z(f) of a preset, or of a table over frequency."""
    wanted = tl.load_liner("polito").impedance([900.0, 1200.0], 2.0)
    (tmp_path / "z.csv").write_text(
        "frequency [kHz],resistance,reactance\n"
        + "".join(f"{f},{z.real:.17g},{z.imag:.17g}\n" for f, z in zip((0.9, 1.2), wanted.tolist(), strict=True))
    )
    about = ["--bulk-mach", "0", "--frequency", "900", "1200", *MESH, "--quiet"]
    one = told(["solve", "b2a", "--liner", "polito", "--speed", "2", *about], capsys)
    other = told(["solve", "b2a", "--liner", str(tmp_path / "z.csv"), *about], capsys)
    for row, same in zip(one["rows"], other["rows"], strict=True):
        assert {k: v or 0 for k, v in row.items()} == pytest.approx({k: v or 0 for k, v in same.items()})
    assert one["duct"]["sound"]["liner"] == "polito"
    case = tl.load_duct("b2a", bulk_mach=0.0).case
    for f, z, row in zip((900.0, 1200.0), wanted.tolist(), one["rows"], strict=True):
        mesh = build_mesh(case, 1200.0, column=0.01, row=0.01)
        alone = solve_duct(case, f, z, mesh)
        assert abs(complex(alone.transmission)) == pytest.approx(row["transmission"], rel=1e-9)
