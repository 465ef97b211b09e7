"""Warnings about data, liner and answer, with numbers: refusals raise, the rest becomes notes of the map."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, SMALLEST_WIDTH
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Levels, interpolation_error
from torchliner.fluid import gas_warnings
from torchliner.liners.model import LinerModel
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.educed import Educed
from torchliner.records.notes import Note, plane_notes
from torchliner.velocity.averages import Averages, survey_of_columns
from torchliner.velocity.choices import Choices

FEWEST_SAMPLES_PER_PERIOD = 8.0
LONG_CELL = 0.125  # wavelengths: over a cell as long the tone turns by 45 degrees
DOUBTFUL_MEAN, LARGEST_MEAN = 3.0, 10.0  # |mean| over rms of v, half of the probes beyond: noted, refused
LARGEST_MODEL_ERROR, DOUBTFUL_MODEL_ERROR = 1e-3, 1e-5  # in R, of the model table: refused, noted
NEAR = (0.45, 0.55)  # hole diameters that count as half of one, the height at which a quiet run's rms acts


def review_case(plane: VelocityPlane, liner: LinerModel, frequency: Tensor) -> Iterator[Note]:
    """Null tests, units, the sampling rate against the frequencies asked for; whether liner and data state the same
    gas, flow and lengths, and whether flow would count twice."""
    name, lowest, highest = plane.name, float(frequency.min()), float(frequency.max())
    if plane.liner == "hard wall":
        text = "there is a hard wall below and no liner: the values only show what this model makes of such a velocity"
        yield Note("null-test", f"null test: {name}: {text}")
    yield from plane_notes(plane, lowest, liner.cell_pitch)
    if (steps := plane.sampling_rate / highest) < FEWEST_SAMPLES_PER_PERIOD:
        text = f"{steps:.3g} samples per period of {highest:g} Hz, fewer than {FEWEST_SAMPLES_PER_PERIOD:g}"
        yield Note("coarse-sampling", f"{name} has {text}: the corners of |v| are not resolved")
    if liner.flow_resistance > 0:
        text = (
            f"the law of liner {liner.describe().get('name', '')!r} adds {liner.flow_resistance:.3g} rho c of "
            f"resistance for grazing flow, but |v| as measured in {name} holds the turbulence already (Roncen et "
            "al. 2026, section 2.4), so flow would count twice; set the law's mach to 0"
        )
        yield Note("flow-counted-twice", text, liner.flow_resistance)
    if liner.lacks_mach and plane.mach is None:
        text = f"neither the liner nor {name} states a Mach number, on which the liner's law depends; 0 is taken"
        yield Note("no-mach", f"{text}: state mach of the data (--mach), 0 where there is no flow")
    if liner.fluid is not None:
        yield from (Note("gas", text) for text in gas_warnings(liner.fluid, plane.fluid, name))


def review_reading(
    plane: VelocityPlane,
    cell_pitch: float | None,
    frequency: Tensor,
    blocks: Blocks,
    chosen: Choices,
    liner: LinerModel | None,
) -> Iterator[Note]:
    """What is known to be doubtful before any sample is read: no tone, one cell of all, a short record, a background
    of another height."""
    locked, quiet, name = chosen.averaging == "phase-locked", chosen.background, plane.name
    if locked and plane.frequency is None and len(frequency) > 1:
        text = f"{name} states no tone, and {len(frequency)} frequencies are asked for: of v only the mean is averaged"
        yield Note("no-stated-tone", f"{text} over the cells; state frequency= of the data")
    if locked and cell_pitch is None and plane.x is not None:
        length, wave = float(plane.x.max() - plane.x.min()), float(plane.fluid.sound_speed) / float(frequency.max())
        if length > LONG_CELL * wave:
            text = f"all of {1e3 * length:.3g} mm counts as one cell, {length / wave:.2g} wavelengths, over which the"
            text += " phase of the tone turns; state cell_pitch, or choose averaging='admittance'"
            yield Note("no-cell-pitch", f"{name}: the liner states no cell_pitch, so that {text}")
    if chosen.interval is not None and blocks.count < FEWEST_BLOCKS:
        text = f"no error bars, since the record holds {blocks.periods} whole periods of the tone"
        least = f"{FEWEST_BLOCKS} are the least, and 16 periods give a fair interval"
        yield Note("no-intervals", f"{name}: {text}; {least}")
    diameter = None if liner is None else liner.hole_diameter
    if quiet is None or not quiet.source or quiet.height is None or not diameter:
        return
    if not NEAR[0] <= (share := quiet.height / diameter) <= NEAR[1]:
        text = (
            f"the rms without sound is that at {1e3 * quiet.height:.3g} mm, {share:.2g} hole diameters. It acts at "
            f"half a diameter, {500 * diameter:.3g} mm: in resolved cases R was off by -47 and -38 % at 0.25 "
            "diameters, by -12 to -5 % at 0.41, by +21 and +42 % at 0.7. Give planes on either side of it, between "
            "which the rms is interpolated (--background LOW HIGH)"
        )
        yield Note("background-height", text)


def review_moments(plane: VelocityPlane, known: Moments, cells: int) -> Iterator[Note]:
    """Probes that were left out, dead or constant, and cells that lost probes or are gone.

    Args:
        plane: with its samples, if it has any.
        cells: how many there were.
    Raises:
        ValueError: data of which no sum means anything: nan or inf; |v| beyond the speed of sound, or beyond a table;
            nearly all of v is its mean, as of a velocity along the flow, and that is not taken off.
    """
    used, seen, name = known.used, known.survey, plane.name
    mean, square, rms = seen.mean.cpu(), seen.mean_square.cpu(), seen.rms.cpu()
    if bool((faulty := ~torch.isfinite(square)).any()):
        probe = int(faulty.nonzero()[0])
        raise ValueError(
            f"{name} holds nan or inf at {int(faulty.sum())} of {plane.probes} probes, the first at probe "
            f"{_place(plane, probe)}, sample {first_fault(plane, seen.blocks, probe)}; repair them, or leave such "
            "probes out with missing='exclude' (--missing exclude)"
        )
    if isinstance(known.nodes, Levels):
        refuse_beyond_table(plane, known, known.nodes.kinks[-1])
    sound, peak = float(plane.fluid.sound_speed), float(seen.peak.max())
    if peak > sound:
        text = f"|v| = {peak:.4g} m/s, beyond the speed of sound, {sound:.4g} m/s; check the unit of the data"
        raise ValueError(f"{name} reaches {text}")
    if excluded := int((~used).sum()):
        yield Note("excluded-probes", f"{name}: {excluded} of {plane.probes} probes hold nan or inf; excluded")
    flat = (square - mean**2 <= 1e-12 * square) & used
    if bool(flat.any()) and (not bool(flat[used].all()) or not bool(square[used].any())):
        text = f"constant, the first at index {int(flat.nonzero()[0])}; dead sensors look like this"
        yield Note("constant-probes", f"{name}: {int(flat.sum())} of {plane.probes} probes are {text}")
    # Those that do not fluctuate count as 0.
    ratio = torch.where(rms <= 1e-6 * mean.abs(), 0, mean.abs() / rms.clamp(min=1e-300))[used].median()
    if ratio > DOUBTFUL_MEAN and known.settings["mean"] == "kept":
        text = f"{name}: the mean of v is {float(ratio):.3g} times its rms"
        if ratio > LARGEST_MEAN:
            raise ValueError(
                f"{text} (limit {LARGEST_MEAN:g}), as of a velocity along the flow; name the wall-normal component, or "
                "take the mean off with mean='removed' (--mean removed)"
            )
        text += ": this may be a velocity along the flow, or the wall blows"
        yield Note("large-mean", f"{text}; mean='removed' (--mean removed) takes the mean off")
    gone, weight = cells - known.membership.count, known.cells.weight
    if gone or weight is not None:
        least = 1.0 if weight is None else float(weight.min())
        text = f"{gone} of {cells} cells hold no probe that is left and count in no average; others weigh the "
        yield Note("lost-cells", f"{name}: {text}share of their probes that they have, the least {least:.2g}")


def first_fault(plane: VelocityPlane, blocks: Blocks, probe: int) -> int:
    """The first sample that is nan or inf, of a probe that has one."""
    for begin in range(0, blocks.borders[-1], 1 << 14):
        wrong = ~torch.isfinite(plane.read(begin, min(begin + (1 << 14), blocks.borders[-1]))[:, probe])
        if bool(wrong.any()):
            return begin + int(wrong.int().argmax())
    raise ValueError(f"{plane.name}: sums of v^2 at probe {probe} are beyond the range of numbers; check the unit")


def refuse_beyond_table(plane: VelocityPlane, known: Moments, top: float) -> None:
    """Refuse |v| above ``top``, m/s, where the table of these moments ends and their sums are nan.

    Raises:
        ValueError: beyond its table.
    """
    for averaging in (name for name in known.sums if name in AVERAGINGS):
        beyond = torch.isnan(known.sums[averaging].sum((0, 1, 2))).cpu()
        if bool(beyond.any()):
            first = int(beyond.nonzero()[0])
            peak = float(survey_of_columns(known, averaging).peak[first])
            place = f"cell {first}" if averaging == "velocity" else f"probe {_place(plane, first)}"
            remedy = "" if averaging == "admittance" else ", or take averaging='admittance'"
            raise ValueError(
                f"{plane.name} reaches |v| = {peak:.4g} m/s at {place} (averaging {averaging!r}), above the liner's "
                f"table, {top:g} m/s; extend it{remedy}"
            )


def _place(plane: VelocityPlane, probe: int) -> tuple[int, ...]:
    """Of a probe on the plane's axes."""
    return tuple(int(i) for i in torch.unravel_index(torch.tensor(probe), plane.probe_shape))


def review_table(known: Moments, liner: LinerModel, frequency: Tensor, z: Tensor) -> tuple[float, list[Note]]:
    """Model-table error in R, up to the largest |v| of the data, and what to say of it; ``z``: of the liner, (F,).

    Raises:
        ValueError: it is too large for any digit that is printed.
    """
    if known.nodes is None:
        return 0.0, []
    error, speed = interpolation_error(known.nodes, liner, frequency, known.top_speed(liner))
    text = (
        f"{known.plane.name}: the model-table error in R of {type(liner).__name__} is {error:.2g}, at |v| = "
        f"{speed:.4g} m/s, from its values at {known.nodes.count} speeds"
    )
    remedy = "reduce the data with this liner and these frequencies"
    if known.onto is not None:
        remedy = "give it as a TabulatedLiner with its kinks among the speeds, or state speed_max and speed_kinks"
    if error > LARGEST_MODEL_ERROR:
        raise ValueError(f"{text} (limit {LARGEST_MODEL_ERROR:g}): {remedy}")
    most = error * float((z + 1).abs().square().max()) / 2  # of dZ = (Z + 1)^2 dR/2
    return error, [Note("model-table", f"{text}: {remedy}", most)] if error > DOUBTFUL_MODEL_ERROR else []


def fallen_back(held: Tensor, chosen: Choices) -> list[Note]:
    """How many values the phase rule ``self-consistent`` could not hold, bool (P, F)."""
    if bool(held.all()):
        return []
    text = f"{int((~held).sum())} of {held.numel()} values have a coherence below {chosen.minimum_coherence:g}"
    return [Note("phase-fell-back", f"self-consistent phase: {text} with the tone; they are 'averaged' instead")]


def review_answer(known: Moments, paper: Averages, chief: Educed, frequency: Tensor, chosen: Choices) -> Iterator[Note]:
    """Probes that count as wall, values that fell back, fewer than eight runs, a large bias of a mean of admittances.

    ``paper``: averaging ``admittance``, whose probes are judged; ``chief``: of the liner, by the answer's averaging.
    """
    plane, total, blocks, limit = known.plane, int(known.used.sum()), known.survey.blocks, chosen.wall_filter or 0.0
    walls = [] if paper.wall is None else paper.wall.sum(0).tolist()
    for f, found in zip(frequency.tolist(), walls, strict=bool(walls)):
        text = (
            f"wall filter: {found} of {total} probes ({100 * found / total:.3g} %) of {plane.name} have a squared "
            f"coherence below {limit:g} with {f:g} Hz and count as wall, admittance 0, in averages over probes; "
            f"without any tone {100 * (1 - limit) ** (blocks.count - 1):.2g} % of probes would pass it, with "
            f"{blocks.count} blocks"
        )
        if plane.frequency is not None and abs(f / plane.frequency - 1) > SAME_FREQUENCY:
            text += f"; the tone of the data is {plane.frequency:g} Hz, so this filters turbulence, not sound"
        yield Note("wall-filter", text)
    if chosen.phase == "self-consistent":
        yield from fallen_back(paper.held, chosen)
    if (interval := chief.interval) is None:
        return
    runs, width = float(interval.runs.min()), float(interval.widths.max())
    if runs < FEWEST_RUNS and width > SMALLEST_WIDTH:
        # Runs grow with the length of the record as S^(2/3), since their own length grows too.
        wanted = math.ceil((FEWEST_RUNS / runs) ** 1.5 * blocks.periods)
        text = (
            f"{plane.name}: the error bars rest on {runs:.2g} independent blocks, fewer than {FEWEST_RUNS}; they are "
            f"rough, and about {wanted} periods instead of {blocks.periods} would give {FEWEST_RUNS}"
        )
        yield Note("few-blocks", text, width / 2 if math.isfinite(width) else None)
    pairs = zip(interval.bias.tolist(), interval.standard_error.tolist(), strict=True)
    for f, (bias, error) in zip(frequency.tolist(), pairs, strict=True):
        if max(abs(bias.real) - error.real, abs(bias.imag) - error.imag) > SMALLEST_WIDTH:
            text = (
                f"{plane.name}: the mean of the probes' admittances is off by about {bias.real:+.2g}{bias.imag:+.2g}j "
                f"in Z at {f:g} Hz, more than its standard error, because each probe's record is short; the interval "
                "is without that bias, the value is not"
            )
            yield Note("biased-mean", text, abs(bias))
