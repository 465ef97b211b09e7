"""Derivatives of the educed impedance in the liner's parameters, and tolerances propagated."""

import pytest
import torch
from conftest import FREQUENCY, PARAMETERS, RATE, frozen_plane, plane_of, turbulence
from torch.autograd import forward_ad

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")

SPEEDS = 1e-6  # differences with steps of 1e-5; interpolation over |v| leaves 1e-8
TOLERANCES = {"orifice_diameter": 2e-5, "porosity": 0.0012, "cavity_depth": 1e-4}


def model(**changes):
    about = {"velocity_gain": 0.9, "velocity_reading": "conserved", "cell_pitch": 5e-3}
    given = {**PARAMETERS, **about, "fluid": tl.Fluid.from_temperature(300.0, 9e4)}
    return tl.SDoFLiner(**{**given, **changes})


def cells_plane():
    return plane_of(turbulence((12, 300), seed=2), x=[(i + 0.5) * 10e-3 / 12 for i in range(12)])


def moved(name, value):
    """The model with one number changed, without the module under test where that can be."""
    if name.startswith("offset_"):
        part = 1 if name == "offset_resistance" else 1j
        return model(impedance_offset=0.03 - 0.02j + part * (value - model().numbers()[name].value))
    if name in ("temperature", "pressure"):
        return model(fluid=tl.Fluid.from_temperature(**{"temperature": 300.0, "pressure": 9e4, name: value}))
    return model(**{name: value})


def largest(found, wanted):
    return float((found - wanted).abs().max() / wanted.abs().max())


def differences(make, value, **options):
    step = 1e-5 * abs(value)
    above, below = (tl.educe(cells_plane(), make(value + sign * step), **options).liner for sign in (1, -1))
    return {name: (above[name].impedance - below[name].impedance) / (2 * step) for name in above}


@pytest.fixture(scope="module")
def wrapped():
    return tl.sensitivities(cells_plane(), model())


@pytest.mark.parametrize("name", model().numbers())
def test_every_parameter_against_differences(wrapped, name):
    row = [*wrapped.numbers].index(name)
    for averaging, wanted in differences(lambda value: moved(name, value), model().numbers()[name].value).items():
        assert largest(wrapped.slopes[averaging][row], wanted) < SPEEDS


@pytest.mark.parametrize("choices", [{"drive": "running-rms"}, {"mean": "removed"}], ids=str)
def test_choices_of_the_speed_are_followed(choices):
    found = tl.sensitivities(cells_plane(), model(), None, ["porosity"], **choices)
    wanted = differences(lambda value: model(porosity=value), 0.06, **choices)
    for averaging in wanted:
        assert largest(found.slopes[averaging][0], wanted[averaging]) < SPEEDS


def test_moments_stand_for_a_plane(wrapped):
    found = tl.sensitivities(tl.moments(cells_plane(), model(), dtype="float64"), model())
    for averaging, wanted in wrapped.slopes.items():
        assert largest(found.slopes[averaging], wanted) < 1e-7


def test_one_tolerance_is_one_contribution(wrapped):
    row = [*wrapped.numbers].index("orifice_diameter")
    budget = tl.sensitivities(cells_plane(), model(), tolerances={"orifice_diameter": 2e-5})
    wanted = 3**-0.5 * 2e-5 * wrapped.slopes["admittance"][row, 0]
    found = complex(budget.combined["admittance"][0])
    assert found == pytest.approx(complex(abs(wanted.real), abs(wanted.imag)), rel=1e-12)


def test_the_budget_against_monte_carlo():
    """Draws within the limits, frozen |v|: the covariance of R and X, to the draws' scatter."""
    budget = tl.sensitivities(frozen_plane(2.0), model(), FREQUENCY, tolerances=TOLERANCES)
    generator = torch.Generator().manual_seed(1)
    draws = 2 * torch.rand(600, 3, generator=generator, dtype=torch.float64) - 1
    centre = torch.tensor([number.value for number in budget.numbers.values()], dtype=torch.float64)
    widths = {row.parameter: row.half_width for row in budget.rows}
    values = centre + draws * torch.tensor([widths[name] for name in budget.numbers], dtype=torch.float64)
    made = [model(**dict(zip(budget.numbers, row, strict=True))) for row in values.tolist()]
    impedance = torch.stack([each.impedance(FREQUENCY, 2.0) for each in made])
    wanted = torch.cov(torch.view_as_real(impedance.reshape(-1)).T)
    # 600 draws scatter by some 5 %; the second order of these tolerances is below that.
    assert largest(budget.covariance["velocity"][0], wanted) < 0.15


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"orifice_diameter": 0.02}, "orifice_diameter is 0.02, above its value, .* in SI"),
        ({"porosity": 0}, "tolerance of porosity is 0; .* above 0"),
        ({"porosty": 0.01}, "'porosity'"),
    ],
)
def test_tolerances_without_meaning_are_refused(tolerances, message):
    with pytest.raises(ValueError, match=message):
        tl.sensitivities(cells_plane(), model(), tolerances=tolerances)


@pytest.mark.parametrize(
    ("liner", "changes", "error", "message"),
    [
        (model(), {"parameters": ["cavity_dept"]}, ValueError, "'cavity_dept'.*cavity_depth"),
        (model(), {"phase": "given"}, ValueError, "takes phase 'averaged'"),
        (object(), {}, TypeError, "without impedance"),
        (tl.TabulatedLiner([500.0, 2000.0], [1 - 1j, 1 + 1j]), {}, TypeError, "TabulatedLiner"),
    ],
)
def test_slips_are_refused(liner, changes, error, message):
    with pytest.raises(error, match=message):
        tl.sensitivities(cells_plane(), liner, FREQUENCY, **changes)
    with pytest.raises(TypeError, match="plane is list"):
        tl.sensitivities([cells_plane()], model())


def make(name=None, value=None):
    given = {**PARAMETERS, **({} if name is None else {name: value})}
    return tl.SDoFLiner(**given, velocity_reading="conserved")


def reflection(liner, frequencies=(FREQUENCY,), **options):
    tone = 3 * torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(300))
    plane = plane_of(turbulence((4, 300), seed=2) + tone)
    if options.get("phase") == "given":
        options["reference_phase"] = 0.3
    return tl.educe(plane, liner, list(frequencies), **options).probes["admittance"].reflection


@pytest.mark.parametrize("phase", ["averaged", "given", "self-consistent"])
def test_backward_is_forward(phase):
    value = torch.tensor(0.78, dtype=torch.float64, requires_grad=True)
    found = reflection(make("vena_contracta", value), (1400, 2100), phase=phase)
    parts = torch.cat([found.real.flatten(), found.imag.flatten()])
    backward = torch.stack([torch.autograd.grad(part, value, retain_graph=True)[0] for part in parts])
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(value.detach(), torch.ones_like(value))
        again = reflection(make("vena_contracta", dual), (1400, 2100), phase=phase)
        slope = forward_ad.unpack_dual(again).tangent
    wanted = torch.cat([slope.real.flatten(), slope.imag.flatten()])
    assert float((backward - wanted).abs().max()) < 1e-9 * float(wanted.abs().max())


def test_second_derivative():
    value = torch.tensor(0.78, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradgradcheck(
        lambda c: torch.view_as_real(reflection(make("vena_contracta", c))).sum(), value
    )


def test_moments_refuse_to_lose_the_derivative_in_the_velocity():
    """Of the default engine; without derivatives it is as good as any other."""
    plane = plane_of(turbulence((2, 300), seed=2).requires_grad_())
    for read in (lambda: tl.educe(plane, make()), lambda: tl.moments(plane)):
        with pytest.raises(ValueError, match=r"carries a gradient.*replay"):
            read()
        with torch.no_grad():
            read()
