"""Wavenumbers and modes of a lined duct: closed forms, eigen-solver, shooting, counted roots."""

import cmath
import math

import numpy as np
import pytest
import scipy.linalg
import torch
from conftest import relative_error
from scipy.integrate import solve_ivp

import torchliner as tl
from torchliner.duct import modes as modes_module
from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.duct.flow_profiles import ParabolicProfile, TanhProfile, UniformProfile
from torchliner.duct.modes import cut_on_frequency, duct_modes
from torchliner.names import CONDITIONS, DIRECTIONS

HEIGHT, SPEED, FREQUENCY = 50e-3, 343.0, 1500.0
K = 2 * math.pi * FREQUENCY / SPEED
DUCT = {"height": HEIGHT, "sound_speed": SPEED}
CREMER = 2.1061961 + 1.1253643j  # gamma H of the double root: sin 2x + 2x = 0


def exact(*values: complex) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.complex128)


def entire(alpha, impedance: complex, mach: float, condition: str):
    """The relation written out once more, over numpy, for contours."""
    d = K - alpha * mach
    gamma = np.sqrt(d**2 - alpha**2 + 0j)
    factor = d**2 / K if condition == "ingard-myers" else d
    return impedance * gamma * np.sin(gamma * HEIGHT) - 1j * factor * np.cos(gamma * HEIGHT)


def roots_within(left, right, low, high, *about) -> float:
    """Number of zeros in a rectangle: the winding of F along its edge, divided by 2 pi."""
    corners = [complex(left, low), complex(right, low), complex(right, high), complex(left, high)]
    steps = np.linspace(0, 1, 4001)
    edge = np.concatenate([a + steps * (b - a) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)])
    return np.diff(np.unwrap(np.angle(entire(edge, *about)))).sum() / (2 * np.pi)


def chebyshev_wavenumbers(impedance: complex, mach: float, condition: str, points: int = 40):
    """p'' + (d^2 - alpha^2) p = 0, p'(0) = 0, Z p'(H) = -j (d^2/k or d) p(H), by collocation."""
    nodes = np.cos(np.pi * np.arange(points + 1) / points)
    weight = np.r_[2, np.ones(points - 1), 2] * (-1) ** np.arange(points + 1)
    apart = nodes[:, None] - nodes + np.eye(points + 1)
    slope = np.outer(weight, 1 / weight) / apart
    slope -= np.diag(slope.sum(1))
    slope *= 2 / HEIGHT  # node 0 is y = H, the last one y = 0
    one = np.eye(points + 1)
    parts = [slope @ slope + K**2 * one, -2 * K * mach * one, (mach**2 - 1) * one]
    parts = [part.astype(complex) for part in parts]
    wall = (1, -2 * mach / K, mach**2 / K**2) if condition == "ingard-myers" else (1, -mach / K, 0)
    for part, factor in zip(parts, wall, strict=True):
        part[0] = 1j * K * factor * one[0]
        part[-1] = 0
    parts[0][0] += impedance * slope[0]
    parts[0][-1] = slope[-1]
    big = np.eye(points + 1)
    none = np.zeros_like(big)
    found = scipy.linalg.eigvals(
        np.block([[none, big], [-parts[0], -parts[1]]]), np.block([[big, none], [none, parts[2]]])
    )
    return found[np.isfinite(found)]


@pytest.mark.parametrize("mach", [0.0, 0.3, -0.3, 0.9])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_rigid_wall(mach, condition):
    """k/(1+M) downstream, -k/(1-M) upstream; back to an infinite impedance."""
    about, rigid = {**DUCT, "mach": mach, "condition": condition}, exact(complex("inf"))
    both = [wavenumber_from_impedance(rigid, FREQUENCY, direction=d, **about) for d in DIRECTIONS]
    assert complex(both[0]) == pytest.approx(K / (1 + mach), rel=1e-14)
    assert complex(both[1]) == pytest.approx(-K / (1 - mach), rel=1e-14)
    again = impedance_from_wavenumber(both[0], FREQUENCY, **about)
    assert float(again.abs()) > 1e12


def test_published_number():
    """Ingard-Myers, M 0.3, 1500 Hz, Z = 2.33-0.30j in 50 mm: alpha = 21.45776-2.51104j."""
    found = complex(wavenumber_from_impedance(exact(2.33 - 0.30j), FREQUENCY, mach=0.3, **DUCT))
    assert abs(found - (21.45776 - 2.51104j)) < 1e-5
    back = complex(impedance_from_wavenumber(exact(21.45776 - 2.51104j), FREQUENCY, mach=0.3, **DUCT))
    assert abs(back - (2.33 - 0.30j)) < 1e-5


def test_cremers_optimum_is_a_double_root():
    """Modes 0 and 1 meet at Z = jkH/(x tan x) with sin 2x + 2x = 0; half the digits are left."""
    assert abs(cmath.sin(2 * CREMER) + 2 * CREMER) < 1e-6
    best = 1j * K * HEIGHT / (CREMER * cmath.tan(CREMER))
    wanted = cmath.sqrt(K**2 - (CREMER / HEIGHT) ** 2)
    for mode in (0, 1):
        found = complex(wavenumber_from_impedance(exact(best), FREQUENCY, mode=mode, **DUCT))
        assert abs(found - wanted) < 1e-4 * abs(wanted)  # sqrt of the digits of CREMER


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_round_trip(condition, direction):
    """Z to alpha to Z for 200 walls, three modes, several flows: 1e-12 relative."""
    draws = torch.randn(2, 200, 1, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    walls = torch.complex(0.05 + 1.5 * draws[0].abs(), 1.2 * draws[1])
    mach = torch.tensor([0.0, 0.1, 0.3, 0.5], dtype=torch.float64)[:, None]
    about = {**DUCT, "mach": mach, "condition": condition}
    alpha = wavenumber_from_impedance(walls, FREQUENCY, direction=direction, mode=torch.arange(3), **about)
    assert alpha.shape == (200, 4, 3)
    assert relative_error(impedance_from_wavenumber(alpha, FREQUENCY, **about), walls) < 1e-12


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("mach", [0.0, 0.3])
@pytest.mark.parametrize("impedance", [2.33 - 0.3j, 0.5 + 1.0j, 0.3 - 0.4j])
def test_eigen_solver_and_argument_principle(condition, mach, impedance):
    """Four modes a side are the collocated eigenvalues, and the rectangle holds no others."""
    about = {**DUCT, "mach": mach, "condition": condition, "mode": torch.arange(4)}
    sides = [wavenumber_from_impedance(exact(impedance), FREQUENCY, direction=d, **about) for d in DIRECTIONS]
    found = torch.cat(sides).tolist()
    solver = chebyshev_wavenumbers(impedance, mach, condition)
    for alpha in found:
        assert np.abs(solver - alpha).min() < 1e-6 * abs(alpha)
    assert min(abs(a - b) for i, a in enumerate(found) for b in found[:i]) > 1.0
    box = (-130.0, 130.0, -235.0, 235.0)
    inside = [a for a in found if abs(a.real) < 130 and abs(a.imag) < 235]
    count = roots_within(*box, impedance, mach, condition)
    assert count == pytest.approx(round(count), abs=1e-6)
    theirs = (np.abs(solver.real) < 130) & (np.abs(solver.imag) < 235)
    assert round(count) == theirs.sum()
    # Ingard-Myers in flow has up to two hydrodynamic modes that no rigid mode becomes.
    spare = 2 if condition == "ingard-myers" and mach else 0
    assert len(inside) <= round(count) <= len(inside) + spare


@pytest.mark.parametrize("condition", CONDITIONS)
def test_no_jumps_along_the_ray(condition):
    rays = torch.polar(torch.ones(3).double(), torch.tensor([0.3, -0.5, 1.2]).double())
    share = torch.linspace(0.01, 3, 1200, dtype=torch.float64)  # of the admittance
    alpha = wavenumber_from_impedance(
        rays[:, None, None] / share[:, None], FREQUENCY, mach=0.3, condition=condition, mode=torch.arange(3), **DUCT
    )
    steps = alpha.diff(dim=1).abs()
    apart = torch.stack([(alpha[..., i] - alpha[..., j]).abs() for i, j in ((0, 1), (1, 2), (0, 2))])
    assert float(steps.max()) < 0.25 * float(apart.min())
    # Halving the steps halves the moves: a jump would not shrink.
    assert float(alpha[:, ::2].diff(dim=1).abs().max()) > 1.8 * float(steps.max())


@pytest.mark.parametrize("condition", CONDITIONS)
def test_derivatives(condition):
    """In Z, k, H and M, first and second, at |Z| above and below 1; everything broadcasts."""
    walls = exact(2.33 - 0.3j, 0.4 + 0.5j).requires_grad_()
    reals = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (1500.0, 0.05, 0.3)]

    def forward(z, f, h, m):
        return wavenumber_from_impedance(z, f / SPEED, height=h, mach=m, sound_speed=1.0, condition=condition)

    def backward(z, f, h, m):
        alpha = exact(9.0 - 1.5j, -35 + 8j) * z
        return impedance_from_wavenumber(alpha, f, height=h, mach=m, condition=condition)

    for function in (forward, backward):
        torch.autograd.gradcheck(function, (walls, *reals), eps=1e-7, atol=1e-4, rtol=1e-5)
    torch.autograd.gradgradcheck(
        lambda z: forward(z, *(r.detach() for r in reals)), (walls,), eps=1e-6, atol=1e-3, rtol=1e-4
    )


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"mach": 1.0}, "mach is 1; .*between -1 and 1"),
        ({"frequency": [500.0, float("nan")]}, r"frequency \(Hz\) is nan; .*above 0"),
        ({"height": -0.05}, r"height \(m\) is -0\.05"),
        ({"sound_speed": math.inf}, r"sound_speed \(m/s\) is inf"),
        ({"condition": "ingard"}, "condition 'ingard'.*ingard-myers"),
    ],
)
def test_both_ways_refuse(about, match):
    given = {"height": HEIGHT, **about}
    frequency = given.pop("frequency", FREQUENCY)
    with pytest.raises(ValueError, match=match):
        impedance_from_wavenumber(exact(20 - 1j), frequency, **given)
    with pytest.raises(ValueError, match=match):
        wavenumber_from_impedance(exact(2.0), frequency, **given)


def test_other_refusals():
    for function in (impedance_from_wavenumber, wavenumber_from_impedance):
        with pytest.raises(TypeError, match=r"torch\.float32; a complex tensor"):
            function(torch.tensor([1.0]), FREQUENCY, **DUCT)
    with pytest.raises(ValueError, match=r"mode is -1; .*0, 1, 2"):
        wavenumber_from_impedance(exact(2.0), FREQUENCY, mode=-1, **DUCT)
    at_cut_on = cut_on_frequency(UniformProfile(0.3, HEIGHT, SPEED))
    with pytest.raises(RuntimeError, match=r"two modes meet .* change Z or the frequency"):
        wavenumber_from_impedance(exact(2.0), at_cut_on, mach=0.3, mode=1, **DUCT)
    with pytest.warns(tl.DataWarning, match=r"negative resistance, -0\.2 at least, in 1 of 2"):
        wavenumber_from_impedance(exact(1.0, -0.2 + 1j), FREQUENCY, **DUCT)


VELOCITY = "continuous-velocity"
B2A = 2.33 - 0.30j
BOTH = ("downstream", "upstream")
WALLS = [B2A, 0.5 + 1.0j, 0.5 - 1.0j, 0.05 - 0.3j, 8.0 + 0.0j]
UNIFORM = UniformProfile(0.3, HEIGHT, SPEED)
TANH = TanhProfile(0.3, HEIGHT, 0.1, SPEED)


def k_of(frequency):
    return 2 * math.pi * frequency / SPEED


def shoot(profile, alpha, k, height=HEIGHT):
    """p, v at y = 0 from p = 1, v = 0 at y = H by DOP853: in (p, v) with M', the package in (p, v/sigma) without it."""

    def right(y, q):
        mach, slope = float(profile.mach(y)), float(profile.mach_slope(y))
        local = k - alpha * mach
        u = (alpha * q[0] + 1j * slope * q[1]) / local
        return [-1j * local * q[1], -1j * (local * q[0] - alpha * u)]

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    start, state = height, [1.0 + 0j, 0j]
    for stop in (height / 2, 0.0):  # the slope may bend on the centreline
        run = solve_ivp(right, (start, stop), state, **options)
        start, state = stop, run.y[:, -1]
    return state


@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("mach", [0.0, 0.3, 0.6])
def test_rigid_uniform_duct(mach, direction):
    """alpha = (-k M +- sqrt(k^2 - (1 - M^2)(n pi/H)^2))/(1 - M^2), p = cos(n pi y/H)."""
    frequency = np.array([300.0, 1500.0, 5000.0])
    modes = duct_modes(UniformProfile(mach, HEIGHT, SPEED), frequency, direction=direction)
    k, n = k_of(frequency)[:, None], np.arange(6)
    root = np.sqrt(k**2 - (1 - mach**2) * (n * np.pi / HEIGHT) ** 2 + 0j)
    root = np.where(root.imag > 0, -root, root)  # decays downstream
    wanted = (-k * mach + (1 if direction == "downstream" else -1) * root) / (1 - mach**2)
    assert np.abs(modes.wavenumber.numpy() - wanted).max() < 1e-9 * 6 * np.pi / HEIGHT
    y = np.linspace(0, HEIGHT, 17)
    p, u, v = modes.at(y)
    local = k - wanted * mach
    shape = np.cos(n[:, None] * np.pi * (1 - y / HEIGHT))
    sine = np.sin(n[:, None] * np.pi * (1 - y / HEIGHT)) * (n * np.pi / HEIGHT)[:, None]
    assert np.abs(p.numpy() - shape).max() < 1e-9
    assert np.abs(u.numpy() - (wanted / local)[..., None] * shape).max() < 1e-8
    assert np.abs(v.numpy() - 1j * sine / local[..., None]).max() < 1e-8 * 6 * np.pi / 0.3


@pytest.mark.parametrize("condition", ["ingard-myers", VELOCITY])
@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("height", [HEIGHT, 0.15])
def test_modes_of_uniform_flow_are_those_of_the_dispersion_relation(height, direction, condition):
    """By number too, at walls where two modes come close; there none is missed (as above)."""
    frequency = torch.tensor([500.0, 1500.0, 2000.0]).double()
    walls = torch.tensor([*WALLS, 0.4083 - 0.4108j], dtype=torch.complex128)[:, None]
    about = {"direction": direction, "slip_condition": condition, "count": 4}
    found = duct_modes(UniformProfile(0.3, height, SPEED), frequency, walls, **about).wavenumber
    duct = {"height": height, "mach": 0.3, "sound_speed": SPEED, "condition": condition, "direction": direction}
    wanted = tl.wavenumber_from_impedance(walls[..., None], frequency[:, None], mode=torch.arange(4), **duct)
    assert torch.allclose(found, wanted, rtol=1e-8, atol=0)


SHEARED = {
    "tanh": TANH,
    "thick": TanhProfile(0.3, HEIGHT, 0.5, SPEED),
    "parabola": ParabolicProfile(0.3, HEIGHT, SPEED),
}


@pytest.mark.parametrize("direction", BOTH)
@pytest.mark.parametrize("name", SHEARED)
def test_shooting_returns_the_impedance(name, direction):
    """DOP853 at 1e-12 from the rigid wall, through v and M': Z to 1e-7, p at the wall to 1e-8."""
    profile = SHEARED[name]
    modes = duct_modes(profile, 1500.0, B2A, count=3, direction=direction)
    for n in range(3):
        p, v = shoot(profile, complex(modes.wavenumber[0, n]), k_of(1500.0))
        assert abs(p / -v / B2A - 1) < 1e-7
        assert abs(complex(modes.pressure[0, n, -1]) / p - 1) < 1e-8
        assert abs(complex(modes.normal[0, n, -1]) / v - 1) < 1e-7


@pytest.mark.filterwarnings("ignore:profile shear:torchliner.DataWarning")
@pytest.mark.parametrize("direction", BOTH)
def test_thin_layers_tend_to_ingard_and_myers(direction):
    """At the same centreline flow the difference falls as the thickness; continuity of velocity is not the limit."""
    errors = {}
    for condition in ("ingard-myers", VELOCITY):
        for shear in (0.04, 0.02, 0.01):
            thin = TanhProfile(0.3, HEIGHT, shear, SPEED)
            plug = UniformProfile(thin.centreline_mach, HEIGHT, SPEED)
            about = {"count": 1, "direction": direction, "slip_condition": condition}
            found, limit = (duct_modes(flow, 1500.0, B2A, **about) for flow in (thin, plug))
            errors[condition, shear] = abs(complex(found.wavenumber - limit.wavenumber))
    for shear in (0.02, 0.01):
        halved = errors["ingard-myers", shear] / errors["ingard-myers", 2 * shear]
        assert halved == pytest.approx(0.5, abs=0.03)
    assert errors[VELOCITY, 0.01] > 0.9 * errors[VELOCITY, 0.04]


def test_extreme_walls():
    """Z = 0 has p = 0 on the wall; Z = inf, 1e9 and nothing are the rigid wall."""
    soft = duct_modes(TANH, 1500.0, 0.0)
    assert float(soft.pressure[..., -1].abs().max()) < 1e-9
    rigid = duct_modes(TANH, 1500.0)
    for hard in (math.inf, complex(0, math.inf), 1e9):
        assert float((duct_modes(TANH, 1500.0, hard).wavenumber - rigid.wavenumber).abs().max()) < 1e-6


def test_batch_is_the_loop(monkeypatch):
    monkeypatch.setattr(modes_module, "CHUNK", 32)
    frequency, walls = [700.0, 1500.0, 2600.0], torch.tensor(WALLS, dtype=torch.complex128)[:, None]
    whole = duct_modes(TANH, frequency, walls, count=3)  # 45 modes
    for i, f in [(0, 0), (3, 2), (4, 1)]:
        one = duct_modes(TANH, frequency[f], walls[i], count=3)
        assert torch.allclose(whole.wavenumber[i, f], one.wavenumber[0], rtol=1e-11, atol=1e-9)
        assert torch.allclose(whole.axial[i, f], one.axial[0], rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_gradients(monkeypatch):
    monkeypatch.setattr(modes_module, "POINTS", 8)
    walls = torch.tensor([[B2A], [0.5 - 1j]], dtype=torch.complex128, requires_grad=True)

    def outputs(z):
        modes = duct_modes(TANH, [1500.0], z, count=2)
        return modes.wavenumber, modes.pressure[..., ::30], modes.axial[..., ::30]

    assert torch.autograd.gradcheck(outputs, (walls,), eps=1e-5, atol=1e-5, rtol=1e-5)


def test_cut_on():
    """n c sqrt(1 - M^2)/(2 H), where mode n has a double wavenumber; shear lowers it by less than 1 %."""
    limit = cut_on_frequency(UNIFORM)
    assert limit == pytest.approx(SPEED * math.sqrt(1 - 0.09) / (2 * HEIGHT), rel=1e-12)
    at = float(duct_modes(UNIFORM, limit, count=2).wavenumber[0, 1].abs())
    assert at == pytest.approx(0.3 * k_of(limit) / (1 - 0.09), rel=1e-6)
    below, above = duct_modes(TANH, [0.99 * limit, limit], count=2).wavenumber[:, 1]
    assert abs(below.imag) > 0.3
    assert abs(above.imag) < 1e-6


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"frequency": 0.0}, "frequency .*is 0"),
        ({"impedance": math.nan}, "impedance is nan or -1"),
        ({"count": 60}, "count is 60; from one mode to 24"),
        ({"direction": "up"}, "direction 'up'.*downstream, upstream"),
        ({"slip_condition": None}, r"Mach 0\.3; .*'continuous-velocity'"),
        ({"slip_condition": "myers"}, "slip condition 'myers'"),
    ],
)
def test_modes_refuse(change, match):
    arguments = {"frequency": 1500.0, "impedance": B2A, "slip_condition": VELOCITY, **change}
    with pytest.raises(ValueError, match=match):
        duct_modes(UNIFORM, arguments.pop("frequency"), arguments.pop("impedance"), **arguments)
