r"""Impedance from wall pressures by fitting the linearised Euler equations themselves.

Microphone i hears :math:`\sum_k A_k h_{ik}(\rho)`: for each of K waves sent into the duct the duct's response h to a
unit of it times an amplitude that is not known. With the measured p_i the residuals are those of
:math:`q_i = \sum_k A_k h_{ik}/p_i`: in the real part of q - 1 relative amplitude, in the imaginary part phase, over
their errors. The wall is sought as its reflection :math:`\rho = (Z - 1)/(Z + 1)`, since steps in Z would march to a
rigid wall without end. The derivative by rho is from central differences (h is holomorphic: one serves both parts).

Reflected and evanescent waves of a short liner are part of the model. An end that reflects is a wave that comes in
there: with the far end ``fitted`` it is a second amplitude; with the far end ``stated`` it is what the case says, and a
reflection of 0.05 that the case does not know of moves Z by more than any error of the microphones.
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
from torchliner.duct.presets import load_duct
from torchliner.duct.solver import DuctSolver
from torchliner.names import FAR_ENDS, SOURCES, __version__
from torchliner.pressure.least_squares import Minimum, System, best_of, least_squares, project, solve_linear
from torchliner.pressure.microphone_errors import CONTRADICTED, MicrophoneErrors, field_notes, largest_misfit
from torchliner.records import FieldFit, MicrophoneLine
from torchliner.records.wall_eduction import fine_places

NEAREST = 1e-8  # 1 - rho of what counts as rigid: |Z| = 2e8
FARTHEST = 100.0  # |rho|: Z = -1 to 2 %
TOGETHER = 63  # impedances at once
STEP = 1e-5  # in rho, of differences: good to 1e-10
NEAR = 1e-3  # a last step in rho of a first search
SINGULAR = 1e-15  # of the normal matrix with a diagonal of 1: rounding
ALIKE = (1.0, 1.0)  # weights of amplitude and phase that make the widest valleys
SIZES = (0.0, *(0.01 * 2000 ** (i / 10) for i in range(11)))  # of resistances and reactances to begin from, to 20
STARTS, KEPT = 8, 2  # of all pairs of them, and of the places where first searches end
SAME = 1e-6  # relative, and m, of what line and case both state
LIKE_RIGID = 2.0  # standard errors of rho within which the wall is not told from a rigid one


def fit_field(
    line: MicrophoneLine,
    duct: DuctSolver | str | Path | None = None,
    *,
    wall: str = "opposite",
    far_end: str = "fitted",
    start: complex | None = None,
    **errors: Any,
) -> FieldFit:
    """Impedance of the liner of a duct that fits a line of microphones best.

    Args:
        line: microphones anywhere along the duct, any spacing.
        duct: at the line's frequencies, with one lined patch; or a preset or TOML file (see ``load_duct``), which says
            the wall, too.
        wall: of the microphones, ``opposite`` or ``lined``.
        far_end: reflection of the far end, ``fitted``, or ``stated`` by the case.
        start: impedance where the search begins; default the best of those from a grid. Soft walls, and those near the
            greatest attenuation, have minima beside the true one.
        errors: ``draws``, ``level_error``, ``phase_error`` and ``seed``, as of ``MicrophoneErrors``; they weight
            the fit. Draws whose fit does not settle have no impedance (nan).
    Returns:
        The fit, without gradients.
    Raises:
        ValueError: too few microphones (four; three with the far end stated) or one outside the duct, an error below
            1e-4, no duct, or one of another shape, frequency or liner, or with several patches.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``, with a code.
    """
    if duct is None:
        raise ValueError("a fit of the field needs the duct: state --duct with a preset or a .toml file")
    if isinstance(duct, DuctSolver):
        solver = duct
    else:
        setup = load_duct(duct, frequency=line.frequency.tolist())
        solver, wall = DuctSolver(setup.case, setup.frequency), setup.wall
    require_choice("far_end", far_end, FAR_ENDS)
    assumed, waves = MicrophoneErrors(**errors), {"stated": 1, "fitted": 2}[far_end]
    _check(line, solver, waves + 1)
    pressure, along = line.pressure.detach().to(torch.complex128), fine_places(line.x)
    sources = (line.source_side, other_side(line.source_side))[:waves]
    freedom = 2 * (line.microphones - waves - 1)
    choices: dict[str, Any] = {"method": "field", "wall": wall, "far_end": far_end, "draws": assumed.draws}
    choices |= {"largest_misfit": largest_misfit(freedom, CONTRADICTED), "source_side": line.source_side}
    choices |= {"source": line.name, "microphones": line.microphones, "mach": float(solver.case.profile.bulk_mach)}
    choices |= {**assumed.stated, "unknowns": solver.mesh.unknowns, "version": __version__}

    def search_of(pressure: Tensor) -> WallSearch:
        cases = pressure.movedim(-2, -1).reshape(-1, len(line.frequency), line.microphones)
        return WallSearch(solver, sources, line.x, wall, cases, tuple(1 / part for part in assumed.parts))

    def record_of(found: Minimum, pressure: Tensor, kept: Tensor) -> FieldFit:
        """Of a solution for pressures (..., N, F), nan where it is not kept, (B, F)."""
        shape, z = (*pressure.shape[:-2], pressure.shape[-1]), impedance_from_reflection(found.place[..., 0])
        amplitude = torch.complex(found.amplitude[..., ::2], found.amplitude[..., 1::2])[..., None]
        heard, ends = (each @ amplitude for each in search.response(found.place, torch.cat([line.x, along])))
        heard = torch.where(kept[..., None], heard[..., 0], math.nan).reshape(*shape, -1).movedim(-1, -2)
        at, between = heard.split([line.microphones, len(along)], -2)
        misfit = found.cost / freedom
        used = torch.where(misfit > choices["largest_misfit"], misfit, 1.0)
        return FieldFit(
            method="LEE fit",
            frequency=line.frequency,
            x=line.x,
            impedance=torch.where(kept, z, math.nan).reshape(shape),
            covariance=impedance_covariance(found, used).reshape(*shape, 2, 2),
            amplitude=solver.case.incident * amplitude[..., 0, 0].reshape(shape),
            end_reflection=(ends[..., 0, 0] / ends[..., 1, 0]).reshape(shape),
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

    search = search_of(pressure)
    if start is None:
        found = best_wall(search)
    else:
        wanted = torch.full_like(search.pressure[..., :1], start)
        found = least_squares(search.system, bounded(reflection_from_impedance(wanted)), search.move)

    def drawn(pressure: Tensor) -> FieldFit:
        again = least_squares(search_of(pressure).system, found.place.repeat(assumed.draws, 1, 1), search.move)
        return record_of(again, pressure, again.converged)

    result = record_of(found, pressure, torch.ones_like(found.converged))
    result = assumed.with_draws(result, pressure, freedom, drawn)
    notes = field_notes(result)
    tell([str(note) for note in notes])
    return replace(result, notes=notes)


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
class WallSearch:
    """rho as Re rho, Im rho, in a duct that waves are sent into."""

    solver: DuctSolver
    sources: Sequence[str]  # sides that waves are sent from, (K,)
    places: Tensor  # x, m, (N,)
    wall: str  # of the places, ``opposite`` or ``lined``
    pressure: Tensor  # Pa, (B, F, N); frequencies share the solutions of a duct
    weights: tuple[float, ...]  # 1 over the error of the amplitude's logarithm, and of the phase in radians

    def response(self, rho: Tensor, places: Tensor) -> tuple[Tensor, Tensor]:
        """Of walls (B, F, 1) h at places (m, (X,)), Pa, (B, F, X, K), for the case's own incident amplitude, and the
        plane-like mode in and out at the far end, (B, F, 2, K); warnings of a trial are not passed on."""
        parts, end = [], other_side(self.sources[0])
        for some in rho.split(TOGETHER):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DataWarning)
                fields = [self.solver.solve(impedance_from_reflection(some), side) for side in self.sources]
            pressure = torch.stack([field.wall_pressure(places, self.wall) for field in fields], -1)
            parts.append((pressure, torch.stack([torch.stack(field.end_waves(end), -1) for field in fields], -1)))
        pressure, ends = (torch.cat(each) for each in zip(*parts, strict=True))
        return pressure, ends

    def system(self, place: Tensor, index: Tensor) -> System:
        """Residuals (B, F, 2 N) and their derivatives by Re rho, Im rho, with Re A, Im A, ..."""
        pressure, walls = self.pressure[index], torch.cat([place, place + STEP, place - STEP])
        value, above, below = self.response(walls, self.places)[0].chunk(3)
        slope = (above - below) / (2 * STEP)
        by_place = torch.stack([self._in_parts(turn * slope, pressure) for turn in (1, 1j)], -3)
        target = torch.cat([torch.full_like(pressure.real, self.weights[0]), torch.zeros_like(pressure.real)], -1)
        return project(self._in_parts(value, pressure), by_place, target)

    def _in_parts(self, fields: Tensor, pressure: Tensor) -> Tensor:
        """What amplitudes Re A, Im A, ... add to level and phase, over their errors, (..., F, 2 N, 2 K)."""
        share = fields / pressure[..., None]
        both = torch.stack([share, 1j * share], -1).flatten(-2)
        return torch.cat([both.real * self.weights[0], both.imag * self.weights[1]], -2)

    def move(self, place: Tensor, step: Tensor, _: Tensor) -> tuple[Tensor, bool]:
        """Walls within the bounds of rho."""
        return bounded(place + torch.complex(step[..., ::2], step[..., 1::2])), True


def best_wall(search: WallSearch) -> Minimum:
    """The best wall with no guess, from the best of a grid of impedances.

    Quiet microphones and phases that count more than levels make narrow valleys: the grid is compared by pressure, not
    by its logarithm, and the first search takes relative errors of both parts alike.
    """
    pressure, signed = search.pressure, sorted({sign * size for size in SIZES for sign in (-1, 1)})
    walls = torch.tensor([complex(r, x) for r in SIZES for x in signed], dtype=torch.complex128)
    places = bounded(reflection_from_impedance(walls)).to(pressure.device)[:, None]
    fields, _ = search.response(places[:, None].expand(-1, pressure.shape[-2], -1), search.places)  # (G, F, N, K)
    misfit = torch.stack([solve_linear(each, pressure)[-1].norm(dim=-1) for each in fields])
    best = places[misfit.topk(STARTS, 0, largest=False).indices]  # (S, B, F, 1)
    alike = replace(search, pressure=pressure.repeat(STARTS, 1, 1), weights=ALIKE)
    rough = least_squares(alike.system, best.flatten(0, 1), alike.move, tolerance=NEAR)
    kept = rough.cost.reshape(best.shape[:-1]).topk(KEPT, 0, largest=False).indices[..., None]
    places = rough.place.reshape(best.shape).gather(0, kept)
    return best_of(least_squares(search.system, each, search.move) for each in places)


def bounded(rho: Tensor) -> Tensor:
    """Moved off 1 and infinity, where Z has no number or is -1."""
    rho = rho * (FARTHEST / rho.abs().clamp(min=FARTHEST))
    return torch.where((1 - rho).abs() < NEAREST, 1 - NEAREST, rho)


def impedance_covariance(found: Minimum, scale: Tensor) -> Tensor:
    """Of Re Z and Im Z, (B, F, 2, 2), to first order, for errors that are ``scale`` times, in variance, (B, F), those
    that the weights are from: large where nothing is known, diagonal and infinite where a rigid wall lies within two
    standard errors."""
    normal, away = found.jacobian.mT @ found.jacobian, 1 - found.place[..., 0]
    size = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30).rsqrt()
    by = size[..., :, None] * size[..., None, :]
    own = scale[..., None, None] * by * torch.linalg.inv(normal * by + SINGULAR * torch.eye(2).to(normal))
    error, slope = own.diagonal(dim1=-2, dim2=-1).sum(-1).clamp(min=0).sqrt(), 2 / away**2
    turn = torch.view_as_real(torch.stack([slope, 1j * slope], -1)).mT  # Re Z, Im Z by Re rho, Im rho
    infinite = torch.diag_embed(torch.full_like(size, torch.inf))
    return torch.where((away.abs() < LIKE_RIGID * error)[..., None, None], infinite, turn @ own @ turn.mT)
