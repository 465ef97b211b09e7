"""Derivatives of the educed reflection in every parameter of a liner."""

from __future__ import annotations

import pytest
import torch
from conftest import FREQUENCY, PARAMETERS, RATE, plane_of, turbulence
from torch.autograd import forward_ad

import torchliner as tl
from torchliner.least_squares import dual_level

pytestmark = [
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]


def make(name=None, value=None):
    given = {**PARAMETERS, **({} if name is None else {name: value})}
    return tl.SDoFLiner(**given, velocity_reading="conserved")


def reflection(liner, frequencies=(FREQUENCY,), **options):
    tone = 3 * torch.cos(2 * torch.pi * FREQUENCY / RATE * torch.arange(300))
    plane = plane_of(turbulence((4, 300), seed=2) + tone)
    if options.get("phase") == "given":
        options["reference_phase"] = 0.3
    return tl.educe(plane, liner, list(frequencies), **options).probes["admittance"].reflection


@pytest.mark.parametrize("phase", ["averaged", "given", "self-consistent"])
def test_backward_is_forward(phase):
    """Reverse differentiation of one probe is its row of the forward derivative."""
    value = torch.tensor(0.78, dtype=torch.float64, requires_grad=True)
    found = reflection(make("vena_contracta", value), (1400, 2100), phase=phase)
    backward = torch.stack(
        [
            torch.autograd.grad(part.flatten()[i], value, retain_graph=True)[0]
            for part in (found.real, found.imag)
            for i in range(8)
        ]
    )
    with dual_level():
        dual = forward_ad.make_dual(value.detach(), torch.ones_like(value))
        again = reflection(make("vena_contracta", dual), (1400, 2100), phase=phase)
        slope = forward_ad.unpack_dual(again).tangent
    wanted = torch.cat([slope.real.flatten(), slope.imag.flatten()])
    assert float((backward - wanted).abs().max()) < 1e-9 * float(wanted.abs().max())


def test_second_derivative():
    """Smooth enough for Newton's method."""
    value = torch.tensor(0.78, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradgradcheck(
        lambda c: torch.view_as_real(reflection(make("vena_contracta", c))).sum(), value
    )


def test_moments_refuse_to_lose_the_derivative_in_the_velocity():
    """Of the default engine; without derivatives it is as good as any other."""
    plane = plane_of(turbulence((2, 300), seed=2).requires_grad_())
    for read in (lambda: tl.educe(plane, make()), lambda: tl.moments(plane)):
        with pytest.raises(ValueError, match=r"carries a gradient.*replay"):
            read()
        with torch.no_grad():
            read()
