"""Eduction from lines of wall microphones: Kumaresan and Tufts, two waves, warnings, intervals, the command."""

import cmath
import csv
import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
import torch
from conftest import relative_error

import torchliner as tl
from coverage import METHODS, held_by_draws
from torchliner.cli.main import main
from torchliner.conversions import spl_from_pressure_amplitude
from torchliner.duct.dispersion import impedance_from_wavenumber, wavenumber_from_impedance
from torchliner.duct.flow_profiles import UniformProfile
from torchliner.duct.modes import cut_on_frequency
from torchliner.duct.presets import duct_text
from torchliner.names import CONDITIONS
from torchliner.pressure.microphone_errors import LEVEL_ERROR
from torchliner.pressure.plane_waves import sort_waves
from torchliner.pressure.two_waves import two_wave_fit
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import MicrophoneLine

HEIGHT, SPACING, COUNT = 0.05, 0.012, 12
FREQUENCY = torch.tensor([600.0, 1000.0, 1500.0], dtype=torch.float64)
WALLS = torch.tensor([0.8 - 1.2j, 1.5 + 0.3j, 2.33 - 0.3j], dtype=torch.complex128)
X = torch.arange(COUNT, dtype=torch.float64) * SPACING
OTHER = {"upstream": "downstream", "downstream": "upstream"}


def wave(side: str, x=X, *, mach=0.3, walls=WALLS, condition="ingard-myers", mode=0, back=False):
    """e^{-j alpha x} of the mode that runs away from a source on one side, 1 at its end of x;
    ``back`` is the one that runs towards it, 1 at the other end."""
    direction = side if back else OTHER[side]
    alpha = wavenumber_from_impedance(
        walls, FREQUENCY, height=HEIGHT, mach=mach, condition=condition, direction=direction, mode=mode
    )
    origin = x[0] if (side == "upstream") != back else x[-1]
    return torch.exp(-1j * alpha * (x[:, None] - origin)), alpha


def line_of(pressure, side="upstream", x=X, **about) -> MicrophoneLine:
    about = {"duct_height": HEIGHT, "mach": 0.3, "source_side": side, **about}
    return MicrophoneLine(x, pressure, about.pop("frequency", FREQUENCY), **about)


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize(("rank", "order"), [(1, 1), (1, 6), (2, 2), (2, 4), (3, 6), (6, 6)])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_one_wave_is_exact(side, rank, order, condition):
    """Z in is Z out to 1e-10 at any order, and a rank above the one wave that is there."""
    pressure, alpha = wave(side, condition=condition)
    found = kumaresan_tufts(line_of(100 * pressure, side), rank=rank, order=order, condition=condition)
    assert relative_error(found.impedance, WALLS) < 1e-10
    assert relative_error(found.wavenumber, alpha) < 1e-11
    assert float(found.residual.max()) < 1e-12
    assert found.singular_values.shape == (order, 3)
    if order > 1:  # one wave, one singular value
        assert float((found.singular_values[1:] / found.singular_values[0]).max()) < 1e-13
    assert relative_error(found.pressure_at(X), 100 * pressure) < 1e-10
    assert float((spl_from_pressure_amplitude(found.pressure_at(X)) - line_of(100 * pressure).level).abs().max()) < 1e-9


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize(("rank", "order"), [(2, 2), (2, 3), (2, 6), (3, 6)])
def test_incident_and_reflected(side, rank, order):
    """The impedance is that of the wave from the source, even where it has less energy over the array."""
    there, alpha = wave(side)
    back, beta = wave(side, back=True)
    amplitude = 600 * np.exp(0.7j)
    line = line_of(100 * there + amplitude * back, side)
    with pytest.warns(tl.DataWarning, match="of the energy of the strongest wave: the source may"):
        found = kumaresan_tufts(line, rank=rank, order=order)
    # Both waves are of one wall: the impedance alone could not tell which was taken.
    assert relative_error(found.wavenumber, alpha) < 1e-9
    assert relative_error(found.impedance, WALLS) < 1e-9
    strongest = found.amplitudes.abs().argsort(0, descending=True)[:2]
    modes = found.modes.gather(0, strongest)
    for f in range(len(FREQUENCY)):
        wanted = {complex(alpha[f]), complex(beta[f])}
        for mode in modes[:, f].tolist():
            assert min(abs(mode - each) for each in wanted) < 1e-9
    assert relative_error(found.pressure_at(X), 100 * there + amplitude * back) < 1e-9


def test_of_two_modes_the_stronger_one():
    """Mode 1 beside mode 0: their energies over the array decide, not their order."""
    plane, first = wave("upstream")[0], wave("upstream", mode=1)[0]
    for weights, mode in (((100, 30), 0), ((0.3, 100), 1)):
        pressure = weights[0] * plane + weights[1] * first
        found = kumaresan_tufts(line_of(pressure), rank=2, order=4)
        wanted = wave("upstream", mode=mode)[1]
        assert relative_error(found.wavenumber, wanted) < 1e-8
        assert relative_error(found.impedance, WALLS) < 1e-7


def test_microphones_over_the_liner_alone_are_used():
    pressure = wave("upstream")[0].clone()
    pressure[:2] = 50.0
    pressure[-1] = 9j
    line = line_of(pressure, liner_start=float(X[2]) - 1e-3, liner_end=float(X[-2]) + 1e-3)
    found = kumaresan_tufts(line)
    assert found.x.tolist() == X[2:-1].tolist()
    assert found.choices["order"] == 4
    assert relative_error(found.impedance, WALLS) < 1e-10
    assert len(kumaresan_tufts(line, margin=2e-3).x) == 7


def noisy(pressure, count: int, seed: int):
    random = np.random.default_rng(seed)
    line = line_of(pressure)
    level = line.level.numpy() + 0.1 * random.standard_normal((count, *line.pressure.shape))
    phase = line.phase.numpy() + 0.1 * random.standard_normal((count, *line.pressure.shape))
    return MicrophoneLine.from_levels(X, level, phase, FREQUENCY, duct_height=HEIGHT, mach=0.3, source_side="upstream")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"order": 7}, "12 microphones are fewer than twice the order, 7; the most is 6"),
        ({"rank": 7}, "rank is 7; it must be 1 to the order, 6"),
        ({"condition": "myers"}, "unknown condition 'myers' .did you mean 'ingard-myers'"),
        ({"draws": -1}, "draws is -1; 0 for none, or at least 2"),
        ({"draws": 5, "phase_error": math.nan}, "phase_error is nan"),
        ({"margin": 0.2}, "two"),
    ],
)
def test_kumaresan_and_tufts_refuse(options, match):
    line = line_of(wave("upstream")[0], liner_start=-0.01, liner_end=0.15)
    with pytest.raises(ValueError, match=match):
        kumaresan_tufts(line, **options)


LIMIT = cut_on_frequency(UniformProfile(0.3, HEIGHT, tl.Fluid().sound_speed))
APART = 0.2 * torch.arange(12, dtype=torch.float64)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (lambda: line_of(wave("upstream")[0], frequency=[1000.0, 1500.0, LIMIT + 1]), f"{LIMIT:.4g} Hz .* 50 mm"),
        (lambda: line_of(wave("upstream")[0], duct_width=0.15), "width, 150 mm"),
        (lambda: line_of(torch.exp(-1j * (5 - 0.5j) * APART[:, None]).expand(-1, 3), x=APART), "above 1115 Hz"),
        (
            lambda: line_of(torch.exp(-1j * (20 + 0.5j) * X[:, None]).expand(-1, 3)),
            "at 3 of 3 .* resistance is negative",
        ),
    ],
)
def test_doubts_are_warned_of(line, words):
    with pytest.warns(tl.DataWarning, match=words):
        kumaresan_tufts(line())


@pytest.mark.filterwarnings("ignore:.*draws have no impedance")
def test_a_frequency_without_a_wave_is_kept_and_told():
    mixed = wave("upstream")[0].clone()
    mixed[:, 1] = mixed[:, 1].conj()
    with pytest.warns(tl.DataWarning, match="at 1 of 3 values, first at 1000 Hz, no wave"):
        found = kumaresan_tufts(line_of(mixed), rank=1, draws=10)
    assert torch.isnan(found.impedance[1].real)
    assert found.failed.tolist() == [0, 10, 0]
    assert "lost-draws" in {note.code for note in found.notes}
    assert torch.isfinite(found.deviation[[0, 2]]).all()


UNEVEN = torch.tensor([0.0, 0.011, 0.03, 0.037, 0.064, 0.083, 0.1, 0.13], dtype=torch.float64)


def both_ways(side="upstream", x=X, share=0.3 + 0.2j, **about):
    """100 Pa away from the source and a share of it back, with their wavenumbers."""
    there, alpha = wave(side, x, **about)
    back, beta = wave(side, x, back=True, **about)
    return 100 * (there + share * back), alpha, beta


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_known_walls_come_back(side, condition):
    pressure, alpha, beta = both_ways(side, UNEVEN, condition=condition)
    found = two_wave_fit(line_of(pressure, side, UNEVEN), condition=condition)
    assert relative_error(found.impedance, WALLS) < 1e-9
    assert relative_error(found.modes, torch.stack([alpha, beta])) < 1e-9
    assert relative_error(found.pressure_at(UNEVEN), pressure) < 1e-9
    assert float(found.residual.max()) < 1e-11
    assert found.choices["unsettled"] == 0
    assert found.singular_values is None


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("side", OTHER)
def test_no_guess_is_needed(side, condition):
    """60 walls with resistances of 0.1 to 6 and reactances of -4 to 4, without a start."""
    random = torch.Generator().manual_seed(4)
    draws = torch.rand(2, 60, generator=random, dtype=torch.float64)
    walls = torch.complex(0.1 * 60 ** draws[0], 8 * draws[1] - 4)
    about = {"height": HEIGHT, "mach": 0.3, "condition": condition}
    alphas = [wavenumber_from_impedance(walls, 1200.0, direction=d, **about) for d in OTHER.values()]
    ends = (X[0], X[-1])
    parts = [torch.exp(-1j * alpha[:, None] * (X - end)) for alpha, end in zip(alphas, ends, strict=True)]
    mix = (1.0, 0.2) if side == "upstream" else (0.2, 1.0)
    pressure = (mix[0] * parts[0] + mix[1] * parts[1])[..., None]
    found = two_wave_fit(line_of(pressure, side, frequency=1200.0), condition=condition)
    wrong = (found.impedance[:, 0] / walls - 1).abs() > 1e-6
    # One microphone alone sees a wave back that decays within a spacing: Z is good to 1e-2 instead.
    back = alphas[1 if side == "upstream" else 0]
    assert bool((back.imag[wrong].abs() * 0.012 > 2).all())
    assert int(wrong.sum()) <= 1
    assert relative_error(found.impedance[:, 0], walls) < 1e-2


def test_tied_waves_belong_to_one_wall_whatever_the_noise():
    found = two_wave_fit(noisy(both_ways()[0], 20, seed=11))
    walls = impedance_from_wavenumber(found.modes, FREQUENCY, height=HEIGHT, mach=0.3)
    assert relative_error(walls[:, 0], walls[:, 1]) < 1e-9


def test_ties_and_drawn_errors():
    """Deviations drawn are the scatter of realisations, and a tie lowers them; the mean has no bias."""
    pressure = both_ways()[0]
    scatter = two_wave_fit(noisy(pressure, 300, seed=1)).impedance
    one = noisy(pressure, 1, seed=2)
    line = dataclasses.replace(one, pressure=one.pressure[0])
    found = two_wave_fit(line, draws=300, seed=3)
    for part in ("real", "imag"):
        drawn, seen = getattr(found.deviation, part), getattr(scatter, part).std(0)
        # 4 % for each deviation from 300 values; the slope at a noisy line differs by a few %.
        assert drawn.tolist() == pytest.approx(seen.tolist(), rel=0.2)
        bias = getattr(scatter.mean(0) - WALLS, part).abs()
        assert bool((bias < 4 * seen / math.sqrt(300)).all())
    others = kumaresan_tufts(line, draws=100)
    assert bool((found.deviation.abs() < others.deviation.abs()).all())


def rigid_line(mach=0.25, side="upstream", **about) -> MicrophoneLine:
    """120 dB downstream and half of it back at x = 0, before a liner from 0.2 to 0.6 m."""
    x = torch.tensor([-0.3, -0.11, -0.05, 0.3, 0.5, 0.9, 1.15], dtype=torch.float64)[:, None]
    k = 2 * math.pi * FREQUENCY / 343.2
    size = 2**0.5 * 20.0
    pressure = size * (torch.exp(-1j * k * x / (1 + mach)) + 0.5j * torch.exp(1j * k * x / (1 - mach)))
    about = {"liner_start": 0.2, "liner_end": 0.6, **about}
    return line_of(pressure, side, x[:, 0], mach=mach, **about)


def test_two_flush_microphones_set_the_level():
    """120 dB at the liner's edge, reflection turned there; the source's side decides which wave is incident."""
    line = rigid_line()
    for some in ([1, 2, 3], [0, 2, 4], range(7)):
        found = sort_waves(line.select(some))
        assert found.incident_level.tolist() == pytest.approx([120.0] * 3, abs=1e-9)
        assert found.at == 0.2
        for f, hertz in enumerate(FREQUENCY.tolist()):
            k = 2 * math.pi * hertz / 343.2
            turn = cmath.exp(1j * k * 0.2 / 0.75) / cmath.exp(-1j * k * 0.2 / 1.25)
            assert complex(found.reflection[f]) == pytest.approx(0.5j * turn, abs=1e-9)
    assert found.microphones.tolist() == [-0.3, -0.11, -0.05]
    behind = sort_waves(rigid_line(side="downstream"))
    assert behind.microphones.tolist() == [0.9, 1.15]
    assert behind.incident_level.tolist() == pytest.approx([120 + 20 * math.log10(0.5)] * 3)
    assert behind.at == 0.6
    drawn = dataclasses.replace(line, pressure=torch.stack([line.pressure, 2 * line.pressure]))
    assert sort_waves(drawn).incident_level[1].tolist() == pytest.approx([126.0206] * 3, abs=1e-4)


def test_fits_and_sorting_refuse():
    line = line_of(both_ways(x=UNEVEN)[0], x=UNEVEN)
    x = torch.tensor([0.0, 343.2 * (1 - 0.25**2) / 2000.0], dtype=torch.float64)
    half = line_of(torch.ones(2, 1) + 0j, x=x, mach=0.25, frequency=1000.0, liner_start=0.5, liner_end=0.6)
    for call, words in (
        (lambda: two_wave_fit(line.select(range(3))), "3 microphones are used; two waves of one wall need at least 4"),
        (lambda: two_wave_fit(dataclasses.replace(line, source_side="unknown")), "source_side is 'unknown'"),
        (lambda: sort_waves(rigid_line(liner_start=None, liner_end=None)), "does not say where its liner is"),
        (lambda: sort_waves(rigid_line(liner_start=-0.5)), "0 microphones stand before the liner"),
        (lambda: sort_waves(half), "spacing is 1 times half a wavelength"),
    ):
        with pytest.raises(ValueError, match=words):
            call()


def off(line: MicrophoneLine, size: float, seed: int) -> MicrophoneLine:
    random = torch.Generator().manual_seed(seed)
    noise = torch.randn(line.pressure.shape, dtype=torch.complex128, generator=random)
    rms = line.pressure.abs().square().mean(0).sqrt()
    return dataclasses.replace(line, pressure=line.pressure + size * rms * noise)


def test_no_mach_number_is_refused_and_0_says_it(tmp_path, capsys):
    """M = 0 is never assumed: Z 1.93+0.02j would become 0.61+0.99j; what was taken is in JSON."""
    path, unknown = str(tmp_path / "line.h5"), dataclasses.replace(line_of(both_ways()[0]), mach=None)
    for method in (*METHODS.values(), sort_waves):
        with pytest.raises(ValueError, match="microphones states no Mach number"):
            method(dataclasses.replace(unknown, liner_start=0.05, liner_end=1.0))
    unknown.write(path)
    assert tl.read_microphones(path).mach is None
    assert main(["kt", path]) == 2
    assert "line.h5 states no Mach number; give mach=" in capsys.readouterr().err
    for given in ("0.3", "0"):
        assert main(["kt", path, "--mach", given, "--json", "--quiet"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["rows"][0]["mach"] == float(given)
        right = abs(told["rows"][2]["impedance"]["resistance"] - 2.33) < 1e-6
        assert right == (given == "0.3")


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize("share", [0.0, 0.3 + 0.2j])
def test_conjugated_phases_are_noticed(side, share):
    line = line_of(both_ways(side, share=share)[0].conj(), side)
    with pytest.warns(tl.DataWarning) as told:
        found = two_wave_fit(line)
    assert any("phases be of exp(-j omega t)" in str(one.message) for one in told)
    assert [str(one.message) for one in told] == [str(note) for note in found.notes]


def test_intervals_from_the_residual_hold_the_truth():
    """Student's 95 % of R and of X over 40 noisy lines, within what these tell."""
    line, held = line_of(both_ways()[0]), []
    for seed in range(40):
        found = kumaresan_tufts(off(line, 0.005, seed))
        low, high = found.interval()
        held += [(low.real < WALLS.real) & (WALLS.real < high.real), (low.imag < WALLS.imag) & (WALLS.imag < high.imag)]
    assert 0.87 < float(torch.stack(held).double().mean()) < 0.995


@pytest.mark.parametrize("method", METHODS)
def test_linearised_is_the_draws(method):
    """Errors of 0.5 % in Pa: the standard error is the scatter of eductions of drawn lines."""
    line = line_of(both_ways()[0])
    many = torch.stack([off(line, 0.005, seed).pressure for seed in range(200)])
    scatter = METHODS[method](dataclasses.replace(line, pressure=many)).impedance
    found = METHODS[method](off(line, 0.005, 1))
    assert found.freedom == 2 * (12 - {"two-waves": 3}.get(method, 4))
    scaled = found.deviation * 0.005 / (found.residual * (24 / found.freedom) ** 0.5)
    for part in ("real", "imag"):
        wanted = getattr(scatter, part).std(0)
        assert (getattr(scaled, part) / wanted).tolist() == pytest.approx([1.0] * 3, rel=0.2)


@pytest.mark.parametrize(("method", "size"), [("kt", 1.0), ("kt", 1.5), ("kt", 3.0), ("two-waves", 3.0)])
def test_intervals_hold_whatever_the_errors_assumed(method, size):
    """Errors up to three times those assumed: 360 of R and X; 2.4 % is two standard deviations."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        share, found = held_by_draws(method, "upstream", size, 60, 200)
    assert 0.92 < share < 0.985
    level = (
        torch.stack([one.choices["level_error"] * one.error_scale for one in found]).median(0).values
    )  # one line in 60 has no second wave
    if size == 3.0:
        assert (level / (3 * LEVEL_ERROR)).tolist() == pytest.approx([1.0] * 3, rel=0.15)
        assert sum("model-misfit" in {getattr(note, "code", "") for note in one.notes} for one in found) == 60
    if size == 1.0:
        assert sum(bool(one.notes) for one in found) <= 6


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("lines")
    for side in ("upstream", "downstream"):
        line = line_of(both_ways(side)[0], side, title=f"{side} case")
        line.write(tmp_path / f"{side}.h5")
        one = line_of(both_ways(side)[0][:, 2:], side, frequency=1500.0)
        one.write(tmp_path / f"{side}_1500.h5")
    return tmp_path


def test_table_and_files(files, capsys):
    path = str(files / "upstream.h5")
    assert main(["kt", path, "-o", str(files / "rows.csv"), "--quiet"]) == 0
    text = capsys.readouterr().out
    assert "Impedance from microphones: upstream case" in text
    assert "2.330-0.300j" in text
    with (files / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["frequency"]) for row in rows] == FREQUENCY.tolist()
    for row, wall in zip(rows, WALLS.tolist(), strict=True):
        assert complex(float(row["resistance"]), float(row["reactance"])) == pytest.approx(wall)
        assert float(row["deviation_resistance"]) < 1e-12  # nothing is left of an exact line
        assert (float(row["energy_share"]), row["mach"]) == (pytest.approx(1.0), "0.3")


@pytest.mark.parametrize("method", ["kt", "two-waves"])
def test_both_sides_at_once(files, capsys, method):
    names = [str(files / f"{side}.h5") for side in ("upstream", "downstream")]
    arguments = ["--method", method, "--draws", "2", "--json", "--quiet"]
    assert main(["kt", *names, *arguments]) == 0
    first = json.loads(capsys.readouterr().out)
    assert list(dict.fromkeys(row["line"] for row in first["rows"])) == ["upstream case", "downstream case"]
    for row in first["rows"][2::3]:
        assert row["impedance"]["resistance"] == pytest.approx(2.33, abs=1e-6)
        assert 0 < row["deviation"]["resistance"] < 1
        assert row["low"]["resistance"] < row["high"]["resistance"]
        assert first["choices"]["draws"] == 2
    again = []
    for seed in ("0", "0", "1"):
        main(["kt", str(files / "upstream_1500.h5"), *arguments, "--seed", seed])
        again.append(json.loads(capsys.readouterr().out)["rows"])
    assert again[0] == again[1] != again[2]


@pytest.fixture(scope="module")
def solved_files(tmp_path_factory):
    """Lines of a short solved duct, its file beside them, whose far end reflects."""
    folder = tmp_path_factory.mktemp("solved")
    text = duct_text("b2a").replace("start = -0.300", "start = -0.06")
    (folder / "b2a.toml").write_text(text.replace("end = 0.450", "end = 0.21"))
    for side in ("upstream", "downstream"):
        solve = ["duct", "solve", str(folder / "b2a.toml"), "--source-side", side, "--quiet"]
        written = str(folder / f"{side}.h5")
        assert main([*solve, "--end-reflection", "0.1+0.05j", "-o", written]) == 0
    return folder


@pytest.mark.slow
def test_fit_of_the_field(solved_files, capsys):
    names = [str(solved_files / f"{side}.h5") for side in ("upstream", "downstream")]
    arguments = ["kt", *names, "--method", "field", "--duct", str(solved_files / "b2a.toml")]
    assert main([*arguments, "-o", str(solved_files / "rows.csv")]) == 0
    text = capsys.readouterr().out
    assert text.count("2.330-0.300j") == 2
    with (solved_files / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert complex(float(rows[0]["known_resistance"]), float(rows[0]["known_reactance"])) == pytest.approx(2.33 - 0.3j)
    assert float(rows[0]["misfit"]) < 1e-6
    assert 0 < float(rows[0]["deviation_resistance"]) < 0.1
    assert "wavenumber_real" not in rows[0]
    arguments.remove(names[1])
    assert main([*arguments, "--far-end", "stated", "--draws", "2", "--json"]) == 0
    output = capsys.readouterr()
    row = json.loads(output.out)["rows"][0]
    assert row["misfit"] > 10
    assert row["end_reflection"]["real"] == pytest.approx(0.0, abs=1e-12)
    picture = solved_files / "fit.png"
    drawn = ["--draws", "2", "--figure", str(picture)]
    assert main([*arguments, "--start", "2+0.1j", *drawn, "--quiet"]) == 0
    assert "2.330-0.300j" in capsys.readouterr().out
    assert picture.stat().st_size > 15_000


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["{}", "--far-end", "stated"], "--far-end is no option of --method kt"),
        (["{}", "--frequency", "700"], "has no 700 Hz; it holds [600.0, 1000.0, 1500.0] Hz"),
        (["{}", "--method", "two-waves", "--rank", "2"], "--rank is no option of --method two-wav"),
        (["{}", "--source-side", "downstream", "--rank", "1"], "runs away from a source downstream"),
    ],
)
def test_command_refuses(files, capsys, arguments, match):
    line_of(both_ways(share=0.0)[0]).write(files / "pure.h5")
    assert main(["kt", *(word.format(files / "pure.h5") for word in arguments)]) == 2
    assert match in capsys.readouterr().err
