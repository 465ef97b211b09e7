"""Warnings about data, liner and answer, with numbers: refusals raise, the rest becomes notes of the map."""

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.engine.blocks import Blocks
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, SMALLEST_WIDTH
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Levels, interpolation_error
from torchliner.engine.survey import coherence_by_chance
from torchliner.fluid import gas_warnings
from torchliner.liners.model import LinerModel
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.educed import Educed
from torchliner.records.notes import Note, plane_notes
from torchliner.velocity import jets
from torchliner.velocity.averages import Averages, survey_of_columns
from torchliner.velocity.choices import Choices

FEWEST_SAMPLES_PER_PERIOD = 8.0
LONG_CELL = 0.125  # wavelengths: over a cell as long the tone turns by 45 degrees
DOUBTFUL_MEAN, LARGEST_MEAN = 3.0, 10.0  # |mean| over rms of v, half of the probes beyond: noted, refused
LARGEST_MODEL_ERROR, DOUBTFUL_MODEL_ERROR = 1e-3, 1e-5  # in R, of the model table: refused, noted
NEAR = (0.45, 0.55)  # hole diameters that count as half of one, the height at which a quiet run's rms acts
CHANCE = 0.01  # of records without a tone, of which the test finds one
NO_TONE = "no-tone"  # code of the note with which phase-locked averaging gives way to ``admittance``
TONAL = 0.1  # share of the variance of v in step with the tone, above which Z elsewhere is not that of a tone alone


def review_case(plane: VelocityPlane, liner: LinerModel, frequency: Tensor) -> Iterator[Note]:
    """Null tests, units, the sampling rate against the frequencies asked for; whether liner and data state the same
    gas, flow and lengths, and whether flow would count twice."""
    name, lowest, highest = plane.name, float(frequency.min()), float(frequency.max())
    if plane.liner == "hard wall":
        yield Note("null-test", f"null test: {name}: there is a hard wall below and no liner")
    yield from plane_notes(plane, lowest, liner.cell_pitch)
    if (steps := plane.sampling_rate / highest) < FEWEST_SAMPLES_PER_PERIOD:
        text = f"{steps:.3g} samples per period of {highest:g} Hz, fewer than {FEWEST_SAMPLES_PER_PERIOD:g}"
        yield Note("coarse-sampling", f"{name} has {text}: the corners of |v| are not resolved")
    if liner.flow_resistance > 0:
        text = (
            f"the law of liner {liner.describe().get('name', '')!r} adds {liner.flow_resistance:.3g} rho c for grazing "
            f"flow, but |v| of {name} holds the turbulence already, so flow would count twice: set its mach to 0"
        )
        yield Note("flow-counted-twice", text, liner.flow_resistance)
    if liner.lacks_mach and plane.mach is None:
        yield Note("no-mach", f"neither the liner nor {name} states a Mach number: 0 is taken; state mach (--mach)")
    if liner.fluid is not None:
        yield from (Note("gas", text) for text in gas_warnings(liner.fluid, plane.fluid, name))


def review_moments(plane: VelocityPlane, known: Moments, cells: int) -> Iterator[Note]:
    """Probes that were left out, dead or constant, and cells, of which there were so many, that lost probes or are
    gone. Data of which no sum means anything are refused."""
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
        refuse_beyond_table(plane, known, known.nodes)
    sound, peak = float(plane.fluid.sound_speed), float(seen.peak.max())
    if peak > sound:
        text = f"|v| = {peak:.4g} m/s, beyond the speed of sound, {sound:.4g} m/s; check the unit of the data"
        raise ValueError(f"{name} reaches {text}")
    if excluded := int((~used).sum()):
        yield Note("excluded-probes", f"{name}: {excluded} of {plane.probes} probes hold nan or inf; excluded")
    flat = (square - mean**2 <= 1e-12 * square) & used
    if bool(flat.any()) and (not bool(flat[used].all()) or not bool(square[used].any())):
        text = f"{int(flat.sum())} of {plane.probes} probes are constant, the first at index {int(flat.nonzero()[0])}"
        yield Note("constant-probes", f"{name}: {text}")
    # Those that do not fluctuate count as 0.
    ratio = torch.where(rms <= 1e-6 * mean.abs(), 0, mean.abs() / rms.clamp(min=1e-300))[used].median()
    if ratio > DOUBTFUL_MEAN and known.settings["mean"] == "kept":
        text = f"{name}: the mean of v is {float(ratio):.3g} times its rms (limit {LARGEST_MEAN:g}), as of a velocity "
        text += "along the flow; name the wall-normal component, or take mean='removed' (--mean removed)"
        if ratio > LARGEST_MEAN:
            raise ValueError(text)
        yield Note("large-mean", text)
    gone, weight = cells - known.membership.count, known.cells.weight
    if gone or weight is not None:
        least = 1.0 if weight is None else float(weight.min())
        text = f"{gone} of {cells} cells hold no probe that is left; others weigh what they have, at least {least:.2g}"
        yield Note("lost-cells", f"{name}: {text}")


def first_fault(plane: VelocityPlane, blocks: Blocks, probe: int) -> int:
    """The first sample that is nan or inf, of a probe that has one."""
    for begin in range(0, blocks.borders[-1], 1 << 14):
        wrong = ~torch.isfinite(plane.read(begin, min(begin + (1 << 14), blocks.borders[-1]))[:, probe])
        if bool(wrong.any()):
            return begin + int(wrong.int().argmax())
    raise ValueError(f"{plane.name}: sums of v^2 at probe {probe} are beyond the range of numbers; check the unit")


def refuse_beyond_table(plane: VelocityPlane, known: Moments, nodes: Levels) -> None:
    """Refuse |v| where the table of these moments ends, so that their sums are nan."""
    for averaging in (name for name in known.sums if name in AVERAGINGS):
        beyond = torch.isnan(known.sums[averaging].sum((0, 1, 2))).cpu()
        if bool(beyond.any()):
            first = int(beyond.nonzero()[0])
            peak = float(survey_of_columns(known, averaging).peak[first])
            place = f"cell {first}" if averaging == "velocity" else f"probe {_place(plane, first)}"
            raise ValueError(
                f"{plane.name} reaches |v| = {peak:.4g} m/s at {place} (averaging {averaging!r}), above the liner's "
                f"table, {nodes.kinks[-1]:g} m/s; extend it"
            )


def _place(plane: VelocityPlane, probe: int) -> tuple[int, ...]:
    """Of a probe on the plane's axes."""
    return tuple(int(i) for i in torch.unravel_index(torch.tensor(probe), plane.probe_shape))


def review_sound(
    known: Moments, liner: LinerModel, frequency: Tensor, chosen: Choices
) -> tuple[list[Note], dict[str, Any]]:
    """Notes, and for the ``choices`` of the result ``velocity_ratio``, |V1|/(phi M c): peak of the phase-locked
    velocity of the cells at the tone over porosity and flow velocity, and ``tone_share``, of the variance of v*.

    Of phase-locked averaging, no stated tone, one cell of all, a background of another height; a record without the
    tone that is stated, or without any of those asked for, where none is; strong sound in weak flow without a
    background; frequencies at which |v| is set by another tone.
    """
    plane, seen, cells, count = known.plane, known.survey, known.membership, known.survey.blocks.count
    name, porosity, notes, facts = plane.name, liner.surface_porosity, list[Note](), dict[str, Any]()
    locked, quiet, diameter = chosen.averaging == "phase-locked", chosen.background, liner.hole_diameter
    if locked and plane.frequency is None and len(frequency) > 1:
        text = f"{name}: of v only the mean is averaged over cells; state its tone (frequency=)"
        notes.append(Note("no-stated-tone", text))
    if locked and known.cell_pitch is None and plane.x is not None:
        length, wave = float(plane.x.max() - plane.x.min()), float(plane.fluid.sound_speed) / float(frequency.max())
        if length > LONG_CELL * wave:
            text = f"{name}: all of {1e3 * length:.3g} mm counts as one cell, {length / wave:.2g} wavelengths"
            notes.append(Note("no-cell-pitch", f"{text}; state cell_pitch, or choose averaging='admittance'"))
    share = 0.5 if quiet is None or quiet.height is None or not diameter else quiet.height / diameter
    if not NEAR[0] <= share <= NEAR[1]:
        text = (
            f"the rms without sound is that at {1e3 * quiet.height:.3g} mm, {share:.2g} hole diameters; it acts at "
            "half a diameter (docs/background.md): give planes on either side of it (--background LOW HIGH)"
        )
        notes.append(Note("background-height", text))
    tested = frequency if plane.frequency is None else torch.tensor([plane.frequency], dtype=torch.float64)
    coherence = float(seen.coherence(tested, cells).nan_to_num(1).max()) if count > 2 else 1.0
    limit = coherence_by_chance(max(count, 3), CHANCE)
    if coherence <= limit:
        text = (
            f"{name}: v holds no tone of {float(tested[0]):g} Hz that can be told from noise: its squared coherence "
            f"over {count} blocks is {coherence:.2g}, and noise reaches {limit:.2g} in {100 * CHANCE:g} % of records"
        )
        if chosen.phase == "self-consistent":
            raise ValueError(f"{text}; phase 'self-consistent' needs one: choose phase='averaged'")
        stated = plane.incident_level is not None and plane.source_side not in ("none", "unknown")
        if chosen.background is not None or stated:  # there is sound for all that: the averaging stays
            notes.append(Note("hidden-tone", f"{text}; the phase-locked velocity is mostly noise"))
        else:
            notes.append(Note(NO_TONE, f"{text}; Z is the response to turbulence alone, averaging 'admittance'"))
    place, facts["velocity_ratio"] = [i for i, f in enumerate(frequency.tolist()) if plane.frequency in (None, f)], None
    if coherence > limit and plane.mach and porosity and len(place) == 1:
        peak = float(cells.mean(seen.tone(frequency[place])[0, :, 0]).abs().mean())
        ratio = peak / (porosity * plane.mach * float(plane.fluid.sound_speed))
        facts["velocity_ratio"] = ratio if math.isfinite(ratio) else None
    if not locked or plane.frequency is None or not seen.harmonics:
        return notes, facts
    ratio = facts["velocity_ratio"]
    if ratio is not None and ratio > jets.LIMIT and known.settings["background"] is None:
        by, most = jets.excess_resistance(known, liner, frequency[place], ratio)
        text = (
            f"{name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {jets.LIMIT:g}): v holds vortices of the jets "
            f"that the sound makes. In resolved cases about {jets.likely_share(ratio):.2g} +- {jets.SCATTER:g} of the "
            f"incoherent velocity acts at this ratio, so that R is probably too high by about {by:.2g} (up to "
            f"{most:.2g}); nothing is taken off: give a run without sound (--background)"
        )
        notes.append(Note("velocity-ratio", text, by))
    other = (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY
    if bool(other.any()) and known.settings["drive"] == "instantaneous":
        _, periodic, rest = jets.parts_of_drive(known)
        share = facts["tone_share"] = periodic / max(periodic + rest, 1e-300)
        if share > TONAL:
            text = (
                f"{100 * share:.3g} % of the variance of v is in step with the tone of {plane.frequency:g} Hz: at "
                f"{float(frequency[other][0]):g} Hz Z is that of a weak second tone beside it, not of one alone"
            )
            notes.append(Note("other-tone", f"{name}: {text}"))
    return notes, facts


def fallen_back(held: Tensor, chosen: Choices) -> list[Note]:
    """How many values the phase rule ``self-consistent`` could not hold, bool (P, F)."""
    if bool(held.all()):
        return []
    text = f"{int((~held).sum())} of {held.numel()} values have a coherence below {chosen.minimum_coherence:g}"
    return [Note("phase-fell-back", f"self-consistent phase: {text} with the tone; they are 'averaged' instead")]


def review_answer(
    known: Moments, liner: LinerModel, paper: Averages, chief: Educed, frequency: Tensor, chosen: Choices
) -> tuple[float, list[Note]]:
    """Model-table error in R, up to the largest |v| of the data; and notes: of that, of probes that count as wall,
    values that fell back, no interval or fewer than eight runs, a large bias of a mean of admittances.

    ``paper``: averaging ``admittance``, whose probes are judged; ``chief``: of the liner, by the answer's averaging.
    """
    name, total, blocks, limit = known.plane.name, int(known.used.sum()), known.survey.blocks, chosen.wall_filter or 0.0
    notes, error = list[Note](), 0.0
    if known.nodes is not None:
        error, speed = interpolation_error(known.nodes, liner, frequency, known.top_speed(liner))
        remedy = "reduce the data with this liner and these frequencies"
        if known.onto is not None:
            remedy = "give it as a TabulatedLiner with its kinks among the speeds, or state speed_max and speed_kinks"
        text = (
            f"{name}: the model-table error in R of {type(liner).__name__} is {error:.2g}, at |v| = {speed:.4g} m/s, "
            f"from its values at {known.nodes.count} speeds (limit {LARGEST_MODEL_ERROR:g}): {remedy}"
        )
        if error > LARGEST_MODEL_ERROR:
            raise ValueError(text)
        if error > DOUBTFUL_MODEL_ERROR:  # dZ = (Z + 1)^2 dR/2
            most = float((chief.impedance.detach() + 1).abs().square().max()) / 2
            notes.append(Note("model-table", text, error * most))
    walls = [] if paper.wall is None else paper.wall.sum(0).tolist()
    for f, found in zip(frequency.tolist(), walls, strict=bool(walls)):
        text = (
            f"wall filter: {found} of {total} probes ({100 * found / total:.3g} %) of {name} are wall at {f:g} Hz; "
            f"without any tone {100 * (1 - limit) ** (blocks.count - 1):.2g} % would pass it"
        )
        notes.append(Note("wall-filter", text))
    if chosen.phase == "self-consistent":
        notes += fallen_back(paper.held, chosen)
    if chosen.interval is not None and blocks.count < FEWEST_BLOCKS:
        text = f"no error bars, since the record holds {blocks.periods} whole periods; {FEWEST_BLOCKS} are the least"
        notes.append(Note("no-intervals", f"{name}: {text}, 16 give a fair interval"))
    if (interval := chief.interval) is None:
        return error, notes
    low, high = map(torch.view_as_real, (interval.low, interval.high))
    runs, width = float(interval.runs.min()), float((high - low).max())
    if runs < FEWEST_RUNS and width > SMALLEST_WIDTH:
        # Runs grow with the length of the record as S^(2/3), since their own length grows too.
        wanted = math.ceil((FEWEST_RUNS / runs) ** 1.5 * blocks.periods)
        text = f"{name}: the error bars rest on {runs:.2g} independent blocks; they are rough, and {wanted} periods "
        text += f"instead of {blocks.periods} would give {FEWEST_RUNS}"
        notes.append(Note("few-blocks", text, width / 2 if math.isfinite(width) else None))
    pairs = zip(interval.bias.tolist(), interval.standard_error.tolist(), strict=True)
    for f, (bias, scatter) in zip(frequency.tolist(), pairs, strict=True):
        if max(abs(bias.real) - scatter.real, abs(bias.imag) - scatter.imag) > SMALLEST_WIDTH:
            text = (
                f"{name}: the mean of the probes' admittances is off by about {bias.real:+.2g}{bias.imag:+.2g}j in Z "
                f"at {f:g} Hz, more than its standard error; the interval is without that bias, the value is not"
            )
            notes.append(Note("biased-mean", text, abs(bias)))
    return error, notes
