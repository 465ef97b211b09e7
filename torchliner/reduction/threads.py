"""Small tensors in one thread: several take longer, and add in another order."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra of tables in one thread: several add in another order, and the least squares,
    whose normal matrix is near singular, makes 1e-9 of that."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
