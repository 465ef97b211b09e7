"""Differences of two maps, and what their intervals are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
import torch
from conftest import plane_of, turbulence

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
X = [0.0, 0.004, 0.008, 0.02, 0.024, 0.028]


@cache
def made(seed=0, rms=3.0, tones=(1400.0,), count=6, **choices):
    plane = plane_of(turbulence((count, 1200), seed, rms), x=X[:count], title=f"seed {seed}")
    liner = tl.load_liner("polito")
    return tl.educe(plane, liner, list(tones), averaging="admittance", **choices)


def test_the_difference_and_its_interval_of_independent_records():
    """Second less first; the middle is that of the intervals, squares of half-widths add."""
    a, b = made(0), made(1)
    found = tl.compare(a, b)
    assert not found.same_run
    assert [row.place for row in found.rows] == [
        "liner",
        *(f"cell {i}" for i in range(a.cell_x.numel())),
    ]
    row = found.rows[0]
    assert row.difference == complex(b.answer[0] - a.answer[0])
    (a_low, a_high), (b_low, b_high) = (each.bounds_of_liner("admittance") for each in (a, b))
    half = ((a_high - a_low).real ** 2 + (b_high - b_low).real ** 2) ** 0.5 / 2
    assert (row.high - row.low).real / 2 == pytest.approx(half, rel=1e-12)
    middle = (b_low + b_high - a_low - a_high) / 2
    assert (row.low + row.high) / 2 == pytest.approx(middle, rel=1e-12)
    back = tl.compare(b, a).rows[0]
    assert back.difference == -row.difference
    assert (back.low, back.high) == pytest.approx((-row.high, -row.low), rel=1e-12)


def test_one_run_is_seen_and_bounded_from_above():
    """The same samples under other choices: half-widths add."""
    again = made(0, rms=3.0, drive="rms")
    found = tl.compare(made(0), again)
    assert found.same_run
    assert "upper bound" in found.words
    widths = [high - low for low, high in (each.bounds_of_liner("admittance") for each in (made(0), again))]
    assert found.rows[0].high - found.rows[0].low == pytest.approx(sum(widths), rel=1e-12)
    case = {"data": {"case": "n130"}}
    one, other = (replace(each, choices={**each.choices, **case}) for each in (made(0), made(1)))
    assert tl.compare(one, other).same_run  # two heights of a run


@pytest.mark.parametrize("same", [False, True])
def test_what_a_record_does_not_bound_has_no_bounded_difference(same):
    """inf - inf is no number; the difference is unbounded, and shows nothing."""
    first, second = made(0), made(0 if same else 1)
    known = first.liner["admittance"]
    ends = {
        end: torch.full_like(known.low, complex(sign * torch.inf, sign * torch.inf))
        for end, sign in (("low", -1), ("high", 1))
    }
    open_ended = replace(known, interval=replace(known.interval, **ends))
    first = replace(first, liner={**first.liner, "admittance": open_ended})
    for found in (tl.compare(first, second), tl.compare(second, first)):
        assert found.same_run is same
        row = found.rows[0]
        assert (row.low.real, row.low.imag) == (-torch.inf, -torch.inf)
        assert (row.high.real, row.high.imag) == (torch.inf, torch.inf)
        assert row.differs_in == ""
        assert found.rows[1].low.real > -torch.inf


def test_louder_turbulence_differs_clearly_and_the_same_flow_does_not():
    assert "R" in tl.compare(made(0), made(1, rms=6.0)).rows[0].differs_in
    assert tl.compare(made(0), made(1)).rows[0].differs_in == ""


@pytest.mark.slow
def test_the_interval_of_two_records_covers():
    """40 pairs of one flow: 0 lies within the interval of R in 93 to 97 %, within what 40 tell."""
    inside = sum("R" not in tl.compare(made(2 * n), made(2 * n + 1)).rows[0].differs_in for n in range(40))
    assert inside >= 33


def test_frequencies_are_matched_by_value():
    two, turned = made(tones=(1400.0, 1000.0)), made(1, tones=(1000.0, 1400.0))
    rows = {row.frequency: row for row in tl.compare(two, turned).rows if row.place == "liner"}
    assert rows[1400.0].second == complex(turned.answer[1])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"tones": (1000.0,)}, r"other frequencies: \[1400.0\] Hz and \[1000.0\] Hz"),
        ({"count": 3}, r"other cells \(2 and 1\)"),
        ({"interval": 0.9}, r"intervals of 0.95 and 0.9"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_remedy(other, message):
    with pytest.raises(ValueError, match=message):
        tl.compare(made(0), made(0, **other))


def test_averagings_must_be_held_by_both():
    other = replace(made(1), averaging="velocity")
    with pytest.raises(ValueError, match="'admittance' and 'velocity'"):
        tl.compare(made(0), other)
    assert tl.compare(made(0), other, "velocity").averaging == "velocity"
    with pytest.raises(ValueError, match="averaging 'phase-locked'"):
        tl.compare(made(0), made(1), "phase-locked")
    moved = replace(made(0), cell_x=made(0).cell_x + 1e-3)
    with pytest.raises(ValueError, match="other cells"):
        tl.compare(made(0), moved)
