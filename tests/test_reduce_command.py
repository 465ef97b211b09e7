"""torchliner reduce, and the commands that take what it wrote."""

from __future__ import annotations

import json

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from test_cli import run

import torchliner as tl

CASE = ["--quiet", "--json"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A plane and its moments."""
    folder = tmp_path_factory.mktemp("reduce")
    tone = torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(1200))
    v = (turbulence((6, 1200)) + 4 * tone).float()
    about = {"x": 2e-3 * torch.arange(6.0), "reference": {"true": 1 - 0.5j}, "liner": "polito"}
    plane_of(v, **about).write(folder / "plane.h5")
    tl.moments(tl.read_plane(folder / "plane.h5"), cell_pitch=tl.load_liner("polito").cell_pitch).write(
        folder / "moments.h5"
    )
    return folder


def test_what_is_written_and_said(capsys, files, tmp_path):
    """Size against the data, K, c, the error for any liner and for the one named."""
    code, out, _ = run(capsys, "reduce", f"{files}/plane.h5", "-o", f"{tmp_path}/m.h5", "--quiet")
    assert code == 0
    for text in ("MB, the velocity 0.0288 MB", "6 probes, cells: 1 of 12.44 mm", "1200 samples",
                 "K = 64 functions of |v|, c = 1.5 m/s: good for any liner smooth in |v|",
                 "for polito at 300 to 6000 Hz"):  # fmt: skip
        assert text in out
    one, other = (tl.read_moments(folder / name).sums["phase-locked"]
                  for folder, name in ((files, "moments.h5"), (tmp_path, "m.h5")))  # fmt: skip
    assert torch.equal(one, other)


def test_for_one_liner(capsys, files, tmp_path):
    """K and c of a liner that is named, whose error is that at the tone."""
    words = ["reduce", f"{files}/plane.h5", "-o", f"{tmp_path}/m.h5", *CASE]
    code, out, _ = run(capsys, *words, "--liner", "polito", "--averaging", "admittance")
    found = json.loads(out)
    assert code == 0
    assert found["functions"] < 40
    assert 0 < found["error_in_R"] < 2e-6
    assert not found["any_liner"]
    code, out, _ = run(capsys, *words, "--cell-pitch", "0.004")
    found = json.loads(out)
    assert (found["cell_pitch"], found["cells"]) == (0.004, 2)
    assert found["bytes"] > tl.read_moments(tmp_path / "m.h5").size


@pytest.mark.parametrize(
    "words",
    [
        ["educe"],
        ["educe", "--averaging", "velocity", "--no-intervals"],
        ["educe", "--incident-level", "131"],
        ["sensitivity", "--averaging", "phase-locked"],
        ["sensitivity"],
        ["calibrate", "--free", "porosity", "--draws", "0"],
    ],
    ids=" ".join,
)
def test_moments_stand_for_a_plane(capsys, files, words):
    """The answer of each command, from moments of any liner: as from the plane, to their error."""
    found = []
    for name in ("plane.h5", "moments.h5"):
        code, out, _ = run(capsys, words[0], f"{files}/{name}", *words[1:], *CASE)
        assert code in (0, 1)
        found.append(json.loads(out.replace(f"{files}/{name}", "").replace(":/wall_normal_velocity", "")))
    one, other = (list(numbers(each)) for each in found)
    assert len(one) == len(other) > 5
    for mine, theirs in zip(one, other, strict=True):
        assert theirs == pytest.approx(mine, rel=1e-3, abs=1e-4)


def numbers(value):
    """All numbers of an answer, in order, but for errors of interpolation and sizes of files."""
    if isinstance(value, dict):
        for key, each in value.items():
            if not any(
                word in key for word in ("error", "nodes", "inputs", "phase_locked", "tone_share", "incoherent")
            ):
                yield from numbers(each)
    elif isinstance(value, list):
        for each in value:
            yield from numbers(each)
    elif isinstance(value, (int, float)):
        yield value


def test_info_of_moments(capsys, files):
    """What is left of the plane, and what the moments are."""
    code, out, _ = run(capsys, "info", f"{files}/moments.h5")
    assert code == 0
    for text in ("samples                            1200", "reduced with averaging", "phase-locked",
                 "functions of |v|                   64", "largest |v| (m/s)"):  # fmt: skip
        assert text in out
    code, _, err = run(capsys, "info", f"{files}/moments.h5", "--figure", f"{files}/v.png")
    assert code == 2
    assert "time samples are gone" in err


def test_pictures_without_velocity(capsys, files, tmp_path, unrendered):
    """All but those of the velocity."""
    run(capsys, "educe", f"{files}/moments.h5", "--figure", f"{tmp_path}/p", "--quiet")
    made = {path.name for path in (tmp_path / "p").iterdir()}
    assert {"along_x.png", "along_x_moments.csv"} <= made
    assert not any("velocity" in name for name in made)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["reduce", "{plane}"], "required"),
        (["reduce", "{plane}", "-o", "{plane}"], "is an input; name another file"),
        (["reduce", "{plane}", "-o", "m.csv"], "must be one of .h5"),
        (["reduce", "nowhere.h5", "-o", "m.h5"], "no such file"),
        (["reduce", "{plane}", "-o", "{folder}/m.h5", "--averagin", "x"], "did you mean '--averaging'"),
        (["reduce", "{plane}", "-o", "{folder}/m.h5", "--liner", "polito", "--cell-pitch", "0.01"],
         "name it only where no liner is given"),
        (["reduce", "{moments}", "-o", "{folder}/m.h5"], "name the plane file that was reduced"),
        (["validate", "{moments}"], "moments.h5 holds moments"),
        (["educe", "{moments}", "--liner", "lbm_slit"], "cells of 12.44 mm"),
        (["educe", "{moments}", "--phase", "self-consistent"], "choose --phase averaged"),
        (["replay", "{moments}"], "time samples are gone, which this needs"),
        (["educe", "{moments}", "--drive", "rms"], "choose --drive instantaneous"),
        (["educe", "{moments}", "--background", "1"], "leave background out, or reduce"),
        (["reduce", "{plane}", "-o", "{folder}/m.h5", "--interval", "0.9"], "--interval"),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "",
)  # fmt: skip
def test_bad_input_is_refused(capsys, files, words, message):
    """Exit code 2 and a line that says what to do."""
    names = {"plane": files / "plane.h5", "moments": files / "moments.h5", "folder": files}
    code, _, err = run(capsys, *(word.format(**names) for word in words))
    assert code == 2
    assert message in err
    assert not (files / "m.h5").exists()


def test_an_interrupt_leaves_nothing(capsys, files, tmp_path, monkeypatch):
    """Ctrl-C: exit code 130, no file, no part of one."""

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("torchliner.io.moments_file.write_variables", stop)
    code, _, err = run(capsys, "reduce", f"{files}/plane.h5", "-o", f"{tmp_path}/m.h5")
    assert (code, err.splitlines()[-1]) == (130, "torchliner: interrupted")
    assert not list(tmp_path.iterdir())
