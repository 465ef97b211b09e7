"""Moments of parts in time add up to those of the record, in any order; what does not belong is
refused."""

from __future__ import annotations

import dataclasses
import functools
import pickle
from itertools import pairwise

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, relative_error, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st

import torchliner as tl
from torchliner.liners.catalogue import preset_names
from torchliner.reduction.basis import ANY_LINER, Chebyshev, interpolation_error, response_of
from torchliner.reduction.moments import ASKED

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
N = 2100  # 70 periods: 35 blocks of two
CHOICES = [
    {"order": "admittance"},
    {"order": "velocity", "phase": "self-consistent"},
    {},
    {"mean": "removed"},
    {"drive": "rms"},
    {"window": "hann"},
    {"pre_roll": 0.011},
    {"order": "admittance", "interval": None},
]


def velocity(samples: int = N, probes: int = 5, dtype=torch.float64) -> torch.Tensor:
    """Turbulence and a tone of another size at each probe, m/s."""
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(samples))
    return (turbulence((probes, samples)) + torch.linspace(1, 8, probes)[:, None] * tone).to(dtype)


def parts_of(v, cuts, **choices):
    """Of each stretch between cuts."""
    edges = sorted({0, *cuts, v.shape[-1]})
    if "given" not in choices:
        choices["of_samples"] = v.shape[-1]
    return [tl.moments_part(plane_of(v[..., a:b]), first_sample=a, **choices) for a, b in pairwise(edges)]


def summed(v, cuts, arrange=lambda parts: parts, **choices):
    """All parts added, in two steps where one is not enough."""
    found = tl.Moments.sum(arrange(parts_of(v, cuts, **choices)))
    if len(found.sums.groups) < 2 + (found.sums.periodic is not None):
        found = tl.Moments.sum(arrange(parts_of(v, cuts, given=found)), given=found)
    return found


def tensors(value):
    """All of a record's, in order."""
    if isinstance(value, torch.Tensor):
        yield value
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from tensors(each)
    elif dataclasses.is_dataclass(value):
        for each in dataclasses.fields(value):
            yield from tensors(getattr(value, each.name))


def same_bits(one, other) -> bool:
    pairs = zip(tensors(one), tensors(other), strict=True)
    return all(torch.equal(a.nan_to_num(7), b.nan_to_num(7)) for a, b in pairs)


@pytest.mark.parametrize("choices", CHOICES, ids=str)
@pytest.mark.parametrize("cuts", [(256, 1024, 1280), (1, 2, 61, 777, N - 1)])
def test_parts_add_up_to_the_record(choices, cuts, liner):
    """Cuts at multiples of 256 leave the totals as they are; any cut leaves the map to 1e-12."""
    v, pitch = velocity(), liner.cell_pitch
    whole = tl.moments(plane_of(v), cell_pitch=pitch, **choices)
    found = summed(v, cuts, cell_pitch=pitch, **choices)
    steady = choices.get("drive") == "rms" or "mean" in choices
    if cuts[0] == 256 and not steady:  # where no statistic of the record enters |v|
        for one, other in zip(whole.sums.groups[:2], found.sums.groups[:2], strict=True):
            assert torch.equal(one.totals, other.totals)
    maps = [each.educe(liner, **choices) for each in (whole, found)]
    for name in ("impedance", "cell_impedance", "cell_impedance_velocity_first", "answer"):
        one, other = (getattr(each, name) for each in maps)
        assert relative_error(other, one) < 1e-12
    if "interval" not in choices:
        one, other = (each.liner["admittance"].interval.low for each in maps)
        assert relative_error(other, one) < 1e-11
    for name in ("mean", "mean_square", "smallest", "largest", "coherence"):
        one, other = (getattr(each.sums.survey, name) for each in (whole, found))
        assert torch.allclose(one, other, rtol=1e-12, atol=1e-12)


@given(st.sets(st.integers(1, N - 1), max_size=7), st.randoms(use_true_random=False))
@settings(max_examples=25)
def test_any_order_of_parts_is_one(cuts, draw):
    """Parts of any length, one sample included, arrive in any order: the same bits."""
    v = velocity(dtype=torch.float32)

    def shuffled(parts):
        return draw.sample(parts, len(parts))

    first, second = (summed(v, cuts, arrange) for arrange in (lambda parts: parts, shuffled))
    assert same_bits(first.sums, second.sums)


def test_neighbours_add_in_steps(liner):
    """(a + b) + c is the sum of all three; workers send parts as bytes."""
    a, b, c = parts_of(velocity(), (512, 1024), averaging="admittance")
    wanted = tl.Moments.sum([a, b, c])
    stepwise = tl.Moments.sum([pickle.loads(pickle.dumps(b + c)), a])
    for one, other in zip(wanted.sums.groups, stepwise.sums.groups, strict=True):
        assert torch.equal(one.totals, other.totals)
    assert same_bits(a.sums, parts_of(velocity(), (512, 1024), averaging="admittance")[0].sums)
    # A part within one segment of the coherence, of two periods, joined to the next one first.
    a, b, c = parts_of(velocity(), (1030, 1040), averaging="admittance")
    seen = tl.Moments.sum([a, b + c]).sums.survey.coherence
    assert torch.allclose(seen, wanted.sums.survey.coherence, rtol=1e-12)
    with pytest.raises(TypeError, match="unsupported operand"):
        _ = a + 1


def test_faulty_samples_are_found_where_they_are(liner):
    """The first fault keeps its place in the record; a probe left out of one part alone is told."""
    v = velocity()
    v[3, 1500] = torch.nan
    with pytest.raises(ValueError, match=r"1 of 5 probes, the first at probe \(3,\), sample 1500"):
        parts_of(v, (1024,))
    with pytest.raises(ValueError, match=r"share their probes without faults: 5 of 5 .* 4 of 5"):
        tl.Moments.sum(parts_of(v, (1024,), missing="exclude", averaging="admittance"))
    v[3, 10] = torch.nan
    choices = {"missing": "exclude", "order": "admittance"}
    found, whole = summed(v, (1024,), **choices), tl.moments(plane_of(v), **choices)
    one, other = (each.educe(liner.replace(cell_pitch=None), **choices) for each in (found, whole))
    assert relative_error(one.answer, other.answer) < 1e-12


def test_a_first_reading_alone_answers_other_orders(liner):
    """The order that needs a second reading is refused until it is there; the others are not."""
    v, bare = velocity(), liner.replace(cell_pitch=None)
    first = tl.Moments.sum(parts_of(v, (512,)))
    with pytest.raises(ValueError, match=r"sum of a first reading alone.*given=.*probes first"):
        first.educe(bare)
    wanted = tl.moments(plane_of(v), averaging="admittance").educe(bare, averaging="admittance")
    found = first.educe(bare, averaging="admittance")
    assert relative_error(found.answer, wanted.answer) < 1e-12
    second = parts_of(v, (512,), given=first)
    with pytest.raises(ValueError, match="need given="):
        tl.Moments.sum(second)
    whole = tl.Moments.sum(second, given=first)
    with pytest.raises(ValueError, match="are complete; leave given out"):
        parts_of(v, (512,), given=whole)
    with pytest.raises(ValueError, match="given moments know"):
        parts_of(v, (512,), given=first, averaging="admittance")
    with pytest.raises(ValueError, match=r"are complete; leave given out"):
        tl.Moments.sum(second, given=whole)
    with pytest.raises(ValueError, match=r"first reading; leave given out"):
        tl.Moments.sum(parts_of(v, (512,)), given=first)
    for other, message in (
        (plane_of(v[:4]), r"probes have shapes \(5,\) and \(4,\)"),
        (plane_of(v, height=2e-3), "not one case: height is None and 0.002"),
        (plane_of(v, sampling_rate=RATE + 1), "it is of another record"),
    ):
        with pytest.raises(ValueError, match=message):
            tl.moments_part(other, first_sample=0, given=first)


def test_a_second_reading_belongs_to_its_own_first():
    """Two records of one case, whose first sums alone differ: neither answers for the other."""
    one, other = velocity(), velocity().flip(1)
    first, another = (tl.Moments.sum(parts_of(v, (512,))) for v in (one, other))
    with pytest.raises(ValueError, match=r"not reduced with the given sum.*give the sum that"):
        tl.Moments.sum(parts_of(one, (512,), given=first), given=another)
    mixed = [parts_of(one, (512,), given=first)[0], parts_of(one, (512,), given=another)[1]]
    with pytest.raises(ValueError, match="parts of one record share their first sum"):
        tl.Moments.sum(mixed, given=first)


def test_what_was_taken_at_a_frequency_is_not_asked_for_at_another(liner):
    """The running rms' own window, the coherence behind walls, and the sound of an unknown tone."""
    v, bare = velocity(), liner.replace(cell_pitch=None)
    running = {"drive": "running-rms", "order": "admittance", "interval": None}
    known = tl.moments(plane_of(v), **running)
    with pytest.raises(ValueError, match=r"with running_window 0.000714.*0.00142857.* is asked"):
        known.educe(bare, 700.0, **running)
    own = tl.educe(plane_of(v), bare, running_window=1 / FREQUENCY, frequency=700.0, **running)
    same = known.educe(bare, 700.0, running_window=1 / FREQUENCY, **running)
    assert relative_error(same.answer, own.answer) < 1e-7
    with pytest.raises(ValueError, match=r"coherence of v with 1400 Hz, .* that with 700 Hz: reduce"):
        tl.moments(plane_of(v)).educe(bare, 700.0, wall_filter=0.5)
    quiet = plane_of(v, frequency=None)
    known = tl.moments(quiet, frequency=FREQUENCY)
    with pytest.warns(tl.DataWarning, match="taken at 1400 Hz, for which the data were reduced"):
        known.educe(bare, 700.0, allow_short=True)
    assert "reduced" not in str(known.educe(bare, FREQUENCY).notes)


@given(
    diameter=st.floats(0.5e-3, 2.5e-3), porosity=st.floats(0.03, 0.15),
    thickness=st.floats(0.5e-3, 2e-3), depth=st.floats(10e-3, 60e-3),
)  # fmt: skip
def test_moments_of_any_liner_know_most(diameter, porosity, thickness, depth):
    """R to 1e-5 up to 6 kHz and 10 m/s, as docs/moments.md says; presets to 7e-7."""
    mine = tl.load_liner("polito").replace(
        orifice_diameter=diameter, porosity=porosity, facesheet_thickness=thickness,
        cavity_depth=depth,
    )  # fmt: skip
    error = functools.partial(interpolation_error, Chebyshev(*ANY_LINER), frequency=ASKED, top=10.0)
    assert error(response=response_of(mine))[0] < 1e-5
    presets = [tl.load_liner(name) for name in preset_names()]
    assert max(error(response=response_of(each))[0] for each in presets) < 7e-7


def test_a_liner_that_the_moments_do_not_know_is_refused(liner):
    """A table, which ends at a |v|; a liner or frequencies for which K is too small; in between
    they answer with a note."""
    bare = liner.replace(cell_pitch=None)
    frequency, speed = torch.linspace(600, 3000, 40), torch.linspace(0, 40, 41)
    table = tl.TabulatedLiner(frequency, bare.impedance(frequency[:, None], speed), speed)
    known = tl.moments(plane_of(velocity()), averaging="admittance")
    for ask in (known.error, functools.partial(known.educe, averaging="admittance")):
        with pytest.raises(ValueError, match=r"moments for any liner.* up to 40 m/s alone: reduce"):
            ask(table)
    few = tl.moments(plane_of(velocity()), bare, averaging="admittance")
    options = {"order": "admittance", "interval": None, "tolerance": 1e-15}
    with pytest.warns(tl.DataWarning, match="beyond 1e-11: reduce them again with this liner"):
        few.educe(bare, **options)
    other = bare.replace(orifice_diameter=5e-3, porosity=0.02)
    with pytest.raises(ValueError, match=r"velocity: R of SDoF.*the data were reduced with \(limit"):
        few.educe(other, 3000.0, averaging="admittance")


def _other_plane(**about):
    return lambda v: tl.moments_part(
        plane_of(v[:, 512:], **about), first_sample=512, of_samples=N, averaging="admittance"
    )


def _other_choices(**choices):
    return lambda v: tl.moments_part(
        plane_of(v[:, 512:]), first_sample=512, of_samples=N, **{"order": "admittance"} | choices
    )


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (lambda v: _other_plane()(v[:4]), r"share their probes: \(5,\) .* \(4,\)"),
        (_other_plane(x=torch.arange(5.0)), r"share their x \(m\): None"),
        (_other_plane(sampling_rate=2 * RATE), "sampling rate"),
        (_other_plane(frequency=700.0), "not one case: frequency is 1400.0 and 700.0"),
        (_other_plane(incident_level=145.0), "not one case: incident_level is None and 145.0"),
        (_other_plane(height=2e-3), "not one case: height"),
        (lambda v: _other_plane()(v.float()), "precision"),
        (_other_choices(phase="self-consistent"), "rows"),
        (_other_choices(mean="removed"), "settings"),
        (_other_choices(averaging="velocity"), "settings"),
        (_other_choices(cell_pitch=0.01), "cell pitch"),
        (_other_choices(interval=None), "error bars"),
        (_other_choices(frequency=700.0), "rows|tones"),
        (_other_choices(liner=tl.load_liner("lbm_slit")), r"functions of \|v\|"),
        (lambda v: parts_of(v, (500,), averaging="admittance")[1], "samples 500 to 511 overlap"),
        (lambda v: parts_of(v, (520,), averaging="admittance")[1], "samples 512 to 519 are missing"),
        (lambda v: parts_of(v, (512, 1000), averaging="admittance")[1], "samples 0 to 999 of 2100"),
    ],
)
def test_what_does_not_belong_is_refused(other, message):
    """Another plane, other choices, another basis, samples twice or not at all."""
    v = velocity()
    mine = parts_of(v, (512,), averaging="admittance")[0]
    with pytest.raises(ValueError, match=message):
        tl.Moments.sum([mine, other(v)])


def test_what_is_no_part_is_refused():
    """Records, nothing, samples beyond the record, and what parts cannot do."""
    v = velocity()
    with pytest.raises(TypeError, match="Moments is no part"):
        tl.Moments.sum([tl.moments(plane_of(v))])
    with pytest.raises(ValueError, match="no part is given"):
        tl.Moments.sum([])
    with pytest.raises(ValueError, match="first_sample is 0 to 2000"):
        tl.moments_part(plane_of(v[:, :100]), first_sample=2001, of_samples=N)
    with pytest.raises(ValueError, match="of_samples is needed"):
        tl.moments_part(plane_of(v), first_sample=0)
    with pytest.raises(ValueError, match="running-rms"):
        tl.moments_part(plane_of(v), first_sample=0, of_samples=N, drive="running-rms")
    with pytest.raises(TypeError, match="one VelocityPlane is needed"):
        tl.moments_part(v, first_sample=0, of_samples=N)


def test_a_record_without_blocks(liner):
    """Shorter than two periods: no error bars, the same value."""
    v, bare = velocity(45), liner.replace(cell_pitch=None)
    choices = {"order": "admittance", "allow_short": True}
    found, whole = summed(v, (20,), **choices), tl.moments(plane_of(v), **choices)
    one, other = (each.educe(bare, **choices) for each in (found, whole))
    # Sums of pieces are multiples of 2^-32, here of 30 samples, with a seam within a piece.
    assert relative_error(one.answer, other.answer) < 1e-10
    assert one.uncertainty is None


def test_moments_state_their_error_and_readings(liner):
    """What is not read twice says so; the error for any liner holds where R is looked at."""
    plane = plane_of(velocity())
    readings = {"phase-locked": 2, "admittance": 1}
    for order, count in readings.items():
        found = tl.moments(plane, cell_pitch=liner.cell_pitch, averaging=order)
        assert found.readings == count
    assert 0 < found.error(liner) < 1e-5
    few = tl.moments(plane, liner, averaging="admittance")
    assert few.sums.basis.count < 64
    assert few.error(liner, FREQUENCY) < 1e-9 < few.error(liner, 6000.0)


@pytest.mark.parametrize("phase", ["averaged", "self-consistent"])
@pytest.mark.parametrize("samples", [900, 960, 4000])
def test_a_record_that_goes_on(samples, phase, liner):
    """At any moment the map is that of a record of the whole blocks so far, however it came."""
    v, choices = velocity(samples), {"order": "admittance", "phase": phase}
    going = tl.GrowingMoments(plane_of(v[:, :7]), cell_pitch=liner.cell_pitch, phase=phase)
    at = 7
    for step in (0, 1, 29, 100, 256, 1000, samples):
        going.update(v[:, at : at + step])
        at += step
    assert going.done == samples // 30 * 30
    record = plane_of(v[:, : going.done])
    wanted = tl.moments(record, cell_pitch=liner.cell_pitch, **choices).educe(liner, **choices)
    found, kept = going.educe(liner, phase=phase), going.moments()
    for name in ("impedance", "cell_impedance_velocity_first", "answer"):
        assert relative_error(getattr(found, name), getattr(wanted, name)) < 1e-11
    if going.level == 0:  # as many blocks as a record at once has
        limits = (each.liner["admittance"].interval.low for each in (found, wanted))
        assert relative_error(*limits) < 1e-10
    else:
        assert 16 <= kept.sums.plan.rest <= 32
    going.update(v)
    assert same_bits(kept.educe(liner, **choices), found)


@pytest.mark.parametrize("samples", [360, 1200, 6000])
def test_coherence_of_a_record_that_goes_on(samples, liner):
    """Over segments as long as those of a record of so many samples, near the tone and far off."""
    v, beside = velocity(samples), [1500.0, 1450.0, 1900.0, FREQUENCY]
    choices = {"order": "admittance", "phase": "self-consistent"}
    found = tl.GrowingMoments(plane_of(v), liner, beside, phase="self-consistent").educe(
        liner, beside, phase="self-consistent"
    )
    wanted = tl.educe(plane_of(v), liner, beside, **choices)
    assert found.choices["coherence_segments"] == wanted.choices["coherence_segments"]
    assert found.coherence.numpy() == pytest.approx(wanted.coherence.numpy(), abs=1e-9)
    assert relative_error(found.impedance, wanted.impedance) < 1e-9


def test_what_a_record_that_goes_on_cannot_do(liner):
    """Statistics of the whole record, other probes, faults; no block yet."""
    v = velocity(100)
    for choices, message in [
        ({"order": "phase-locked"}, "need the whole record"),
        ({"window": "hann"}, "need the whole record"),
        ({"drive": "rms"}, "has drive 'instantaneous' alone"),
        ({"mean": "removed"}, "has mean 'kept' alone"),
        ({"periods": 0}, "periods"),
    ]:
        with pytest.raises(ValueError, match=message):
            tl.GrowingMoments(plane_of(v), **choices)
    going = tl.GrowingMoments(plane_of(v[:, :29]))
    with pytest.raises(ValueError, match="29 samples so far; a block of 1 periods has 30"):
        going.educe(liner)
    with pytest.raises(ValueError, match=r"samples have shape \(4, 5\); they are of probes \(5,\)"):
        going.update(v[:4, :5])
    v[2, 50] = torch.inf
    with pytest.raises(ValueError, match=r"1 of 5 probes hold nan or inf .* probe 2; nothing"):
        going.update(v[:, 29:])
    assert going.done == 0
