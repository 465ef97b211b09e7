"""How much of |v| is the tone's own doing, and what that means at other frequencies."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.prepared import Prepared

PHASES = 64  # of the tone, and equally likely values of the turbulence
LARGEST_CHANGE = 0.05  # of Z by the tone's part, relative to |Z|, that goes without a note


def tone_velocities(prepared: Prepared) -> tuple[float, float, float] | None:
    """Mean, rms of what is periodic with the tone, and rms of the rest of v*, m/s, over all cells.

    None unless the plane states its tone and v was taken apart (``coherent first``).
    """
    part, cells = prepared.periodic, prepared.cells
    if part is None or prepared.plane.frequency is None or not len(part.harmonics.lines):
        return None
    kept = prepared.in_cells
    of_cells = cells.average(part.fit, kept, -1)
    periodic = (of_cells * (part.gram @ of_cells)).sum(0) / part.samples - of_cells[0] ** 2
    probes = slice(0, prepared.plane.probes)
    own = (part.fit * part.sums).sum(0) / part.samples
    rest = (prepared.survey.mean_square[probes] - own).clamp(min=0) * part.scale**2
    return (
        float(of_cells[0].mean()),
        float(periodic.clamp(min=0).mean().sqrt()),
        float(rest[kept.to(rest.device)].mean().sqrt()),
    )


def tone_share(prepared: Prepared) -> float | None:
    """Share of the variance of v* that is periodic with the tone of the data, 0 to 1."""
    known = tone_velocities(prepared)
    if known is None:
        return None
    _, periodic, rest = known
    return periodic**2 / max(periodic**2 + rest**2, 1e-300)


def with_and_without(prepared: Prepared) -> tuple[Tensor, Tensor]:
    """Z, (F,), of a sine as strong as the tone's part plus Gaussian turbulence as strong as the
    rest, and of that turbulence alone."""
    known, reader = tone_velocities(prepared), prepared.reader
    assert known is not None and reader is not None  # noqa: PT018
    mean, periodic, rest = known
    middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
    turbulent = mean + rest * 2**0.5 * torch.erfinv(2 * middle - 1)
    tonal = periodic * 2**0.5 * torch.cos(2 * torch.pi * middle)
    window = next(i for i, (line, _) in enumerate(reader.window) if line == 0)
    own = reader.coefficients[:, window].detach().to("cpu", torch.complex128)

    def impedance(velocity: Tensor) -> Tensor:
        speed = velocity.abs().flatten().clamp(max=prepared.top_speed)
        functions = reader.basis.functions(speed).to("cpu", torch.complex128)
        return impedance_from_reflection(own @ functions.mean(0))

    return impedance(turbulent[:, None] + tonal), impedance(turbulent)


def review_other_tones(prepared: Prepared) -> list[str]:
    """Where |v| is the tone's own, Z at other frequencies is not that of a tone sent alone."""
    plane, frequency, share = prepared.plane, prepared.frequency, tone_share(prepared)
    if share is None or prepared.reader is None or prepared.chosen.drive != "instantaneous":
        return []
    assert plane.frequency is not None
    other = (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY
    if not bool(other.any()) or phase_rule(prepared.chosen.phase).several_tones:
        return []
    beside, alone = with_and_without(prepared)
    change = torch.where(other, ((alone - beside) / beside).abs(), 0)
    worst = int(change.argmax())
    if float(change[worst]) <= LARGEST_CHANGE:
        return []
    asked = [f"{float(f):g}" for f in (frequency[other].min(), frequency[other].max())]
    _, periodic, rest = tone_velocities(prepared) or (0.0, 0.0, 0.0)
    return [
        f"{plane.name}: v is {100 * share:.3g} % (of its variance) in step with the tone of "
        f"{plane.frequency:g} Hz ({periodic:.3g} m/s rms, the rest {rest:.3g}), so |v| is partly "
        "that tone's own: "
        f"at {' to '.join(dict.fromkeys(asked))} Hz Z is that of a weak second tone beside this "
        f"one, not of a tone sent alone. Without this one it would be about {_text(alone[worst])} "
        f"instead of {_text(beside[worst])} at {float(frequency[worst]):g} Hz (sine and Gaussian "
        f"turbulence of these rms; note above {100 * LARGEST_CHANGE:g} %)"
    ]


def _text(z: Tensor) -> str:
    value = complex(z)
    return f"{value.real:.2f}{value.imag:+.2f}j"
