"""Error bars of maps: whose they are, what they do not depend on, files, tables and warnings."""

from __future__ import annotations

import warnings

import pytest
import torch
from conftest import FREQUENCY, RATE, load_script, plane_of, turbulence

import torchliner as tl

PERIODS = 20
SAMPLES = round(PERIODS * RATE / FREQUENCY)


@pytest.fixture
def noisy() -> tl.VelocityPlane:
    return plane_of(turbulence((6, SAMPLES)), x=[0.001 * i for i in range(6)])


def every_part(found: tl.ImpedanceMap):
    """Of all averagings."""
    parts = [*found.probes.values(), *found.cells.values(), *found.liner.values(), *found.along_x.values()]
    assert all(each.interval is not None for each in parts)
    return parts


@pytest.mark.parametrize("drive", ["instantaneous", "rms", "running-rms"])
def test_interval_holds_its_value(noisy, liner, drive):
    """The educed value lies within its own bounds, and the error is some fraction of the width."""
    found = tl.educe(noisy, liner, drive=drive)
    for each in every_part(found):
        # At this rms the reactance of the liner has a minimum: first-order bounds miss it.
        for part in ("real",) if drive == "rms" else ("real", "imag"):
            low, middle, high = (getattr(z, part) for z in (each.interval.low, each.impedance, each.interval.high))
            assert (low < middle).all()
            assert (middle < high).all()
            width = (high - low) / getattr(each.interval.standard_error, part)
            assert (width > 3.5).all()
            if drive != "running-rms":  # whose blocks are fewer independent ones: Student's quantile of 3 runs is 4.3
                assert (width < 7).all()


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize(("name", "trials"), [("liner of 8 cells", 60), ("liner of 200", 100)])
def test_intervals_hold_the_known_value(name, trials):
    """Of 1 kHz noise, 16 periods: 480 probes and cells (standard error 1 %), 60 and 100 liners (3 %)."""
    script = load_script("coverage")
    rows = [*script.rows_of(name, "1 kHz noise", 16, trials)]
    assert {row["v"] for row in rows} == {"no tone", "tone"}
    for row in rows:
        for part in "RX":
            assert row[f"{part} inside (%)"] > (91.5 if row["trials"] >= 400 else 86), row


@pytest.mark.parametrize("averaging", ["admittance", "velocity", "phase-locked"])
def test_a_record_of_one_block_has_no_interval(liner, averaging, tmp_path):
    """Its whole period then counts; moments and their file do without intervals, too."""
    v = turbulence((2, 40))
    choices = {"allow_short": True, "averaging": averaging}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = tl.educe(plane_of(v), liner, **choices)
        tl.moments(plane_of(v), liner, **choices).write(tmp_path / "m.h5")
        again = tl.read_moments(tmp_path / "m.h5").educe(liner, **choices)
    assert found.level is None
    assert torch.allclose(found.answer, again.answer, rtol=1e-8, atol=0)
    if averaging == "admittance":
        z = liner.impedance(FREQUENCY, v[:, :30].abs())
        wanted = ((z - 1) / (z + 1)).mean(1)
        assert float((found.probes["admittance"].reflection[:, 0] - wanted).abs().max()) < 1e-8
