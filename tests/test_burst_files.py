"""Files of bursts: DXEX exports, columns, CSV, HDF5, folders, and what is wrong with them."""

from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest
from test_moments_file import same_bits

import torchliner as tl
from torchliner.io.burst_csv import read_burst_csv
from torchliner.io.burst_file import read_burst_file, write_bursts
from torchliner.io.burst_sources import read_bursts
from torchliner.io.burst_text import read_burst_columns
from torchliner.io.dantec import NO_PARTNER, read_dantec, read_position

LAYOUT = "row, arrival_time [ms], transit_time [us], streamwise [m/s], wall_normal [m/s]"
PAIRED = ["Row#", "AT [ms]", "TT [\N{MICRO SIGN}s]", "LDA1 [m/s]", "LDA2 [m/s]"]
APART = ["Row#", "AT [ms]", "TT [us]", "LDA1 [m/s]", "AT{2} [ms]", "TT{2} [us]", "LDA2{2} [m/s]"]
BURSTS = [["1", "1.5", "20.0", "30.25", "-0.5"], ["2", "2.25", "10.0", "31.5", "0.25"],
          ["3", "4.0", "40.0", "28.0", "1.0"]]  # fmt: skip
LONE = [["1", "1.000", "10", "30", "0.500", "11", "0.1"],
        ["2", "2.000", "20", "31", "1.001", "21", "0.2"],
        ["3", "3.000", "30", "32", "3.002", "31", "0.3"],
        ["", "", "", "", "7.000", "41", "0.4"]]  # fmt: skip


def dxex(
    path, rows=BURSTS, names=PAIRED, version="v5", position="7;1.00 mm;-2.50 mm;0.50 mm",
    comma=False, encoding="latin-1", end="\r\n",
):  # fmt: skip
    """An export as the format's description has it."""
    head = [
        f"DXEX {version}",
        "C:/runs/B\N{LATIN SMALL LETTER E WITH ACUTE}ton.lda",
        "2:44:21 PM",
        position,
        "Region1",
        "\t".join(f'"{name}"' for name in names) + "\t",
    ]
    lines = head + ["\t".join(row) for row in rows]
    if comma:
        lines[3] = lines[3].replace(".", ",")
        lines[6:] = [line.replace(".", ",") for line in lines[6:]]
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


@pytest.mark.parametrize("version", ["v3", "v5"])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-8-sig"])
def test_coincident_export(tmp_path, version, comma, encoding):
    """Versions, decimal marks and encodings say the same; the micro sign is understood."""
    path = dxex(tmp_path / "a.txt", version=version, comma=comma, encoding=encoding)
    record = read_dantec(path, frequency=1500.0)
    assert record.arrival_time.tolist() == pytest.approx([1.5e-3, 2.25e-3, 4e-3], rel=1e-12)
    assert record.transit_time.tolist() == pytest.approx([2e-5, 1e-5, 4e-5], rel=1e-12)
    assert record.streamwise.tolist() == [30.25, 31.5, 28.0]
    assert record.wall_normal.tolist() == [-0.5, 0.25, 1.0]
    assert record.position == pytest.approx((1e-3, -2.5e-3, 5e-4))
    assert record.frequency == 1500
    assert record.dropped == {}
    assert record.provenance["format"] == f"DXEX {version}"
    assert record.provenance["channels"] == {"LDA1": "streamwise", "LDA2": "wall_normal"}


def test_components_are_named_and_turned(tmp_path):
    path = dxex(tmp_path / "a.txt")
    record = read_dantec(path, ["-wall_normal", "skip"])
    assert record.wall_normal.tolist() == [-30.25, -31.5, -28.0]
    assert record.streamwise is None
    for wrong, message in (
        (["wall_normal"], "components names 1"),
        (["wall_norml", "skip"], "did you mean 'wall_normal'"),
        (["skip", "skip"], "one of them at least"),
        (["streamwise", "-streamwise"], "once each"),
    ):
        with pytest.raises(ValueError, match=message):
            read_dantec(path, wrong)


def test_non_coincident_export(tmp_path):
    """Columns of unequal length; without a window the wall-normal channel stands alone."""
    path = dxex(tmp_path / "b.txt", LONE, APART)
    alone = read_dantec(path)
    assert alone.wall_normal.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert alone.arrival_time.tolist() == pytest.approx([5e-4, 1.001e-3, 3.002e-3, 7e-3])
    assert alone.transit_time.tolist() == pytest.approx([1.1e-5, 2.1e-5, 3.1e-5, 4.1e-5])
    assert alone.streamwise is None
    assert r"streamwise (3 bursts)" in alone.notes[0]
    paired = read_dantec(path, coincidence_window=5e-6)
    assert paired.wall_normal.tolist() == [0.2, 0.3]
    assert paired.streamwise.tolist() == [30, 32]
    assert paired.dropped == {NO_PARTNER: 2}
    with pytest.raises(ValueError, match=r"within 0.01 us"):
        read_dantec(path, coincidence_window=1e-8)


def test_the_channel_that_is_skipped_may_be_the_longer_one(tmp_path):
    path = dxex(tmp_path / "b.txt", LONE, APART)
    first = read_dantec(path, ["wall_normal", "skip"])
    assert first.arrival_time.tolist() == pytest.approx([1e-3, 2e-3, 3e-3])
    assert first.wall_normal.tolist() == [30, 31, 32]
    assert first.notes == ()
    second = read_dantec(path, ["skip", "wall_normal"])
    assert second.wall_normal.tolist() == [0.1, 0.2, 0.3, 0.4]


@pytest.mark.parametrize("option", [
    {"components": ["-wall_normal"]}, {"coincidence_window": 1e-5}, {"separator": "comma"},
])  # fmt: skip
def test_options_of_other_formats_are_refused(tmp_path, option):
    """A minus in ``components`` turned nothing in a file with a header."""
    record = tl.BurstRecord([0.1, 0.2], wall_normal=[1.0, 2.0], x=0.0, y=1e-3, z=0.0)
    for ending in (".csv", ".h5"):
        path = tmp_path / f"a{ending}"
        record.write(path)
        with pytest.raises(ValueError, match=rf"a{ending} is .* takes no {next(iter(option))}="):
            read_bursts(path, **option)
    if "separator" not in option:
        return
    with pytest.raises(ValueError, match=r"b.txt is of format DXEX and takes no columns="):
        read_bursts(dxex(tmp_path / "b.txt"), columns=LAYOUT)


def test_non_coincident_channel_that_ends_in_the_middle_is_refused(tmp_path):
    rows = [list(row) for row in LONE]
    rows[1][5] = ""
    with pytest.raises(ValueError, match="line 8, column 'transit_time' is ''; a num"):
        read_dantec(dxex(tmp_path / "b.txt", rows, APART))
    rows = [list(row) for row in LONE]
    rows[3][6] = ""
    with pytest.raises(ValueError, match=r"unequal lengths: arrival_time 4.* wall_normal 3"):
        read_dantec(dxex(tmp_path / "b.txt", rows, APART))


def test_values_that_are_no_numbers_are_counted(tmp_path):
    rows = [*BURSTS, ["4", "5.0", "20.0", "nan", "0.5"]]
    record = read_dantec(dxex(tmp_path / "a.txt", rows))
    assert record.bursts == 3
    assert record.dropped == {"not a number in the file": 1}


def test_other_units_are_converted(tmp_path):
    names = ["Row#", "AT [s]", "TT [ns]", "LDA1 [mm/s]", "LDA2 [cm/s]"]
    record = read_dantec(dxex(tmp_path / "a.txt", names=names))
    assert float(record.arrival_time[0]) == 1.5
    assert float(record.transit_time[0]) == pytest.approx(2e-8)
    assert float(record.streamwise[0]) == pytest.approx(0.03025)
    assert float(record.wall_normal[0]) == pytest.approx(-0.005)


def replaced(names, old, new):
    return [new if name == old else name for name in names]


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"version": "v4"}, r"line 1 is 'DXEX v4'; 'DXEX v3' or 'DXEX v5'"),
        ({"rows": []}, "holds no bursts: the file ends before line 8"),
        ({"names": replaced(PAIRED, "AT [ms]", "Time [ms]")}, r"'AT \[ms\]' is missing"),
        ({"names": replaced(PAIRED[:4], "LDA1 [m/s]", "Anode [V]")}, "no column 'LDA1"),
        ({"names": replaced(PAIRED, "LDA2 [m/s]", "LDA2 [knots]")}, "units 'knots'"),
        ({"names": replaced(PAIRED, "LDA2 [m/s]", "LDA0 [m/s]")}, "channels count from 1"),
        ({"names": replaced(PAIRED, "AT [ms]", "AT [kg]")}, "units 'kg'.*time is needed"),
        ({"rows": [*BURSTS, ["4", "5,0", "20", "30", "1"]]}, "mixes decimal marks: line 10.*'5,0'"),
        ({"rows": [*BURSTS, ["4", "5.0", "20", "30", "1", "9"]]}, "line 10 has 6 cells, the head"),
        ({"rows": [*BURSTS, ["4", "5.0", "20", "30"]]}, "line 10, column 'wall_normal' is ''"),
        ({"rows": [*BURSTS, ["4", "x", "20", "30", "1"]]}, "line 10, column 'arrival_time' is 'x'"),
        ({"position": "somewhere"}, "line 4 is 'somewhere'"),
        ({"position": "1 mm;2 mm;3 furlong"}, "units 'furlong'"),
    ],
)  # fmt: skip
def test_faulty_exports_are_refused(tmp_path, how, message):
    with pytest.raises(ValueError, match=message):
        read_dantec(dxex(tmp_path / "a.txt", **how))


def test_empty_and_cut_files_are_refused(tmp_path):
    empty = tmp_path / "e.txt"
    empty.write_text(" \n")
    for read in (read_dantec, read_burst_csv, read_bursts):
        with pytest.raises(ValueError, match=r"e.txt is empty"):
            read(empty)
    with pytest.raises(ValueError, match=r"e.txt is empty"):
        read_burst_columns(empty, LAYOUT)
    (tmp_path / "cut.txt").write_text("DXEX v3\nproject\n")
    with pytest.raises(ValueError, match="ends after line 2"):
        read_dantec(tmp_path / "cut.txt")
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_bursts(tmp_path / "none.txt")
    with pytest.raises(OSError, match="is a folder"):
        read_dantec(tmp_path)
    (tmp_path / "raw.txt").write_bytes(b"DX\0")
    with pytest.raises(ValueError, match="zero bytes"):
        read_burst_columns(tmp_path / "raw.txt", LAYOUT)


def test_positions_are_read_with_either_mark():
    assert read_position("1,50 mm;-2 cm;0 m", "f") == pytest.approx((1.5e-3, -0.02, 0))
    assert read_position("12;1.50 mm;-2 cm;0 m", "f") == pytest.approx((1.5e-3, -0.02, 0))


# Columns without a header


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
    assert other.transit_time is None


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("arrival_time [ms], wall_normal [m/s]", "5 cells, 2 columns are stated"),
        ("row, arrival_time, skip, skip, wall_normal [m/s]", "'arrival_time' has no unit"),
        ("row, arrival_tme [ms], skip, skip, wall_normal [m/s]", "did you mean 'arrival_time'"),
        ("row, skip, skip, skip, wall_normal [m/s]", "'arrival_time' is missing"),
        ("row, arrival_time [ms], skip, skip, skip", "no velocity"),
        ("row, arrival_time [ms], skip, skip, wall_normal [ms]", "a velocity is needed"),
        ("row, arrival_time [ms], skip, wall_normal [m/s], wall_normal [m/s]", "is named twice"),
        ("row, -arrival_time [ms], skip, skip, wall_normal [m/s]", "only velocities"),
    ],
)
def test_faulty_columns_are_refused(tmp_path, columns, message):
    path = tmp_path / "c.txt"
    path.write_text("\n".join(" ".join(row) for row in BURSTS))
    with pytest.raises(ValueError, match=message):
        read_burst_columns(path, columns)


def test_a_row_with_a_cell_missing_is_refused(tmp_path):
    path = tmp_path / "c.txt"
    path.write_text("1 1.5 20 30 1\n2 2.5 20 30\n3 3.5 20 30 1\n")
    with pytest.raises(ValueError, match="line 2, column 'wall_normal' is ''; a num"):
        read_burst_columns(path, LAYOUT)


# Our own files


def record_of(seed=0, count=50, **about):
    rng = np.random.default_rng(seed)
    about = {"x": 0.01 * seed, "y": 1e-3, "z": 0.0, "frequency": 1500.0, "mach": 0.3, **about}
    return tl.BurstRecord(
        rng.exponential(1e-3, count).cumsum(), rng.normal(size=count), rng.normal(30, 3, count),
        rng.uniform(1e-5, 2e-5, count), title=f"s{seed}", **about,
    )  # fmt: skip


def test_stations_come_back_from_hdf5_bit_for_bit(tmp_path):
    """With what each lacks: transit times, a component, bursts dropped before."""
    records = [
        record_of(0, 50, dropped={"outlier": 3}, notes=("a doubt",), fluid=tl.Fluid(340.0),
                  reference={"true": 1 - 2j}, provenance={"a": 1}),
        record_of(1, 7, fluid=tl.Fluid(340.0), reference={"true": 1 - 2j}),
        tl.BurstRecord(np.array([1.0, 2.0]), np.ones(2), x=0.5, y=1e-3, z=0.0, frequency=1500.0,
                       mach=0.3, fluid=tl.Fluid(340.0), reference={"true": 1 - 2j}, title="s2"),
    ]  # fmt: skip
    path = tmp_path / "all.h5"
    write_bursts(records, path)
    found = read_burst_file(path)
    for one, other in zip(records, found, strict=True):
        assert same_bits(other, one)


def test_a_station_comes_back_from_csv_bit_for_bit(tmp_path):
    record = record_of(3, dropped={"run of exact zeros": 2}, liner="onera", source_side="upstream")
    record.write(tmp_path / "s.csv")
    again = read_burst_csv(tmp_path / "s.csv")
    assert same_bits(dataclasses.replace(again, provenance={}), record)
    with pytest.raises(ValueError, match="one station, not 2"):
        write_bursts([record, record], tmp_path / "s.csv")


def test_csv_of_others(tmp_path):
    """Semicolons, decimal comma, other units, remarks."""
    path = tmp_path / "s.csv"
    path.write_text(
        "# from the lab\n# x = 12.5 mm\n# frequency = 1.5 kHz\n"
        "arrival_time [ms];wall_normal [cm/s]\n1,5;20\n2,5;-30,5\n"
    )
    record = read_burst_csv(path)
    assert record.arrival_time.tolist() == pytest.approx([1.5e-3, 2.5e-3])
    assert record.wall_normal.tolist() == pytest.approx([0.2, -0.305])
    assert (record.x, record.frequency) == (pytest.approx(0.0125), 1500.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("arrival_time [s],wall_normal [m/s]\n", "holds no bursts"),
        ("# x = 1 m\n", "no header line"),
        ("arrival_time [s],transit_time [s]\n1,2\n", "no velocity"),
        ("arrival_time [s],wall_normal\n1,2\n", "has no unit"),
        ("# freqency = 3 Hz\narrival_time [s],wall_normal [m/s]\n1,2\n", "mean 'frequency'"),
        ("# x = two mm\narrival_time [s],wall_normal [m/s]\n1,2\n", "line 1, x is 'two mm'"),
        ("# x = 2\narrival_time [s],wall_normal [m/s]\n1,2\n", "line 1, x has units ''"),
        ("arrival_time [s];wall_normal [m/s]\n1,5;2.5\n", "mixes decimal marks"),
        ("arrival_time [s],wall_normal [m/s]\n1,5,2\n", "line 2 has 3 cells, the header 2"),
    ],
)  # fmt: skip
def test_faulty_csv_is_refused(tmp_path, text, message):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_burst_csv(path)


def test_faulty_hdf5_is_refused(tmp_path):
    path = tmp_path / "b.h5"
    record_of(1).write(path)
    with h5py.File(path, "a") as file:
        file["burst_count"][0] = 49
    with pytest.raises(ValueError, match="arrival_time has 50 values; /burst_count says 49"):
        read_burst_file(path)
    record_of(1).write(path)
    with h5py.File(path, "a") as file:
        del file["station_name"]
        file.create_dataset("station_name", data=["a", "b"], dtype=h5py.string_dtype())
    with pytest.raises(ValueError, match=r"station_name has shape \(2,\), \(station\); station is \(1,\)"):
        read_burst_file(path)
    with pytest.raises(ValueError, match="frequency 2000"):
        write_bursts([record_of(0), record_of(1, frequency=2000.0)], path)
    record_of(1).write(path)
    with pytest.raises(ValueError, match="places of its own for frequency"):
        read_bursts(path, frequency=3.0)


# Folders


def test_a_folder_is_sorted_by_x(tmp_path):
    for name, x in (("c", "1.00"), ("a", "30.00"), ("b", "2.00")):
        dxex(tmp_path / f"{name}.txt", position=f"{x} mm;1.00 mm;0.00 mm")
    (tmp_path / ".hidden.txt").write_text("nothing")
    records = read_bursts(tmp_path)
    assert [record.x for record in records] == pytest.approx([1e-3, 2e-3, 3e-2])


def test_faulty_folders_are_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no files of bursts"):
        read_bursts(tmp_path)
    (tmp_path / "picture.png").write_bytes(b"x")
    with pytest.raises(ValueError, match="holds no files of bursts"):
        read_bursts(tmp_path)
    dxex(tmp_path / "a.txt")
    dxex(tmp_path / "b.txt", position="1.00 mm;-2.50 mm;0.50 mm")
    with pytest.raises(ValueError, match=r"a.txt and .*b.txt have the same position, \(1, -2.5"):
        read_bursts(tmp_path)
    (tmp_path / "b.txt").write_text("1 2 3 4 5\n")
    with pytest.raises(ValueError, match=r"b.txt begins with '1 2 3 4 5'.*--columns"):
        read_bursts(tmp_path)
    with pytest.raises(ValueError, match=r"b.txt states no position"):
        read_bursts(tmp_path, columns=LAYOUT)
