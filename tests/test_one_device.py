"""The complete eduction on ``meta`` tensors: no operation on two devices, nothing read back before Z, few launches."""

from typing import Any

import pytest
import torch
from one_device import OneDevice
from torch import Tensor

import torchliner as tl
from torchliner.velocity.averages import average
from torchliner.velocity.choices import COMPUTED, Choices
from torchliner.velocity.reading import reading_of, take_moments

PROBES, SAMPLES = 27400, 2280  # the paper's plane
MOST_UPLOADS, MOST_LAUNCHES = 20, 2500
CHOICES: list[dict[str, Any]] = [
    {},
    {"averaging": "velocity"},
    {"averaging": "admittance"},
    {"phase": "self-consistent"},
    {"phase": "given"},
    {"mean": "removed"},
    {"drive": "running-rms"},
    {"background": 1.0},
    {"wall_filter": 0.2},
    {"interval": None},
]


class Shapes:
    """A velocity that has a shape and no numbers."""

    shape, dtype = (PROBES, SAMPLES), torch.float32

    def read(self, begin: int, end: int, out: Tensor | None = None) -> Tensor:
        return torch.empty(end - begin, PROBES, device="meta")

    def load(self) -> Tensor:
        raise NotImplementedError


def educed_on_meta(frequency: list[float], **choices: Any) -> OneDevice:
    liner, asked = tl.load_liner("polito"), torch.tensor(frequency, dtype=torch.float64)
    x = (torch.arange(PROBES) + 0.5) * liner.cell_pitch / 25
    plane = tl.VelocityPlane(Shapes(), sampling_rate=200e3, frequency=1400.0, x=x)
    chosen = Choices(device="meta", **choices)
    reading = reading_of(plane, [liner], asked, chosen, projected=True)
    phase = 0.3 if chosen.phase == "given" else None
    with OneDevice() as mode, torch.no_grad():
        known = take_moments(reading, reviewed=False)
        found = {name: average(known, liner, asked, chosen, name, phase) for name in COMPUTED[chosen.averaging]}
    assert {each.liner.reflection.device.type for each in found.values()} == {"meta"}
    return mode


@pytest.mark.parametrize("choices", CHOICES, ids=str)
def test_work_stays_on_the_device(choices: dict[str, Any]) -> None:
    educed_on_meta([1400.0], **choices)


def test_the_default_takes_few_launches_and_uploads() -> None:
    mode = educed_on_meta([1400.0])
    assert mode.uploads <= MOST_UPLOADS
    assert sum(mode.launches.values()) <= MOST_LAUNCHES


def test_several_frequencies_take_no_more_launches_than_one() -> None:
    one, three = (educed_on_meta(asked, phase="self-consistent") for asked in ([1400.0], [1120.0, 1400.0, 1820.0]))
    assert three.uploads <= MOST_UPLOADS
    assert sum(three.launches.values()) <= 1.02 * sum(one.launches.values())


def test_the_mode_sees_what_it_is_for() -> None:
    there, here = torch.empty(3, device="meta"), torch.ones(3)
    with OneDevice(), pytest.raises(RuntimeError, match="joins"):
        torch.add(there, here)
    with OneDevice(), pytest.raises(RuntimeError, match="reads"):
        there.nonzero()
    with OneDevice(), pytest.raises(RuntimeError, match="copies"):
        there.to("cpu")
    with OneDevice() as mode:
        here.to("meta")
    assert mode.uploads == 1
