r"""Impedance from wall pressures by fitting the linearised Euler equations themselves.

Microphone i hears :math:`\sum_k A_k h_{ik}(\rho)`: for each of K waves sent into the duct, one from the source or one
from either end, the duct's response h to a unit of it times an amplitude that is not known. With the measured p_i the
residuals are those of :math:`q_i = \sum_k A_k h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the
imaginary part phase, each over its stated error. The wall is sought as its reflection :math:`\rho = (Z - 1)/(Z + 1)`,
since steps in Z would march to a rigid wall without end. Levenberg and Marquardt's method takes the derivative of the
field by rho from central differences (h is holomorphic: one serves both parts); A is solved for at every place.

Reflected and evanescent waves of a short liner are part of the model. An end that reflects is a wave that comes in
there. With the far end ``fitted`` it is a second amplitude, in which the field is linear; with the far end ``stated``
it is what the case says, and a reflection of 0.05 that the case does not know of moves Z by more than any error of the
microphones.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import DataWarning, require_choice, tell
from torchliner.conversions import impedance_from_reflection, reflection_from_impedance
from torchliner.duct.case import other_side
from torchliner.duct.field import DuctField
from torchliner.duct.presets import load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.names import FAR_ENDS, SOURCES, __version__
from torchliner.pressure.least_squares import Minimum, Problem, System, best_of, least_squares, project, solve_linear
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, field_notes, largest_misfit
from torchliner.records import FieldFit, MicrophoneLine
from torchliner.records.wall_eduction import fine_places

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %
TOGETHER = 63  # impedances at once
STEP = 1e-5  # in rho, of differences: good to 1e-10
TOLERANCE, NEAR = 1e-9, 1e-3  # of a step in rho: of the last one, and of a first search
KEPT = 2  # of the places that first searches end at
SINGULAR = 1e-15  # of the normal matrix with a diagonal of 1: rounding
ALIKE = (1.0, 1.0)  # weights of amplitude and phase that make the widest valleys
SIZES = (0.0, *(0.01 * 2000 ** (i / 10) for i in range(11)))  # of resistances and reactances to begin from, to 20
STARTS = 8  # of all pairs of them
SAME = 1e-6  # relative, and m, of what line and case both state
LIKE_RIGID = 2.0  # standard errors of rho within which the wall is not told from a rigid one


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
            1e-4, a solver for another duct, frequency or liner, or with several patches.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``, with a code.
    """
    require_choice("far_end", far_end, FAR_ENDS)
    assumed, waves = MicrophoneErrors(**errors), {"stated": 1, "fitted": 2}[far_end]
    _check(line, solver, waves + 1)
    pressure, along = line.pressure.detach().to(torch.complex128), fine_places(line.x)
    sources = (line.source_side, other_side(line.source_side))[:waves]
    problem = WallSearch(solver, sources, line.x, wall, _cases(pressure), tuple(1 / part for part in assumed.parts))
    freedom = 2 * (line.microphones - waves - 1)
    choices: dict[str, Any] = {"method": "field", "wall": wall, "far_end": far_end, "draws": assumed.draws}
    choices |= {"largest_misfit": largest_misfit(freedom, CONTRADICTED), "source_side": line.source_side}
    choices |= {"source": line.name, "microphones": line.microphones, "mach": float(solver.case.profile.bulk_mach)}
    choices |= {**assumed.stated, "unknowns": solver.mesh.unknowns, "version": __version__}

    def record_of(found: Minimum, pressure: Tensor, lost: Tensor) -> FieldFit:
        """Of a solution for pressures (..., N, F), nan where it is lost, (B, F)."""
        shape, rho = (*pressure.shape[:-2], pressure.shape[-1]), found.place[..., 0]
        amplitude, *pressures, far = problem.heard(found, along)
        at, between = (p.masked_fill(lost[..., None], math.nan).reshape(*shape, -1).movedim(-1, -2) for p in pressures)
        misfit = found.cost / freedom
        used = torch.where(misfit > choices["largest_misfit"], misfit, 1.0)[..., None, None]
        return FieldFit(
            method="LEE fit",
            frequency=line.frequency,
            x=line.x,
            impedance=impedance_from_reflection(rho).masked_fill(lost, math.nan).reshape(shape),
            covariance=impedance_covariance(rho, used * covariance_of(found)).reshape(*shape, 2, 2),
            amplitude=solver.case.incident * amplitude[..., 0].reshape(shape),
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

    if start is None:
        found = best_wall(problem)
    else:
        wanted = torch.full((*problem.pressure.shape[:-1], 1), complex(start), dtype=torch.complex128)
        found = least_squares(problem, bounded(reflection_from_impedance(wanted)).to(pressure.device))
    result = record_of(found, pressure, torch.zeros_like(found.converged))

    def drawn(pressure: Tensor) -> FieldFit:
        again = replace(problem, pressure=_cases(pressure))
        settled = least_squares(again, found.place.repeat(assumed.draws, 1, 1))
        return record_of(settled, pressure, ~settled.converged)

    result = assumed.with_draws(result, pressure, freedom, drawn)
    notes = field_notes(result)
    tell([str(note) for note in notes])
    return replace(result, notes=notes)


def _cases(pressure: Tensor) -> Tensor:
    """(..., N, F) as (B, F, N)."""
    return pressure.movedim(-2, -1).reshape(-1, pressure.shape[-1], pressure.shape[-2])


def fit_line(line: MicrophoneLine, *, duct: str | Path | None = None, **options: Any) -> FieldFit:
    """``fit_field`` in the duct of a preset or TOML file (see ``load_duct``), at the line's frequencies, with the
    ``options`` of ``fit_field`` but for the wall."""
    if duct is None:
        raise ValueError("a fit of the field needs the duct: state --duct with a preset or a .toml file")
    setup = load_duct(duct, frequency=line.frequency.tolist())
    return fit_field(line, DuctSolver(setup.case, setup.frequency), wall=setup.wall, **options)


def _check(line: MicrophoneLine, solver: DuctSolver, unknowns: int) -> None:
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
    if wrong:
        raise ValueError(f"{line.name}: {'; '.join(wrong)}")


@dataclass(frozen=True, eq=False)
class WallSearch(Problem):
    """rho as Re rho, Im rho, in a duct that waves are sent into."""

    solver: DuctSolver
    sources: Sequence[str]  # sides that waves are sent from, (K,)
    places: Tensor  # x, m, (N,)
    wall: str  # of the places, ``opposite`` or ``lined``
    pressure: Tensor  # Pa, (B, F, N); frequencies share the solutions of a duct
    weights: tuple[float, ...]  # 1 over the error of the amplitude's logarithm, and of the phase in radians
    tolerance: float = TOLERANCE  # of the last step

    def fields(self, rho: Tensor) -> list[DuctField]:
        """For each source, of walls (B, F, 1); warnings of a trial are not passed on."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return [self.solver.solve(impedance_from_reflection(rho), side) for side in self.sources]

    def response(self, fields: Sequence[DuctField], places: Tensor) -> Tensor:
        """h, Pa, (B, F, N, K), for the case's own incident amplitude."""
        return torch.stack([field.wall_pressure(places, self.wall) for field in fields], -1)

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals (B, F, 2 N) and their derivatives by Re rho, Im rho, with Re A, Im A, ..."""
        pressure, both = self.pressure[index], []
        for rho in place.split(TOGETHER // 3):
            walls = torch.cat([rho, rho + STEP, rho - STEP])
            both.append(self.response(self.fields(walls), self.places).unflatten(0, (3, -1)))
        value, above, below = torch.cat(both, 1)
        slope = (above - below) / (2 * STEP)
        by_place = torch.stack([self._in_parts(turn * slope, pressure) for turn in (1, 1j)], -3)
        one = torch.ones_like(pressure.real)
        target = torch.cat([one * self.weights[0], 0 * one], -1)
        return project(self._in_parts(value, pressure), by_place, target)

    def _in_parts(self, fields: Tensor, pressure: Tensor) -> Tensor:
        """What amplitudes Re A, Im A, ... add to level and phase, over their errors, (..., F, 2 N, 2 K)."""
        share = fields / pressure[..., None]
        both = torch.stack([share, 1j * share], -1).flatten(-2)
        return torch.cat([both.real * self.weights[0], both.imag * self.weights[1]], -2)

    def move(self, place: Tensor, step: Tensor, index: Tensor) -> tuple[Tensor, Tensor | bool]:
        """Walls within the bounds of rho."""
        del index
        return bounded(place + torch.complex(step[..., ::2], step[..., 1::2])), True

    def heard(self, found: Minimum, along: Tensor) -> tuple[Tensor, ...]:
        """Of a minimum the amplitudes A, (B, F, K), the pressure at the places, Pa, (B, F, N), and at ``along`` (m,
        (X,)), (B, F, X), and of the end away from the first source the plane-like mode in over out, (B, F)."""
        amplitudes = torch.complex(found.amplitude[..., ::2], found.amplitude[..., 1::2])
        parts, end = [], other_side(self.sources[0])
        for rho, a in zip(found.place.split(TOGETHER), amplitudes.split(TOGETHER), strict=True):
            fields = self.fields(rho)
            waves = torch.stack([torch.stack(field.end_waves(end), -1) for field in fields], -1)
            sent, out = (waves * a[..., None, :]).sum(-1).unbind(-1)
            lines = [(self.response(fields, x) * a[..., None, :]).sum(-1) for x in (self.places, along)]
            parts.append((a, *lines, sent / out))
        return tuple(torch.cat(each) for each in zip(*parts, strict=True))


def best_wall(problem: WallSearch) -> Minimum:
    """The best wall with no guess, from the best of a grid of impedances.

    Quiet microphones and phases that count more than levels make narrow valleys: the grid is compared by pressure, not
    by its logarithm, and the first search takes relative errors of both parts alike.
    """
    pressure, signed = problem.pressure, sorted({sign * size for size in SIZES for sign in (-1, 1)})
    walls = torch.tensor([complex(r, x) for r in SIZES for x in signed], dtype=torch.complex128)
    places = bounded(reflection_from_impedance(walls)).to(pressure.device)[:, None]
    parts = places[:, None].expand(-1, pressure.shape[-2], -1).split(TOGETHER)
    fields = torch.cat([problem.response(problem.fields(part), problem.places) for part in parts])  # (G, F, N, K)
    misfit = torch.stack([solve_linear(each, pressure)[-1].norm(dim=-1) for each in fields])
    best = places[misfit.topk(STARTS, 0, largest=False).indices]  # (S, B, F, 1)
    alike = replace(problem, pressure=pressure.repeat(STARTS, 1, 1), weights=ALIKE, tolerance=NEAR)
    rough = least_squares(alike, best.flatten(0, 1))
    kept = rough.cost.reshape(best.shape[:-1]).topk(KEPT, 0, largest=False).indices[..., None]
    return best_of(least_squares(problem, each) for each in rough.place.reshape(best.shape).gather(0, kept))


def bounded(rho: Tensor) -> Tensor:
    """Moved off 1 and infinity, where Z has no number or is -1."""
    rho = rho * (FARTHEST / rho.abs().clamp(min=FARTHEST))
    return torch.where((1 - rho).abs() < NEAREST, 1 - NEAREST, rho)


def covariance_of(found: Minimum) -> Tensor:
    """Of Re rho and Im rho, (B, F, 2, 2), for the errors that the weights are from; large, and not 0 as of a
    pseudo-inverse, where nothing is known."""
    normal = found.jacobian.mT @ found.jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30).rsqrt()
    by = scale[..., :, None] * scale[..., None, :]
    values, vectors = torch.linalg.eigh(normal * by)
    inverse: Tensor = by * ((vectors / values.clamp(min=SINGULAR)[..., None, :]) @ vectors.mT)
    return inverse


def impedance_covariance(rho: Tensor, covariance: Tensor) -> Tensor:
    """Of Re Z and Im Z, (..., 2, 2), from that of Re rho and Im rho, to first order; diagonal and infinite where a
    rigid wall lies within two standard errors."""
    error = covariance.diagonal(dim1=-2, dim2=-1).sum(-1).clamp(min=0).sqrt()
    slope = 2 / (1 - rho) ** 2
    turn = torch.stack([torch.stack([slope.real, -slope.imag], -1), torch.stack([slope.imag, slope.real], -1)], -2)
    infinite = torch.diag_embed(torch.full_like(covariance[..., 0], torch.inf))
    rigid = ((1 - rho).abs() < LIKE_RIGID * error)[..., None, None]
    return torch.where(rigid, infinite, turn @ covariance @ turn.mT)
