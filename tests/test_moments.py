"""Moments educe as their plane does, for any liner; what they do not know is refused."""

from __future__ import annotations

import functools

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, relative_error, turbulence
from hypothesis import given
from hypothesis import strategies as st

import torchliner as tl
from torchliner.engine.moments import ASKED
from torchliner.engine.nodes import ANY_LINER, interpolation_error
from torchliner.liners.catalogue import preset_names

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
N = 2100  # 70 periods
CHOICES = [
    {"averaging": "admittance"},
    {"averaging": "velocity", "phase": "self-consistent"},
    {},
    {"mean": "removed"},
    {"drive": "rms"},
    {"drive": "running-rms", "interval": None},
]


def velocity(samples: int = N, probes: int = 5, dtype=torch.float64) -> torch.Tensor:
    """Turbulence and a tone of another size at each probe, m/s."""
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(samples))
    return (turbulence((probes, samples)) + torch.linspace(1, 8, probes)[:, None] * tone).to(dtype)


@pytest.mark.parametrize("known_liner", [True, False])
@pytest.mark.parametrize("choices", CHOICES, ids=str)
def test_moments_educe_as_their_plane(choices, known_liner, liner):
    """R to 1e-6: that is their own table's error and less."""
    plane, about = plane_of(velocity(), x=[0.002 * i for i in range(5)]), dict(choices)
    interval = about.pop("interval", 0.95)
    whole = tl.educe(plane, liner, interval=interval, **about)
    if known_liner:
        known = tl.moments(plane, liner, **about)
    else:
        known = tl.moments(plane, cell_pitch=liner.cell_pitch, frequency=FREQUENCY, **about)
    found = known.educe(liner, interval=interval, **about)
    assert found.averagings == whole.averagings
    for averaging in whole.averagings:
        for kind in ("liner", "cells"):
            one, other = (getattr(each, kind)[averaging] for each in (whole, found))
            assert relative_error(other.impedance, one.impedance) < 1e-6
            if interval is not None:
                assert relative_error(other.interval.low, one.interval.low) < 1e-5
    assert torch.equal(found.coherence, whole.coherence)


def test_what_was_taken_at_a_frequency_is_not_asked_for_at_another(liner):
    """The running rms' own window, and the coherence behind walls."""
    v, bare = velocity(), liner.replace(cell_pitch=None)
    running = {"drive": "running-rms", "averaging": "admittance"}
    known = tl.moments(plane_of(v), **running)
    with pytest.raises(ValueError, match=r"reduced with running_window 0.000714.*0.00142857.* is asked"):
        known.educe(bare, 700.0, **running)
    own = tl.educe(plane_of(v), bare, running_window=1 / FREQUENCY, frequency=700.0, **running)
    same = known.educe(bare, 700.0, running_window=1 / FREQUENCY, **running)
    assert relative_error(same.answer, own.answer) < 1e-6
    with pytest.raises(ValueError, match=r"coherence of v.* at 1400, .* and not at 700 Hz"):
        tl.moments(plane_of(v)).educe(bare, 700.0, wall_filter=0.5)


@given(
    diameter=st.floats(0.5e-3, 2.5e-3),
    porosity=st.floats(0.03, 0.15),
    thickness=st.floats(0.5e-3, 2e-3),
    depth=st.floats(10e-3, 60e-3),
)
def test_moments_of_any_liner_know_most(diameter, porosity, thickness, depth):
    """R up to 6 kHz and 10 m/s, as docs/moments.md says: to 1e-5 from 5 % open area on; presets to 7e-7."""
    mine = tl.load_liner("polito").replace(
        orifice_diameter=diameter, porosity=porosity, facesheet_thickness=thickness, cavity_depth=depth
    )
    error = functools.partial(interpolation_error, ANY_LINER, frequency=ASKED, top=10.0)
    assert error(mine)[0] < (1e-5 if porosity >= 0.05 else 3e-4)
    assert max(error(tl.load_liner(name))[0] for name in preset_names()) < 7e-7


def test_a_liner_that_the_moments_do_not_know_is_refused(liner):
    """A table, which ends at a |v|."""
    bare = liner.replace(cell_pitch=None)
    frequency, speed = torch.linspace(600, 3000, 40), torch.linspace(0, 40, 41)
    table = tl.TabulatedLiner(frequency, bare.impedance(frequency[:, None], speed), speed)
    known = tl.moments(plane_of(velocity()), averaging="admittance")
    for ask in (known.error, functools.partial(known.educe, averaging="admittance")):
        with pytest.raises(ValueError, match=r"moments for any liner.* up to 40 m/s: reduce"):
            ask(table)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"phase": "self-consistent"}, "phase"),
        ({"mean": "removed"}, "reduced with mean 'kept'"),
        ({"drive": "rms"}, "reduced with drive 'instantaneous'"),
        ({"averaging": "phase-locked"}, "reduced with averaging 'admittance'"),
    ],
)
def test_other_choices_are_refused(choices, message, liner):
    known = tl.moments(plane_of(velocity()), liner, averaging="admittance")
    with pytest.raises(ValueError, match=message):
        known.educe(liner, **{"averaging": "admittance"} | choices)


def test_moments_state_their_error(liner):
    """That for any liner holds where R is looked at; that of one liner at its frequency."""
    plane = plane_of(velocity())
    assert 0 < tl.moments(plane, cell_pitch=liner.cell_pitch, averaging="admittance").error(liner) < 1e-5
    few = tl.moments(plane, liner, averaging="admittance")
    assert few.nodes.count < 64
    assert few.error(liner, FREQUENCY) < 1e-9 < few.error(liner, 6000.0)
