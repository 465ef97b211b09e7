"""Warnings about data, liner and answer, with numbers: refusals raise, the rest becomes notes of the map."""

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY
from torchliner.engine.intervals import FEWEST_BLOCKS, FEWEST_RUNS, SMALLEST_WIDTH
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Levels, interpolation_error
from torchliner.engine.survey import coherence_by_chance
from torchliner.fluid import gas_warnings
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.educed import Educed
from torchliner.records.notes import Note, plane_notes
from torchliner.velocity.averages import Averages, survey_of_columns
from torchliner.velocity.background import LIMIT, SCATTER, excess_resistance, likely_share, parts_of_drive
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
    name, highest, added = plane.name, float(frequency.max()), liner.flow_resistance
    if plane.liner == "hard wall":
        yield Note("null-test", f"null test: {name}: there is a hard wall below and no liner")
    yield from plane_notes(plane, float(frequency.min()), liner.cell_pitch)
    if (steps := plane.sampling_rate / highest) < FEWEST_SAMPLES_PER_PERIOD:
        text = f"{name} has {steps:.3g} samples per period of {highest:g} Hz, fewer than {FEWEST_SAMPLES_PER_PERIOD:g}"
        yield Note("coarse-sampling", f"{text}: the corners of |v| are not resolved")
    if added > 0:
        text = f"{name}: the liner adds {added:.3g} rho c for flow that |v| holds already; set its mach to 0"
        yield Note("flow-counted-twice", text, added)
    if liner.lacks_mach and plane.mach is None:
        yield Note("no-mach", f"neither the liner nor {name} states a Mach number: 0 is taken; state mach (--mach)")
    if liner.fluid is not None:
        yield from (Note("gas", text) for text in gas_warnings(liner.fluid, plane.fluid, name))


def review_moments(plane: VelocityPlane, known: Moments, cells: int) -> Iterator[Note]:
    """Probes that were left out, dead or constant, and cells, of which there were so many, that lost probes or are
    gone. Data of which no sum means anything are refused."""
    used, seen, name, probes, weight = known.used, known.survey, plane.name, plane.probes, known.cells.weight
    mean, square, rms = seen.mean.cpu(), seen.mean_square.cpu(), seen.rms.cpu()
    if len(faulty := (~torch.isfinite(square)).nonzero()):
        where = f"probe {plane.place(faulty[0])}, sample {plane.first_fault(int(faulty[0]))}"
        text = f"{name} holds nan or inf at {len(faulty)} of {probes} probes, the first at {where}; repair them, or "
        raise ValueError(f"{text}leave such probes out with missing='exclude' (--missing exclude)")
    table = known.nodes.kinks if isinstance(known.nodes, Levels) else ()
    for averaging, sums in known.sums.items() if table else ():
        if len(beyond := torch.isnan(sums.sum((0, 1, 2))).nonzero()):  # above the end of the table of these moments
            peak = float(survey_of_columns(known, averaging).peak[beyond[0]])
            place = f"cell {int(beyond[0])}" if averaging == "velocity" else f"probe {plane.place(beyond[0])}"
            text = f"{name} reaches |v| = {peak:.4g} m/s at {place} (averaging {averaging!r})"
            raise ValueError(f"{text}, above the liner's table, {table[-1]:g} m/s; extend it")
    sound, peak = float(plane.fluid.sound_speed), float(seen.peak.max())
    if peak > sound:
        raise ValueError(f"{name}: |v| = {peak:.4g} m/s is beyond the speed of sound, {sound:.4g} m/s; check the unit")
    if excluded := int((~used).sum()):
        yield Note("excluded-probes", f"{name}: {excluded} of {probes} probes hold nan or inf; excluded")
    flat = seen.constant.cpu() & used
    if bool(flat.any()) and (not bool(flat[used].all()) or not bool(square[used].any())):
        text = f"{name}: {int(flat.sum())} of {probes} probes are constant, the first at index {int(flat.nonzero()[0])}"
        yield Note("constant-probes", text)
    # Those that do not fluctuate count as 0.
    ratio = torch.where(rms <= 1e-6 * mean.abs(), 0, mean.abs() / rms.clamp(min=1e-300))[used].median()
    if ratio > DOUBTFUL_MEAN and known.settings["mean"] == "kept":
        text = f"{name}: the mean of v is {float(ratio):.3g} times its rms (limit {LARGEST_MEAN:g}), as of a velocity "
        text += "along the flow; name the wall-normal component, or take mean='removed' (--mean removed)"
        if ratio > LARGEST_MEAN:
            raise ValueError(text)
        yield Note("large-mean", text)
    if (gone := cells - known.membership.count) or weight is not None:
        least = 1.0 if weight is None else float(weight.min())
        text = f"{gone} of {cells} cells have no probe left; others count by share of probes, at least {least:.2g}"
        yield Note("lost-cells", f"{name}: {text}")


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
    name, tone, sound, porosity = plane.name, plane.frequency, float(plane.fluid.sound_speed), liner.surface_porosity
    locked, quiet, diameter = chosen.averaging == "phase-locked", chosen.background, liner.hole_diameter
    notes, facts, ratio = list[Note](), dict[str, Any](velocity_ratio=None), 0.0
    if locked and tone is None and len(frequency) > 1:
        notes.append(Note("no-stated-tone", f"{name}: of v only the mean is averaged over cells; state the tone"))
    span = 0.0 if plane.x is None or known.cell_pitch else float(plane.x.max() - plane.x.min())
    if locked and (waves := span * float(frequency.max()) / sound) > LONG_CELL:
        text = f"{name}: one cell is {waves:.2g} wavelengths long; state cell_pitch, or choose averaging='admittance'"
        notes.append(Note("no-cell-pitch", text))
    away = 0.5 if quiet is None or quiet.height is None or not diameter else quiet.height / diameter
    if not NEAR[0] <= away <= NEAR[1]:
        text = f"the rms without sound is that at {away:.2g} hole diameters, and the one at 0.5 acts: give planes "
        notes.append(Note("background-height", f"{text}on either side of it (--background LOW HIGH)"))
    tested = frequency if tone is None else frequency.new_tensor([tone])
    coherence = float(seen.coherence(tested, cells).nan_to_num(1).max()) if count > 2 else 1.0
    if coherence <= (limit := coherence_by_chance(max(count, 3), CHANCE)):
        text = f"{name}: v holds no tone of {float(tested[0]):g} Hz that can be told from noise: its squared coherence "
        text += f"over {count} blocks is {coherence:.2g}, noise reaches {limit:.2g} in {100 * CHANCE:g} % of records"
        if chosen.hears_tone:
            raise ValueError(f"{text}; phase {chosen.phase!r} needs one: choose phase='averaged' (--phase averaged)")
        stated = plane.incident_level is not None and plane.source_side not in ("none", "unknown")
        if quiet is not None or stated:  # there is sound for all that: the averaging stays
            notes.append(Note("hidden-tone", f"{text}; the phase-locked velocity is mostly noise"))
        else:
            notes.append(Note(NO_TONE, f"{text}; Z is the response to turbulence alone, averaging 'admittance'"))
    at_tone = frequency[[tone in (None, f) for f in frequency.tolist()]]
    if coherence > limit and plane.mach and porosity and len(at_tone) == 1:
        peak = float(cells.mean(seen.tone(at_tone)[0, :, 0]).abs().mean().nan_to_num(0))
        ratio = peak / (porosity * plane.mach * sound)
        facts["velocity_ratio"] = ratio or None
    if not locked or tone is None or not seen.harmonics:
        return notes, facts
    if ratio > LIMIT and known.settings["background"] is None:
        by, most = excess_resistance(known, liner, at_tone, ratio)
        text = f"{name}: velocity ratio |V1|/(phi M c) = {ratio:.2g} (limit {LIMIT:g}): v holds vortices that the "
        text += f"sound makes. In resolved cases {likely_share(ratio):.2g} +- {SCATTER:g} of the incoherent velocity "
        text += f"acts, R is probably too high by {by:.2g} (up to {most:.2g}); give a run without sound (--background)"
        notes.append(Note("velocity-ratio", text, by))
    other = frequency[(frequency / tone - 1).abs() >= SAME_FREQUENCY]
    if len(other) and known.settings["drive"] == "instantaneous":
        _, periodic, rest = parts_of_drive(known)
        share = facts["tone_share"] = periodic / max(periodic + rest, 1e-300)
        if share > TONAL:
            text = f"{name}: {100 * share:.3g} % of the variance of v is in step with the tone of {tone:g} Hz: at "
            text += f"{float(other[0]):g} Hz Z is that of a weak second tone beside it, not of one alone"
            notes.append(Note("other-tone", text))
    return notes, facts


def fallen_back(held: Tensor, chosen: Choices) -> list[Note]:
    """How many values a phase rule that needs a tone in v could not hold, bool (P, F)."""
    text = f"{int((~held).sum())} of {held.numel()} values have a coherence below {chosen.minimum_coherence:g}"
    text = f"{chosen.phase} phase: {text} with the tone; they are 'averaged' instead"
    return [] if bool(held.all()) else [Note("phase-fell-back", text)]


def review_answer(
    known: Moments, liner: LinerModel, paper: Averages, chief: Educed, frequency: Tensor, chosen: Choices
) -> tuple[float, list[Note]]:
    """Model-table error in R, up to the largest |v| of the data; and notes: of that, of probes that count as wall,
    values that fell back, no interval or fewer than eight runs, a large bias of a mean of admittances.

    ``paper``: averaging ``admittance``, whose probes are judged; ``chief``: of the liner, by the answer's averaging.
    """
    name, total, blocks, error, notes = known.plane.name, int(known.used.sum()), known.survey.blocks, 0.0, list[Note]()
    if known.nodes is not None:
        error, speed = interpolation_error(known.nodes, liner, frequency, known.top_speed(liner))
        text = f"{name}: the model-table error in R of {type(liner).__name__} is {error:.2g} at |v| = {speed:.4g} m/s, "
        text += f"from values at {known.nodes.count} speeds (limit {LARGEST_MODEL_ERROR:g}): "
        text += "reduce the data with this liner" if known.onto is None else "state its speed_max and speed_kinks"
        if error > LARGEST_MODEL_ERROR:
            raise ValueError(text)
        if error > DOUBTFUL_MODEL_ERROR:  # dZ = (Z + 1)^2 dR/2
            most = float((chief.impedance.detach() + 1).abs().square().max()) / 2
            notes.append(Note("model-table", text, error * most))
    if paper.wall is not None:
        by_chance = 100 * (1 - (chosen.wall_filter or 0.0)) ** (blocks.count - 1)
        for f, found in zip(frequency.tolist(), paper.wall.sum(0).tolist(), strict=True):
            text = f"{name}: {found} of {total} probes ({100 * found / total:.3g} %) are wall at {f:g} Hz"
            notes.append(Note("wall-filter", f"{text}; without any tone {by_chance:.2g} % would pass the filter"))
    notes += fallen_back(paper.held, chosen)
    if chosen.interval is not None and blocks.count < FEWEST_BLOCKS:
        text = f"{name}: no error bars from {blocks.periods} whole periods; {FEWEST_BLOCKS} are the least, 16 are fair"
        notes.append(Note("no-intervals", text))
    if (interval := chief.interval) is None:
        return error, notes
    runs = float(interval.runs.min())
    if runs < FEWEST_RUNS and (width := float(interval.widths.max())) > SMALLEST_WIDTH:
        # Runs grow with the length of the record as S^(2/3), since their own length grows too.
        wanted = math.ceil((FEWEST_RUNS / runs) ** 1.5 * blocks.periods)
        text = f"{name}: the error bars rest on {runs:.2g} independent blocks; {wanted} periods give {FEWEST_RUNS}"
        notes.append(Note("few-blocks", text, width / 2 if math.isfinite(width) else None))
    pairs = zip(frequency.tolist(), interval.bias.tolist(), interval.standard_error.tolist(), strict=True)
    for f, bias, scatter in pairs:
        if max(abs(bias.real) - scatter.real, abs(bias.imag) - scatter.imag) > SMALLEST_WIDTH:
            text = f"{name}: the mean of admittances is off by about {bias:+.2g} in Z at {f:g} Hz, beyond its standard "
            notes.append(Note("biased-mean", f"{text}error; the bounds are without that bias", abs(bias)))
    return error, notes
