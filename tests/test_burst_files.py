"""Files of bursts: DXEX exports, columns, CSV, HDF5, folders, and what is wrong with them."""

import dataclasses

import h5py
import numpy as np
import pytest
from conftest import same_bits

import torchliner as tl
from torchliner.io.burst_sources import read_bursts
from torchliner.io.burst_text import STATED, read_burst_columns, read_dantec
from torchliner.io.own_writer import write_several
from torchliner.records.declared import variables_of

LAYOUT = "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]"
PAIRED = ["Row#", "AT [ms]", "TT [\N{MICRO SIGN}s]", "LDA1 [m/s]", "LDA2 [m/s]"]
APART = ["Row#", "AT [ms]", "TT [us]", "LDA1 [m/s]", "AT{2} [ms]", "TT{2} [us]", "LDA2{2} [m/s]"]
BURSTS = [
    ["1", "1.5", "20.0", "30.25", "-0.5"],
    ["2", "2.25", "10.0", "31.5", "0.25"],
    ["3", "4.0", "40.0", "28.0", "1.0"],
]
LONE = [
    ["1", "1.000", "10", "30", "0.500", "11", "0.1"],
    ["2", "2.000", "20", "31", "1.001", "21", "0.2"],
    ["3", "3.000", "30", "32", "3.002", "31", "0.3"],
    ["", "", "", "", "7.000", "41", "0.4"],
]


PLACE = "7;1.00 mm;-2.50 mm;0.50 mm"


def dxex(path, rows=BURSTS, names=PAIRED, version="v5", position=PLACE, comma=False, encoding="latin-1"):
    """An export as the format's description has it."""
    named = "".join(f'"{name}"\t' for name in names)
    table = ["\t".join(row) for row in rows]
    position, *table = [line.replace(".", ",") if comma else line for line in (position, *table)]
    project = "C:/runs/B\N{LATIN SMALL LETTER E WITH ACUTE}ton.lda"
    lines = [f"DXEX {version}", project, "2:44:21 PM", position, "Region1", named, *table, ""]
    path.write_bytes("\r\n".join(lines).encode(encoding))
    return path


@pytest.mark.parametrize(
    "how", [{}, {"version": "v3"}, {"comma": True}, {"encoding": "utf-8"}, {"encoding": "utf-8-sig", "comma": True}]
)
def test_coincident_export(tmp_path, how):
    record = read_dantec(dxex(tmp_path / "a.txt", **how), frequency=1500.0)
    assert record.arrival_time.tolist() == pytest.approx([1.5e-3, 2.25e-3, 4e-3], rel=1e-12)
    assert record.transit_time.tolist() == pytest.approx([2e-5, 1e-5, 4e-5], rel=1e-12)
    assert record.streamwise.tolist() == [30.25, 31.5, 28.0]
    assert record.wall_normal.tolist() == [-0.5, 0.25, 1.0]
    assert (record.x, record.y, record.z) == pytest.approx((1e-3, -2.5e-3, 5e-4))
    assert (record.frequency, record.dropped) == (1500, {})
    assert record.provenance["channels"] == {"LDA1": "streamwise", "LDA2": "wall_normal"}


def test_components_are_named_and_turned(tmp_path):
    record = read_dantec(dxex(tmp_path / "a.txt"), ["-wall_normal", "skip"])
    assert record.wall_normal.tolist() == [-30.25, -31.5, -28.0]
    assert record.streamwise is None


def test_non_coincident_export(tmp_path):
    path = dxex(tmp_path / "b.txt", LONE, APART)
    alone = read_dantec(path)
    assert alone.wall_normal.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert alone.arrival_time.tolist() == pytest.approx([5e-4, 1.001e-3, 3.002e-3, 7e-3])
    assert alone.streamwise is None
    assert "streamwise has its own arrival times" in alone.notes[0]
    first = read_dantec(path, ["wall_normal", "skip"])  # that which is skipped may be the longer one
    assert (first.wall_normal.tolist(), first.notes) == ([30, 31, 32], ())
    assert read_dantec(path, ["skip", "wall_normal"]).wall_normal.tolist() == [0.1, 0.2, 0.3, 0.4]


def replaced(names, old, new):
    return [new if name == old else name for name in names]


def edited(row, column, text):
    """``LONE`` with another cell."""
    return [[*each[:column], text, *each[column + 1 :]] if i == row else each for i, each in enumerate(LONE)]


@pytest.mark.parametrize(
    ("how", "options", "words"),
    [
        ({"version": "v4"}, {}, ["line 1", "'DXEX v4'", "'DXEX v5'"]),
        ({"rows": []}, {}, ["no values", "line 6"]),
        ({"names": replaced(PAIRED, "AT [ms]", "Time [ms]")}, {}, ["'arrival_time' is missing", "'AT [ms]'"]),
        ({"names": replaced(PAIRED[:4], "LDA1 [m/s]", "Anode [V]")}, {}, ["'LDA1 [m/s]'", "Anode [V]"]),
        ({"names": replaced(PAIRED, "LDA2 [m/s]", "LDA0 [m/s]")}, {}, ["from 1", "LDA0"]),
        ({"names": replaced(PAIRED, "AT [ms]", "AT [kg]")}, {}, ["units 'kg'", "time"]),
        ({"rows": [*BURSTS, ["4", "5.0", "20", "30", "1", "9"]]}, {}, ["line 10 has 6 cells"]),
        ({"position": "somewhere"}, {}, ["line 4", "somewhere"]),
        ({}, {"components": ["wall_normal"]}, ["LDA1, LDA2", "wall_normal"]),
        ({}, {"components": ["wall_norml", "skip"]}, ["did you mean 'wall_normal'"]),
        ({}, {"components": ["skip", "skip"]}, ["one at least"]),
        ({}, {"components": ["streamwise", "-streamwise"]}, ["at most once"]),
        ({"rows": edited(1, 5, ""), "names": APART}, {}, ["line 8", "'transit_time' is ''"]),
    ],
)
def test_faulty_exports_are_refused(tmp_path, how, options, words):
    with pytest.raises(ValueError, match=r"a\.txt|component") as error:
        read_dantec(dxex(tmp_path / "a.txt", **how), **options)
    assert [word for word in words if word not in str(error.value)] == []


def test_empty_and_cut_files_are_refused(tmp_path):
    (tmp_path / "e.txt").write_text(" \n")
    for read in (read_dantec, read_bursts, read_burst_columns):
        with pytest.raises(ValueError, match=r"e.txt is empty"):
            read(tmp_path / "e.txt")
    (tmp_path / "cut.txt").write_text("DXEX v3\nproject\n")
    with pytest.raises(ValueError, match="ends after line 2"):
        read_dantec(tmp_path / "cut.txt")
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_bursts(tmp_path / "none.txt")


@pytest.mark.parametrize("comma", [False, True])
def test_columns_in_the_stated_order(tmp_path, comma):
    path = tmp_path / "c.txt"
    text = "\n".join(" ".join(row) for row in BURSTS)
    path.write_text(text.replace(".", ",") if comma else text)
    record = read_burst_columns(path, LAYOUT, x=0.01)
    assert record.wall_normal.tolist() == [-0.5, 0.25, 1.0]
    assert record.streamwise.tolist() == [30.25, 31.5, 28.0]
    assert record.transit_time.tolist() == pytest.approx([2e-5, 1e-5, 4e-5])
    assert record.x == 0.01
    turned = "skip, arrival_time [ms], skip, -wall_normal [mm/s], streamwise [m/s]"
    other = read_burst_columns(path, turned)
    assert other.wall_normal.tolist() == pytest.approx([-0.03025, -0.0315, -0.028])
    assert other.streamwise.tolist() == [-0.5, 0.25, 1.0]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("arrival_time [ms], wall_normal [m/s]", "5 cells, the header 2"),
        ("row, arrival_time, skip, skip, wall_normal [m/s]", "'arrival_time' has no unit"),
        ("row, arrival_tme [ms], skip, skip, wall_normal [m/s]", "did you mean 'arrival_time'"),
        ("row, skip, skip, skip, wall_normal [m/s]", "'arrival_time' is missing"),
        ("row, arrival_time [ms], skip, skip, skip", "no velocity"),
        ("row, arrival_time [ms], skip, skip, wall_normal [ms]", "velocity is needed"),
        ("row, arrival_time [ms], skip, wall_normal [m/s], wall_normal [m/s]", "named twice"),
        (LAYOUT, "line 2, column 'wall_normal' is ''"),
    ],
)
def test_faulty_columns_are_refused(tmp_path, columns, words):
    path = tmp_path / "c.txt"
    path.write_text("1 1.5 20 30 1\n2 2.5 20 30\n3 3.5 20 30 1\n")
    with pytest.raises(ValueError, match=words):
        read_burst_columns(path, columns)


def record_of(seed=0, count=50, **about):
    rng = np.random.default_rng(seed)
    about = {"x": 0.01 * seed, "y": 1e-3, "z": 0.0, "frequency": 1500.0, "mach": 0.3, "title": f"s{seed}", **about}
    bursts = rng.exponential(1e-3, count).cumsum(), rng.normal(size=count), rng.normal(30, 3, count)
    return tl.BurstRecord(*bursts, rng.uniform(1e-5, 2e-5, count), **about)


def test_stations_come_back_from_hdf5_bit_for_bit(tmp_path):
    records = [
        record_of(0, 50, dropped={"outlier": 3}, notes=("a doubt",), reference={"true": 1 - 2j}, provenance={"a": 1}),
        record_of(1, 7, fluid=tl.Fluid(340.0)),
        tl.BurstRecord(np.array([1.0, 2.0]), np.ones(2), x=0.5, y=1e-3, z=0.0, frequency=1500.0, title="s2"),
    ]
    path = tmp_path / "all.h5"
    write_several([records[2], *records[:2]], path)
    found = read_bursts(path)
    assert [each.name.rpartition(", ")[2] for each in found] == ["station 1", "station 2", "station 0"]
    for one, other in zip(records, found, strict=True):
        assert same_bits(other, one)
    with h5py.File(path, "a") as file:
        del file["station_1/arrival_time"]
    with pytest.raises(ValueError, match=r"all.h5:/station_1/arrival_time is missing"):
        read_bursts(path)
    with pytest.raises(ValueError, match="places of its own for frequency"):
        read_bursts(path, frequency=3.0)


def write_burst_csv(record, path):
    """As a laboratory writes it: what is stated, then a header, then the bursts."""
    stated = {
        name: f"{value!r} {STATED[name]}" for name in STATED if isinstance(value := getattr(record, name), float)
    } | {name: value for name in STATED if isinstance(value := getattr(record, name), str) and value}
    units = {row.field: row.unit for row in variables_of(type(record)) if row.dims}
    columns = {name: value for name in units if (value := getattr(record, name)) is not None}
    lines = [f"# {name} = {value}" for name, value in stated.items()]
    lines.append(",".join(f"{name} [{units[name]}]" for name in columns))
    lines += [",".join(map(repr, row)) for row in zip(*(each.tolist() for each in columns.values()), strict=True)]
    path.write_text("\n".join(lines))


def test_a_station_comes_back_from_csv_bit_for_bit(tmp_path):
    record = record_of(3, liner="onera", source_side="upstream")
    write_burst_csv(record, tmp_path / "s.csv")
    assert same_bits(dataclasses.replace(read_burst_columns(tmp_path / "s.csv"), provenance={}), record)


def test_csv(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text(
        "# from the lab\n# x = 12.5 mm\n# frequency = 1.5 kHz\n# liner = onera\n"
        "arrival_time [ms];wall_normal [cm/s]\n1,5;20\n2,5;-30,5\n"
    )
    record = read_burst_columns(path)
    assert record.arrival_time.tolist() == pytest.approx([1.5e-3, 2.5e-3])
    assert record.wall_normal.tolist() == pytest.approx([0.2, -0.305])
    assert (record.x, record.frequency, record.liner) == (pytest.approx(0.0125), 1500.0, "onera")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("arrival_time [s],wall_normal [m/s]\n", "holds no values"),
        ("# x = 1 m\n", "no header line"),
        ("arrival_time [s],transit_time [s]\n1,2\n", "no velocity"),
        ("# x = 2\narrival_time [s],wall_normal [m/s]\n1,2\n", "line 1, x has units ''"),
    ],
)
def test_faulty_csv_is_refused(tmp_path, text, words):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        read_burst_columns(path)


@pytest.mark.parametrize("option", [{"components": ["-wall_normal"]}, {"separator": "comma"}])
def test_options_of_other_formats_are_refused(tmp_path, option):
    """A minus in ``components`` turned nothing in a file with a header."""
    tl.BurstRecord([0.1, 0.2], wall_normal=[1.0, 2.0], x=0.0, y=1e-3, z=0.0).write(tmp_path / "a.h5")
    (tmp_path / "a.csv").write_text("arrival_time [s],wall_normal [m/s]\n1,5\n")
    for ending in (".csv", ".h5"):
        with pytest.raises(ValueError, match=rf"a{ending} .* {next(iter(option))}"):
            read_bursts(tmp_path / f"a{ending}", **option)
    with pytest.raises(ValueError, match=r"b.txt takes no columns"):
        read_bursts(dxex(tmp_path / "b.txt"), columns=LAYOUT)


def test_folders(tmp_path):
    with pytest.raises(ValueError, match="holds no files of bursts"):
        read_bursts(tmp_path)
    (tmp_path / ".hidden.txt").write_text("nothing")
    (tmp_path / "picture.png").write_bytes(b"x")
    for name, x in (("c", "1.00"), ("a", "30.00"), ("b", "2.00")):
        dxex(tmp_path / f"{name}.txt", position=f"{x} mm;1.00 mm;0.00 mm")
    assert [record.x for record in read_bursts(tmp_path)] == pytest.approx([1e-3, 2e-3, 3e-2])
    dxex(tmp_path / "b.txt", position="30.00 mm;1.00 mm;0.00 mm")
    with pytest.raises(ValueError, match=r"a.txt and .*b.txt have the same position, \(30, 1, 0"):
        read_bursts(tmp_path)
    (tmp_path / "b.txt").write_text("1 2 3 4 5\n")
    with pytest.raises(ValueError, match=r"b.txt begins with '1 2 3 4 5'.*--columns"):
        read_bursts(tmp_path)
