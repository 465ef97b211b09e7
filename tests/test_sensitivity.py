"""Derivatives of the educed impedance in the liner's parameters, and tolerances propagated."""

from __future__ import annotations

import csv
import json

import pytest
import torch
from conftest import DATA, FREQUENCY, Resistive, frozen_plane, plane_of, turbulence
from torch.autograd import forward_ad

import torchliner as tl
from torchliner.cli.main import BAD_INPUT, DONE, main
from torchliner.conversions import impedance_from_reflection
from torchliner.liners.cell import air_state
from torchliner.studies.sensitivities import covariance_of
from torchliner.units import parse_tolerance

pytestmark = [
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]
SLIT = str(DATA / "slit_n130_y2.5mm.h5")
# Differences with steps of 1e-5; interpolation over |v| leaves 1e-8, each result states its own.
SPEEDS = 1e-6


def model(**changes):
    given = {
        "facesheet_thickness": 1e-3, "orifice_diameter": 1e-3, "porosity": 0.06,
        "cavity_depth": 38e-3, "cavity_hydraulic_radius": 4e-3, "cavity_porosity": 0.9,
        "open_area_fraction": 0.8, "vena_contracta": 0.78, "impedance_offset": 0.03 - 0.02j,
        "velocity_gain": 0.9, "velocity_reading": "conserved", "cell_pitch": 5e-3,
        "fluid": tl.Fluid.from_temperature(300.0, 9e4),
    }  # fmt: skip
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
        state = {"temperature": 300.0, "pressure": 9e4, name: value}
        return model(fluid=tl.Fluid.from_temperature(**state))
    return model(**{name: value})


def quantities(found):
    return {
        "probes": found.impedance,
        **{f"cells {name}": each.impedance for name, each in found.cells.items()},
        **{f"liner {name}": each.impedance for name, each in found.liner.items()},
    }


def slopes_of(found):
    return {
        "probes": found.probes,
        **{f"cells {name}": each for name, each in found.cells.items()},
        **{f"liner {name}": each for name, each in found.liner.items()},
    }


def largest(found, wanted):
    return float((found - wanted).abs().max() / wanted.abs().max())


@pytest.fixture(scope="module")
def wrapped():
    return tl.sensitivities(cells_plane(), model(), averaging="phase-locked")


@pytest.mark.parametrize("name", model().numbers())
def test_every_parameter_against_differences(wrapped, name):
    """All from one reading; central differences of ``educe`` agree, probe by probe."""
    step = 1e-5 * abs(model().numbers()[name].value)
    above, below = (
        quantities(tl.educe(cells_plane(), moved(name, model().numbers()[name].value + sign * step),
                            averaging="phase-locked"))
        for sign in (1, -1)
    )  # fmt: skip
    row = [*wrapped.numbers].index(name)
    for key in above:
        wanted = (above[key] - below[key]) / (2 * step)
        assert largest(slopes_of(wrapped)[key][row], wanted) < SPEEDS
    assert float(wrapped.level_error[row]) < SPEEDS


@pytest.mark.parametrize(
    ("name", "phase"),
    [("orifice_diameter", "averaged"), ("temperature", "self-consistent"), ("porosity", "given")],
)
def test_phases_against_forward_mode(name, phase):
    """With nonlinear phase rules, at two frequencies: as ``educe`` differentiated."""
    options = {"phase": phase, "interval": None, "minimum_coherence": 0.0}
    if phase == "given":
        options["reference_phase"] = 0.3
    found = tl.sensitivities(cells_plane(), model(), [1000.0, FREQUENCY], [name], **options)
    value = torch.tensor(model().numbers()[name].value, dtype=torch.float64)
    with forward_ad.dual_level():
        dual = model().with_numbers({name: forward_ad.make_dual(value, torch.ones_like(value))})
        whole = quantities(tl.educe(cells_plane(), dual, [1000.0, FREQUENCY], **options))
        for key, value in whole.items():
            slope = forward_ad.unpack_dual(value).tangent
            assert slope.shape[-1] == 2
            assert largest(slopes_of(found)[key][0], slope) < SPEEDS


def test_frozen_velocity_gives_the_models_own_slope():
    """With |v| constant dZ/dp is that of the formula; of the offset it is 1 and j exactly."""
    names = ["porosity", "vena_contracta", "offset_resistance", "offset_reactance"]
    found = tl.sensitivities(frozen_plane(2.0), model(), FREQUENCY, names)
    for i, name in enumerate(names[:2]):
        value = model().numbers()[name].value
        step = 1e-6 * value
        above, below = (moved(name, value + s * step).impedance(FREQUENCY, 2.0)
                        for s in (1, -1))  # fmt: skip
        assert largest(found.probes[i], (above - below) / (2 * step)) < SPEEDS
    assert float((found.liner["admittance"][2:, 0] - torch.tensor([1, 1j])).abs().max()) < SPEEDS


def test_slopes_are_those_of_the_formula_averaged_over_the_samples():
    """dR/dp of a probe: the mean of dR(f, |v_n|)/dp over whole periods, no interpolation."""
    plane = cells_plane()
    names = ["orifice_diameter", "vena_contracta", "offset_reactance"]
    found = tl.sensitivities(plane, model(), FREQUENCY, names, averaging="admittance")
    numbers = model().numbers()
    for i, name in enumerate(names):
        value = torch.tensor(numbers[name].value, dtype=torch.float64, requires_grad=True)
        each = model().with_numbers({name: value}).impedance(FREQUENCY, plane.velocity[3].abs())
        z = impedance_from_reflection(((each - 1) / (each + 1)).mean())
        parts = [torch.autograd.grad(part, value, retain_graph=True)[0] for part in (z.real, z.imag)]
        assert largest(found.probes[i, 3, 0], torch.complex(*parts)) < 1e-8
        assert float(found.level_error[i]) < 1e-7


def test_moments_stand_for_a_plane(wrapped):
    reduced = tl.moments(cells_plane(), model(), dtype="float64")
    found = tl.sensitivities(reduced, model())
    for key in ("probes", "cells velocity", "liner phase-locked"):
        assert largest(slopes_of(found)[key], slopes_of(wrapped)[key]) < 1e-7


def test_scaling_is_by_value(wrapped):
    """1 % of the parameter, and any step."""
    wanted = 0.01 * wrapped.values[:, None] * wrapped.liner["velocity"]
    assert torch.equal(wrapped.per_percent().liner["velocity"], wanted)
    assert wrapped.numbers["temperature"].unit == "K"


def test_state_of_air():
    """Temperature and pressure come back from the gas they made."""
    assert air_state(tl.Fluid.from_temperature(280.0, 8e4)) == pytest.approx((280.0, 8e4))


@pytest.mark.parametrize("reading", ["as_measured", "conserved"])
def test_velocity_gain_scales_the_velocity(reading):
    """Z with gain g at |v| is Z without at g |v|."""
    plain = model(velocity_gain=1.0, velocity_reading=reading)
    scaled = plain.replace(velocity_gain=1.7)
    speeds = torch.tensor([0.0, 0.3, 2.0, 9.0], dtype=torch.float64)
    found, wanted = scaled.impedance(FREQUENCY, speeds), plain.impedance(FREQUENCY, 1.7 * speeds)
    assert largest(found, wanted) < 1e-14


def test_one_tolerance_is_one_contribution(wrapped):
    """Rectangular limits are divided by sqrt 3, a standard uncertainty is taken as it is."""
    row = [*wrapped.numbers].index("orifice_diameter")
    for limits, factor in (("rectangular", 3**-0.5), ("standard", 1.0)):
        budget = wrapped.propagate({"orifice_diameter": "0.02 mm"}, limits=limits)
        wanted = factor * 2e-5 * wrapped.liner["admittance"][row, 0]
        found = complex(budget.combined["admittance"][0])
        assert found == pytest.approx(complex(abs(wanted.real), abs(wanted.imag)), rel=1e-12)
        probes = factor * 2e-5 * wrapped.probes[row]
        assert torch.allclose(budget.places["probes"].imag, probes.imag.abs(), rtol=1e-12)


def test_the_budget_against_monte_carlo():
    """Draws within the limits, frozen |v|: the covariance of R and X, to the draws' scatter."""
    tolerances = {"orifice_diameter": "0.02 mm", "porosity": "2 %", "cavity_depth": "0.1 mm"}
    found = tl.sensitivities(frozen_plane(2.0), model(), FREQUENCY, list(tolerances))
    budget = found.propagate(tolerances, limits="rectangular")
    generator = torch.Generator().manual_seed(1)
    draws = 2 * torch.rand(600, 3, generator=generator, dtype=torch.float64) - 1
    values = found.values + draws * budget.half_widths
    impedance = torch.stack(
        [
         model(**dict(zip(tolerances, row, strict=True))).impedance(FREQUENCY, 2.0)
         for row in values.tolist()]
    )  # fmt: skip
    wanted = torch.cov(torch.view_as_real(impedance.reshape(-1)).T)
    # 600 draws scatter by some 5 %; the second order of these tolerances is below that.
    assert largest(budget.covariance["velocity"][0], wanted) < 0.15


RESISTIVE = Resistive(0.2, 0.15, 1e-4, 0.04)


def test_any_model_that_states_numbers_is_differentiated():
    """dZ/dp of a model of one's own is that of differences, and carries its tolerances."""
    options = {"frequency": [1000.0, FREQUENCY], "dtype": "float64"}
    found = tl.sensitivities(cells_plane(), RESISTIVE, **options)
    assert tuple(found.numbers) == ("r0", "a", "m", "length")
    for i, (name, number) in enumerate(RESISTIVE.numbers().items()):
        step = 1e-5 * number.value
        above, below = (
            quantities(tl.educe(cells_plane(), RESISTIVE.replace(**{name: number.value + s}),
                                **options)) for s in (step, -step)
        )  # fmt: skip
        for key in above:
            slope = (above[key] - below[key]) / (2 * step)
            assert largest(slopes_of(found)[key][i], slope) < SPEEDS
    budget = found.propagate({"length": "0.1 mm", "a": "0.01"}, limits="standard")
    assert budget.half_widths.tolist() == pytest.approx([0.01, 1e-4])
    assert [part.unit for part in budget.of(averaging="admittance", frequency=FREQUENCY)] == ["s/m", "m"]


@pytest.mark.filterwarnings("ignore:Converting a tensor with requires_grad")
def test_a_model_without_derivatives_is_refused():
    """A number that went through float() would have sensitivity 0."""

    class Broken(Resistive):
        def impedance(self, frequency, speed=0.0):
            speed = torch.as_tensor(speed)
            return torch.complex(float(self.a) * speed + 0 * frequency, 0 * speed * frequency)

    with pytest.raises(ValueError, match=r"Broken.impedance passes no derivative in a.*float\(\)"):
        tl.sensitivities(cells_plane(), Broken(0.2, 0.15, 1e-4, 0.04), parameters=["a"])


def test_correlated_tolerances_add_or_cancel(wrapped):
    """Correlation 1 adds changes, -1 subtracts them, and the order of names does not matter."""
    tolerances = {"porosity": "1 %", "vena_contracta": 0.01}
    alone = wrapped.propagate(tolerances, limits="standard")
    changes = alone.contributions["velocity"][:, 0]
    for sign in (1.0, -1.0):
        pair = {("vena_contracta", "porosity"): sign}
        budget = wrapped.propagate(tolerances, limits="standard", correlation=pair)
        wanted = changes[0] + sign * changes[1]
        assert complex(budget.combined["velocity"][0]).real == pytest.approx(abs(float(wanted.real)), rel=1e-9)
    largest_first = [part.parameter for part in alone.of(averaging="velocity")]
    assert largest_first == ["porosity", "vena_contracta"]


def test_covariance_by_hand():
    """Two independent changes, 3 + 4j and 1 - 2j."""
    found = covariance_of(torch.tensor([3 + 4j, 1 - 2j], dtype=torch.complex128),
                          torch.eye(2, dtype=torch.float64))  # fmt: skip
    assert found.tolist() == [[10.0, 10.0], [10.0, 20.0]]


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
    found = parse_tolerance(text, name, number.quantity, number.value)
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"orifice_diameter": 0.02}, r"orifice_diameter is 0.02; write .* above 0 and its unit, one of m, mm,"),
        ({"orifice_diameter": "2e-5"}, "orifice_diameter is '2e-5'; .* its unit, one of m, mm"),
        ({"temperature": "1"}, r"temperature is '1'; .* its unit, one of K, %.* as in '0.5 K'"),
        ({"pressure": "1 kpa"}, r"pressure is '1 kpa' \(did you mean 'kPa'"),
        ({"porosity": "0.1 mm"}, "porosity is '0.1 mm'.* one of none, %"),
        ({"porosity": "0 %"}, "porosity is '0 %'; write a finite half-width above 0"),
        ({"porosity": "-1 %"}, "porosity is '-1 %'; write a finite half-width above 0"),
        ({"porosity": "2"}, "a half-width of 2, more than its value, .* write '2 %' where per"),
        ({"porosty": "1 %"}, "did you mean 'porosity'"),
        ({}, "no tolerance is stated"),
    ],
)
def test_tolerances_without_meaning_are_refused(wrapped, tolerances, message):
    with pytest.raises(ValueError, match=message):
        wrapped.propagate(tolerances, limits="standard")


def test_other_slips_are_refused(wrapped):
    plane = cells_plane()
    zero = tl.sensitivities(plane, model(impedance_offset=0j), FREQUENCY, ["offset"])
    with pytest.raises(ValueError, match=r"offset_resistance is '5 %'; .* one of none, % \(of 0\), as in '0.5'"):
        zero.propagate({"offset_resistance": "5 %"}, limits="standard")
    with pytest.raises(ValueError, match="unknown reading of the limits 'uniform'"):
        wrapped.propagate({"porosity": "1 %"}, limits="uniform")
    with pytest.raises(ValueError, match="is -1 to 1"):
        wrapped.propagate({"porosity": "1 %", "pressure": "1 kPa"}, limits="standard",
                          correlation={("porosity", "pressure"): 1.2})  # fmt: skip
    three = {"porosity": "1 %", "pressure": "1 kPa", "temperature": "1 K"}
    pairs = {("porosity", "pressure"): 0.9, ("pressure", "temperature"): 0.9,
             ("porosity", "temperature"): -0.9}  # fmt: skip
    with pytest.raises(ValueError, match="contradict each other"):
        wrapped.propagate(three, limits="standard", correlation=pairs)
    with pytest.raises(ValueError, match=r"unknown parameter 'cavity_dept' \(did you mean"):
        tl.sensitivities(plane, model(), FREQUENCY, ["cavity_dept"])
    with pytest.raises(ValueError, match="named twice"):
        tl.sensitivities(plane, model(), FREQUENCY, ["offset", "offset_reactance"])
    with pytest.raises(ValueError, match="drive 'rms' leaves no moments"):
        tl.sensitivities(plane, model(), FREQUENCY, drive="rms")
    with pytest.raises(TypeError, match=r"without impedance\(frequency, speed\)"):
        tl.sensitivities(plane, object(), FREQUENCY)
    table = tl.TabulatedLiner([500.0, 2000.0], [1 - 1j, 1 + 1j])
    with pytest.raises(TypeError, match=r"TabulatedLiner, whose numbers\(\) names no parameter"):
        tl.sensitivities(plane, table, FREQUENCY)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file of twelve probes that names its liner."""
    path = tmp_path_factory.mktemp("planes") / "small.h5"
    plane_of(turbulence((12, 300), seed=2), liner="lbm_slit").write(path)
    return str(path)


def test_command_prints_sorts_and_draws(capsys, tmp_path, small):
    """Contributions sorted, combined last; CSV and picture written."""
    table, picture = tmp_path / "budget.csv", tmp_path / "budget.png"
    code = main(["sensitivity", small, "--tolerance", "orifice_diameter=0.02 mm", "--tolerance",
                 "porosity=2 %", "-o", str(table), "--figure", str(picture)])  # fmt: skip
    out = capsys.readouterr().out
    assert code == DONE
    assert out.index("porosity") < out.index("orifice_diameter") < out.index("combined")
    assert "rectangular" in out
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["parameter"] for row in rows] == ["porosity", "orifice_diameter", "combined"]
    total = sum(float(row["impedance_resistance"]) ** 2 for row in rows[:2]) ** 0.5
    assert float(rows[2]["impedance_resistance"]) == pytest.approx(total, rel=1e-9)
    assert picture.stat().st_size > 10_000
    code = main(["sensitivity", small, "--parameters", "porosity", "cavity_depth", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert [row["parameter"] for row in found["rows"]] == ["cavity_depth", "porosity"]
    assert found["rows"][0]["unit"] == "m"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tolerance", "orifice_diameter=0.02"], "and its unit, one of m, mm"),
        (["--tolerance", "orifice_diameter"], "write NAME=VALUE"),
        (["--tolerance", "porosity=1 %", "--correlation", "porosity=1"], "write NAME,NAME=VALUE"),
        (["--tolerance", "porosity=1 %", "-o", SLIT], "is an input"),
    ],
)
def test_command_refuses(capsys, words, message):
    assert main(["sensitivity", SLIT, *words]) == BAD_INPUT
    assert message in capsys.readouterr().err


def test_numbers_of_the_slit():
    """n130 at 2.5 mm, per 1 %, velocity first; frozen with version 0.1."""
    found = tl.sensitivities(tl.read_plane(SLIT), tl.load_liner("lbm_slit"), None,
                             ["porosity", "cavity_depth", "vena_contracta"])  # fmt: skip
    wanted = torch.tensor([-0.003099 - 0.004575j, 0.0000395 + 0.017745j, -0.001677 - 0.0000667j])
    assert float((found.per_percent().liner["velocity"][:, 0] - wanted).abs().max()) < 2e-6


TWICE = "--correlation porosity,temperature=0.5 --correlation temperature,porosity=0.2"
PAIR = ["--tolerance", "porosity=1 %", "--tolerance", "temperature=1 K"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tolerance", "porosity=1 %", "--tolerance", "porosity=2 %"], "--tolerance names porosity twice"),
        (["--correlation", "porosity,orifice_diameter=0.5"], "is one of tolerances; state them"),
        (["--limits", "standard"], "--limits is one of tolerances; state them"),
        (
            [*PAIR, *TWICE.split()],
            "--correlation names temperature and porosity twice",
        ),
        (
            [*PAIR, "--correlation", "porosity,temperature=x"],
            "porosity,temperature=x'] cannot be r",
        ),
        (["-o", "rows.h5"], "must be one of .csv"),
        (["--figure", "bars.xyz"], "must be one of .png"),
    ],
)
def test_command_refuses_what_would_be_ignored(capsys, words, message):
    assert main(["sensitivity", SLIT, *words]) == BAD_INPUT
    assert message in capsys.readouterr().err


def test_a_plane_is_needed(capsys):
    with pytest.raises(TypeError, match="plane is list; one VelocityPlane is needed"):
        tl.sensitivities([tl.read_plane(SLIT)], tl.load_liner("lbm_slit"))


def test_json_states_impedance_and_correlation(capsys, small):
    """What the table prints below its rows; nothing is text where a number is meant."""
    words = ["--tolerance", "porosity=2 %", "--tolerance", "orifice_diameter=0.02 mm"]
    assert main(["sensitivity", small, *words, "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)
    nominal = tl.educe(tl.read_plane(small), tl.load_liner("lbm_slit"), dtype="float64")
    wanted = float(nominal.liner["velocity"].impedance[0].real)
    assert found["impedance"][0]["resistance"] == pytest.approx(wanted, rel=1e-9)
    assert -1 <= found["correlation_of_R_and_X"][0] <= 1
    (combined,) = [row for row in found["rows"] if row["parameter"] == "combined"]
    assert combined["value"] is None
    main(["sensitivity", small, *words, "--quiet"])
    printed = capsys.readouterr().out
    assert f"correlation of R and X {found['correlation_of_R_and_X'][0]:+.2f}" in printed
