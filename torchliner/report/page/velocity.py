"""Statistics of the velocity, and the distribution of |v| where data or moments are given."""

from __future__ import annotations

import math

import numpy as np

from torchliner.records import ImpedanceMap
from torchliner.report.figure import (
    COLOURS,
    ONE_ROW,
    draw_curve,
    finish,
    label_axes,
    panels_of,
    styled,
    subplots,
)
from torchliner.report.figure import Figure as Drawing
from torchliner.report.numbers import Curves, over_z
from torchliner.report.page.blocks import Block, Facts, Figure, Text
from torchliner.report.page.speeds import Speeds, speeds_of
from torchliner.report.page.subject import MapSubject, at_probes
from torchliner.report.typesetting import typeset

BINS = 60
MEAN, RMS = "v0 (m/s)", "v' rms (m/s)"
LABELS = {MEAN: "$v_0$ (m s$^{-1}$)", RMS: "$v'_{rms}$ (m s$^{-1}$)"}


def velocity(subject: MapSubject) -> list[Block]:
    """Mean and rms of v over the probes; its amplitude at the tone; |v|."""
    result, index = subject.result, subject.main
    mean, rms = at_probes(result.mean_velocity), at_probes(result.velocity_rms)
    if not len(rms):
        return [Text("No probe has a velocity that is a number.")]
    whole = float(rms.square().mean().sqrt())
    facts = [
        ("mean of v, away from the liner", _spread(mean)), ("rms about the mean", _spread(rms)),
        ("rms over all probes", f"{whole:.4g} m/s"),
    ]  # fmt: skip
    tone = at_probes(result.velocity_amplitude[..., index].abs())
    coherence = at_probes(result.coherence[..., index])
    if len(tone):
        facts.append(("peak amplitude at the tone", _spread(tone)))
    if len(coherence):
        facts.append(("squared coherence with the tone, median", f"{float(coherence.median()):.3f}"))
    thinned, _ = subject.thinned
    blocks: list[Block] = [Facts([(name, typeset(text)) for name, text in facts])]
    if len(rms) > 1:
        curves = _along_x(thinned)
        alt = (
            f"Two curves along x: mean velocity from {float(mean.min()):.3g} to "
            f"{float(mean.max()):.3g} m/s; rms from {float(rms.min()):.3g} to "
            f"{float(rms.max()):.3g} m/s, {whole:.3g} m/s over all probes."
        )
        caption = (
            "Time mean v0 of the wall-normal velocity, positive away from the liner, and rms v′ of "
            "the rest along x; over z the squares of v′ are averaged."
        )
        blocks.append(Figure("velocity", _draw_along_x(curves), typeset(alt), caption, curves.table))
    return [*blocks, *_distribution(subject)]


def _spread(values: object) -> str:
    low, middle, high = (float(getattr(values, name)()) for name in ("min", "median", "max"))
    return f"{middle:.4g} m/s (median), {low:.4g} to {high:.4g} m/s over the probes"


def _along_x(result: ImpedanceMap) -> Curves:
    x, mean = over_z(result.x, result.mean_velocity.double())
    _, square = over_z(result.x, result.velocity_rms.double().square())
    return Curves(x, {MEAN: mean.numpy(), RMS: square.sqrt().numpy()}, "")


@styled
def _draw_along_x(curves: Curves) -> Drawing:
    figure, panels = panels_of(2, 2.6)
    for axis, name in zip(panels, LABELS, strict=True):
        draw_curve(axis, curves, name, COLOURS[0], 1e3)
        label_axes(axis, "$x$ (mm)", LABELS[name])
    panels[1].set_ylim(bottom=0)
    return finish(figure, None)


def _distribution(subject: MapSubject) -> list[Block]:
    if subject.known is None:
        return [Text(
            "The distribution of |v| is not in a map; the report draws it where the data or their "
            "moments are given (--data, or data= in Python)."
        )]  # fmt: skip
    speeds = speeds_of(subject.known)
    if speeds is None or not math.isfinite(float(speeds.moments.sum())):
        return [Text(
            "The moments are of the levels of a tabulated liner, from which no distribution of |v| "
            "follows: reduce the data without a liner (torchliner reduce)."
        )]  # fmt: skip
    middle, most = speeds.quantile(0.5), speeds.quantile(0.99)
    curves = _histogram(speeds)
    alt = (
        f"Density of |v| over all probes and samples: median {middle:.3g} m/s, 99 % below "
        f"{most:.3g} m/s, largest {speeds.top:.3g} m/s; a half-normal curve of the same rms, "
        f"{math.sqrt(speeds.mean_square):.3g} m/s, beside it."
    )
    drive = subject.known.settings.get("drive", "instantaneous")
    caption = (
        f"Probability density of the |v| that drives the liner ({drive}), over all probes and "
        f"samples, from {len(speeds.moments)} moments: median {middle:.3g} m/s, 99 % below "
        f"{most:.3g} m/s, largest {speeds.top:.3g} m/s. Smoothed over about "
        f"{speeds.resolution(middle):.2g} m/s at the median. Dashed: half-normal of the same rms, "
        "which Gaussian turbulence without a mean has."
    )
    return [Figure("speeds", _draw_speeds(curves), alt, caption, curves.table)]


def _histogram(speeds: Speeds) -> Curves:
    edges, density = speeds.density(BINS)
    middle = ((edges[1:] + edges[:-1]) / 2).numpy()
    rms = math.sqrt(speeds.mean_square)
    normal = math.sqrt(2 / math.pi) / rms * np.exp(-0.5 * (middle / rms) ** 2)
    values = {"density (s/m)": density.numpy(), "half-normal of the same rms (s/m)": normal}
    return Curves(middle, values, "", "speed |v| (m/s)")


@styled
def _draw_speeds(curves: Curves) -> Drawing:
    figure, axes = subplots(1, 1, 2.8)
    axis = axes[0, 0]
    density, normal = curves.values.values()
    axis.fill_between(curves.at, density, step="mid", color=COLOURS[0], alpha=0.3, linewidth=0)
    axis.step(curves.at, density, where="mid", color=COLOURS[0], label="|v|")
    axis.plot(curves.at, normal, "--", color="k", linewidth=0.9, label="half-normal, same rms")
    axis.set_xlim(0, curves.at[-1])
    axis.set_ylim(bottom=0)
    label_axes(axis, "$|v|$ (m s$^{-1}$)", "density (s m$^{-1}$)")
    return finish(figure, None, legend=ONE_ROW)
