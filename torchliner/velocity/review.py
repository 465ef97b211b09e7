"""Warnings about data and liner, with numbers: refusals raise, the rest becomes notes of the map."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS, SAME_FREQUENCY
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.blocks import Blocks
from torchliner.engine.drives import FEWEST_BLOCKS, tone_variances
from torchliner.engine.intervals import FEWEST_BLOCKS as FEWEST_FOR_INTERVALS
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import interpolation_error, response
from torchliner.fluid import gas_warnings
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.notes import Note
from torchliner.records.unit_checks import height_warnings, plane_unit_warnings
from torchliner.velocity.averages import Averages, mean_direction
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import first_fault

FEWEST_SAMPLES_PER_PERIOD = 8.0
SAME_MACH = 0.01
EVEN = 1.01  # largest over smallest area of probes that count alike
LONG_CELL = 0.125  # wavelengths: over a cell as long the tone turns by 45 degrees
LARGEST_MODEL_ERROR, DOUBTFUL_MODEL_ERROR = 1e-3, 1e-5  # in R, of the model table: refused, noted
FEWEST_RUNS = 8  # below, an interval says little
LONGEST_WINDOW = 0.25  # of a running rms, in records
SMALLEST_WIDTH = 1e-9  # a frozen |v| leaves rounding
LEAST_DIRECTION = 0.9  # mean of e^{j psi}: phases over 90 degrees, evenly
CHANCE = 0.01  # of probes that pass a limit of coherence without any tone, above which a warning is given
PHASES = 64  # of the tone, and equally likely values of the turbulence
LARGEST_CHANGE = 0.05  # of Z by the tone's part, relative to |Z|, that goes without a note


def review_record(plane: VelocityPlane, frequency: Tensor, chosen: Choices) -> list[Note]:
    """Length and rate of the record against the frequencies asked for.

    Raises:
        ValueError: fewer than four periods, unless ``allow_short``.
    """
    notes = []
    if plane.liner == "hard wall":
        text = (
            f"null test: there is a hard wall below {plane.name} and no liner; the values only show what this model "
            "makes of such a velocity"
        )
        notes.append(Note("null-test", text))
    for f in frequency.tolist():
        periods = f * plane.samples / plane.sampling_rate
        if periods < FEWEST_PERIODS * (1 - 1e-6) and not chosen.allow_short:
            raise ValueError(
                f"{plane.name} holds {periods:.3g} periods of {f:g} Hz, fewer than {FEWEST_PERIODS:g}; pass "
                "allow_short=True if that is meant"
            )
    notes += [Note("units", text) for text in plane_unit_warnings(plane, float(frequency.min()))]
    area = plane.area
    if area is not None and float(area.max()) > EVEN * float(area.min()):
        text = (
            f"{plane.name}: the areas of the probes differ, {float(area.min()):.3g} to {float(area.max()):.3g} m2; "
            "averages weigh probes alike, not by area"
        )
        notes.append(Note("areas", text))
    per_period = plane.sampling_rate / float(frequency.max())
    if per_period < FEWEST_SAMPLES_PER_PERIOD:
        text = (
            f"{plane.name} has {per_period:.3g} samples per period of {float(frequency.max()):g} Hz; |v| has corners, "
            f"and below {FEWEST_SAMPLES_PER_PERIOD:g} they are not resolved"
        )
        notes.append(Note("coarse-sampling", text))
    return notes


def review_liner(plane: VelocityPlane, liner: LinerModel) -> list[Note]:
    """Whether liner and data state the same gas, flow and lengths, and whether flow would count twice."""
    notes = [Note("height", text) for text in height_warnings(plane, liner.cell_pitch)]
    if liner.flow_resistance > 0:
        text = (
            f"the law of liner {liner.describe().get('name', '')!r} adds {liner.flow_resistance:.3g} rho c of "
            f"resistance for grazing flow, but |v| as measured in {plane.name} holds the turbulence already (Roncen et "
            "al. 2026, section 2.4), so flow would count twice; set the law's mach to 0"
        )
        notes.append(Note("flow-counted-twice", text, liner.flow_resistance))
    stated = liner.numbers().get("mach")
    if stated is not None and plane.mach is not None and abs(stated.value - plane.mach) > SAME_MACH:
        text = (
            f"mach is {stated.value:g} in the liner and {plane.mach:g} in {plane.name}; the liner's is used for the "
            "model: state the flow's there"
        )
        notes.append(Note("other-mach", text))
    gas = [] if liner.fluid is None else gas_warnings(liner.fluid, plane.fluid, plane.name)
    return notes + [Note("gas", text) for text in gas]


def review_cells(
    plane: VelocityPlane, liner: LinerModel, frequency: Tensor, cells: Cells, chosen: Choices
) -> list[Note]:
    """Where the phase-locked velocity of a cell is not what its name says; before any sample is read."""
    if "phase-locked" not in chosen.averagings:
        return []
    notes = []
    if plane.frequency is None and len(frequency) > 1:
        text = (
            f"{plane.name} states no tone, and {len(frequency)} frequencies are asked for: of v only the mean is "
            "averaged over the cells; state frequency= of the data"
        )
        notes.append(Note("no-stated-tone", text))
    if plane.probes > 1 and int(torch.bincount(cells.labels[cells.labels >= 0]).max()) == 1:
        text = (
            f"{plane.name}: no cell holds more than one probe, so the phase-locked velocity of a cell is that of its "
            "probe, and averaging 'phase-locked' is 'admittance'; more probes a cell are needed"
        )
        notes.append(Note("one-probe-cells", text))
    if liner.cell_pitch is None and plane.x is not None:
        length = float(plane.x.max() - plane.x.min())
        wave = float(plane.fluid.sound_speed) / float(frequency.max())
        if length > LONG_CELL * wave:
            text = (
                f"{plane.name}: the liner states no cell_pitch, so that all of {1e3 * length:.3g} mm counts as one "
                f"cell, {length / wave:.2g} wavelengths, over which the phase of the tone turns; state cell_pitch, or "
                "choose averaging='admittance'"
            )
            notes.append(Note("no-cell-pitch", text))
    return notes


def review_blocks(plane: VelocityPlane, blocks: Blocks, tone: float, chosen: Choices) -> list[Note]:
    """Records too short for intervals, or to tell what of v is periodic."""
    notes = []
    if chosen.interval is not None and blocks.count < FEWEST_FOR_INTERVALS:
        text = (
            f"{plane.name}: no error bars, since the record holds {blocks.periods} whole periods of {tone:g} Hz; "
            f"{FEWEST_FOR_INTERVALS} are the least, and 16 periods give a fair interval"
        )
        notes.append(Note("no-intervals", text))
    if "phase-locked" in chosen.averagings and blocks.count < FEWEST_BLOCKS and not chosen.allow_short:
        text = (
            f"{plane.name} is too short to tell what of v is periodic and what is turbulence: all that a fit of the "
            f"tone finds counts as periodic; {FEWEST_BLOCKS} periods are the least"
        )
        notes.append(Note("short-for-phase-locked", text))
    return notes


def review_moments(plane: VelocityPlane, known: Moments) -> list[Note]:
    """Probes with faults, dead or left out, and cells that lost probes; ``plane`` still has its samples if any has.

    Raises:
        ValueError: nan or inf; |v| beyond the speed of sound.
    """
    seen = known.survey
    squares, peak = seen.squares.sum(0).cpu(), seen.peak.cpu()
    faulty = ~torch.isfinite(squares)
    if bool(faulty.any()):
        probe = int(faulty.nonzero()[0])
        place = tuple(int(i) for i in torch.unravel_index(torch.tensor(probe), plane.probe_shape))
        raise ValueError(
            f"{plane.name} holds nan or inf at {int(faulty.sum())} of {plane.probes} probes, the first at probe "
            f"{place}, sample {first_fault(plane, seen.blocks, probe)}; repair them, or leave such probes out with "
            "missing='exclude' (--missing exclude)"
        )
    notes, used = [], known.used
    if excluded := int((~used).sum()):
        text = f"{plane.name}: {excluded} of {plane.probes} probes hold nan or inf; excluded"
        notes.append(Note("excluded-probes", text))
    sound = float(plane.fluid.sound_speed)
    if float(peak.max()) > sound:
        raise ValueError(
            f"{plane.name} reaches |v| = {float(peak.max()):.4g} m/s, beyond the speed of sound, {sound:.4g} m/s; "
            "check the unit of the data"
        )
    mean, square = seen.mean.cpu(), seen.mean_square.cpu()
    flat = (square - mean**2 <= 1e-12 * square) & used
    still = flat & (square == 0)
    if bool(still.any()):
        text = (
            f"{plane.name}: {int(still.sum())} of {plane.probes} probes are exactly 0 throughout, the first at index "
            f"{int(still.nonzero()[0])}; they give the liner at rest"
        )
        notes.append(Note("probes-at-rest", text))
    elif bool(flat.any()) and not bool(flat[used].all()):
        text = (
            f"{plane.name}: {int(flat.sum())} of {plane.probes} probes are constant, the first at index "
            f"{int(flat.nonzero()[0])}; dead sensors look like this"
        )
        notes.append(Note("constant-probes", text))
    return notes


def review_lost_cells(plane: VelocityPlane, cells: Cells, kept: Cells) -> list[Note]:
    """Cells that lost probes, or all of them, to ``missing``."""
    notes = []
    if gone := cells.count - kept.count:
        text = f"{plane.name}: {gone} of {cells.count} cells hold no probe that is left; they count in no average"
        notes.append(Note("lost-cells", text))
    if kept.weight is not None:
        short = kept.weight[kept.weight < 1]
        text = (
            f"{plane.name}: {len(short)} of {cells.count} cells have lost some of their probes; in averages over cells "
            f"each weighs the share that it has, the least {float(short.min()):.2g}"
        )
        notes.append(Note("short-cells", text))
    return notes


def review_table(
    plane: VelocityPlane, known: Moments, liner: LinerModel, frequency: Tensor
) -> tuple[float, list[Note]]:
    """Model-table error in R, up to the largest |v| of the data, and what to say of it.

    Raises:
        ValueError: it is too large for any digit that is printed.
    """
    if known.nodes is None:
        return 0.0, []
    error, speed = interpolation_error(known.nodes, liner, frequency, known.top_speed(liner))
    text = (
        f"{plane.name}: the model-table error in R of {type(liner).__name__} is {error:.2g}, at |v| = {speed:.4g} m/s, "
        f"from its values at {known.nodes.count} speeds"
    )
    if known.projected is None:
        remedy = "reduce the data with this liner and these frequencies"
    else:
        remedy = (
            "it is not smooth in |v| there; give it as a TabulatedLiner with its kinks among the speeds, or state "
            "speed_max and speed_kinks"
        )
    if error > LARGEST_MODEL_ERROR:
        raise ValueError(f"{text} (limit {LARGEST_MODEL_ERROR:g}): {remedy}")
    return error, [Note("model-table", f"{text}: {remedy}", error)] if error > DOUBTFUL_MODEL_ERROR else []


def review_walls(
    plane: VelocityPlane, wall: Tensor | None, used: Tensor, frequency: Tensor, count: int, limit: float | None
) -> list[Note]:
    """How many probes count as wall, (P, F) bool, and how many would pass without any tone, of ``count`` blocks."""
    if wall is None or limit is None:
        return []
    notes, total, chance = [], int(used.sum()), 100 * (1 - limit) ** (count - 1)
    for f, found in zip(frequency.tolist(), wall.sum(0).tolist(), strict=True):
        text = (
            f"wall filter: {found} of {total} probes ({100 * found / total:.3g} %) of {plane.name} have a squared "
            f"coherence below {limit:g} with {f:g} Hz and count as wall, admittance 0, in the averages over probes; "
            f"averaging 'velocity' is as without the filter. Without any tone {chance:.2g} % of probes would pass it, "
            f"with {count} blocks"
        )
        if plane.frequency is not None and abs(f / plane.frequency - 1) > SAME_FREQUENCY:
            text += f"; the tone of the data is {plane.frequency:g} Hz, so this filters turbulence, not sound"
        notes.append(Note("wall-filter", text))
    return notes


def review_phase(known: Moments, phase: Tensor | None) -> list[Note]:
    """Stated phases so far apart within a cell that their mean direction says little, or nothing; (P, F or 1)."""
    if phase is None:
        return []
    length = mean_direction(known.membership, phase).abs().cpu()
    wide = length < LEAST_DIRECTION
    if not bool(wide.any()):
        return []
    text = (
        f"reference_phase differs within {int(wide.any(1).sum())} of {known.cells.count} cells: the mean of e^(j psi) "
        f"is as short as {float(length.min()):.2g} (1 where all agree, limit {LEAST_DIRECTION:g}), so that the one "
        "phase of such a cell, and its value with averaging 'velocity', mean little; use the probes' values"
    )
    return [Note("phases-in-a-cell", text)]


def review_rule(held: Tensor, count: int, chosen: Choices) -> list[Note]:
    """How many values fell back to ``averaged``, bool (P, F), and how many pass by chance with ``count`` blocks."""
    if chosen.phase != "self-consistent":
        return []
    notes, limit = [], chosen.minimum_coherence
    if not bool(held.all()):
        text = (
            f"self-consistent phase: {int((~held).sum())} of {held.numel()} values have a coherence below {limit:g} "
            "with the tone; they are 'averaged' instead"
        )
        notes.append(Note("phase-fell-back", text))
    chance = (1 - limit) ** (count - 1)
    if chance > CHANCE and limit > 0:
        text = (
            f"self-consistent phase: with {count} blocks, {100 * chance:.2g} % of probes pass a coherence of {limit:g} "
            "without any tone; a longer record or a higher minimum_coherence is safer"
        )
        notes.append(Note("coherence-by-chance", text))
    return notes


def review_intervals(
    plane: VelocityPlane, found: Averages, blocks: Blocks, frequency: Tensor, chosen: Choices
) -> list[Note]:
    """Fewer than eight runs; a running rms that hardly varies; a large bias of a mean of admittances."""
    interval = found.liner.interval
    if interval is None:
        return []
    notes = []
    runs = float(interval.runs.min())
    if runs < FEWEST_RUNS and float(interval.widths.max()) > SMALLEST_WIDTH:
        # Runs grow with the length of the record as S^(2/3), since their own length grows too.
        wanted = math.ceil((FEWEST_RUNS / runs) ** 1.5 * blocks.periods)
        text = (
            f"{plane.name}: the error bars rest on {runs:.2g} independent blocks, fewer than {FEWEST_RUNS}; they are "
            f"rough, and about {wanted} periods instead of {blocks.periods} would give {FEWEST_RUNS}"
        )
        notes.append(Note("few-blocks", text))
    window = chosen.running_window or 0.0
    if chosen.drive == "running-rms" and window > LONGEST_WINDOW * plane.duration:
        text = (
            f"{plane.name}: the running rms is over {window:.3g} s of a record of {plane.duration:.3g} s, so that it "
            "hardly varies in it, and the error bars are too narrow; take a shorter running_window, or drive='rms'"
        )
        notes.append(Note("long-window", text))
    for f, bias, error in zip(
        frequency.tolist(), interval.bias.tolist(), interval.standard_error.tolist(), strict=True
    ):
        if max(abs(bias.real) - error.real, abs(bias.imag) - error.imag) > SMALLEST_WIDTH:
            text = (
                f"{plane.name}: the mean of the probes' admittances is off by about {bias.real:+.2g}{bias.imag:+.2g}j "
                f"in Z at {f:g} Hz, more than its standard error, because each probe's record is short; the interval "
                "is without that bias, the value is not"
            )
            notes.append(Note("biased-mean", text, abs(bias)))
    return notes


def tone_share(known: Moments) -> tuple[float, float, float, float] | None:
    """Share of the variance of v* that is periodic with the tone, mean, rms of that part and of the rest, m/s.

    None unless the plane states its tone and averaging is ``phase-locked``.
    """
    if known.locked is None or known.plane.frequency is None or not known.survey.harmonics:
        return None
    mean, periodic, rest = (float(each) for each in tone_variances(known.locked, known.survey, known.membership))
    return periodic / max(periodic + rest, 1e-300), mean, periodic**0.5, rest**0.5


def review_other_tones(plane: VelocityPlane, known: Moments, liner: LinerModel, frequency: Tensor) -> list[Note]:
    """Where |v| is the tone's own, Z at other frequencies is not that of a tone sent alone."""
    found = tone_share(known)
    if found is None or known.settings["drive"] != "instantaneous" or plane.frequency is None:
        return []
    share, mean, periodic, rest = found
    other = (frequency / plane.frequency - 1).abs() >= SAME_FREQUENCY
    if not bool(other.any()):
        return []
    middle = (torch.arange(PHASES, dtype=torch.float64) + 0.5) / PHASES
    turbulent = mean + rest * 2**0.5 * torch.erfinv(2 * middle - 1)
    tonal = periodic * 2**0.5 * torch.cos(2 * torch.pi * middle)
    top = known.top_speed(liner)

    def impedance(velocity: Tensor) -> Tensor:
        speed = velocity.abs().flatten().clamp(max=top)
        return impedance_from_reflection(response(liner, frequency, speed).mean(1))

    with torch.no_grad():
        beside, alone = impedance(turbulent[:, None] + tonal), impedance(turbulent)
    change = torch.where(other, ((alone - beside) / beside).abs(), 0)
    worst = int(change.argmax())
    if float(change[worst]) <= LARGEST_CHANGE:
        return []
    asked = [f"{float(f):g}" for f in (frequency[other].min(), frequency[other].max())]
    text = (
        f"{plane.name}: {100 * share:.3g} % of the variance of v is in step with the tone of {plane.frequency:g} Hz "
        f"({periodic:.3g} m/s rms, the rest {rest:.3g}), so |v| is partly that tone's own: at "
        f"{' to '.join(dict.fromkeys(asked))} Hz Z is that of a weak second tone beside this one, not of a tone sent "
        f"alone. Without this one it would be about {_text(alone[worst])} instead of {_text(beside[worst])} at "
        f"{float(frequency[worst]):g} Hz (sine and Gaussian turbulence of these rms)"
    )
    return [Note("other-tone", text, float((alone - beside)[worst].abs()))]


def _text(z: Tensor) -> str:
    value = complex(z)
    return f"{value.real:.2f}{value.imag:+.2f}j"


def texts(notes: Iterable[Note]) -> list[str]:
    """The words of each."""
    return [note.text for note in notes]
