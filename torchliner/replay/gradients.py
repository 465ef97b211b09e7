"""Whether a derivative passes through a tensor, backward or forward."""

from __future__ import annotations

from torch import Tensor
from torch.autograd import forward_ad


def carries_gradient(value: Tensor) -> bool:
    """True if ``value`` requires a gradient or has a tangent of forward differentiation."""
    return value.requires_grad or forward_ad.unpack_dual(value).tangent is not None
