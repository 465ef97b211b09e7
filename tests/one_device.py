"""Proof without a GPU that work stays on the device of the data.

``meta`` tensors have shapes and no numbers. torch lets a CPU tensor meet them in many operations without a word, and
refuses only what must be read back. Under this mode both are errors, and launches and copies to the device are counted.
"""

from collections import Counter
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

VIEWS = {
    f"aten::{name}"
    for name in (
        "select slice view t transpose expand unsqueeze squeeze unbind detach alias permute split split_with_sizes "
        "_unsafe_view as_strided view_as_real view_as_complex real imag _conj"
    ).split()
}
COPIES = ("aten::_to_copy", "aten::copy_")
READS = ("aten::_local_scalar_dense", "aten::item", "aten::nonzero", "aten::_unique2", "aten::masked_select")


class OneDevice(TorchDispatchMode):
    """Refuses operations on several devices (0-d CPU scalars apart) and reads back to the host."""

    def __init__(self, device: str = "meta") -> None:
        super().__init__()
        self.device, self.launches, self.uploads = torch.device(device), Counter[str](), 0

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Look at one operation, then let it run."""
        kwargs = kwargs or {}
        name = function.name().split(".")[0]
        tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)]
        if any(tensor.device == self.device for tensor in tensors):
            self._check(name, tensors, kwargs.get("device"))
            if name not in VIEWS:  # which launch nothing
                self.launches[name] += 1
        elif kwargs.get("device") == self.device and tensors:
            self.uploads += 1
        return function(*args, **kwargs)

    def _check(self, name: str, tensors: list[torch.Tensor], target: Any) -> None:
        if name in READS:
            raise RuntimeError(f"{name} reads a tensor of {self.device} back to the host")
        if name in COPIES and target not in (None, self.device):
            raise RuntimeError(f"{name} copies a tensor of {self.device} to {target}")
        away = [tensor for tensor in tensors if tensor.device != self.device and tensor.dim() > 0]
        if away and name not in COPIES:
            raise RuntimeError(f"{name} joins {self.device} and {away[0].device}, shape {tuple(away[0].shape)}")
