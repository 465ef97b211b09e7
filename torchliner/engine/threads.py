"""Work on a CPU in several threads, each with torch in one.

torch's own threads share every operation and wait for each other by turning in a loop, on processors that others could
use: with small tensors, or on a machine that is busy, they take many times longer than one.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import Tensor
from torch.autograd import forward_ad

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """torch in one thread; several also add small tables in another order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def is_differentiated(*values: Tensor) -> bool:
    """Whether a value requires a gradient or carries a tangent of forward differentiation."""
    return any(value.requires_grad or forward_ad.unpack_dual(value).tangent is not None for value in values)


def alive_together() -> int:
    """Items of ``in_order`` that live at once: one for each thread, and one so that no thread waits for its next."""
    threads = torch.get_num_threads()
    return threads if threads == 1 else threads + 1


def in_order(
    work: Callable[[Item], Result], items: Iterable[Item], device: torch.device, *, alone: bool = False
) -> Iterator[Result]:
    """The ``work`` of each item, in order; on a CPU as many at once as torch has threads, unless ``alone``.

    Items may be read from a file: few are asked for ahead, and ``alive_together`` must live at once.
    """
    threads = torch.get_num_threads()
    if alone or device.type != "cpu" or threads == 1:
        yield from map(work, items)
        return
    with_gradients = torch.is_grad_enabled()  # which a new thread would not know

    def in_a_thread(item: Item) -> Result:
        with torch.set_grad_enabled(with_gradients):
            return work(item)

    most = alive_together()
    with one_thread(), ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(in_a_thread, item))
            if len(waiting) == most:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
