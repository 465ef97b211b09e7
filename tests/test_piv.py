"""Time-resolved particle images: uniform in time, so they go through planes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.io import savemat

import torchliner as tl
from torchliner.cli.main import main

RATE, FREQUENCY = 20e3, 1000.0


@pytest.fixture
def images(tmp_path):
    """[nY, nX, nT] as PIV software exports it: y runs downward, mm, mm/s would be wrong: m/s."""
    times = np.arange(400) / RATE
    heights, places = np.array([2.5, 1.75, 1.0]), np.linspace(0, 18, 10)
    shape = np.exp(-heights)[:, None, None] * (1 + 0.1 * np.cos(places))[:, None]
    velocity = (3 * shape * np.cos(2 * np.pi * FREQUENCY * times)).astype(np.float32)
    path = tmp_path / "piv.mat"
    savemat(path, {"VY": velocity, "X_unique": places, "Y_unique": heights})
    return path, velocity


WORDS = (
    "--variable VY --axes y,x,time --velocity-units m/s --sampling-rate 2e4 --length-units mm --frequency 1000"
).split()


def test_a_mat_file_of_images_gives_a_map(images, tmp_path, capsys):
    """convert picks a height, educe does the rest; by hand the same."""
    path, velocity = images
    plane, out = tmp_path / "plane.h5", tmp_path / "map.h5"
    assert main(["convert", str(path), *WORDS, "--row", "2", "-o", str(plane)]) == 0
    known = tl.read_plane(plane)
    assert known.height == pytest.approx(1.0e-3)
    assert known.x.tolist() == pytest.approx(np.linspace(0, 0.018, 10).tolist())
    assert torch.equal(known.velocity, torch.from_numpy(velocity[2]))
    words = ["educe", str(plane), "--liner", "onera", "-o", str(out), "--quiet", "--interval", "none"]
    assert main(words) == 0
    by_hand = tl.VelocityPlane(velocity[2], sampling_rate=RATE, frequency=FREQUENCY, x=known.x)
    wanted = tl.educe(by_hand, tl.load_liner("onera"), interval=None)
    assert float((tl.read_map(out).impedance - wanted.impedance).abs().max()) < 1e-12
