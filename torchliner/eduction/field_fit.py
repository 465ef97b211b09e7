"""Impedance from wall pressures by fitting the linearised Euler equations themselves.

No mode is singled out and nothing is assumed of the waves in the duct but the equations: reflected
and evanescent waves of a short liner are part of the model. ``field_model`` says what is minimised.

An end that reflects is a wave that comes in there. With the far end ``fitted`` it is a second
amplitude, and since the field is linear in both, no reflection is iterated on; with the far end
``stated`` it is what the case says, and a reflection of 0.05 that the case does not know of moves Z
by more than any error of the microphones.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from torchliner.checks import DataWarning, require_choice
from torchliner.duct.case import SOURCES, other_side
from torchliner.duct.catalogue import load_duct
from torchliner.duct.lee import DuctSolver
from torchliner.eduction.field_model import (
    STEPS,
    FieldModel,
    Solution,
    from_grid,
    least_squares,
)
from torchliner.eduction.microphone_errors import LEVEL_ERROR, PHASE_ERROR, draw_pressures
from torchliner.records import FieldFit, MicrophoneLine
from torchliner.records.drawn_impedance import fine_places

FAR_ENDS = ("fitted", "stated")
VARIATIONS = ("constant", "linear")
SAME = 1e-6  # relative, of what line and case both state
SAME_PLACE = 1e-6  # m
SMALLEST = 1e-4  # dB, degrees: no microphone is as good, and rounding keeps smaller ones apart
POOR = 3.0  # chi squared over its degrees of freedom


def fit_field(
    line: MicrophoneLine,
    solver: DuctSolver,
    *,
    wall: str = "opposite",
    far_end: str = "fitted",
    variation: str = "constant",
    start: complex | None = None,
    draws: int = 0,
    level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
    generator: torch.Generator | None = None,
) -> FieldFit:
    """Impedance of the liner of a duct that fits a line of microphones best.

    Args:
        line: microphones anywhere along the duct, any spacing.
        solver: the duct, at the line's frequencies, with one lined patch.
        wall: of the microphones, ``opposite`` or ``lined``.
        far_end: ``fitted``, it reflects what is found, or ``stated``, what the case says.
        variation: of Z along the liner, ``constant`` or ``linear``.
        start: impedance where the search begins; default the best of those from a coarse grid. Soft
            walls, and those near the greatest attenuation, have minima beside the true one.
        draws: of the microphones' errors, 0 for none; the paper takes 500 for its method.
        level_error, phase_error: standard deviations, dB and degrees; they weight the fit.
        generator: of random numbers; default one with seed 0.
    Raises:
        ValueError: too few microphones (four; three with the far end stated; one more for a linear
            variation) or one outside the duct, an error below 1e-4, a solver for other frequencies,
            another height, Mach number, sound speed, liner or side of the source, or with several
            patches.
    Warns:
        DataWarning: a fit that did not converge, a misfit that the errors do not explain, a
            negative resistance, an end that reflects more than it gets; the same text is in
            ``notes``.
    """
    require_choice("far_end", far_end, FAR_ENDS)
    require_choice("variation", variation, VARIATIONS)
    waves = {"stated": 1, "fitted": 2}[far_end]
    _check(line, solver, waves + 1 + VARIATIONS.index(variation))
    sources = (line.source_side, other_side(line.source_side))[:waves]
    for name, value in (("level_error (dB)", level_error), ("phase_error (degrees)", phase_error)):
        if not SMALLEST <= value < math.inf:
            raise ValueError(
                f"{name} is {value:g}; it weights the fit and must be finite and at least "
                f"{SMALLEST:g}"
            )
    weights = (1 / (math.log(10) / 20 * level_error), 1 / math.radians(phase_error))
    model = FieldModel(solver, sources, line.x, wall)

    def solved(pressure: Tensor, begin: Tensor | None) -> FieldFit:
        """Of pressures (..., N, F); from the best of a grid if no begin is given."""
        target = pressure.movedim(-2, -1).reshape(-1, len(line.frequency), line.microphones)
        if begin is None:
            found = _constant(model, target, weights, start)
            if variation == "constant":
                return _result(found, model, pressure, line)
            begin = torch.cat([found.wall, torch.zeros_like(found.wall)], -1)
        found = least_squares(model, target, begin, weights)
        return _result(found, model, pressure, line)

    result = solved(line.pressure, None)
    choices = {"method": "field", "wall": wall, "far_end": far_end, "variation": variation,
               "level_error": level_error,
               "phase_error": phase_error, "draws": draws, "source_side": line.source_side,
               "source": line.name, "microphones": line.microphones,
               "unknowns": solver.mesh.unknowns}  # fmt: skip
    result = replace(result, choices=choices, notes=_notes(result, line))
    for note in result.notes:
        warnings.warn(note, DataWarning, stacklevel=2)
    if draws:
        random = generator or torch.Generator().manual_seed(0)
        noisy = draw_pressures(
            line.pressure, draws, random, level_error=level_error, phase_error=phase_error
        )
        begin = torch.stack(
            [result.impedance, result.rise / 2][: 1 + VARIATIONS.index(variation)], -1
        )
        begin = begin.expand(draws, *begin.shape).reshape(-1, *begin.shape[-2:])
        drawn = solved(noisy, begin)
        result = replace(result, draws=drawn)
        lost = int((~drawn.converged).sum())
        if lost:
            note = (
                f"{line.name}: {lost} of {drawn.converged.numel()} draws did not settle in {STEPS} "
                "steps; they count with the best impedance met"
            )
            warnings.warn(note, DataWarning, stacklevel=2)
            result = replace(result, notes=(*result.notes, note))
    return result


def _constant(
    model: FieldModel, pressure: Tensor, weights: tuple[float, float], start: complex | None
) -> Solution:
    """The best constant wall, (B, F, 1)."""
    if start is None:
        return from_grid(model, pressure, weights)
    begin = torch.full((*pressure.shape[:-1], 1), start, dtype=torch.complex128)
    return least_squares(model, pressure, begin.to(pressure.device), weights)


def duct_of_line(line: MicrophoneLine, duct: str | Path) -> tuple[DuctSolver, str]:
    """The solver of a preset or TOML file for a line, and the wall that its microphones are on.

    Args:
        line: its frequencies and the side of its source are taken; height, Mach number and gas must
            be the file's.
        duct: see ``load_duct``.
    """
    setup = load_duct(duct, frequency=line.frequency.tolist(), source_side=line.source_side)
    return DuctSolver(setup.case, setup.frequency, keep="walls"), setup.wall


def _check(line: MicrophoneLine, solver: DuctSolver, unknowns: int) -> None:
    case = solver.case
    if line.source_side not in SOURCES:
        raise ValueError(
            f"{line.name}: source_side is {line.source_side!r}; state upstream or downstream"
        )
    if line.microphones <= unknowns:
        raise ValueError(
            f"{line.name} has {line.microphones} microphones; impedances and amplitudes, "
            f"{unknowns} complex unknowns, need at least {unknowns + 1}"
        )
    if not torch.equal(line.frequency.cpu(), solver.frequency.cpu()):
        raise ValueError(
            f"{line.name} has frequencies {line.frequency.tolist()} Hz, the duct "
            f"{solver.frequency.tolist()} Hz; build the solver for those of the line"
        )
    if len(case.liner) != 1:
        raise ValueError(
            f"the duct has {len(case.liner)} lined patches; one impedance is fitted to one patch"
        )
    stated = {
        "duct_height (m)": (line.duct_height, case.height),
        "mach": (line.mach, case.profile.bulk_mach),
        "sound_speed (m/s)": (line.fluid.sound_speed, case.profile.sound_speed),
    }
    for name, (mine, theirs) in stated.items():
        if abs(float(mine) - float(theirs)) > SAME * max(abs(float(mine)), abs(float(theirs))):
            raise ValueError(
                f"{line.name} has {name} {float(mine):g}, the duct {float(theirs):g}; state one "
                "and the same in both"
            )
    if line.liner_start is not None and line.liner_end is not None:
        start, end = case.liner[0]
        if max(abs(line.liner_start - start), abs(line.liner_end - end)) > SAME_PLACE:
            raise ValueError(
                f"{line.name} has its liner from x = {line.liner_start:g} to {line.liner_end:g} m, "
                f"the duct from {start:g} to {end:g} m; state one and the same in both"
            )
    outside = (line.x < case.start) | (line.x > case.end)
    if bool(outside.any()):
        raise ValueError(
            f"{line.name}: a microphone at x = {float(line.x[outside][0]):g} m lies outside the "
            f"duct, {case.start:g} to {case.end:g} m"
        )


def _result(found: Solution, model: FieldModel, pressure: Tensor, line: MicrophoneLine) -> FieldFit:
    """The record of a solution for pressures (..., N, F)."""
    shape = (*pressure.shape[:-2], pressure.shape[-1])
    case, along = model.solver.case, fine_places(line.x)

    def heard(places: Tensor) -> Tensor:
        fields = replace(model, places=places).in_parts(found.wall)
        total = (fields * found.amplitude[..., None, :]).sum(-1)
        return total.reshape(*shape, len(places)).movedim(-1, -2)

    at_microphones = heard(line.x)
    left = (at_microphones - pressure).abs().square().sum(-2)
    count = found.wall.shape[-1]
    freedom = 2 * (line.microphones - count - len(model.sources))
    far = model.end_reflection(found.wall, found.amplitude, other_side(model.sources[0]))
    rise, rise_error = torch.zeros_like(found.wall[..., 0]), torch.zeros_like(found.wall[..., 0])
    if count == 2:
        rise = 2 * found.wall[..., 1]
        spread = found.covariance.diagonal(dim1=-2, dim2=-1)[..., 2:].clamp(min=0).sqrt()
        rise_error = 2 * torch.complex(spread[..., 0], spread[..., 1])
    return FieldFit(
        method="LEE fit",
        frequency=line.frequency,
        x=line.x,
        impedance=found.wall[..., 0].reshape(shape),
        covariance=found.covariance[..., :2, :2].reshape(*shape, 2, 2),
        rise=rise.reshape(shape),
        rise_error=rise_error.reshape(shape),
        amplitude=case.incident * found.amplitude[..., 0].reshape(shape),
        end_reflection=far.reshape(shape),
        pressure=at_microphones,
        along=along,
        pressure_along=heard(along),
        residual=(left / pressure.abs().square().sum(-2)).sqrt(),
        misfit=(found.cost / freedom).reshape(shape),
        converged=found.converged.reshape(shape),
        source_side=line.source_side,
    )


def _notes(result: FieldFit, line: MicrophoneLine) -> tuple[str, ...]:
    notes = []
    for i, f in enumerate(line.frequency.tolist()):
        lost = int((~result.converged[..., i]).sum())
        if lost:
            notes.append(
                f"{line.name}: the fit at {f:g} Hz did not settle in {STEPS} steps in {lost} of "
                f"{result.converged[..., i].numel()} cases; the impedance is the best one met"
            )
        worst = float(result.misfit[..., i].max())
        if worst > POOR:
            notes.append(
                f"{line.name}: at {f:g} Hz the residuals are {math.sqrt(worst):.3g} times the "
                "stated errors of the microphones: the duct model, the flow, the far end or the "
                "errors are not those of the measurement, or this is not the deepest minimum "
                "(begin elsewhere, start=)"
            )
        least = float(result.impedance[..., i].real.min())
        if least < 0:
            notes.append(f"{line.name}: the resistance at {f:g} Hz is {least:.3g}, below 0")
        most = float(result.end_reflection[..., i].abs().max())
        if most > 1:
            notes.append(
                f"{line.name}: at {f:g} Hz the far end would reflect {most:.3g} times what it gets"
            )
    return tuple(notes)
