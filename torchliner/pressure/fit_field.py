"""Impedance from wall pressures by fitting the linearised Euler equations themselves.

Reflected and evanescent waves of a short liner are part of the model; ``field_model.py`` says what is minimised. An end
that reflects is a wave that comes in there. With the far end ``fitted`` it is a second amplitude, in which the field is
linear; with the far end ``stated`` it is what the case says, and a reflection of 0.05 that the case does not know of
moves Z by more than any error of the microphones.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.duct.case import other_side
from torchliner.duct.presets import load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.least_squares import Minimum
from torchliner.names import FAR_ENDS, SOURCES, __version__
from torchliner.pressure.field_model import (
    FieldModel,
    best_wall,
    bounded,
    covariance_of,
    impedance_at,
    impedance_covariance,
    like_rigid,
    search,
)
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, largest_misfit
from torchliner.pressure.notes import field_notes
from torchliner.records import FieldFit, MicrophoneLine
from torchliner.records.wall_eduction import fine_places

SAME = 1e-6  # relative, and m, of what line and case both state
FIRST_ORDER = 6.0  # standard errors of rho; nearer to a rigid wall Z is not linear over them
SMALLEST = 1e-4  # dB, degrees: no microphone is as good, and rounding keeps smaller ones apart
NOTHING = complex(math.nan, math.nan)


def fit_field(
    line: MicrophoneLine,
    solver: DuctSolver,
    *,
    wall: str = "opposite",
    far_end: str = "fitted",
    start: complex | None = None,
    **errors: Any,
) -> FieldFit:
    """Impedance of the liner of a duct that fits a line of microphones best.

    Args:
        line: microphones anywhere along the duct, any spacing.
        solver: the duct, at the line's frequencies, with one lined patch.
        wall: of the microphones, ``opposite`` or ``lined``.
        far_end: ``fitted``, it reflects what is found, or ``stated``, what the case says.
        start: impedance where the search begins; default the best of those from a grid. Soft walls, and those near the
            greatest attenuation, have minima beside the true one.
        errors: ``draws``, ``level_error``, ``phase_error`` and ``generator``, as of ``MicrophoneErrors``; they weight
            the fit. Draws whose fit does not settle have no impedance (nan).
    Returns:
        The fit, without gradients.
    Raises:
        ValueError: too few microphones (four; three with the far end stated) or one outside the duct, an error below
            1e-4, a solver for another duct, frequency or liner, or with several patches; a stated far end whose
            reflection is stated for a source on the other side.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``, with a code.
    """
    require_choice("far_end", far_end, FAR_ENDS)
    assumed = MicrophoneErrors(**errors)
    assumed.require_above(SMALLEST)
    waves = {"stated": 1, "fitted": 2}[far_end]
    _check(line, solver, waves + 1, far_end)
    model = FieldModel(solver, (line.source_side, other_side(line.source_side))[:waves], line.x, wall)
    weights = (1 / assumed.parts[0], 1 / assumed.parts[1])
    freedom = 2 * (line.microphones - waves - 1)
    choices = {"method": "field", "wall": wall, "far_end": far_end, **assumed.choices, "draws": assumed.draws}
    choices |= {"largest_misfit": largest_misfit(freedom, CONTRADICTED), "source_side": line.source_side}
    choices |= {"source": line.name, "microphones": line.microphones, "mach": float(solver.case.profile.bulk_mach)}
    choices |= {"unknowns": solver.mesh.unknowns, "version": __version__}
    pressure = line.pressure.detach().to(torch.complex128)
    target = _cases(pressure)
    if start is None:
        found = best_wall(model, target, weights, freedom * largest_misfit(freedom))
    else:
        if math.isnan(abs(complex(start))) or start == -1:
            raise ValueError(f"start is {start}; an impedance other than -1 is needed")
        wanted = torch.full((*target.shape[:-1], 1), complex(start), dtype=torch.complex128, device=target.device)
        found = search(model, target, bounded(reflection_from_impedance(wanted)), weights)
    result = _result(found, model, pressure, line, freedom, choices)

    def drawn(pressure: Tensor) -> FieldFit:
        again = search(model, _cases(pressure), found.place.repeat(assumed.draws, 1, 1), weights)
        return _result(again, model, pressure, line, freedom, choices, all_of_them=False)

    result = assumed.with_draws(result, pressure, freedom, drawn)
    spread = result.error_scale.reshape(found.cost.shape)[..., None, None] ** 2 * covariance_of(found)
    rho = found.place[..., 0]
    doubts = like_rigid(rho, spread), like_rigid(rho, spread, FIRST_ORDER), model.gains(found.place)
    notes = field_notes(result, *(each.reshape(result.impedance.shape) for each in doubts))
    tell([str(note) for note in notes])
    return replace(result, notes=notes)


def _cases(pressure: Tensor) -> Tensor:
    """(..., N, F) as (B, F, N)."""
    return pressure.movedim(-2, -1).reshape(-1, pressure.shape[-1], pressure.shape[-2])


def fit_line(line: MicrophoneLine, *, duct: str | Path | None = None, **options: Any) -> FieldFit:
    """``fit_field`` in the duct of a preset or TOML file (see ``load_duct``), at the line's frequencies.

    Raises:
        ValueError: no duct is stated; as ``fit_field``, whose ``options`` may be given but for the wall.
    """
    if duct is None:
        raise ValueError("a fit of the field needs the duct: state --duct with a preset or a .toml file")
    setup = load_duct(duct, frequency=line.frequency.tolist())
    return fit_field(line, DuctSolver(setup.case, setup.frequency), wall=setup.wall, **options)


def _check(line: MicrophoneLine, solver: DuctSolver, unknowns: int, far_end: str) -> None:
    """Refuse what cannot be fitted, or is of another duct."""
    case, side, count, wrong = solver.case, line.source_side, line.microphones, list[str]()
    if len(case.liner) != 1:
        raise ValueError(f"the duct has {len(case.liner)} lined patches; one impedance is fitted to one patch")
    both = {  # of line and duct; the line may leave a number out
        "duct_height (m)": (line.duct_height, case.height),
        "mach": (line.mach, case.profile.bulk_mach),
        "sound_speed (m/s)": (line.fluid.sound_speed, case.profile.sound_speed),
        "liner_start (m)": (line.liner_start, case.liner[0][0]),
        "liner_end (m)": (line.liner_end, case.liner[0][1]),
    }
    for what, (mine, theirs) in both.items():
        if mine is not None and not math.isclose(mine, theirs, rel_tol=SAME, abs_tol=SAME * ("liner" in what)):
            wrong.append(f"{what} is {float(mine):g}, of the duct {float(theirs):g}; state the same in both")
    if side not in SOURCES:
        wrong.append(f"source_side is {side!r}; state upstream or downstream (in the file, or --source-side)")
    if count <= unknowns:
        wrong.append(f"{count} microphones are too few for {unknowns} complex unknowns (impedance, amplitudes)")
    if not torch.equal(line.frequency.cpu(), solver.frequency.cpu()):
        wrong.append(f"frequencies are {line.frequency.tolist()} Hz, of the duct {solver.frequency.tolist()} Hz")
    if outside := line.x[(line.x < case.start) | (line.x > case.end)].tolist():
        wrong.append(f"microphones at x = {outside} m lie outside the duct, {case.start:g} to {case.end:g} m")
    stated = torch.cat([torch.as_tensor(r).flatten() for r in (case.end_reflection, case.source_reflection)])
    if far_end == "stated" and side != case.source and bool(stated.any()):
        sides = f"are stated for a source {case.source}, the line has its source {side}"
        wrong.append(f"the reflections of the duct {sides}; state them for that one, or take far_end='fitted'")
    if wrong:
        raise ValueError(f"{line.name}: {'; '.join(wrong)}")


def _result(
    found: Minimum,
    model: FieldModel,
    pressure: Tensor,
    line: MicrophoneLine,
    freedom: int,
    choices: dict[str, Any],
    all_of_them: bool = True,
) -> FieldFit:
    """The record of a solution for pressures (..., N, F); of all of them, or with nan where the fit did not settle."""
    shape = (*pressure.shape[:-2], pressure.shape[-1])
    along, rho, lost = fine_places(line.x), found.place[..., 0], ~(found.converged | all_of_them)
    amplitude = torch.complex(found.amplitude[..., ::2], found.amplitude[..., 1::2])
    *pressures, far = model.heard(found.place, amplitude, along)
    at, between = (p.masked_fill(lost[..., None], NOTHING).reshape(*shape, -1).movedim(-1, -2) for p in pressures)
    misfit = found.cost / freedom
    used = torch.where(misfit > choices["largest_misfit"], misfit, 1.0)[..., None, None]
    return FieldFit(
        method="LEE fit",
        frequency=line.frequency,
        x=line.x,
        impedance=impedance_at(rho).masked_fill(lost, NOTHING).reshape(shape),
        covariance=impedance_covariance(rho, used * covariance_of(found)).reshape(*shape, 2, 2),
        amplitude=model.solver.case.incident * amplitude[..., 0].reshape(shape),
        end_reflection=far.reshape(shape),
        pressure=at,
        along=along,
        pressure_along=between,
        residual=(at - pressure).norm(dim=-2) / pressure.norm(dim=-2),
        misfit=misfit.reshape(shape),
        converged=found.converged.reshape(shape),
        source_side=line.source_side,
        choices=choices,
        line=line,
        freedom=freedom,
    )
