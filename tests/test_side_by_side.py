"""The simulated duct in which all methods are compared, and the figures with a known truth."""

import numpy as np
import pytest
from conftest import load_script

import torchliner as tl

load_script("b2a_line")  # which the next one imports
SCRIPT, FIGURE = load_script("side_by_side"), load_script("figure_14")
pytestmark = [
    pytest.mark.slow,  # a study of the pages: the methods it compares have tests of their own
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]


@pytest.fixture(scope="module")
def world():
    """Eight places and 0.2 s; turbulence that rises along x, white."""
    x = (np.arange(8) + 0.5) * SCRIPT.LENGTH / 8
    generator = np.random.default_rng(1)
    turbulence = generator.standard_normal((8, 10_000)) * np.linspace(2, 5, 8)[:, None]
    return SCRIPT.settle("rising", "downstream", tl.load_liner("onera"), turbulence, x)


def test_wall_and_sound_belong_together(world):
    """The literal sum gives the wall that the field was solved with; pressure over velocity is it
    too, to what the field's polynomials of degree 4 make of a kinked wall; it rises with v'."""
    assert world.literal_error < 1e-6
    pressure = world.field.wall_pressure(world.x, "lined")[0].numpy()
    ratio = pressure / (tl.Fluid().characteristic_impedance * world.sound)
    assert np.abs(ratio - world.impedance).max() < 5e-3
    assert world.impedance[-1].real > world.impedance[0].real + 0.5


def test_local_methods_return_the_wall(world):
    """DIR-TDIBC but for the wave's phase, which it is not told; in situ, without turbulence in the
    pressures, to the same."""
    liner = tl.load_liner("onera")
    rows, along = SCRIPT.by_velocity(world, liner)
    assert abs(rows[0].error.real) < 0.05
    assert np.abs(along.impedance[:, 0].numpy() - world.impedance).max() < 0.15
    quiet = SCRIPT.cavities(world, liner, np.zeros_like(world.turbulence))
    rows, found = SCRIPT.by_cavities(world, quiet)
    with_losses = next(row for row in rows if row.method == "in situ, with losses")
    assert abs(with_losses.error.real) < 1e-3
    assert abs(with_losses.error.imag) < 1e-3
    assert np.abs(found.points.impedance[:, 0].numpy() - world.impedance).max() < 5e-3


@pytest.mark.parametrize("facility", FIGURE.FACILITIES, ids=lambda f: f.preset)
def test_figures_14_and_19(facility, tmp_path):
    """The fit of the field returns what the pressures were made with, KT does not; the range of the
    levels holds what is fitted."""
    sides = {side: FIGURE.educed(facility, side, 20) for side in FIGURE.SIDES}
    FIGURE.draw(facility, sides, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 50_000
    for side, one in sides.items():
        by_modes, by_field = FIGURE.impedances(facility, side, one)
        away = [abs(row.impedance - facility.truth[side]) for row in (by_modes, by_field)]
        assert away[0] > 0.2
        assert away[1] < 1e-6
        for row in FIGURE.levels(facility, side, one):
            assert row["KT least (dB)"] <= row["KT (dB)"] + 0.3
            assert row["KT most (dB)"] >= row["KT (dB)"] - 0.3
            assert row["KT (dB)"] == pytest.approx(row["SPL (dB)"], abs=0.7)
    if facility.preset == "ufsc":
        levels = [sides[side].line.level[:, 0] for side in FIGURE.SIDES]
        assert float(levels[0][0]) == pytest.approx(FIGURE.FIRST)
        assert float(levels[1][-1]) == pytest.approx(FIGURE.FIRST)
