"""Records that go on, against one reading of all of them; torchliner follow: planes that are being written."""

import dataclasses
import gc
import json
import subprocess
import sys
import warnings

import h5py
import numpy as np
import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from hypothesis import given, settings
from hypothesis import strategies as st
from test_cli import run

import torchliner as tl
from torchliner.campaign.follow import MOST, Frames, follow
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import reading_of, take_moments

PROBES, SAMPLES = 4, 2400  # 80 periods
PITCH = 5e-3


@pytest.fixture(scope="module")
def velocity() -> torch.Tensor:
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(SAMPLES))
    return (turbulence((PROBES, SAMPLES), seed=3) + 3 * tone).float()


def piece(velocity, low: int, high: int) -> tl.VelocityPlane:
    x = 2e-3 * torch.arange(PROBES)
    return plane_of(velocity[:, low:high], x=x, liner="polito", start=low / RATE)


class Solver:
    """Does the next of its steps at each look of the follower, in the place of sleep."""

    def __init__(self, *steps) -> None:
        self.steps, self.looks = list(steps), 0

    def __call__(self, _seconds: float) -> None:
        self.looks += 1
        if self.steps:
            self.steps.pop(0)()


def followed(path, *steps, until=None, **choices):
    """Standings at each change, and the moments at the end."""
    how = {"every": 1.0, "idle": 3.0, "sleep": Solver(*steps), "until": until}
    growing, rows = zip(*follow(Frames(path), tl.load_liner("polito"), **how, **choices), strict=True)
    return [each for each in rows if each], growing[-1].moments()


def test_a_plane_that_is_whole_is_its_eduction(tmp_path, velocity):
    piece(velocity, 0, SAMPLES).write(tmp_path / "plane.h5")
    ((row,),), _ = followed(tmp_path / "plane.h5")
    wanted = tl.educe(piece(velocity, 0, SAMPLES), tl.load_liner("polito"), averaging="admittance")
    assert row["impedance"] == pytest.approx(complex(wanted.answer[0]), abs=1e-4)
    low, high = wanted.bounds_of_liner("admittance")
    assert row["half_width"] == pytest.approx(
        max(high.real - low.real, high.imag - low.imag) / 2,
        rel=0.3,  # blocks of other lengths
    )
    assert row["samples"] == SAMPLES
    assert row["needed"] is None


def test_files_that_come_into_a_folder(tmp_path, velocity):
    solver = [lambda i=i: piece(velocity, 600 * i, 600 * i + 600).write(tmp_path / f"v{i}.h5") for i in range(1, 4)]
    solver.insert(1, lambda: (tmp_path / "v2.h5").write_bytes(b"half"))
    piece(velocity, 0, 600).write(tmp_path / "v0.h5")
    found, moments = followed(tmp_path, *solver)
    assert [rows[0]["samples"] for rows in found] == [600, 1200, 1800, 2400]
    whole = tl.GrowingMoments(piece(velocity, 0, SAMPLES), cell_pitch=0.01)
    one, other = (each.sums["admittance"].sum() for each in (moments, whole.moments()))
    assert float(one) == pytest.approx(float(other))
    widths = [rows[0]["half_width"] for rows in found]
    assert widths[-1] < widths[0]


def test_the_time_until_a_wish_goes_as_its_square(tmp_path, velocity):
    """Half the half-width takes four times the record; what is reached ends it."""
    piece(velocity, 0, SAMPLES).write(tmp_path / "plane.h5")
    ((row,),), _ = followed(tmp_path / "plane.h5")
    looks = []
    for until in (row["half_width"] / 2, 1.01 * row["half_width"]):
        solver = Solver()
        *_, (_, (half,)) = follow(
            Frames(tmp_path / "plane.h5"), tl.load_liner("polito"), every=1.0, idle=3.0, until=until, sleep=solver
        )
        looks.append(solver.looks)
        assert half["needed"] == pytest.approx(row["duration"] * (row["half_width"] / until) ** 2)
    assert looks == [3, 0]


WRITER = """
import sys, h5py, numpy as np
path, samples = sys.argv[1], int(sys.argv[2])
v = np.load(path + ".npy")
with h5py.File(path, "w", libver="latest") as file:
    time = file.create_dataset("time", data=np.arange(600) / 42e3, maxshape=(None,), chunks=(256,))
    data = file.create_dataset("wall_normal_velocity", data=v[:600], maxshape=(None, v.shape[1]),
                               chunks=(256, v.shape[1]))
    x = 2e-3 * np.arange(v.shape[1])
    for name, values, unit in (("x", x, "m"), ("frequency", 1400.0, "Hz")):
        file[name] = values
        file[name].attrs["units"] = unit
    time.attrs["units"], data.attrs["units"] = "s", "m/s"
    for axis, name in enumerate(("time", "x")):
        file[name].make_scale(name)
        data.dims[axis].attach_scale(file[name])
    file.swmr_mode = True
    print(flush=True)
    for end in range(1200, samples + 1, 600):
        sys.stdin.readline()
        data.resize(end, axis=0)
        data[end - 600:] = v[end - 600:end]
        data.flush()
        sys.stdin.readline()
        time.resize(end, axis=0)
        time[end - 600:] = np.arange(end - 600, end) / 42e3
        time.flush()
        print(flush=True)
    sys.stdin.readline()
"""


def test_a_file_that_another_process_writes(tmp_path, velocity, request):
    """SWMR: read while it is open, at moments when velocity is ahead of its times as well; no look leaves it open."""
    gc.disable()
    request.addfinalizer(gc.enable)
    path = tmp_path / "plane.h5"
    np.save(f"{path}.npy", velocity.T.numpy())
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), "1800"], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as solver:
        solver.stdout.readline()

        def step(answers: bool):
            def go():
                print(file=solver.stdin, flush=True)
                return solver.stdout.readline() if answers else None

            return go

        found, moments = followed(path, *[step(False), step(True)] * 2)
        print(file=solver.stdin, flush=True)
    assert [rows[0]["samples"] for rows in found] == [600, 1200, 1800]
    whole = tl.GrowingMoments(piece(velocity, 0, 1800), cell_pitch=tl.load_liner("polito").cell_pitch)
    assert torch.equal(moments.sums["admittance"], whole.moments().sums["admittance"])


def test_what_is_wrong_is_told_in_the_end(tmp_path, velocity):
    (tmp_path / "v0.h5").write_bytes(b"half")
    with pytest.raises(OSError, match=r"v0\.h5 begins with b"):
        followed(tmp_path)
    piece(velocity, 0, 600).write(tmp_path / "v1.h5")
    with pytest.raises(OSError, match=r"v0\.h5 begins with b"):
        list(Frames(tmp_path).new())
    frames = Frames(tmp_path / "v1.h5")
    assert sum(each.samples for each in frames.new()) == 600
    piece(velocity, 0, 300).write(tmp_path / "v1.h5")
    with pytest.raises(OSError, match=r"had 600 samples and has 300; it was replaced"):
        list(frames.new())


def test_the_command(capsys, tmp_path, velocity, monkeypatch):
    plane, output = str(tmp_path / "plane.h5"), tmp_path / "m.h5"
    piece(velocity, 0, SAMPLES).write(plane)
    words = ["follow", plane, "--idle", "0.1", "--every", "0.05", "-o", str(output)]
    code, out, err = run(capsys, *words)
    assert (code, err) == (0, "")
    heading, line = out.splitlines()
    assert heading.startswith("samples")
    assert line.split()[0] == str(SAMPLES)
    assert tl.read_moments(output).plane.samples == SAMPLES
    assert run(capsys, *words, "--until", "1e-4")[0] == 1
    code, out, _ = run(capsys, *words, "--until", "9", "--json", "--liner", "polito")
    assert (code, json.loads(out)["samples"]) == (0, SAMPLES)
    output.unlink()

    def stop(_seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setitem(follow.__kwdefaults__, "sleep", stop)
    code, _, err = run(capsys, *words)
    assert (code, err) == (130, "torchliner: interrupted\n")
    assert tl.read_moments(output).plane.samples == SAMPLES
    code, _, err = run(capsys, "follow", plane, "--every", "0")
    assert (code, "--every is 0; it must be finite and above 0" in err) == (2, True)


def test_a_terminated_command_leaves_its_moments(tmp_path, velocity):
    """SIGTERM, which batch systems send, is as good as Ctrl-C; and what the file does not say is stated."""
    with h5py.File(tmp_path / "plane.h5", "w") as file:
        file["w"] = velocity.T.numpy()
    words = "--variable w --axes time,x --velocity-units m/s --length-units mm --sampling-rate 42e3 --idle 99"
    words += f" --x {tmp_path}/x.npy --liner polito --frequency 1400 -o {tmp_path}/m.h5"
    np.save(tmp_path / "x.npy", 2.0 * np.arange(PROBES))
    command = [sys.executable, "-m", "torchliner", "follow", str(tmp_path / "plane.h5"), *words.split()]
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout.readline().startswith("samples")
        assert child.stdout.readline().startswith(str(SAMPLES))
        child.terminate()
        assert child.stderr.read() == "torchliner: interrupted\n"
    assert child.returncode == 130
    found = tl.read_moments(tmp_path / "m.h5").plane
    assert found.samples == SAMPLES
    assert found.x.tolist() == pytest.approx([0, 2e-3, 4e-3, 6e-3])


BEGUN = {
    "words": b"one\ntwo\nthree\n",
    "empty": b"",
    "no header yet": bytes(3000),
    "half": b"\x89HDF\r\n\x1a\n" + bytes(40),
    "heading": b"# Probe 0 (0 0 0)\n# Time\n",
    "one time": {"wall_normal_velocity": ("m/s", [[1.0, 2.0]]), "time": ("s", [0.0])},
    "no plane": {"a": ("kg", [1.0, 2.0])},
}


@pytest.mark.parametrize("name", BEGUN)
def test_what_may_become_a_plane_is_waited_for(tmp_path, name):
    path, sleep = tmp_path / "plane.h5", Solver()
    if isinstance(content := BEGUN[name], bytes):
        path.write_bytes(content)
    else:
        with h5py.File(path, "w") as file:
            for key, (unit, values) in content.items():
                file[key] = values
                file[key].attrs["units"] = unit
    with pytest.raises((OSError, ValueError), match=r"plane.h5"):
        list(follow(Frames(path), tl.load_liner("polito"), every=1.0, idle=3.0, sleep=sleep))
    assert sleep.looks == 3


def test_what_is_there_twice_counts_once(tmp_path, velocity):
    piece(velocity, 0, 1000).write(tmp_path / "v9.h5")
    piece(velocity, 980, 1800).write(tmp_path / "v10.h5")
    frames = Frames(tmp_path)
    with pytest.warns(tl.DataWarning, match="20 samples of .*v10.h5.* count once"):
        found = torch.cat([each.velocity for each in frames.new()], dim=-1)
    assert torch.equal(found, velocity[:, :1800])


# Moments of a record that goes on


def growing_record(samples: int, low: int = 0, rate: float = 42000.0, **about) -> tl.VelocityPlane:
    v = turbulence((PROBES, 9000), seed=2)[:, low : low + samples]
    return plane_of(v, sampling_rate=rate, x=2e-3 * torch.arange(PROBES), **about)


def at_once(plane: tl.VelocityPlane, known: tl.Moments, **choices) -> tl.Moments:
    """One reading with the same borders."""
    frequency = torch.tensor([1400.0], dtype=torch.float64)
    chosen = Choices(**choices, allow_short=True)
    reading = reading_of(plane, [], frequency, chosen, cell_pitch=PITCH, nodes=known.nodes)
    return take_moments(dataclasses.replace(reading, blocks=known.survey.blocks), reviewed=False)


@settings(max_examples=20)
@given(
    st.integers(1, 500),
    st.lists(st.integers(1, 3000), max_size=8),
    st.sampled_from([42000.0, 41234.5]),
    st.sampled_from(["averaged", "self-consistent"]),
)
def test_moments_are_those_of_one_reading(first, pieces, rate, phase):
    choices = {"averaging": "velocity", "phase": phase}
    growing = tl.GrowingMoments(growing_record(first, rate=rate), cell_pitch=PITCH, **choices)
    held = first
    for piece in pieces:
        piece = min(piece, 9000 - held)
        if piece:
            growing.update(growing_record(piece, held, rate).velocity)
        held += piece
    assert growing.periods == int((held + 0.5) * 1400 / rate) // growing.each * growing.each
    if not growing.periods:
        return
    found = growing.moments()
    assert 1 <= found.survey.blocks.count < MOST
    assert found.plane.samples == found.survey.blocks.borders[-1] <= held
    wanted = at_once(growing_record(held, rate=rate), found, **choices)
    assert found.sums.keys() == wanted.sums.keys()
    for name in found.sums:
        torch.testing.assert_close(found.sums[name], wanted.sums[name], rtol=1e-12, atol=1e-12)
    for name in ("sums", "squares", "peaks", "gram"):
        mine, theirs = getattr(found.survey, name), getattr(wanted.survey, name)
        torch.testing.assert_close(mine, theirs, rtol=1e-12, atol=1e-12)


def test_a_standing_is_left_alone_by_what_comes_later(liner):
    growing = tl.GrowingMoments(growing_record(2400), cell_pitch=liner.cell_pitch, averaging="velocity")
    then = growing.moments()
    before = then.educe(liner, averaging="velocity").answer
    growing.update(growing_record(6000, 2400).velocity)
    assert torch.equal(then.educe(liner, averaging="velocity").answer, before)
    wanted = tl.educe(growing_record(growing.moments().plane.samples), liner, averaging="velocity")
    assert float((growing.educe(liner).answer - wanted.answer).abs().max()) < 1e-6
    assert growing.educe(liner).averaging == "velocity"


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"averaging": "phase-locked"}, "needs the whole record; take 'admittance' or 'velocity'"),
        ({"mean": "removed"}, "has mean 'kept' alone"),
        ({"drive": "rms"}, "has drive 'instantaneous' alone"),
        ({"missing": "exclude"}, "has missing 'refuse' alone"),
    ],
)
def test_what_needs_the_whole_record_is_refused(choices, words):
    with pytest.raises(ValueError, match=words):
        tl.GrowingMoments(growing_record(600), cell_pitch=PITCH, **choices)


def test_samples_that_do_not_fit_are_refused():
    growing = tl.GrowingMoments(growing_record(20), cell_pitch=PITCH)
    with pytest.raises(ValueError, match="holds 20 samples; a period has 30"):
        growing.moments()
    bad = growing_record(30, 20).velocity.clone()
    bad[2, 5] = torch.nan
    with pytest.raises(ValueError, match="1 of 4 probes hold nan or inf, the first is probe 2"):
        growing.update(bad)
    with pytest.raises(ValueError, match=r"shape \(3, 9\); they are of probes \(4,\), time last"):
        growing.update(torch.zeros(3, 9))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        growing.update(growing_record(30, 20).velocity)
    assert growing.periods == 1
