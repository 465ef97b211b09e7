"""Levenberg and Marquardt's method on batches: known minima, a batch is the loop, what gives up."""

from __future__ import annotations

import math

import pytest
import torch

from torchliner.least_squares import Problem, System, best_of, damped_step, least_squares


class Rosenbrock(Problem):
    """(1 - x)^2 + a (y - x^2)^2, of least cost 0 at (1, 1), for one a each."""

    longest = 0.5

    def __init__(self, steepness):
        self.steepness = steepness

    def system(self, place, index):
        x, y = place.unbind(-1)
        a = self.steepness[index].sqrt()
        still = torch.zeros_like(x)
        rows = [torch.stack([still - 1, still], -1), torch.stack([-2 * a * x, a], -1)]
        residual = torch.stack([1 - x, a * (y - x**2)], -1)
        return System(residual, torch.stack(rows, -2), still[..., None])


STEEP = torch.tensor([1.0, 10.0, 100.0, 300.0], dtype=torch.float64)
START = torch.tensor([[-1.2, 1.0], [2.0, -3.0], [-1.2, 1.0], [0.0, 0.0]], dtype=torch.float64)


def test_valleys_are_followed_to_their_ends():
    found = least_squares(Rosenbrock(STEEP), START)
    assert bool(found.converged.all())
    assert float((found.place - 1).abs().max()) < 1e-9
    assert float(found.cost.max()) < 1e-18
    assert START[0].tolist() == [-1.2, 1.0]  # starts are left as they are


def test_batch_is_the_loop():
    """Bit for bit: what is done waits untouched, and neighbours in a row do not change a step."""
    together = least_squares(Rosenbrock(STEEP), START, steps=12)
    for i in range(4):
        alone = least_squares(Rosenbrock(STEEP[i : i + 1]), START[i : i + 1], steps=12)
        assert torch.equal(alone.place[0], together.place[i])
        assert bool(alone.converged[0]) == bool(together.converged[i])
    assert together.converged.tolist() != [True] * 4  # some had not got there


def test_a_quadratic_takes_one_step():
    """Without damping the step is that of linear least squares, real and complex."""
    generator = torch.Generator().manual_seed(0)
    for dtype in (torch.float64, torch.complex128):
        matrix, right = (torch.randn(5, 7, n, dtype=dtype, generator=generator) for n in (3, 1))
        step = damped_step(-right[..., 0], matrix, torch.zeros(5, dtype=torch.float64))
        wanted = torch.linalg.lstsq(matrix, right).solution[..., 0]
        assert torch.allclose(step, wanted, atol=1e-12)


class Root(Problem):
    """z^2 = c over complex numbers, and a second unknown that changes nothing."""

    def __init__(self, squares):
        self.squares = squares

    def system(self, place, index):
        z = place[..., :1]
        jacobian = torch.cat([2 * z, torch.zeros_like(z)], -1)[..., None, :]
        return System(z**2 - self.squares[index][:, None], jacobian, z)


def test_holomorphic_residuals():
    """Complex roots; an unknown without effect stays."""
    squares = torch.tensor([2j, -1 + 0j, 0.25 + 0j], dtype=torch.complex128)
    start = torch.tensor([[1.5 + 0.5j, 3j], [0.1 + 2j, 0], [1, 1]], dtype=torch.complex128)
    found = least_squares(Root(squares), start)
    assert bool(found.converged.all())
    assert torch.allclose(found.place[:, 0], squares.sqrt(), atol=1e-12)
    assert torch.equal(found.place[:, 1:], start[:, 1:])


def test_of_several_minima_the_least_is_kept_each():
    """The first of equal ones, and none that lost its way."""
    ends = least_squares(Rosenbrock(STEEP), START), least_squares(Rosenbrock(STEEP), START, steps=1)
    lost = ends[1]._replace(residual=ends[1].residual * math.nan)
    for several in (ends, ends[::-1], (lost, *ends)):
        assert torch.equal(best_of(several).place, ends[0].place)
    mixed = best_of([ends[1], ends[0]._replace(residual=ends[0].residual + torch.tensor([[0.0], [9e9], [0], [0]]))])
    assert torch.equal(mixed.place[1], ends[1].place[1])


def test_what_has_no_way_is_given_up():
    """Steps that cannot be taken end in damping, not in convergence; exact places end at once."""

    class Walled(Rosenbrock):
        def move(self, place, step, index):
            return place + step, index > 0

    found = least_squares(Walled(STEEP), START)
    assert found.converged.tolist() == [False, True, True, True]
    assert torch.equal(found.place[0], START[0])
    problem = Rosenbrock(STEEP)
    problem.exact = 1e9
    assert torch.equal(least_squares(problem, START).place, START)


@pytest.mark.parametrize("longest", [0.05, 0.5])
def test_steps_are_no_longer_than_allowed(longest):
    problem, places = Rosenbrock(STEEP), []
    problem.longest = longest
    move = problem.move
    problem.move = lambda place, step, index: places.append(step) or move(place, step, index)
    least_squares(problem, START, steps=8)
    largest = max(float(step.norm(dim=-1).max()) for step in places)
    assert largest == pytest.approx(longest, rel=1e-12)
    assert math.isfinite(largest)
