"""Liners from files: presets, the user's own TOML, and tables of measured impedance."""

import tomllib

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.engine.nodes import ANY_LINER, choose_nodes, interpolation_error
from torchliner.liners.catalogue import preset_text
from torchliner.liners.laws import LAWS
from torchliner.liners.model import LinerModel, as_liner, named_numbers

PRESETS = (
    "double_layer_example",
    "goodrich_example",
    "guess_example",
    "lbm_orifice",
    "lbm_orifice_coarse",
    "lbm_slit",
    "lbm_slit_coarse",
    "melling_example",
    "mesh_example",
    "microperforate_example",
    "onera",
    "polito",
    "polito_as_printed",
    "two_parameter_example",
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


def test_the_presets_show_every_law():
    """Sources are stated; those that are no liner that was built say so."""
    liners = [tl.load_liner(name) for name in PRESETS]
    shown = {layer.kind for each in liners for layer in getattr(each, "layers", ())}
    assert shown == {*LAWS, "cavity"} - {"weave"}  # that of tests/test_layered.py
    for name in PRESETS:
        content = tomllib.loads(preset_text(name))
        assert content["source"]
        assert ("teaching example" in content["description"]) == name.endswith("_example")


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


@pytest.mark.parametrize(
    ("name", "measured"),
    [
        ("lbm_slit", 0.0863 - 0.0007j),
        ("lbm_orifice", 0.2211 - 0.2154j),
        ("lbm_slit_coarse", 0.1145 + 0.0711j),
        ("lbm_orifice_coarse", 0.2430 - 0.2030j),
    ],
)
def test_resolved_presets_start_from_the_measured_linear_part(name, measured):
    """At |v| = 0 they return the impedance of the 115 dB run on the same grid."""
    assert abs(complex(tl.load_liner(name).impedance(1400.0, 0.0)) - measured) < 1e-4


@pytest.mark.parametrize("name", PRESETS)
def test_copy_of_a_preset_is_the_same_liner(tmp_path, name):
    (tmp_path / "mine.toml").write_text(preset_text(name), encoding="utf-8")
    assert tl.load_liner(tmp_path / "mine.toml") == tl.load_liner(name)
    assert tl.load_liner(str(tmp_path / "mine.toml")) == tl.load_liner(name)


def test_edited_copy_changes_what_was_edited(tmp_path):
    text = preset_text("polito").replace("0.055 ", "0.0878 ").replace('name = "polito"', "")
    text += "\n[fluid]\ntemperature = 300\npressure = 9e4\nprandtl = 0.8\n"
    found = tl.load_liner(write(tmp_path / "mine.toml", text))
    assert (found.porosity, found.name) == (0.0878, "mine")
    gas = tl.Fluid.from_temperature(300, 9e4)
    assert (found.fluid.sound_speed, found.fluid.prandtl) == (gas.sound_speed, 0.8)
    wanted = tl.load_liner("polito").replace(porosity=0.0878, name="mine", fluid=found.fluid)
    assert found == wanted


@pytest.mark.parametrize("call", [tl.load_liner, preset_text])
def test_unknown_preset_names_the_nearest(call):
    with pytest.raises(ValueError, match=r"'onerra' \(did you mean 'onera'\?\).* ends in .toml"):
        call("onerra")
    with pytest.raises(ValueError, match=r"'xyz'; presets are double_layer_example, .*, onera, polito, polito_as_p"):
        call("xyz")


def test_all_mistakes_of_a_file_are_listed_at_once(tmp_path):
    text = preset_text("polito").replace("porosity = 0.055 ", "porosty = 5.5 ")
    text = text.replace("orifice_diameter = 1.17e-3", "orifice_diameter = 1.17")
    text = text.replace('"as_measured"', '"measured"').replace("38.1e-3", "'38 mm'")
    path = write(tmp_path / "a.toml", text, "[fluid]", "densty = 1.2", "temperature = 20")
    with pytest.raises(ValueError, match=r"a.toml has 7 mistake\(s\)") as caught:
        tl.load_liner(path)
    lines = sorted(line.strip() for line in str(caught.value).splitlines()[1:])
    starts = [
        "cavity_depth = '38 mm': input should be a valid number",
        "fluid.densty: no such key (did you mean 'density'?)",
        "fluid.temperature = 20: input should be greater than or equal to 150",
        "orifice_diameter = 1.17: input should be less than or equal to 0.1",
        "porosity: missing",
        "porosty: no such key (did you mean 'porosity'?)",
        "velocity_reading = 'measured': input should be 'as_measured' or 'conserved'",
    ]
    assert all(line.startswith(start) for line, start in zip(lines, starts, strict=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model = sdof", r"a.toml is not valid TOML: .*line 1"),
        ("model = 'sdoff'", r"a.toml: model is 'sdoff' \(did you mean 'sdof'\?\); it is one"),
        ("name = 'x'", r"a.toml: model is None.*; it is one of sdof, "),
        ("model = ['sdof']", r"a.toml: model is \['sdof'\]"),
        ("model = 'table'", r"a.toml: a table is file, a .csv beside this one"),
        (
            preset_text("onera").replace("12.44e-3", "0.5e-3"),
            r"a.toml: liner 'onera': orifice_diameter is 0.000991 m, larger than cell_pitch, 0.0005 m",
        ),
        (preset_text("onera") + "\n[fluid]\nsound_speed = inf", r"sound_speed = inf: .*finite"),
    ],
)
def test_bad_toml_is_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        tl.load_liner(write(tmp_path / "a.toml", text))


@given(f=st.floats(500, 3000), v=st.floats(0, 4))
def test_interpolation_is_exact_on_a_bilinear_function(f, v):
    values = [[bilinear(a, b) for b in GRID_V] for a in GRID_F]
    found = tl.TabulatedLiner(GRID_F, values, GRID_V).impedance(f, v)
    assert abs(complex(found) - bilinear(f, v)) < 1e-12


def test_table_over_frequency_alone_ignores_the_speed():
    liner = tl.TabulatedLiner([1000.0, 2000.0], [1 - 1j, 3 + 1j])
    found = liner.impedance([[1000.0], [1250.0]], [0.0, 7.0, 1e9])
    assert found.tolist() == [[1 - 1j] * 3, [1.5 - 0.5j] * 3]
    assert (liner.frequency_range, liner.speed_max) == ((1000.0, 2000.0), None)


@pytest.mark.parametrize(
    ("frequency", "speed", "message"),
    [
        (499.0, 1.0, r"table 'table': frequency is 499 Hz, outside the table's 500-3000 Hz"),
        ([600.0, 3100.0], 1.0, r"frequency is 3100 Hz, outside the table's 500-3000 Hz"),
        (600.0, 4.1, r"table 'table': \|v\| is 4.1 m/s, outside the table's 0-4 m/s"),
        (600.0, -0.1, r"\|v\| is -0.1 m/s, outside"),
        (600.0, float("nan"), r"\|v\| is nan m/s, outside"),
    ],
)
def test_nothing_is_extrapolated(frequency, speed, message):
    liner = tl.TabulatedLiner(GRID_F, torch.ones(4, 3), GRID_V)
    with pytest.raises(ValueError, match=message):
        liner.impedance(frequency, speed)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2], [1, 2, 3]), r"values have shape \(3,\), the axes \(2,\)"),
        (([1, 2], [1, float("inf")]), r"holds values that are not finite"),
        (([2, 1], [1, 1]), r"frequency must increase; values needed: 1 or more"),
        (([], []), r"frequency must increase; values needed: 1 or more"),
        (([1, 2], [[1], [1]], [0]), r"speed must increase; values needed: 2 or more"),
        (([1, 2], [[1, 1], [1, 1]], [0.5, 1]), r"speed starts at 0.5, not at 0"),
    ],
)
def test_bad_tables_are_refused(arguments, message):
    with pytest.raises(ValueError, match=rf"table 'table'.*{message}"):
        tl.TabulatedLiner(*arguments)


def test_one_frequency_stands_for_itself_alone():
    """Within what makes no difference, over |v| as in any table; beside it nothing is known."""
    liner = tl.TabulatedLiner([1400.0], [[1 - 1j, 3 - 2j]], [0.0, 2.0])
    found = liner.impedance([[1400.0], [1400.0 * (1 + 5e-7)]], [0.0, 1.0, 2.0])
    assert found.tolist() == [[1 - 1j, 2 - 1.5j, 3 - 2j]] * 2
    assert tl.TabulatedLiner([1400.0], [2 + 1j]).impedance(1400.0, 9.0).tolist() == 2 + 1j
    with pytest.raises(ValueError, match=r"frequency is 1401 Hz, outside the table's 1400-1400 Hz"):
        liner.impedance(1401.0, 1.0)


@pytest.mark.parametrize("mark", [",", ";", ", ", ";  "])
@pytest.mark.parametrize("shuffled", [False, True])
def test_csv_is_read_with_comma_or_semicolon(tmp_path, mark, shuffled):
    header, *rows = table_rows(mark=mark)
    path = write(tmp_path / "t.csv", header, *(rows[::-1] if shuffled else rows), "")
    for liner in (tl.load_liner(path), tl.TabulatedLiner.read_csv(path)):
        assert complex(liner.impedance(1000.0, 2.0)) == pytest.approx(bilinear(1000.0, 2.0))
        assert (liner.name, liner.speed_max) == ("t", 4.0)


def test_toml_may_name_a_table_beside_it(tmp_path):
    write(tmp_path / "t.csv", "\ufefffrequency,reactance,resistance,note", "2e3,1,3,b", "1e3,-1,1,a")
    text = "model = 'table'\nfile = 't.csv'\ncell_pitch = 0.01"
    liner = tl.load_liner(write(tmp_path / "mine.toml", text))
    assert (liner.name, liner.cell_pitch) == ("mine", 0.01)
    assert complex(liner.impedance(1500.0)) == 2 + 0j


def test_a_table_may_state_its_units_and_remarks(tmp_path):
    """As the other tables of text do."""
    lines = ["# of me", "Frequency [kHz]; speed [cm/s]; resistance; reactance", "# flow rig", "1;0;2;3", "1;100;4;3"]
    liner = tl.load_liner(write(tmp_path / "t.csv", *lines))
    assert complex(liner.impedance(1000.0, 0.5)) == 3 + 3j


HEAD = "frequency,speed,resistance,reactance"


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["f,resistance,reactance", "1,2,3"], r"'frequency' is missing; there are: res.* write frequency, \[speed"),
        (["frequency [cm],resistance,reactance", "1,2,3"], r"'frequency' has units 'cm'.*in one of Hz"),
        ([HEAD.replace(",", ";"), "1;0;2,5;3.5"], r"mixes decimal marks: line 2 has '2,5'"),
        ([""], r"t.csv is empty"),
        ([HEAD], r"t.csv holds no values: the file ends at line 1"),
        ([HEAD, "1,0,2,3", "", "2,0,two,3"], r"t.csv: line 4, column 'resistance' is 'two'; a num"),
        ([HEAD, "1,0,2"], r"t.csv: line 2, column 'reactance' is ''; a number is need"),
        ([HEAD, "1,0,nan,3"], r"t.csv: line 2, column 'resistance' is 'nan'; a number"),
        ([HEAD, "1,0,2,3,4"], r"t.csv: line 2 has 5 cells, the header 4"),
        ([HEAD + ",speed", "1,0,2,3,0"], r"t.csv: column 'speed' is named twice"),
        (table_rows()[:-1], r"t.csv: no row for 3000 Hz and 4 m/s; the grid is full"),
        ([*table_rows(), "500,0,1,1"], r"t.csv: 1 row\(s\) repeat a frequency and speed"),
        ([HEAD, "1,1,2,3", "1,2,2,3", "2,1,2,3", "2,2,2,3"], r"'t': speed starts at 1, not at 0"),
    ],
)
def test_bad_csv_is_refused(tmp_path, lines, message):
    with pytest.raises(ValueError, match=message):
        tl.load_liner(write(tmp_path / "t.csv", *lines))


def test_any_object_with_an_impedance_is_a_liner(liner):
    """What it states is taken, for the rest the defaults hold; a model is left as it is."""

    class Mine:
        cell_pitch = 5e-3
        orifice_diameter = torch.tensor(1e-3)

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


def test_a_description_that_leaves_numbers_to_defaults_is_refused():
    """Of a map that somebody edited: the default would be another liner, and nothing would say."""
    whole = tl.load_liner("lbm_orifice_coarse").describe()
    assert tl.load_liner(whole).describe() == whole
    for left_out in ("cavity_porosity", "vena_contracta"):
        part = {key: value for key, value in whole.items() if key != left_out}
        with pytest.raises(ValueError, match=f"lacks {left_out}; describe"):
            tl.load_liner(part)
    gas = {key: value for key, value in whole["fluid"].items() if key != "density"}
    with pytest.raises(ValueError, match="lacks fluid; describe"):
        tl.load_liner({**whole, "fluid": gas})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"resistance": [0.5]}, r"resistance has shape \(1,\), reactance \(3,\)"),
        ({"reactance": [[0.0], [0.1], [0.2]]}, r"resistance has shape \(3,\), reactance \(3, 1\)"),
        ({"resistance": [0.5, "0.5", 0.5]}, "a real number is needed"),
        ({"speed": [0.0, 1.0]}, r"values have shape \(3,\), the axes \(3, 2\)"),
    ],
)
def test_numbers_of_a_table_are_a_full_grid(change, words):
    """Lists of other lengths would be stretched over the table."""
    table = {
        "model": "table",
        "name": "t",
        "frequency": [1000.0, 1400.0, 2000.0],
        "resistance": [0.5, 0.6, 0.7],
        "reactance": [-0.5, 0.0, 0.5],
    }
    assert tl.load_liner(table).impedance(1400.0).tolist() == 0.6 + 0j
    with pytest.raises(ValueError, match=words):
        tl.load_liner({**table, **change})
