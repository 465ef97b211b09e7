"""Mean-flow profiles: bulk Mach number, exact slopes, integral measures, limits, bad input."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

import torchliner as tl
from torchliner.duct.flow_profiles import ParabolicProfile, TabulatedProfile, TanhProfile, UniformProfile

HEIGHT, SPEED = 50e-3, 340.0
TABLE_Y = HEIGHT * (1 - np.cos(np.linspace(0, np.pi, 41))) / 2


def table_of(flow, y=TABLE_Y, **about):
    return TabulatedProfile(y, flow.velocity(y), HEIGHT, sound_speed=SPEED, **about)


PROFILES = {
    "uniform": UniformProfile(0.3, HEIGHT, SPEED),
    "parabola": ParabolicProfile(0.3, HEIGHT, SPEED),
    "tanh": TanhProfile(0.3, HEIGHT, 0.1, SPEED),
    "thick tanh": TanhProfile(0.3, HEIGHT, 1.0, SPEED),
    "table": table_of(TanhProfile(0.5, HEIGHT, 0.3, SPEED), bulk_mach=0.3),
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
    assert profile.velocity(y) == pytest.approx(SPEED * profile.mach(y), rel=1e-15)


@pytest.mark.parametrize("name", PROFILES)
def test_the_slope_is_the_derivative(name):
    """A central difference at two steps, extrapolated: fourth order, 1e-7 of the largest slope."""
    profile = PROFILES[name]
    y = np.concatenate([np.geomspace(2e-6, 0.99 * HEIGHT / 2, 25)[:-1], [HEIGHT / 2]])
    y = np.concatenate([y, HEIGHT - y])
    step = 1e-3 * np.minimum(y, HEIGHT - y)
    if name == "table":  # a knot inside the step would be a corner of the slope
        apart = np.abs(y[:, None] - TABLE_Y).min(-1)
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
    wanted = tl.displacement_thickness(y, profile.velocity(y))
    assert profile.displacement_thickness == pytest.approx(wanted, abs=1e-6 * HEIGHT / 2)


def test_walls_and_centreline():
    """No slip but for the plug; no kink on the centreline."""
    for name, profile in PROFILES.items():
        assert profile.mach([0.0, HEIGHT]) == pytest.approx(0.3 if name == "uniform" else 0.0, abs=1e-15)
        near = profile.mach_slope(HEIGHT / 2 * (1 - 1e-9))
        assert abs(near) < 1e-7 * profile.bulk_mach / HEIGHT


def test_parabola_is_the_limit_of_the_tanh_profile():
    """For d -> infinity, to 1/d^2."""
    y = np.linspace(0, HEIGHT, 21)
    thick, parabola = TanhProfile(0.3, HEIGHT, 1e3, SPEED), PROFILES["parabola"]
    assert thick.mach(y) == pytest.approx(parabola.mach(y), abs=1e-6)
    assert thick.mach_slope(y) == pytest.approx(parabola.mach_slope(y), abs=1e-4)
    assert parabola.displacement_thickness == pytest.approx(HEIGHT / 6, rel=1e-14)
    assert parabola.centreline_mach == pytest.approx(0.45, rel=1e-14)


def test_table_gives_its_own_points_back():
    """Unscaled: velocities in m/s as given, between them no new extremes; half a table mirrored."""
    flow = PROFILES["tanh"]
    table = table_of(flow)
    assert table.velocity(TABLE_Y) == pytest.approx(flow.velocity(TABLE_Y), rel=1e-13, abs=1e-13)
    assert table.bulk_mach == pytest.approx(0.3, rel=2e-3)
    between = table.mach(np.linspace(0, HEIGHT / 2, 999))
    assert (np.diff(between) >= 0).all()
    assert table.centreline_mach == float(table.mach(HEIGHT / 2))
    half = table_of(flow, TABLE_Y[:21])
    y = np.linspace(0, HEIGHT, 101)
    assert half.mach(y) == pytest.approx(table.mach(y), rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("uniform", {"bulk_mach": 1.0}, "bulk_mach is 1; .* below 1"),
        ("uniform", {"bulk_mach": -0.1}, r"bulk_mach is -0\.1; .*at least 0"),
        ("tanh", {"shear": 0.02}, r"shear is 0\.02, below 0\.03.*allow_thin=True"),
        ("tanh", {"bulk_mach": 0.99}, r"largest Mach number is 1\.06"),
        ("table", {"bulk_mach": 0.9}, r"largest Mach number is 1\.\d+"),
        ("table", {"y": TABLE_Y + 1e-3}, r"starts at 0\.001 m.*y = 0"),
        ("table", {"y": 0.9 * TABLE_Y}, r"y ends at 0\.045 m.*0\.05 m"),
        ("table", {"y": TABLE_Y[:5]}, r"shape \(5,\) and velocity_table \(41,\)"),
        ("table", {"velocity_table": -TABLE_Y}, r"velocity_table is -0\.05 at y = 0\.05 m"),
        ("table", {"velocity_table": 0 * TABLE_Y}, "0 everywhere"),
    ],
)
def test_refusals(name, change, message):
    with pytest.raises(ValueError, match=message):
        replace(PROFILES[name], **change)


def test_thin_layers_and_points_outside():
    with pytest.warns(tl.DataWarning, match=r"shear is 0\.02, below 0\.05"):
        TanhProfile(0.3, HEIGHT, 0.02, allow_thin=True)
    with pytest.raises(ValueError, match=r"y = 0\.051 m lies outside the duct, 0 to 0\.05 m"):
        PROFILES["tanh"].mach_slope([0.01, 0.051])
