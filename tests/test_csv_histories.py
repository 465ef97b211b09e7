"""Time histories as text, their points in the heading or in a list."""

from __future__ import annotations

import pickle

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane_files import (
    FUZZED,
    POINTS,
    STEP,
    VALUES,
    X,
    Z,
    answer_or_error,
    cuts,
    mutate,
    mutations,
    opened,
    recognised,
)

from torchliner.checks import DataWarning
from torchliner.io.csv_histories import FORMAT
from torchliner.io.plane_format import PlaneRequest

WANTED = VALUES[..., 1].T.reshape(3, 4, 9)
BARE = PlaneRequest(normal="y", velocity_units="m/s", length_units="m", sampling_rate=1 / STEP)


def rows(separator=" ", unit=1.0, values=VALUES[..., 1]):
    return [separator.join([f"{i * STEP * unit:.9g}", *(f"{v:.6g}" for v in row)])
            for i, row in enumerate(values)]  # fmt: skip


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def names(separator=" ", time="time [s]", unit=" [m/s]"):
    return separator.join([time, *(f"p{i}{unit}" for i in range(12))])


def coordinates(scale=1.0):
    return [f"# {axis}, {', '.join(f'{n * scale:.6g}' for n in POINTS[:, i])}"
            for i, axis in enumerate("xyz")]  # fmt: skip


HEADINGS = {
    "coordinates": [*coordinates(), f"# {names()}"],
    "coordinates with units": [line.replace(",", " [mm],", 1) for line in coordinates(1e3)]
    + [f"# {names()}"],
    "points": [f"# {x:.6g}, {y:.6g}, {z:.6g}" for x, y, z in POINTS] + [f"# {names()}"],
    "numbered points": [f"# Point {i}: ({x:.6g}, {y:.6g}, {z:.6g})"
                        for i, (x, y, z) in enumerate(POINTS)] + [f"# {names()}"],
    "in one line": ["# " + ", ".join(f"({x:.6g} {y:.6g} {z:.6g})" for x, y, z in POINTS)],
    "unit line": ["# length_unit = mm", "# velocity_unit = m/s", *coordinates(1e3), "# time p"],
}  # fmt: skip


@pytest.mark.parametrize("heading", list(HEADINGS))
def test_points_in_the_heading(tmp_path, heading):
    """However the heading lists them."""
    path = write(tmp_path / "v.csv", *HEADINGS[heading], *rows())
    assert recognised(FORMAT, path)
    plane = FORMAT.open(path, BARE)
    assert np.allclose(plane.load().velocity, WANTED, atol=1e-6)
    assert np.allclose(plane.x, X)
    assert np.allclose(plane.z, Z)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(2, 4), plane.load().velocity.flatten(0, 1).T[2:4])


@pytest.mark.parametrize("order", ["x y z", "x [mm], z [mm], y [mm]", "z;y;x"])
@pytest.mark.parametrize("separator", [" ", "\t", ",", ";"])
def test_a_list_of_points(tmp_path, order, separator):
    """Columns in any order that the list names; cells parted by any mark."""
    axes = [each[0] for each in order.replace(";", " ").replace(",", " ").split() if each[0] in "xyz"]
    scale = 1e3 if "mm" in order else 1.0
    last = "\n" if separator == " " else ""
    table = [separator.join(f"{scale * p['xyz'.index(a)]:.6g}" for a in axes) for p in POINTS]
    points = write(tmp_path / "points.txt", *(["length_unit\t=\tm"] if scale == 1 else []), order,
                   *table)  # fmt: skip
    points.write_text(points.read_text().rstrip() + last)
    path = write(tmp_path / "YVelocity.csv", names(separator, "time [ms]"), *rows(separator, 1e3))
    plane = FORMAT.open(path, PlaneRequest(normal="y", points=points))
    assert np.allclose(plane.load().velocity, WANTED, atol=1e-6)
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    assert np.allclose(plane.z, Z)


def test_points_as_an_array_and_none(tmp_path):
    """An array in the order of axes; without points there is a row of probes."""
    path = write(tmp_path / "YVelocity.csv", *rows())
    np.save(tmp_path / "points.npy", POINTS[:, [0, 2, 1]])
    stated = {**BARE.__dict__, "points": tmp_path / "points.npy"}
    plane = FORMAT.open(path, PlaneRequest(**{**stated, "axes": "x,z,y"}))
    assert np.allclose(plane.load().velocity, WANTED, atol=1e-6)
    for change, message in (
        ({"axes": "x,z"}, r"points.npy has shape \(12, 3\) and columns x, z;"),
        ({"length_units": None}, "points states no unit of length"),
        ({"normal": "x"}, "is the velocity along y, but normal is 'x'"),
        ({"points": None, "velocity_units": None}, "state velocity_units='m/s'"),
        ({"points": None, "sampling_rate": None}, r"write 'time \[s\]' above"),
    ):
        with pytest.raises(ValueError, match=message):
            FORMAT.open(path, PlaneRequest(**{**stated, **change}))
    alone = FORMAT.open(path, BARE)
    assert alone.x is None
    assert np.allclose(alone.load().velocity.numpy().T, VALUES[..., 1], atol=1e-6)
    np.save(tmp_path / "points.npy", POINTS[:11])
    with pytest.raises(ValueError, match=r"12 columns of values, its points are 11 \(.*npy\)"):
        FORMAT.open(path, PlaneRequest(**stated))


def test_a_stated_rate_and_the_times(tmp_path):
    """Times with a unit may not contradict it; the first row tells the start either way."""
    for head, unit in ((names(), 1.0), (names(time="time [ms]"), 1e3), (names(time="time"), 7.0)):
        path = write(tmp_path / "v.csv", head, *rows(unit=unit)[3:])
        plane = FORMAT.open(path, PlaneRequest(sampling_rate=1.005 / STEP))
        assert plane.sampling_rate == 1.005 / STEP
        assert plane.start == pytest.approx(3 * STEP, rel=6e-3)
        if "[" in head.split("p0")[0]:
            with pytest.raises(ValueError, match=r"v.csv: its times are at .* states 5000 Hz"):
                FORMAT.open(path, PlaneRequest(sampling_rate=5e3))


REMARKS = ("# run 2024 11 23", "# 4 blocks of 1 2 3", "# Case 7: (1, 2, 3)")


@pytest.mark.parametrize("heading", sorted(HEADINGS))
@pytest.mark.parametrize("above", [1, 2, 3])
def test_remarks_with_numbers_are_no_points(tmp_path, heading, above):
    """Above and below the points, whatever these look like."""
    lines = [*REMARKS[:above], *HEADINGS[heading], *REMARKS[above:]]
    plane = FORMAT.open(write(tmp_path / "v.csv", *lines, *rows()), BARE)
    assert np.allclose(plane.load().velocity, WANTED, atol=1e-6)
    assert np.allclose(plane.x, X)


def test_points_that_do_not_fit_are_not_dropped(tmp_path):
    """Too many, too few, one list of two that fit; a remark alone is told."""
    one = [f"{i * STEP:.6g} {i}" for i in range(5)]
    for lines, message in (
        (["# 2024 11 23", *HEADINGS["points"]], "13 lines of its heading may be points.* 12 col"),
        (HEADINGS["points"][1:], "11 lines of its heading may be points"),
        ([HEADINGS["coordinates"][0] + ", 7"], "has 13 values of x, but there are 12 columns"),
    ):
        with pytest.raises(ValueError, match=rf"v.csv.*{message}"):
            FORMAT.open(write(tmp_path / "v.csv", *lines, *rows()), BARE)
    with pytest.raises(ValueError, match=r"2 lines of its heading may be points.* 1 columns"):
        FORMAT.open(write(tmp_path / "v.csv", REMARKS[0], "# 0.1 0 0.2", *one), BARE)
    with pytest.warns(DataWarning, match="v.csv, line 1 is a remark"):
        assert FORMAT.open(write(tmp_path / "v.csv", REMARKS[0], *rows()), BARE).x is None


def test_decimal_commas(tmp_path):
    lines = [line.replace(".", ",") for line in ["\ufeff" + names(";"), *rows(";")]]
    path = write(tmp_path / "v.csv", *lines)
    found = opened(FORMAT, path, PlaneRequest(normal="y"))
    assert np.allclose(found.T, VALUES[..., 1], atol=1e-6)


@pytest.mark.parametrize("separator", ["\t", "  ", ";"])
@pytest.mark.parametrize("heading", [True, False])
def test_decimal_commas_between_blanks(tmp_path, separator, heading):
    """As cells that hold one comma and no point can be nothing else; the first row is whole."""
    values = np.round(VALUES[..., 1], 3)
    values[0] = 0
    lines = [line.replace(".", ",") for line in rows(separator, 1e6, values=values)]
    top = [names(separator, "time [us]")] if heading else []
    path = write(tmp_path / "v.txt", *top, *lines)
    asked = PlaneRequest(velocity_units=None if heading else "m/s", sampling_rate=1 / STEP)
    assert np.allclose(opened(FORMAT, path, asked), values.T, atol=1e-6)


def test_commas_part_integers(tmp_path):
    """A comma before a blank, or two in a cell, are no decimal marks."""
    for separator in (", ", ","):
        lines = [separator.join(map(str, (i, 1, 2))) for i in range(9)]
        path = write(tmp_path / "v.csv", "time [s], a [m/s], b [m/s]", *lines)
        assert opened(FORMAT, path, PlaneRequest())[:, 0].tolist() == [1, 2]


@pytest.mark.parametrize(
    ("heading", "row", "message"),
    [
        ("time [s],a [m/s],b [m/s]", "{},1,,", "names 3 columns, .* first row holds 2 numbers"),
        ("time [s]\ta [m/s]", "{}\t1.5\t2", "names 2 columns, .* first row holds 3 numbers"),
        ("time [s],iter,a", "{},1,2", "column 'iter' is a counter or"),
        ('"Time","U:0","U:1"', "{},1,2", "column 'U:0' is a .* component of a vector"),
    ],
)
def test_columns_are_probes_or_refused(tmp_path, heading, row, message):
    """Also where nothing says how many points there are."""
    path = write(tmp_path / "v.csv", heading, *(row.format(i) for i in range(9)))
    with pytest.raises(ValueError, match=rf"v\.csv.*{message}"):
        FORMAT.open(path, PlaneRequest(velocity_units="m/s", sampling_rate=1e3))


def test_an_index_of_pandas_is_no_time(tmp_path):
    """Where it is parted from time [s] it is passed over; where nothing names it, it is refused; a BOM is neither."""
    table = pandas.DataFrame(
        {"time [s]": STEP * np.arange(9), "p0 [m/s]": VALUES[:, 0, 1], "p1 [m/s]": VALUES[:, 1, 1]}
    )
    for name, stated in (("a.csv", {}), ("b.csv", {"index_label": "index"}), ("c.csv", {"index": False})):
        path = tmp_path / name
        table.to_csv(path, encoding="utf-8-sig", **stated)
        plane = FORMAT.open(path, PlaneRequest())
        assert plane.sampling_rate == pytest.approx(1 / STEP)
        assert np.allclose(plane.load().velocity, VALUES[:, :2, 1].T, atol=1e-7)
    path.write_text(table.to_string() + "\n")
    with pytest.raises(ValueError, match=r"c.csv: its first column counts the rows and has no name"):
        FORMAT.open(path, PlaneRequest())
    path.write_bytes(b"\xef\xbb\xbf" + "\n".join(rows()).encode() + b"\n")
    assert FORMAT.open(path, BARE).velocity.shape == (12, 9)


@pytest.mark.parametrize("line", ["# 0.1, 0.0x1, 0", "# Point 0: (0.1, 0.001, 0O)"])
def test_a_point_of_one_probe_that_cannot_be_read(tmp_path, line):
    path = write(tmp_path / "v.csv", line, *(f"{i * STEP:.6g} {i}" for i in range(5)))
    with pytest.raises(ValueError, match=r"v.csv, line 1 looks like coordinates, but '.*' is no number"):
        FORMAT.open(path, BARE)


def test_each_column_of_a_list_has_its_unit(tmp_path):
    """x in m and z in mm; a unit above one column is that of all."""
    path = write(tmp_path / "v.csv", names(), *rows())
    for units in (("m", "mm", "mm"), ("mm", "", "")):
        factors = [1e3 if unit == "mm" or not units[1] else 1 for unit in units]
        head = " ".join(f"{a} [{u}]" if u else a for a, u in zip("xyz", units, strict=True))
        lines = [" ".join(f"{n:.9g}" for n in point * factors) for point in POINTS]
        points = write(tmp_path / "points.txt", head, *lines)
        found = FORMAT.open(path, PlaneRequest(normal="y", points=points))
        assert np.allclose(found.x, X)
        assert np.allclose(found.z, Z)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("1.0", "x", 1), "could not convert"),
        (lambda t: t.replace("# x, 0, 0.01", "# x, 0, O.01"), "line 1 looks like coordinates, but 'O.01' is no number"),
        (lambda t: t.replace("# x, 0, 0.01", "# x, 0, 0.01x"), "line 1 looks like coordinates, but '0.01x' is no nu"),
        (lambda t: t.replace("\n0 ", "\n0x "), "could not convert string '0x'"),
        (lambda t: t.replace("\n5e-05 ", "\n6.5e-05 "), "not uniform|out of order"),
        (lambda t: "".join(line for line in t.splitlines(True) if not line.startswith("5e-05")),
         "lacks 1 frames"),
        (lambda t: t.replace("p3 [m/s]", "p3 [mm/s]"), "columns are in m/s, mm/s; one unit"),
        (lambda t: t.replace("time [s]", "time [fortnight]"), "time has units 'fortnight'"),
        (lambda t: t.replace("# z", "# ignored").replace("# y", "# ignored"), "states x of the"),
        (lambda t: t.replace("\n3e-05 ", "\n3e-05 1.5 "), "changed from 13 to 14 at row 4; 13 numbers a row"),
        (lambda t: t.replace("\n3e-05", "\n# a remark\n3e-05 7 "), "changed from 13 to 14"),
    ],
)  # fmt: skip
def test_faults(tmp_path, change, message):
    path = write(tmp_path / "v.csv", *HEADINGS["coordinates"], *rows())
    path.write_text(change(path.read_text()))
    with pytest.raises(ValueError, match=rf"{path}.*({message})"):
        FORMAT.open(path, PlaneRequest(normal="y", length_units="m")).load()


def test_a_broken_last_row_and_missing_values(tmp_path):
    """A row without an end is left out, and told; nan stays nan; remarks between rows count not."""
    lines = [*HEADINGS["coordinates"], *rows()]
    lines[6] = lines[6].replace(lines[6].split()[3], "nan") + "\n# a restart"
    path = write(tmp_path / "v.csv", *lines)
    found = opened(FORMAT, path, BARE)
    assert np.isnan(found[0, 2, 2])
    assert int(np.isnan(found).sum()) == 1
    path.write_text(path.read_text()[:-4])
    with pytest.warns(DataWarning, match="8 rows remain"):
        assert opened(FORMAT, path, BARE).shape == (3, 4, 8)


@FUZZED
@given(marks=mutations, cut=cuts, heading=st.sampled_from(sorted(HEADINGS)))
def test_mutated_bytes(tmp_path_factory, marks, cut, heading):
    path = write(tmp_path_factory.mktemp("csv") / "v.csv", *HEADINGS[heading], *rows())
    clean = opened(FORMAT, path, BARE)
    mutate(path, marks, cut)
    if recognised(FORMAT, path):
        answer_or_error(FORMAT, path, BARE, "v.csv", clean)


def test_columns_of_pressures_and_indented_remarks(tmp_path):
    """A column that is named as a pressure is none of velocity; a remark is one wherever its line begins."""
    rows = [f"{i},{i / 42e3:.9g},{i}.5,{-i}.5" for i in range(40)]
    for names, words in (("v_0,v_1", None), ("pressure_0,pressure_1", "'pressure' names no velocity")):
        path = tmp_path / f"{names[0]}.csv"
        path.write_text("\n".join([f"index,time [s],{names}", *rows[:7], " #", *rows[7:]]) + "\n")
        if words is None:
            assert FORMAT.open(path, PlaneRequest(velocity_units="m/s")).samples == 40
            continue
        with pytest.raises(ValueError, match=words):
            FORMAT.open(path, PlaneRequest(velocity_units="m/s"))
