"""Liners from files: presets, the user's own TOML, and tables of measured impedance."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.engine.nodes import ANY_LINER, choose_nodes, interpolation_error
from torchliner.liners.catalogue import liner_text, preset_text
from torchliner.liners.model import LinerModel, as_liner, named_numbers

PRESETS = (
    "double_layer_example",
    "goodrich_example",
    "guess_example",
    "lbm_orifice",
    "lbm_orifice_coarse",
    "lbm_slit",
    "lbm_slit_coarse",
    "mesh_example",
    "microperforate_example",
    "onera",
    "polito",
    "polito_as_printed",
)
GRID_F, GRID_V = (500.0, 800.0, 1400.0, 3000.0), (0.0, 0.5, 4.0)


def bilinear(f, v):
    """Linear in f and in v, so that bilinear interpolation returns it exactly."""
    return 0.1 + 1e-3 * f + 0.3 * v + 2e-4 * f * v + 1j * (-2 + 1e-3 * f - 1e-4 * f * v)


def table_rows(names="frequency,speed,resistance,reactance", mark=","):
    cells = [(f, v, bilinear(f, v).real, bilinear(f, v).imag) for f in GRID_F for v in GRID_V]
    return [names.replace(",", mark), *(mark.join(map(repr, row)) for row in cells)]


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("name", PRESETS)
def test_presets_load_and_absorb(name):
    """Each shipped liner carries its own name and reflects less than all of a 1400 Hz tone."""
    liner = tl.load_liner(name)
    assert liner.name == name
    assert tl.preset_names() == list(PRESETS)
    reflection = tl.reflection_from_impedance(liner.impedance(1400.0, [0.0, 1.0, 5.0]))
    assert bool((reflection.abs() < 1).all())


@pytest.mark.parametrize("name", PRESETS)
def test_moments_hold_every_preset(name):
    """R over |v| within the tolerance of float32 by fewer functions than the most, at one
    frequency and over 300 to 6000 Hz; within 1e-5 by those of moments for liners not known yet."""
    liner = tl.load_liner(name)
    many = torch.arange(300.0, 6001.0, 300.0, dtype=torch.float64)
    for frequency in (many[4:5], many):
        nodes = choose_nodes([liner], frequency, 1e-6)
        assert nodes.count <= 48
        assert interpolation_error(nodes, liner, frequency, 100.0)[0] <= 1e-6
    assert interpolation_error(ANY_LINER, liner, many, 30.0)[0] < 1e-5


# Frozen, computed independently: X = 0 with air above, Hz. The paper says about 1450 and 1400.
@pytest.mark.parametrize(
    ("name", "changes", "resonance"),
    [
        ("onera", {"porosity": 0.0395, "open_area_fraction": 1.0}, 1243.5),
        ("onera", {"porosity": 0.0395, "open_area_fraction": 1.0, "cavity_porosity": (9.91 / 12.44) ** 2}, 1451.3),
        ("onera", {}, 1489.7),
        ("polito_as_printed", {}, 1409.0),
        ("polito_as_printed", {"porosity": 0.0878}, 1636.3),
        ("polito", {}, 1608.5),
    ],
)
def test_resonance_frequencies(name, changes, resonance):
    assert tl.load_liner(name).replace(**changes).resonance() == pytest.approx(resonance, abs=0.06)


@pytest.mark.parametrize("call", [tl.load_liner, preset_text])
def test_unknown_preset_names_the_nearest(call):
    with pytest.raises(ValueError, match=r"'onerra' \(did you mean 'onera'\?\).* end in .toml"):
        call("onerra")
    with pytest.raises(ValueError, match=r"'xyz'; presets: double_layer_example, .*, onera, polito, polito_as_p"):
        call("xyz")


@given(f=st.floats(500, 3000), v=st.floats(0, 4))
def test_interpolation_is_exact_on_a_bilinear_function(f, v):
    values = [[bilinear(a, b) for b in GRID_V] for a in GRID_F]
    found = tl.TabulatedLiner(GRID_F, values, GRID_V).impedance(f, v)
    assert abs(complex(found) - bilinear(f, v)) < 1e-12


def test_one_frequency_stands_for_itself_alone():
    """Within what makes no difference, over |v| as in any table; beside it nothing is known."""
    liner = tl.TabulatedLiner([1400.0], [[1 - 1j, 3 - 2j]], [0.0, 2.0])
    found = liner.impedance([[1400.0], [1400.0 * (1 + 5e-7)]], [0.0, 1.0, 2.0])
    assert found.tolist() == [[1 - 1j, 2 - 1.5j, 3 - 2j]] * 2
    assert tl.TabulatedLiner([1400.0], [2 + 1j]).impedance(1400.0, 9.0).tolist() == 2 + 1j
    with pytest.raises(ValueError, match=r"frequency is 1401 Hz, outside the table's 1400-1400 Hz"):
        liner.impedance(1401.0, 1.0)


def test_toml_may_hold_a_table(tmp_path):
    text = "model = 'table'\nfrequency = [1e3, 2e3]\nvalues = [[1, -1], [3, 1]]\ncell_pitch = 0.01"
    liner = tl.load_liner(write(tmp_path / "mine.toml", text))
    assert (liner.name, liner.cell_pitch) == ("mine", 0.01)
    assert complex(liner.impedance(1500.0)) == 2 + 0j
    write(tmp_path / "again.toml", liner_text(liner, "me"))
    assert tl.load_liner(tmp_path / "again.toml").impedance(1250.0, 3.0) == liner.impedance(1250.0, 3.0)
    write(tmp_path / "t.csv", "\ufefffrequency [kHz],reactance,resistance", "2,1,3", "1,-1,1")
    assert complex(tl.load_liner(tmp_path / "t.csv").impedance(1500.0)) == 2 + 0j


def test_any_object_with_an_impedance_is_a_liner(liner):
    """What it states is taken, for the rest the defaults hold; a model is left as it is."""

    class Mine:
        cell_pitch = 5e-3
        hole_diameter = 1e-3

        def impedance(self, frequency, speed):
            return liner.impedance(frequency, speed)

    found = as_liner(Mine())
    assert isinstance(found, LinerModel)
    assert (found.cell_pitch, found.hole_diameter) == (5e-3, pytest.approx(1e-3))
    assert found.frequency_range is found.fluid is None
    assert found.describe() == {"model": "Mine"}
    assert complex(found.impedance(1000.0, 1.0)) == complex(liner.impedance(1000.0, 1.0))
    assert as_liner(liner) is liner
    with pytest.raises(TypeError, match=r"without impedance\(frequency, speed\).*load_liner"):
        as_liner("polito")
    with pytest.raises(TypeError, match=r"Mine, whose numbers\(\) names no parameter to vary"):
        named_numbers(found)


def test_nothing_is_extrapolated_and_an_axis_may_be_missing():
    liner = tl.TabulatedLiner([1000.0, 2000.0], [1 - 1j, 3 + 1j])
    found = liner.impedance([[1000.0], [1250.0]], [0.0, 7.0, 1e9])
    assert found.tolist() == [[1 - 1j] * 3, [1.5 - 0.5j] * 3]
    grid = tl.TabulatedLiner(GRID_F, torch.ones(4, 3), GRID_V)
    for f, v, message in (
        (499.0, 1.0, r"frequency is 499 Hz, outside the table's 500-3000 Hz"),
        (600.0, 4.1, r"\|v\| is 4.1 m/s, outside the table's 0-4 m/s"),
        (600.0, float("nan"), r"\|v\| is nan m/s"),
    ):
        with pytest.raises(ValueError, match=f"table 'table': {message}"):
            grid.impedance(f, v)


HEAD = "frequency,speed,resistance,reactance"
POLITO = preset_text("polito")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "model = 'sdoff'", "model is 'sdoff'.*'sdof'"),
        ("a.toml", "model = 'table'", "frequency: missing; values: missing"),
        ("a.toml", POLITO.replace("porosity = 0.055 ", "porosty = 5.5 "), "porosty: .*'porosity'.*porosity: missing"),
        ("a.toml", POLITO.replace("porosity = 0.055 ", "porosity = 5.5 "), r"porosity is 5\.5; .*at most 1"),
        ("a.toml", POLITO.replace("1.17e-3", "1.17"), r"orifice_diameter is 1\.17 m; .*0\.1 m"),
        ("a.toml", POLITO.replace("38.1e-3", "'38 mm'"), "cavity_depth is '38 mm'"),
        ("a.toml", POLITO.replace('"as_measured"', '"measured"'), "velocity_reading 'measured'.*as_measured"),
        ("a.toml", POLITO + "\n[fluid]\ntemperature = 20", "temperature = 20: .*150"),
        ("a.toml", POLITO + "\nimpedance_offset = 0.1", "impedance_offset is 0.1; two numbers"),
        ("t.csv", "f,resistance,reactance\n1,2,3", "unknown column 'f'"),
        ("t.csv", "frequency [cm],resistance,reactance\n1,2,3", "units 'cm'.*Hz"),
        ("t.csv", "\n".join(table_rows()[:-1]), "each frequency needs one row"),
        ("t.csv", "\n".join([*table_rows(), "500,0,1,1"]), "each frequency needs one row"),
        ("t.csv", f"{HEAD}\n1,1,2,3\n1,2,2,3\n2,1,2,3\n2,2,2,3", "speed starts at 1, not at 0"),
    ],
)
def test_bad_files_are_refused(tmp_path, name, text, message):
    with pytest.raises(ValueError, match=f"(?s){name.split('.')[0]}.*{message}"):
        tl.load_liner(write(tmp_path / name, text))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2], [1, 2, 3]), r"shape \(3,\), the axes \(2,\)"),
        (([1, 2], [1, float("inf")]), "all are finite"),
        (([2, 1], [1, 1]), "frequency must increase"),
        (([], []), "frequency must increase"),
        (([1, 2], [[1], [1]], [0]), "speed must increase"),
    ],
)
def test_bad_tables_are_refused(arguments, message):
    with pytest.raises(ValueError, match=rf"table 'table'.*{message}"):
        tl.TabulatedLiner(*arguments)
