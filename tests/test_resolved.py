"""Readers of the resolved cells and of the channel: a synthetic twin, and the files themselves."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

import torchliner as tl
from studies.resolved_cases import read_channel, read_resolved
from studies.resolved_liner import GEOMETRY, resolved_cases, resolved_liner

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
SAMPLES, COLUMNS, ROWS = 6, 5, 4
HEIGHTS = np.array([0.5e-3, 2.5e-3], dtype=np.float32)
ATTRIBUTES = {
    "Z_wave_re": 0.25,
    "Z_wave_im": -0.5,
    "Z_insitu_re": 0.75,
    "Z_insitu_im": -0.125,
    "Z_top_re": 0.5,
    "Z_top_im": -1.0,
    "density_kg_m3": 1.25,
    "sound_speed_m_s": 340.0,
    "kinematic_viscosity_m2_s": 1.6e-5,
    "frequency_Hz": 1400.0,
    "incident_SPL_dB_nominal": 130.0,
    "incident_SPL_dB_measured": 129.9,
    "mach": 0.1,
    "n_periods_analysed": 19,
}
SLIT = {
    "cfg_dx": 6.84e-5,
    "cfg_tp": 8,
    "cfg_D": 146,
    "cfg_H": 557,
    "cfg_Lc": 182,
    "cfg_slit": 10,
    "porosity": 10 / 182,
}  # nodes of n115
ORIFICE = {
    "cfg_dx": 1.08e-4,
    "cfg_tp": 5,
    "cfg_D": 33,
    "cfg_H": 353,
    "cfg_Lc": 41,
    "cfg_d_eff_mm": 1.2002305640291455,
    "porosity": 0.05770374776918501,
}


def add(group, name, values, units):
    group[name] = values
    group[name].attrs["units"] = units


def velocity_of(*shape):
    return np.random.default_rng(0).normal(size=shape).astype(np.float32)


@pytest.fixture
def cells(tmp_path):
    """A slit (two-dimensional) and an orifice (three-dimensional) in one file."""
    path = tmp_path / "cells.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"solver": "by hand", "source": "a test"})
        file.create_group("notes")
        for case, rows, nodes in (("slit", (), SLIT), ("orifice", (ROWS,), ORIFICE)):
            group = file.create_group(case)
            group.attrs.update(ATTRIBUTES | nodes)
            add(group, "time", 0.1 + np.arange(SAMPLES) / 1e5, "s")
            add(group, "x", np.arange(COLUMNS) * 1e-3, "m")
            add(group, "y_lines", HEIGHTS, "m")
            add(group, "v_n", velocity_of(SAMPLES, 2, *rows, COLUMNS), "m/s")
            if rows:
                add(group, "z", np.arange(ROWS) * 1e-2, "m")
            else:
                add(group, "u_x", velocity_of(SAMPLES, 2, 3) + 10, "m/s")
    return path


def test_cases_and_heights(cells):
    heights = [0.0005, 0.0025]
    assert resolved_cases(cells) == {"orifice": heights, "slit": heights}


@pytest.mark.parametrize("line", [0, 1])
@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("case", ["slit", "orifice"])
def test_velocity_is_that_of_the_line(cells, case, line, stride):
    plane = read_resolved(cells, case, line, stride)
    stored = velocity_of(SAMPLES, 2, *((ROWS,) if case == "orifice" else ()), COLUMNS)
    for t in range(SAMPLES):
        assert np.array_equal(plane.velocity[..., t], stored[t, line, ..., ::stride])
    assert plane.velocity.dtype == torch.float32
    assert plane.x.tolist() == (np.arange(COLUMNS) * 1e-3)[::stride].tolist()
    assert plane.height == [0.0005, 0.0025][line]
    assert plane.sampling_rate == pytest.approx(1e5)
    assert (plane.z is None) == (case == "slit")


def test_streamwise_velocity_comes_with_its_own_stride(cells):
    plane = read_resolved(cells, "slit", 1, 2)
    wanted = (velocity_of(SAMPLES, 2, 3) + 10)[:, 1].T
    assert np.array_equal(plane.streamwise, wanted)
    assert read_resolved(cells, "slit", 1, 1).streamwise is None
    assert read_resolved(cells, "orifice", 1, 2).streamwise is None


def test_holes_stand_at_the_middle_of_their_open_nodes(cells):
    """Two slits of nodes 86 to 95 of cells of 182, and an orifice of a mask (z, x)."""
    mask = np.zeros((ROWS, COLUMNS), np.int8)
    mask[1:3, 2:5] = 1
    with h5py.File(cells, "a") as file:
        first = np.arange(86, 96)
        file["slit/x"][:] = np.arange(COLUMNS) * 5e-3
        add(file["slit"], "orifice_ix", np.concatenate([first, first + 182]), "1")
        add(file["orifice"], "orifice_mask", mask, "1")
    slits, hole = (read_resolved(cells, case, 0).holes for case in ("slit", "orifice"))
    assert slits.x == pytest.approx((91 * 6.84e-5, 273 * 6.84e-5))
    assert slits.diameter == pytest.approx((6.84e-4, 6.84e-4))
    assert slits.z is None
    assert (*hole.x, *hole.z) == pytest.approx((3.5 * 1.08e-4, 2 * 1.08e-4))


@pytest.mark.parametrize(
    ("case", "liner", "reference"),
    [
        ("slit", "lbm_slit", {"true": 0.25 - 0.5j, "in situ": 0.75 - 0.125j}),
        ("orifice", "lbm_orifice", {"true": 0.75 - 0.125j, "top row": 0.5 - 1j}),
    ],
)
def test_truth_fluid_and_conditions(cells, case, liner, reference):
    """In three dimensions vortices bias the wave decomposition: the truth is in situ."""
    plane = read_resolved(cells, case, 0)
    assert plane.reference == reference
    assert plane.fluid.dynamic_viscosity == pytest.approx(2e-5)
    assert replace(plane.fluid, dynamic_viscosity=2e-5) == tl.Fluid(340.0, 1.25, 2e-5, 1.0, 1.0)
    assert (plane.frequency, plane.incident_level, plane.mach) == (1400.0, 130.0, 0.1)
    assert (plane.liner, plane.source_side) == (liner, "normal")
    assert plane.provenance["solver"] == "by hand"
    assert plane.provenance["periods_behind_truth"] == 19
    assert plane.title.endswith(f"case {case}, y = 0.5 mm")
    assert plane.name.endswith(f"cells.h5:/{case}/v_n[0]")


def test_the_coarse_lattice_has_a_preset_and_truth_of_its_own(cells):
    """Each lattice has its own linear part; on the coarse one the top row is the truth."""
    nodes = {
        "cfg_dx": 1.38375e-4,
        "cfg_tp": 4,
        "cfg_D": 26,
        "cfg_H": 275,
        "cfg_Lc": 32,
        "cfg_d_eff_mm": 1.2094511126654315,
        "porosity": 0.05859375,
    }
    with h5py.File(cells, "a") as file:
        file["orifice"].attrs.update(nodes)
    plane = read_resolved(cells, "orifice", 0)
    assert plane.liner == "lbm_orifice_coarse"
    assert plane.reference == {"true": 0.5 - 1j, "in situ": 0.75 - 0.125j}


@pytest.mark.parametrize("change", [{"cfg_tp": 6}, {"cfg_dx": 8.52e-5}, {"cfg_slit": 9}])
def test_another_geometry_or_lattice_is_no_preset(cells, change):
    with h5py.File(cells, "a") as file:
        file["slit"].attrs.update(change)
    with pytest.warns(tl.DataWarning, match=r"/slit has the geometry and lattice of no preset.*for"):
        assert read_resolved(cells, "slit", 0).liner == ""


@pytest.mark.parametrize(("case", "preset"), [("slit", "lbm_slit"), ("orifice", "lbm_orifice")])
def test_presets_are_the_liners_of_the_files(cells, case, preset):
    """Geometry of the file; linear part of a named case, or as stated."""
    found = resolved_liner(cells, case, 0.25 - 0.5j)
    assert complex(found.impedance(1400.0)) == pytest.approx(0.25 - 0.5j, abs=1e-12)
    assert resolved_liner(cells, "slit", "slit").impedance(1400.0).item() == pytest.approx(0.25 - 0.5j, abs=1e-12)
    known = tl.load_liner(preset)
    for name in GEOMETRY:
        assert getattr(found, name) == pytest.approx(getattr(known, name), rel=1e-5), name


def test_times_that_are_not_uniform_are_refused(cells, channel):
    for path, name in ((cells, "slit/time"), (channel, "t")):
        with h5py.File(path, "a") as file:
            file[name][3] += 1e-5
            file[name][3] *= 1.001
    with pytest.raises(ValueError, match="slit/time is out of order"):
        read_resolved(cells, "slit", 0)
    with pytest.raises(ValueError, match=r"channel.h5:/t is not uniform"):
        read_channel(channel, 0)


@pytest.mark.parametrize(
    ("case", "line", "message"),
    [
        ("slot", 0, r"cells.h5 has no case 'slot' \(did you mean 'slit'\?\); it holds orifice, sl"),
        ("notes", 0, r"cells.h5 has no case 'notes'"),
        ("slit", 2, r"cells.h5:/slit has lines 0 to 1, not 2"),
        ("slit", -1, r"cells.h5:/slit has lines 0 to 1, not -1"),
    ],
)
def test_unknown_case_or_line_is_refused(cells, case, line, message):
    with pytest.raises(ValueError, match=message):
        read_resolved(cells, case, line)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda g: g.attrs.__delitem__("mach"), r"h5:/slit: attribute 'mach' is missing"),
        (lambda g: g.__delitem__("v_n"), r"h5:/slit/v_n is missing; the group holds: time, u_x"),
        (lambda g: g["v_n"].attrs.__delitem__("units"), r"h5:/slit/v_n has no units attribute"),
        (lambda g: g["time"].attrs.update(units="m"), r"h5:/slit/time has units 'm'.*time is need"),
    ],
)
def test_damaged_case_is_refused_with_its_place(cells, damage, message):
    with h5py.File(cells, "a") as file:
        damage(file["slit"])
    with pytest.raises(ValueError, match=message):
        read_resolved(cells, "slit", 0)


@pytest.fixture
def channel(tmp_path):
    """Three planes, units followed by words as in the channel's own file."""
    path = tmp_path / "channel.h5"
    with h5py.File(path, "w") as file:
        file.attrs["Re_tau"] = 369.0
        add(file, "t", 100 + 0.2 * np.arange(SAMPLES), "s")
        add(file, "x", np.arange(COLUMNS) * 0.05, "m")
        add(file, "y", [0.026, 0.052, 0.122], "m")
        add(file, "z", np.arange(ROWS) * 0.1, "m")
        add(file, "v", velocity_of(3, SAMPLES, ROWS, COLUMNS), "m/s, wall-normal, positive away")
        add(file, "u_plane1", velocity_of(SAMPLES, ROWS, COLUMNS), "m/s, streamwise, plane y[1]")
    return path


@pytest.mark.parametrize("plane", [0, 1, 2])
def test_channel_scales_lengths_velocities_and_times(channel, plane):
    """0.2 s x 0.02/800 is 5 us: 200 kHz."""
    found = read_channel(channel, plane, length=0.02, velocity=800.0)
    stored = velocity_of(3, SAMPLES, ROWS, COLUMNS)[plane]
    assert np.allclose(found.velocity, 800 * np.moveaxis(stored, 0, -1), rtol=1e-6)
    assert found.sampling_rate == pytest.approx(2e5)
    assert found.height == pytest.approx([0.52e-3, 1.04e-3, 2.44e-3][plane])
    assert (found.x[1].item(), found.z[1].item()) == pytest.approx((1e-3, 2e-3))
    assert (found.streamwise is not None) == (plane == 1)
    assert (found.liner, found.source_side) == ("hard wall", "none")


needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the real files are not here")


@needs_shared
@pytest.mark.filterwarnings("ignore:.*lattice of no preset")
@pytest.mark.parametrize(
    ("name", "case", "truth", "peak"),
    [
        ("resolved_liner_lbm.h5", "c115", 0.114 + 0.071j, 15.91),
        ("resolved_liner_lbm.h5", "n130", 0.168 - 0.066j, 89.44),
        ("resolved_liner_lbm.h5", "g03_145", 1.662 - 0.460j, 502.97),
        ("resolved_orifice_3d.h5", "o115", 0.221 - 0.215j, 15.91),
        ("resolved_orifice_3d.h5", "o145", 1.099 - 0.511j, 502.97),
        ("resolved_more.h5", "n145", 0.764 - 0.302j, 502.97),
        ("resolved_more.h5", "o130", 0.343 - 0.369j, 89.44),
        ("resolved_more.h5", "t00_130", 0.376 - 0.352j, 89.44),
        ("resolved_more.h5", "t015_145", 1.453 - 0.658j, 502.97),
    ],
)
def test_real_cells(name, case, truth, peak):
    """The cell's mean |v| is 2 p/(rho c |1 + z|) of the stated truth, to 6 % (vortices, start)."""
    plane = read_resolved(SHARED / name, case, 4)
    assert abs(plane.reference["true"] - truth) < 1e-3
    assert plane.height == 0.0025
    rate, periods = plane.sampling_rate, int(1400 * plane.duration)
    times = torch.arange(round(periods / 1400 * rate)) / rate
    mean = plane.velocity.double().reshape(plane.probes, -1).mean(0)[-len(times) :]
    found = 2 * (mean * torch.exp(-2j * torch.pi * 1400 * times)).mean().abs()
    assert float(found) == pytest.approx(2 * peak / (1.2 * 343.2 * abs(1 + truth)), rel=0.06)


@needs_shared
@pytest.mark.parametrize(("plane", "height", "rms"), [(0, 0.52e-3, 1.4), (1, 1.04e-3, 2.8), (2, 2.44e-3, 4.8)])
def test_real_channel(plane, height, rms):
    """Rescaled to 100 m/s over 20 mm: v' of the data's own description, 187 kHz, 7.2 ms."""
    found = read_channel(SHARED / "les_channel_planes.h5", plane, 0.02, 749.06)
    assert found.height == pytest.approx(height, rel=0.01)
    assert float(found.velocity.std()) == pytest.approx(rms, rel=0.05)
    assert found.sampling_rate == pytest.approx(187e3, rel=2e-3)
    assert found.duration == pytest.approx(7.2e-3, rel=0.01)
    assert found.probe_shape == (30, 80)
