r"""Impedance from wall pressures by fitting the linearised Euler equations themselves.

The pressure at microphone i is :math:`A h_i(Z)`, the duct's response to a unit incident wave times
an amplitude A that is not known. With the measured p_i the residuals are those of
:math:`q_i = A h_i(Z)/p_i`: in the real part of q - 1 relative amplitude, in the imaginary part
phase, each over its stated error. Four real unknowns, Z and A, by Levenberg and Marquardt's method
with the exact derivative of the field by Z (h is holomorphic in Z, so one derivative serves both
parts). No mode is singled out and nothing is assumed of the waves in the duct but the equations:
reflected and evanescent waves of a short liner are part of h.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable

import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from torchliner.checks import DataWarning
from torchliner.duct.lee import DuctSolver
from torchliner.eduction.microphone_errors import LEVEL_ERROR, PHASE_ERROR, draw_pressures
from torchliner.records import FieldFit, MicrophoneLine

STEPS = 60
TOLERANCE = 1e-9  # of Z, relative to 1 + |Z|
START_R = (0.1, 0.3, 0.7, 1.5, 3.0, 6.0)
START_X = (-4.0, -2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0, 4.0)
SAME = 1e-6  # relative, of what line and case both state
POOR = 3.0  # chi squared over its degrees of freedom
TOGETHER = 64  # impedances at once

Response = Callable[[Tensor], Tensor]


def fit_field(
    line: MicrophoneLine,
    solver: DuctSolver,
    *,
    wall: str = "opposite",
    draws: int = 0,
    level_error: float = LEVEL_ERROR,
    phase_error: float = PHASE_ERROR,
    generator: torch.Generator | None = None,
) -> FieldFit:
    """Impedance of the liner of a duct that fits a line of microphones best.

    Args:
        line: microphones anywhere along the duct, any spacing; at least three.
        solver: the duct, at the line's frequencies.
        wall: of the microphones, ``opposite`` or ``lined``.
        draws: of the microphones' errors, 0 for none; the paper takes 500 for its method.
        level_error, phase_error: standard deviations, dB and degrees; they weight the fit.
        generator: of random numbers; default one with seed 0.
    Raises:
        ValueError: fewer than three microphones, a microphone outside the duct, a solver for other
            frequencies, another height, Mach number, sound speed or side of the source.
    Warns:
        DataWarning: a fit that did not converge, a misfit that the errors do not explain, a
            negative resistance; the same text is in ``notes``.
    """
    _check(line, solver)
    weights = (1 / (math.log(10) / 20 * level_error), 1 / math.radians(phase_error))
    places = line.x.cpu().numpy()

    def response(impedance: Tensor) -> Tensor:
        """h, Pa, (..., F, N): of the case's own incident amplitude."""
        return solver.solve(impedance[..., None], line.source_side).wall_pressure(places, wall)

    pressure = line.pressure.movedim(-2, -1)  # (..., F, N)
    start = _best_of_grid(response, pressure, weights)
    result = _fitted(response, pressure, start, weights, line)
    notes = _notes(result, line)
    choices = {"wall": wall, "level_error": level_error, "phase_error": phase_error,
               "draws": draws, "unknowns": solver.mesh.unknowns}  # fmt: skip
    if draws:
        random = generator or torch.Generator().manual_seed(0)
        noisy = draw_pressures(
            line.pressure, draws, random, level_error=level_error, phase_error=phase_error
        ).movedim(-2, -1)
        begin = result.impedance.expand(draws, *result.impedance.shape).clone()
        drawn = _fitted(response, noisy, begin, weights, line)
        result = dataclasses.replace(result, draws=drawn)
    for note in notes:
        warnings.warn(note, DataWarning, stacklevel=2)
    scale = solver.case.incident
    return dataclasses.replace(
        result, amplitude=result.amplitude * scale, choices=choices, notes=notes
    )


def _check(line: MicrophoneLine, solver: DuctSolver) -> None:
    case = solver.case
    if line.microphones < 3:
        raise ValueError(
            f"{line.name} has {line.microphones} microphones; Z and the amplitude need three"
        )
    if not torch.equal(line.frequency.cpu(), solver.frequency.cpu()):
        raise ValueError(
            f"{line.name} has frequencies {line.frequency.tolist()} Hz, the duct "
            f"{solver.frequency.tolist()} Hz; build the solver for those of the line"
        )
    stated = {
        "duct_height (m)": (line.duct_height, case.height),
        "mach": (line.mach, case.profile.bulk_mach),
        "sound_speed (m/s)": (line.fluid.sound_speed, case.profile.sound_speed),
    }
    for name, (mine, theirs) in stated.items():
        if abs(float(mine) - float(theirs)) > SAME * max(abs(float(mine)), abs(float(theirs))):
            raise ValueError(f"{line.name} has {name} {float(mine):g}, the duct {float(theirs):g}")
    if line.source_side not in ("upstream", "downstream"):
        raise ValueError(
            f"{line.name}: source_side is {line.source_side!r}; state upstream or downstream"
        )
    outside = (line.x < case.start) | (line.x > case.end)
    if bool(outside.any()):
        raise ValueError(
            f"{line.name}: a microphone at x = {float(line.x[outside][0]):g} m lies outside the "
            f"duct, {case.start:g} to {case.end:g} m"
        )


def _in_parts(response: Response, impedance: Tensor) -> Tensor:
    """(B, F) to (B, F, N), some impedances at a time."""
    return torch.cat([response(part) for part in impedance.split(TOGETHER)])


def _best_of_grid(response: Response, pressure: Tensor, weights: tuple[float, float]) -> Tensor:
    """The impedance of a coarse grid that fits best, (..., F)."""
    grid = torch.tensor([complex(r, x) for r in START_R for x in START_X], dtype=torch.complex128)
    count = pressure.shape[-2]
    fields = _in_parts(response, grid[:, None].expand(-1, count))  # (G, F, N)
    lead = (1,) * (pressure.ndim - 2)
    fields = fields.reshape(len(grid), *lead, *fields.shape[1:])
    amplitude = _linear_amplitude(fields, pressure)
    residual = _residual(amplitude[..., None] * fields / pressure - 1, weights)
    best = residual.square().sum(-1).argmin(0)
    return grid[best]


def _linear_amplitude(fields: Tensor, pressure: Tensor) -> Tensor:
    """A of least relative error, (...)."""
    ratio = fields / pressure
    return ratio.conj().sum(-1) / ratio.abs().square().sum(-1)


def _residual(away: Tensor, weights: tuple[float, float]) -> Tensor:
    """Real and imaginary parts of q - 1 over their errors, (..., 2 N)."""
    return torch.cat([away.real * weights[0], away.imag * weights[1]], -1)


def _with_slope(response: Response, impedance: Tensor) -> tuple[Tensor, Tensor]:
    """h and dh/dZ, (B, F, N), by forward differentiation."""
    values, slopes = [], []
    for part in impedance.split(TOGETHER):
        with forward_ad.dual_level():
            both = response(forward_ad.make_dual(part, torch.ones_like(part)))
            value, slope = forward_ad.unpack_dual(both)
        values.append(value.detach())
        slopes.append(slope.detach())
    return torch.cat(values), torch.cat(slopes)


def _system(
    response: Response, impedance: Tensor, amplitude: Tensor, pressure: Tensor,
    weights: tuple[float, float],
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Residuals (B, F, 2 N) and their derivatives by R, X, Re A/|A|, Im A/|A|, (B, F, 2 N, 4)."""
    fields, slope = _with_slope(response, impedance)
    model = amplitude[..., None] * fields / pressure
    by_z = amplitude[..., None] * slope / pressure
    # A moves relative to itself, so that its size does not matter.
    columns = [by_z, 1j * by_z, model, 1j * model]
    jacobian = torch.stack([_residual(column, weights) for column in columns], -1)
    return _residual(model - 1, weights), jacobian


def _fitted(
    response: Response, pressure: Tensor, start: Tensor, weights: tuple[float, float],
    line: MicrophoneLine,
) -> FieldFit:  # fmt: skip
    """Levenberg-Marquardt on all cases, draws and frequencies at once: (..., F, N)."""
    shape, count = pressure.shape[:-1], pressure.shape[-1]
    target = pressure.reshape(-1, *pressure.shape[-2:])
    z = start.reshape(-1, shape[-1]).to(torch.complex128)
    a = _linear_amplitude(_in_parts(response, z), target)
    residual, jacobian = _system(response, z, a, target, weights)
    cost = residual.square().sum(-1)
    damping = torch.full_like(cost, 1e-3)
    moved = torch.full_like(cost, torch.inf)
    for _ in range(STEPS):
        step = _damped_step(residual, jacobian, damping)
        new_z = z + torch.complex(step[..., 0], step[..., 1])
        new_a = a * (1 + torch.complex(step[..., 2], step[..., 3]))
        new_residual, new_jacobian = _system(response, new_z, new_a, target, weights)
        new_cost = new_residual.square().sum(-1)
        better = new_cost <= cost
        moved = torch.where(better, step[..., :2].norm(dim=-1) / (1 + z.abs()), moved)
        z, a = torch.where(better, new_z, z), torch.where(better, new_a, a)
        residual = torch.where(better[..., None], new_residual, residual)
        jacobian = torch.where(better[..., None, None], new_jacobian, jacobian)
        cost = torch.where(better, new_cost, cost)
        damping = torch.where(better, damping / 10, damping * 10).clamp(1e-12, 1e12)
        stuck = damping >= 1e8
        if bool(((moved < TOLERANCE) | stuck).all()):
            break
    covariance = torch.linalg.pinv(jacobian.mT @ jacobian, hermitian=True)[..., :2, :2]
    model = a[..., None] * _in_parts(response, z)
    return FieldFit(
        frequency=line.frequency,
        x=line.x,
        impedance=z.reshape(shape),
        covariance=covariance.reshape(*shape, 2, 2),
        amplitude=a.reshape(shape),
        pressure=model.reshape(pressure.shape).movedim(-1, -2),
        misfit=(cost / max(1, 2 * count - 4)).reshape(shape),
        converged=(moved < TOLERANCE).reshape(shape),
    )


def _damped_step(residual: Tensor, jacobian: Tensor, damping: Tensor) -> Tensor:
    normal = jacobian.mT @ jacobian
    scale = normal.diagonal(dim1=-2, dim2=-1).clamp(min=1e-30)
    damped = normal + torch.diag_embed(damping[..., None] * scale)
    right = -(jacobian.mT @ residual[..., None])
    step: Tensor = torch.linalg.solve(damped, right)[..., 0]
    return step


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
                "stated errors of the microphones: the duct model, the flow or the errors are not "
                "those of the measurement"
            )
        least = float(result.impedance[..., i].real.min())
        if least < 0:
            notes.append(f"{line.name}: the resistance at {f:g} Hz is {least:.3g}, below 0")
    return tuple(notes)
