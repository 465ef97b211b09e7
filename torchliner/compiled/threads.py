"""Small tensors in one thread: several take longer, and add in another order.

torch's threads wait for their next work by turning in a loop, on the processors that the compiled
sums could use. So a pass gives torch one thread and the sums all of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch

_given: list[int] = []  # torch's threads before each ``one_thread`` that is open


def threads() -> int:
    """Threads that a user gives to torch, whatever ``one_thread`` makes of them."""
    return _given[0] if _given else torch.get_num_threads()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra of tables in one thread: several add in another order, and the least squares,
    whose normal matrix is near singular, makes 1e-9 of that."""
    _given.append(torch.get_num_threads())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(_given.pop())
