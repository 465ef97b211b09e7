"""Derivatives of the educed impedance in the liner's parameters, and tolerances propagated."""

from __future__ import annotations

import json

import pytest
import torch
from conftest import FREQUENCY, PARAMETERS, Resistive, frozen_plane, plane_of, turbulence

import torchliner as tl
from torchliner.cli.main import DONE, main
from torchliner.units import parse_tolerance

pytestmark = [pytest.mark.filterwarnings("ignore::torchliner.DataWarning")]
SPEEDS = 1e-6  # differences with steps of 1e-5; interpolation over |v| leaves 1e-8
TOLERANCES = {"orifice_diameter": "0.02 mm", "porosity": "2 %", "cavity_depth": "0.1 mm"}


def model(**changes):
    about = {"velocity_gain": 0.9, "velocity_reading": "conserved", "cell_pitch": 5e-3}
    given = {**PARAMETERS, **about, "fluid": tl.Fluid.from_temperature(300.0, 9e4)}
    return tl.SDoFLiner(**{**given, **changes})


def cells_plane():
    """Twelve probes over two cells."""
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
    """Of ``educe``, by averaging."""
    step = 1e-5 * abs(value)
    above, below = (tl.educe(cells_plane(), make(value + sign * step), **options).liner for sign in (1, -1))
    return {name: (above[name].impedance - below[name].impedance) / (2 * step) for name in above}


@pytest.fixture(scope="module")
def wrapped():
    return tl.sensitivities(cells_plane(), model())


@pytest.mark.parametrize("name", model().numbers())
def test_every_parameter_against_differences(wrapped, name):
    """All from one reading; central differences of ``educe`` agree in every averaging."""
    row = [*wrapped.numbers].index(name)
    for averaging, wanted in differences(lambda value: moved(name, value), model().numbers()[name].value).items():
        assert largest(wrapped.liner[averaging][row], wanted) < SPEEDS


@pytest.mark.parametrize("choices", [{"drive": "running-rms"}, {"mean": "removed"}], ids=str)
def test_choices_of_the_speed_are_followed(choices):
    found = tl.sensitivities(cells_plane(), model(), None, ["porosity"], **choices)
    wanted = differences(lambda value: model(porosity=value), 0.06, **choices)
    for averaging in wanted:
        assert largest(found.liner[averaging][0], wanted[averaging]) < SPEEDS


def test_moments_stand_for_a_plane(wrapped):
    found = tl.sensitivities(tl.moments(cells_plane(), model(), dtype="float64"), model())
    for averaging, wanted in wrapped.liner.items():
        assert largest(found.liner[averaging], wanted) < 1e-7


def test_one_tolerance_is_one_contribution(wrapped):
    """Rectangular limits are divided by sqrt 3, a standard uncertainty is taken as it is."""
    row = [*wrapped.numbers].index("orifice_diameter")
    for limits, factor in (("rectangular", 3**-0.5), ("standard", 1.0)):
        budget = wrapped.propagate({"orifice_diameter": "0.02 mm"}, limits=limits)
        wanted = factor * 2e-5 * wrapped.liner["admittance"][row, 0]
        found = complex(budget.combined["admittance"][0])
        assert found == pytest.approx(complex(abs(wanted.real), abs(wanted.imag)), rel=1e-12)


def test_the_budget_against_monte_carlo():
    """Draws within the limits, frozen |v|: the covariance of R and X, to the draws' scatter."""
    found = tl.sensitivities(frozen_plane(2.0), model(), FREQUENCY, list(TOLERANCES))
    budget = found.propagate(TOLERANCES)
    generator = torch.Generator().manual_seed(1)
    draws = 2 * torch.rand(600, 3, generator=generator, dtype=torch.float64) - 1
    centre = torch.tensor([number.value for number in found.numbers.values()], dtype=torch.float64)
    widths = {row.parameter: row.half_width for row in budget.rows}
    values = centre + draws * torch.tensor([widths[name] for name in found.numbers], dtype=torch.float64)
    made = [model(**dict(zip(found.numbers, row, strict=True))) for row in values.tolist()]
    impedance = torch.stack([each.impedance(FREQUENCY, 2.0) for each in made])
    wanted = torch.cov(torch.view_as_real(impedance.reshape(-1)).T)
    # 600 draws scatter by some 5 %; the second order of these tolerances is below that.
    assert largest(budget.covariance["velocity"][0], wanted) < 0.15


@pytest.mark.parametrize(
    ("text", "name", "wanted"),
    [
        ("0.02 mm", "orifice_diameter", 2e-5),
        ("+-0.02mm", "orifice_diameter", 2e-5),
        ("±1e-2 mm", "orifice_diameter", 1e-5),
        ("1 %", "cavity_depth", 3.8e-4),
        ("0.5 K", "temperature", 0.5),
        ("2 kPa", "pressure", 2000.0),
        (0.01, "porosity", 0.01),
        ("0.01", "porosity", 0.01),
    ],
)
def test_tolerances_are_read(text, name, wanted):
    """Units and per cent to SI half-widths."""
    number = model().numbers()[name]
    assert parse_tolerance(text, name, number.quantity, number.value) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"orifice_diameter": 0.02}, "orifice_diameter is 0.02.* m, mm,"),
        ({"orifice_diameter": "2e-5"}, "orifice_diameter is '2e-5'.* m, mm"),
        ({"temperature": "1"}, "temperature is '1'.* K, %"),
        ({"pressure": "1 kpa"}, "pressure is '1 kpa'.*'kPa'"),
        ({"porosity": "0.1 mm"}, "porosity is '0.1 mm'.* none, %"),
        ({"porosity": "0 %"}, "porosity is '0 %'.* above 0"),
        ({"porosity": "2"}, "half-width of 2.*'2 %'"),
        ({"porosty": "1 %"}, "'porosity'"),
    ],
)
def test_tolerances_without_meaning_are_refused(wrapped, tolerances, message):
    with pytest.raises(ValueError, match=message):
        wrapped.propagate(tolerances, limits="standard")


class Broken(Resistive):
    """Which passes no derivative in a."""

    def impedance(self, frequency, speed=0.0):
        speed = torch.as_tensor(speed)
        return torch.complex(float(self.a) * speed + 0 * frequency, 0 * speed * frequency)


@pytest.mark.filterwarnings("ignore:Converting a tensor with requires_grad")
@pytest.mark.parametrize(
    ("liner", "changes", "error", "message"),
    [
        (Broken(0.2, 0.15, 1e-4, 0.04), {"parameters": ["a"]}, ValueError, r"no derivative in a.*float\(\)"),
        (model(), {"parameters": ["cavity_dept"]}, ValueError, "'cavity_dept'.*cavity_depth"),
        (model(), {"parameters": ["offset", "offset_reactance"]}, ValueError, "offset_reactance is named twice"),
        (model(), {"drive": "rms"}, ValueError, "drive is 'rms'"),
        (model(), {"phase": "given"}, ValueError, "phase is 'given'"),
        (object(), {}, TypeError, "without impedance"),
        (tl.TabulatedLiner([500.0, 2000.0], [1 - 1j, 1 + 1j]), {}, TypeError, "TabulatedLiner"),
    ],
)
def test_slips_are_refused(liner, changes, error, message):
    with pytest.raises(error, match=message):
        tl.sensitivities(cells_plane(), liner, FREQUENCY, **changes)
    with pytest.raises(TypeError, match="plane is list"):
        tl.sensitivities([cells_plane()], model())


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file of twelve probes that names its liner."""
    path = tmp_path_factory.mktemp("planes") / "small.h5"
    plane_of(turbulence((12, 300), seed=2), liner="lbm_slit").write(path)
    return str(path)


def test_command_is_the_budget(capsys, small):
    """The parameters by size, then their sum."""
    words = ["sensitivity", small, "--tolerance", "orifice_diameter=0.02 mm", "--tolerance", "porosity=2 %", "--quiet"]
    assert main([*words, "--json"]) == DONE
    plain = json.loads(capsys.readouterr().out)
    found = tl.sensitivities(tl.read_plane(small), tl.load_liner("lbm_slit"))
    budget = found.propagate({"orifice_diameter": "0.02 mm", "porosity": "2 %"})
    total = complex(budget.combined["velocity"][0])
    assert [row["parameter"] for row in plain["rows"]] == ["porosity", "orifice_diameter", "combined"]
    assert plain["rows"][-1]["impedance"]["resistance"] == pytest.approx(total.real, rel=1e-6)
