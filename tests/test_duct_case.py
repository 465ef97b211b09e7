"""Flow, cases, meshes and walls of a duct, its energy and settled meshes: laws, refusals, doubts."""

import itertools
import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.integrate import quad, trapezoid
from test_dispersion import B2A, FREQUENCY, HEIGHT, SPEED, TANH, UNIFORM
from test_duct_command import MESH

import torchliner as tl
from torchliner.cli.main import main
from torchliner.duct import settled as lee_settled
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import ParabolicProfile, TabulatedProfile, TanhProfile, UniformProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.settled import solve_settled
from torchliner.duct.solver import DuctSolver, solve_duct
from torchliner.names import DIRECTIONS

STILL = UniformProfile(0.0, HEIGHT, SPEED)


def case_of(**about):
    about = {"profile": STILL, "start": -0.2, "end": 0.35, "liner": (0.0, 0.15), **about}
    return DuctCase(**about)


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"end": -0.3}, r"duct length, end - start \(m\) is -0\.1"),
        ({"end": math.nan}, "end is nan; it must be finite"),
        ({"liner": (0.0, 0.4)}, r"from x = 0 to 0\.4 m .* and 0\.35 m"),
        ({"liner": (0.1, 0.0)}, r"from x = 0\.1 to 0 m must have a length"),
        ({"liner": [(0.0, 0.1), (0.05, 0.15)]}, r"from x = 0\.05 to 0\.15 m .* between 0\.1 m"),
        ({"source": "left"}, "unknown source 'left'"),
        ({"slip_condition": "myers"}, "unknown slip condition 'myers'"),
        ({"incident": complex(1, math.inf)}, r"incident is \(1\+infj\)"),
        ({"source_reflection": torch.tensor([0.1, math.inf])}, r"source_reflection is tensor\(\["),
    ],
)
def test_cases_refused(about, match):
    with pytest.raises(ValueError, match=match):
        case_of(**about)


X, Y = np.array([-0.2, 0.0, 0.15, 0.35]), np.array([0.0, 0.02, 0.05])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"degree": 0}, "degree is 0; it must be finite and above 0"),
        ({"y": Y[:1]}, "mesh y must be edges that increase"),
        ({"x": X[:3]}, r"mesh x must be .* from -0\.2 to 0\.35 m"),
        ({"x": X[[0, 2, 3]]}, r"edge at x = 0 m lies inside a column; make it an edge"),
    ],
)
def test_meshes_refused(change, match):
    with pytest.raises(ValueError, match=match):
        DuctMesh(**{"case": case_of(), "x": X, "y": Y, "degree": 2, **change})


def test_coarse_meshes_are_named():
    case = case_of(profile=UNIFORM, slip_condition="continuous-velocity")
    mesh = DuctMesh(case, np.linspace(-0.2, 0.35, 12), Y, 4)
    mesh.warn_if_coarse(FREQUENCY)  # quiet
    with pytest.warns(tl.DataWarning, match=r"2900 Hz: 8\.28 points per wavelength .* below 9 for"):
        mesh.warn_if_coarse(2900.0)
    with pytest.warns(tl.DataWarning, match="800 Hz: 12 points per wavelength .* below 30 for degree 1"):
        DuctSolver(case, 800.0, DuctMesh(case, mesh.x, Y, 1))


def test_cut_on_modes_are_named():
    with pytest.warns(tl.DataWarning, match=r"at 3600 Hz mode 1 runs too: its cut-on is about 3272 Hz"):
        solve_duct(case_of(profile=UNIFORM, liner=()), [1500.0, 3600.0])


def test_near_ends_are_named():
    """Mode 1 decays by sqrt((pi/H)^2 - k^2): 56.5 1/m at 1500 Hz, without flow."""
    share = math.exp(-0.05 * math.sqrt((math.pi / 0.05) ** 2 - (2 * math.pi * 1500 / SPEED) ** 2))
    for near in ({"start": -0.05}, {"end": 0.2}):
        with pytest.warns(tl.DataWarning, match=rf"so near an end that {100 * share:.2g} % of mode 1"):
            DuctSolver(case_of(**near), FREQUENCY)


@pytest.mark.parametrize(
    ("impedance", "match"),
    [
        (math.nan, "impedance is nan or -1"),
        (torch.ones(2, 2, 1), r"shape \(2, 2, 1\); its last two axes must fit \(1, 1\)"),
        (lambda x, f: torch.ones(len(x) + 1), r"shape \(121,\); its last two axes must fit \(1, 120\)"),
    ],
)
def test_walls_refused(impedance, match):
    solver = DuctSolver(case_of(), FREQUENCY)
    with pytest.raises(ValueError, match=match):
        solver.solve(impedance)


def test_resonance_is_singular():
    length = 0.55
    frequency = 4 * SPEED / (2 * length)
    closed = case_of(liner=(), end_reflection=1.0, source_reflection=1.0)
    mesh = build_mesh(closed, frequency, degree=8, column=0.02)
    with pytest.raises(RuntimeError, match=r"singular: their solution leaves a residual of .* of"):
        solve_duct(closed, frequency, mesh=mesh)


def test_the_solver_says_what_it_lacks():
    said = r"slips along the lined wall at Mach 0\.3; say which .*'ingard-myers'.*'continuous-velocity'"
    with pytest.raises(ValueError, match=said):
        DuctSolver(case_of(profile=UNIFORM), FREQUENCY)
    case = case_of()
    with pytest.raises(ValueError, match="built for another DuctCase"):
        DuctSolver(case, FREQUENCY, build_mesh(case_of(), FREQUENCY))
    field = solve_duct(case, FREQUENCY, B2A)
    for call, match in (
        (lambda: field.at([0.0, 0.36], 0.01), r"x = 0\.36 m lies outside the duct, -0\.2 to 0\.35 m"),
        (lambda: field.at(0.0, 0.06), r"y = 0\.06 m lies outside the duct, 0 to 0\.05 m"),
        (lambda: field.wall_pressure(0.0, "upper"), "wall 'upper'"),
    ):
        with pytest.raises(ValueError, match=match):
            call()


MYERS = "ingard-myers"
COARSE = {"frequency": 1500.0, "column": 0.02, "row": 0.01}


def lined(profile, liner=(0.0, 0.06), **about):
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
    case = lined(profile, source=source, slip_condition=condition, end_reflection=0.3j)
    balance = coarse(case, impedance).energy
    assert abs(float(balance.missing)) < within
    if impedance == -0.5:
        assert float(balance.absorbed) < -0.1
    elif impedance == math.inf:
        assert float(balance.out) == pytest.approx(1, abs=1e-6)
    else:
        assert float(balance.absorbed) > 0.1


def test_a_mesh_that_was_fine_enough_keeps_its_numbers():
    case = lined(TANH)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solve_settled(case, 1500.0, B2A, places=[-0.1, 0.02, 0.15])
    wanted = solve_duct(case, 1500.0, B2A)
    assert complex(found.transmission) == complex(wanted.transmission)
    assert 0 < float(found.difference) < 0.05
    assert found.finer_unknowns > wanted.mesh.unknowns


def test_fields_of_no_meaning_are_named_or_refused(monkeypatch):
    """A shear layer that feeds a wave above a soft wall; meshes that differ."""
    long = DuctCase(TANH, -0.13, 0.7, (0.0, 0.5))
    with pytest.warns(tl.DataWarning, match=r"at 1500 Hz .* 6\.\d*e\+05 times the energy that comes in goes out"):
        solve_duct(long, 1500.0, 0.3)
    monkeypatch.setattr(lee_settled, "SETTLED", 1e-9)
    with pytest.warns(tl.DataWarning, match=r"not settled: \d+ unknowns move that of \d+ by"):
        solve_settled(lined(STILL), 1500.0, B2A)
    monkeypatch.setattr(lee_settled, "REFUSED", 1e-9)
    with pytest.raises(RuntimeError, match="the field is noise of the mesh"):
        solve_settled(lined(STILL), 1500.0, B2A)


def test_solve_states_its_doubts(tmp_path, capsys):
    words = ["solve", "b2a", "--impedance", "0.3", "--mesh", "0.02", "0.0005"]
    assert main(["duct", *words, "-o", str(tmp_path / "m.h5")]) == 0
    row = tl.read_microphones(tmp_path / "m.h5").provenance["plane_mode"][0]
    assert row["energy out"] > 1
    assert "mesh difference (dB)" not in row
    total = row["energy out"] + row["energy absorbed"] + row["energy missing"]
    assert total == pytest.approx(1)
    assert f"{row['energy out']:.3g} times" in capsys.readouterr().err


def test_a_liner_is_a_ducts_wall(tmp_path, capsys):
    wanted = tl.load_liner("polito").impedance([900.0, 1200.0], 2.0)
    rows = [f"{f},{z.real:.17g},{z.imag:.17g}" for f, z in zip((0.9, 1.2), wanted.tolist(), strict=True)]
    (tmp_path / "z.csv").write_text("\n".join(["frequency [kHz],resistance,reactance", *rows]))
    about = ["--bulk-mach", "0", "--frequency", "900", "1200", *MESH, "--quiet"]
    found = []
    for liner in (["polito", "--speed", "2"], [str(tmp_path / "z.csv")]):
        assert main(["duct", "solve", "b2a", "--liner", *liner, *about, "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    one, other = found
    for row, same in zip(one["rows"], other["rows"], strict=True):
        assert {k: v or 0 for k, v in row.items()} == pytest.approx({k: v or 0 for k, v in same.items()})
    assert one["duct"]["sound"]["liner"] == "polito"
    case = tl.load_duct("b2a", bulk_mach=0.0).case
    for f, z, row in zip((900.0, 1200.0), wanted.tolist(), one["rows"], strict=True):
        mesh = build_mesh(case, 1200.0, column=0.01, row=0.01)
        alone = solve_duct(case, f, z, mesh)
        assert abs(complex(alone.transmission)) == pytest.approx(row["transmission"], rel=1e-9)


SOUND = 340.0
TABLE_Y = HEIGHT * (1 - np.cos(np.linspace(0, np.pi / 2, 21))) / 2


def table_of(flow, y=TABLE_Y, **about):
    return TabulatedProfile(y, flow.velocity(y), HEIGHT, sound_speed=SOUND, **about)


PROFILES = {
    "uniform": UniformProfile(0.3, HEIGHT, SOUND),
    "parabola": ParabolicProfile(0.3, HEIGHT, SOUND),
    "tanh": TanhProfile(0.3, HEIGHT, 0.1, SOUND),
    "thick tanh": TanhProfile(0.3, HEIGHT, 1.0, SOUND),
    "table": table_of(TanhProfile(0.5, HEIGHT, 0.3, SOUND), bulk_mach=0.3),
}


def mean(function, *more) -> float:
    """Over the height; from wall and centreline apart, since slopes may jump there."""
    points = [0, 1e-5, 1e-4, 1e-3, HEIGHT / 4, HEIGHT / 2]
    points += [HEIGHT - p for p in points[-2::-1]]
    parts = [quad(function, a, b, epsabs=1e-12, epsrel=1e-11, limit=400)[0] for a, b in itertools.pairwise(points)]
    return sum(parts) / HEIGHT


@pytest.mark.parametrize("name", PROFILES)
def test_the_mean_is_the_bulk_mach_number(name):
    """By quadrature, to its 1e-11; the table's cubics have corners inside, so 1e-9 there."""
    profile = PROFILES[name]
    assert profile.bulk_mach == pytest.approx(0.3, rel=1e-12)
    assert mean(profile.mach) == pytest.approx(0.3, rel=1e-9 if name == "table" else 1e-11)
    y = np.linspace(0, HEIGHT, 7)
    assert profile.velocity(y) == pytest.approx(SOUND * profile.mach(y), rel=1e-15)


@pytest.mark.parametrize("name", PROFILES)
def test_the_slope_is_the_derivative(name):
    """A central difference at two steps, extrapolated: fourth order, 1e-7 of the largest slope."""
    profile = PROFILES[name]
    y = np.concatenate([np.geomspace(2e-6, 0.99 * HEIGHT / 2, 25)[:-1], [HEIGHT / 2]])
    y = np.concatenate([y, HEIGHT - y])
    step = 1e-3 * np.minimum(y, HEIGHT - y)
    if name == "table":  # a knot inside the step would be a corner of the slope
        apart = np.abs(np.minimum(y, HEIGHT - y)[:, None] - TABLE_Y).min(-1)
        y, step = y[apart > step], step[apart > step]
    difference = [(profile.mach(y + h) - profile.mach(y - h)) / (2 * h) for h in (step, step / 2)]
    wanted = (4 * difference[1] - difference[0]) / 3
    found = profile.mach_slope(y)
    assert found == pytest.approx(wanted, abs=1e-7 * max(np.abs(found).max(), 1 / HEIGHT))


@pytest.mark.parametrize("name", PROFILES)
def test_displacement_thickness_is_its_integral(name):
    """The trapezoidal rule on 2e4 graded points: second order, 1e-6 of half the height."""
    profile = PROFILES[name]
    y = HEIGHT / 2 * np.linspace(0, 1, 20001) ** 3
    wanted = trapezoid(1 - profile.mach(y) / profile.mach(HEIGHT / 2), y)
    assert profile.displacement_thickness == pytest.approx(wanted, abs=1e-6 * HEIGHT / 2)


def test_walls_and_centreline():
    for name, profile in PROFILES.items():
        assert profile.mach([0.0, HEIGHT]) == pytest.approx(0.3 if name == "uniform" else 0.0, abs=1e-15)
        near = profile.mach_slope(HEIGHT / 2 * (1 - 1e-9))
        assert abs(near) < 1e-7 * profile.bulk_mach / HEIGHT


def test_parabola_is_the_limit_of_the_tanh_profile():
    """For d -> infinity, to 1/d^2."""
    y = np.linspace(0, HEIGHT, 21)
    thick, parabola = TanhProfile(0.3, HEIGHT, 1e3, SOUND), PROFILES["parabola"]
    assert thick.mach(y) == pytest.approx(parabola.mach(y), abs=1e-6)
    assert thick.mach_slope(y) == pytest.approx(parabola.mach_slope(y), abs=1e-4)
    assert parabola.displacement_thickness == pytest.approx(HEIGHT / 6, rel=1e-14)
    assert parabola.centreline_mach == pytest.approx(0.45, rel=1e-14)


def test_table_gives_its_own_points_back():
    flow = PROFILES["tanh"]
    table = table_of(flow)
    assert table.velocity(TABLE_Y) == pytest.approx(flow.velocity(TABLE_Y), rel=1e-13, abs=1e-13)
    assert table.bulk_mach == pytest.approx(0.3, rel=2e-3)
    between = table.mach(np.linspace(0, HEIGHT / 2, 999))
    assert (np.diff(between) >= 0).all()
    assert table.centreline_mach == float(table.mach(HEIGHT / 2))
    y = HEIGHT / 2 * np.linspace(0, 1, 20001) ** 4  # (y/h)^(1/7): h/8, in closed form
    root = TabulatedProfile(y, 50 * (2 * y / HEIGHT) ** (1 / 7), HEIGHT)
    assert root.displacement_thickness == pytest.approx(HEIGHT / 16, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("uniform", {"bulk_mach": 1.0}, "bulk_mach is 1; .* below 1"),
        ("uniform", {"bulk_mach": -0.1}, r"bulk_mach is -0\.1; .*at least 0"),
        ("tanh", {"bulk_mach": 0.99}, r"largest Mach number is 1\.06"),
        ("table", {"bulk_mach": 0.9}, r"largest Mach number is 1\.\d+"),
        ("table", {"y": TABLE_Y + 1e-3}, r"y runs from 0\.001 to 0\.026 m; it must increase from the wall"),
        ("table", {"y": 0.9 * TABLE_Y}, r"to 0\.0225 m; .*the centreline, 0\.025 m"),
        ("table", {"y": TABLE_Y[:5]}, r"shape \(5,\) and velocity_table \(21,\)"),
        ("table", {"velocity_table": -TABLE_Y}, "must be finite, at least 0"),
        ("table", {"velocity_table": 0 * TABLE_Y}, "above 0 in the end"),
    ],
)
def test_profiles_refused(name, change, message):
    with pytest.raises(ValueError, match=message):
        replace(PROFILES[name], **change)


def test_thin_layers_and_points_outside():
    with pytest.warns(tl.DataWarning, match=r"shear is 0\.02, below 0\.05"):
        TanhProfile(0.3, HEIGHT, 0.02)
    with pytest.raises(ValueError, match=r"y = 0\.051 m lies outside the duct, 0 to 0\.05 m"):
        PROFILES["tanh"].mach_slope([0.01, 0.051])
