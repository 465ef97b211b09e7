"""Every choice of an eduction in one validated place."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

import torch

from torchliner.checks import require_choice, require_positive
from torchliner.eduction.drive import DRIVES, MEANS
from torchliner.replay.compiled import COMPILE
from torchliner.replay.edges import EDGE_RULES
from torchliner.replay.incident import PHASE_RULES
from torchliner.replay.kernels import BAND, KERNELS

ENGINES = ("spectral", "unfold", "direct")
RESPONSES = ("model", "kernel")
DTYPES = {"float32": torch.float32, "float64": torch.float64}


@dataclass(frozen=True)
class Choices:
    """What the paper leaves open, and what it does not.

    Args:
        engine: ``spectral`` (fast), ``unfold`` (the whole reflected signal, for any incident
            signal) or ``direct`` (the literal sum, in float64).
        phase: phase of the incident tone relative to v: ``averaged`` (nothing else is known),
            ``self-consistent`` (from v's own part at f) or ``given``.
        edge: ``finite``, ``wrap`` or ``silent``; see ``torchliner.replay.edges``.
        window: any window of scipy, applied to the reflected signal.
        drive: |v| that drives the kernel: ``instantaneous``, ``rms`` over the record, or
            ``running-rms`` over ``running_window``.
        mean: time-mean velocity ``kept`` in the drive or ``removed``.
        kernel: ``two-sided`` or ``causal``.
        response: ``model`` (R of the liner itself) or ``kernel`` (that of the impulse responses);
            by default the model's for the two-sided kernel, whose error is reported.
        band: Hz, where the kernel stands for the liner.
        levels, spacing, interpolation: velocity grid of the tables.
        velocity_max: top of the grid, m/s; default from the whole record, rounded up.
        pre_roll: s at the start of the record that only emit; the window comes after.
        running_window: s; default one period of the lowest frequency.
        minimum_coherence: squared coherence of v with the tone below which ``self-consistent``
            falls back to ``averaged``; without a tone 0.5 is passed in 1 of 128 with 8 segments
            of two periods, in 1 of 2 with 2 (then noted).
        missing: probes holding nan or inf: ``refuse`` the plane or ``exclude`` them.
        allow_short: accept fewer than four periods.
        device, dtype: where and in what precision R is evaluated; default those of the data.
        memory: bytes, or text such as "2GB", for slabs and work arrays; what the program itself
            (some 0.4 GB) and the result (some 200 B a probe) take comes on top. Default: what is
            fast, about 0.2 GB.
        compile: fuse the inner loops with a compiler, ``auto`` where it pays, ``never``,
            ``always``; the numbers stay the same.
        rank_tolerance: error in R allowed to the low-rank factors of ``unfold``'s kernels;
            default 1e-6 in float32, 1e-11 in float64.
    """

    engine: str = "spectral"
    phase: str = "averaged"
    edge: str = "finite"
    window: Any = "hann"
    drive: str = "instantaneous"
    mean: str = "kept"
    kernel: str = "two-sided"
    response: str | None = None
    band: tuple[float, float] = BAND
    levels: int = 200
    spacing: str = "sqrt"
    interpolation: str = "cubic"
    velocity_max: float | None = None
    pre_roll: float = 0.0
    running_window: float | None = None
    minimum_coherence: float = 0.5
    missing: str = "refuse"
    allow_short: bool = False
    device: str | torch.device | None = None
    dtype: str | torch.dtype | None = None
    memory: int | str | None = None
    compile: str = "auto"
    rank_tolerance: float | None = None

    def __post_init__(self) -> None:
        require_choice("engine", self.engine, ENGINES)
        require_choice("phase rule", self.phase, PHASE_RULES)
        require_choice("edge rule", self.edge, EDGE_RULES)
        require_choice("drive", self.drive, DRIVES)
        require_choice("mean", self.mean, MEANS)
        require_choice("kernel", self.kernel, KERNELS)
        require_choice("missing", self.missing, ("refuse", "exclude"))
        if self.response is not None:
            require_choice("response", self.response, RESPONSES)
        if self.response == "model" and (self.kernel == "causal" or self.engine != "spectral"):
            raise ValueError(
                f"response='model' bypasses the kernel, which engine={self.engine!r}, "
                f"kernel={self.kernel!r} ask for; leave response out"
            )
        if not 0 <= self.pre_roll < float("inf"):
            raise ValueError(f"pre_roll is {self.pre_roll:g} s; it is at least 0")
        if self.pre_roll and self.edge == "wrap":
            raise ValueError("edge rule 'wrap' has no pre_roll: a periodic record has no start")
        require_choice("compile", self.compile, COMPILE)
        for name in ("velocity_max", "running_window", "rank_tolerance"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        if not 0 <= self.minimum_coherence <= 1:
            raise ValueError(f"minimum_coherence is {self.minimum_coherence:g}; it is 0 to 1")
        self.memory_bytes  # noqa: B018  checked here
        self.working_device(torch.device("cpu"))
        self.working_dtype(torch.float64)

    @property
    def uses_kernel_response(self) -> bool:
        """Whether the lines come from the impulse responses rather than from the model."""
        return self.response == "kernel" or self.kernel == "causal" or self.engine != "spectral"

    @property
    def memory_bytes(self) -> int | None:
        """``memory`` in bytes."""
        if self.memory is None:
            return None
        found = re.fullmatch(r"(\d+\.?\d*)\s*([kMGT]?)(i?)B?", str(self.memory).strip())
        if found is None:
            raise ValueError(
                f"memory is {self.memory!r}; give bytes or a size such as '500MB' or '2GB'"
            )
        base = 1024 if found[3] else 1000
        return int(float(found[1]) * base ** " kMGT".index(found[2] or " "))

    def working_device(self, default: torch.device) -> torch.device:
        """The device asked for, checked."""
        try:
            device = torch.device(default if self.device is None else self.device)
        except RuntimeError as error:
            raise ValueError(
                f"unknown device {self.device!r}; use 'cpu', 'cuda' or 'cuda:1'"
            ) from error
        if device.type == "cuda" and not torch.cuda.is_available():
            raise ValueError(
                f"device {str(device)!r} is asked for, but torch {torch.__version__} sees no CUDA "
                "device; use device='cpu' or install a CUDA build of torch"
            )
        return device

    def working_dtype(self, default: torch.dtype) -> torch.dtype:
        """The precision asked for, checked; ``direct`` is always float64."""
        wanted = self.dtype
        if isinstance(wanted, str):
            wanted = DTYPES[require_choice("dtype", wanted, DTYPES)]
        if wanted is not None and wanted not in DTYPES.values():
            raise ValueError(f"dtype is {wanted}; float32 or float64")
        if self.engine == "direct":
            return torch.float64
        return default if wanted is None else wanted

    def describe(self) -> dict[str, Any]:
        """Plain values for a file."""
        plain = asdict(self)
        for key in ("device", "dtype"):
            plain[key] = None if plain[key] is None else str(plain[key])
        plain["response"] = "kernel" if self.uses_kernel_response else "model"
        plain["window"] = self.window if isinstance(self.window, str) else list(self.window)
        return plain
