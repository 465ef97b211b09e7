"""Small tensors in one thread: several take longer, and add in another order.

torch's threads wait for their next work by turning in a loop, on the processors that the compiled
sums could use. So a pass gives torch one thread and the sums all of them.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST = 4  # items at once: Python itself runs in one thread
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


def in_order(work: Callable[[Item], Result], items: Iterable[Item], use: Callable[[Result], None]) -> None:
    """Use the ``work`` of each item, in order; several are worked on at once, each in one thread,
    without derivatives."""

    def alone(item: Item) -> Result:
        with torch.no_grad():
            return work(item)

    # A new thread takes torch's number of threads as it finds it.
    workers = min(threads(), MOST)
    with one_thread(), ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(alone, item))
            if len(waiting) == workers:
                use(waiting.popleft().result())
        while waiting:
            use(waiting.popleft().result())
