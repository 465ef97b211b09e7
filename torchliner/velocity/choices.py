"""Every choice of an eduction in one validated place."""

import contextlib
from dataclasses import dataclass
from typing import Any

import torch

from torchliner.checks import make_plain, require_choice, require_positive
from torchliner.names import AVERAGINGS, DRIVES, DTYPES, MEANS, MISSING, PHASES, UNHEARD

NAMED = {"averaging": AVERAGINGS, "phase": PHASES, "drive": DRIVES, "mean": MEANS, "missing": MISSING}
RANGES = {
    "interval": (1e-9, 1 - 1e-9, "; it is a level between 0 and 1"),
    **dict.fromkeys(("minimum_coherence", "wall_filter"), (0, 1, "; it is a squared coherence, 0 to 1")),
    **dict.fromkeys(("level_limit", "level_uncertainty"), (0, 1e3, " dB; it is 0 to 1000 dB")),
}
# Those that are computed, by the one that is asked for.
COMPUTED = {name: tuple(AVERAGINGS)[: 3 if name == "phase-locked" else 2] for name in AVERAGINGS}
TOLERANCES = {torch.float32: 1e-6, torch.float64: 1e-9}  # error in R of the model table


@dataclass(frozen=True)
class Choices:
    """What the paper leaves open.

    Args:
        averaging: what is averaged over each cell for the ``answer``: ``admittance`` (the paper), of probes driven by
            their own v; ``velocity``, v itself, whose mean drives the liner; ``phase-locked``, the part of v that is
            periodic with the tone, while the rest acts where it is measured. The last reads the data twice and is
            computed only if it is chosen.
        phase: phase of the incident tone relative to v: ``averaged`` over all phases (the phase is not known),
            ``self-consistent`` (from the tone in v itself), ``given`` (by ``reference_phase``).
        drive: |v| that acts on the liner: ``instantaneous``, ``rms`` over the record, or ``running-rms``.
        running_window: of the running rms, s; default one period of the lowest frequency.
        mean: time-mean velocity ``kept`` in the drive or ``removed``.
        interval: confidence level of the error bars, between 0 and 1. In Python None for none.
        wall_filter: squared coherence of v with the tone, 0 to 1, below which a probe counts as wall: admittance 0 in
            averages over probes (section 7.2); default: no filter.
        missing: probes that hold nan or inf: ``refuse`` the plane or ``exclude`` them.
        background: for ``phase-locked``: the same plane without sound (or its moments), to whose rms the incoherent
            velocity of each cell is scaled down; several at other heights, whose rms is interpolated to half a hole
            diameter; or that rms, m/s. Default: as measured. Strong sound in weak flow makes jets, whose vortices would
            else count as turbulence.
        minimum_coherence: squared coherence of v with the tone, 0 to 1, below which ``self-consistent`` falls back to
            ``averaged``. Noise alone exceeds 0.5 at a share 0.5^(S - 1) of the probes, with S blocks.
        level_limit: dB by which the pressure from Z and the phase-locked velocity may differ from the known one.
        level_uncertainty: of the known pressure, dB; added to the limit.
        level_matched: also find the share of the incoherent velocity that makes the level check 0, and Z with it: a
            measurement by pressure and velocity, not a prediction. The data are read about ten times more.
        allow_short: accept fewer than four periods.
        device: where to compute, cpu, cuda or cuda:1; default where the data are.
        dtype: precision of the computation; default that of the data.
    """

    averaging: str = "phase-locked"
    phase: str = "averaged"
    drive: str = "instantaneous"
    running_window: float | None = None
    mean: str = "kept"
    interval: float | None = 0.95
    wall_filter: float | None = None
    missing: str = "refuse"
    background: Any = None
    minimum_coherence: float = 0.5
    level_limit: float = 0.3
    level_uncertainty: float = 0.0
    level_matched: bool = False
    allow_short: bool = False
    device: str | torch.device | None = None
    dtype: str | torch.dtype | None = None

    def __post_init__(self) -> None:
        make_plain(self)
        for name, known in NAMED.items():
            require_choice(name, getattr(self, name), known)
        for name, (low, high, words) in RANGES.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name} is {value:g}{words}")
        if self.background is not None and self.averaging != "phase-locked":
            raise ValueError("background is only used with averaging='phase-locked'")
        if self.running_window is not None:
            require_positive("running_window", self.running_window)
            if self.drive != "running-rms":
                raise ValueError(f"running_window is only used with drive='running-rms', not {self.drive!r}")
        self.working(torch.empty(0, dtype=torch.float64))

    @property
    def hears_tone(self) -> bool:
        """Whether the phase rule needs the tone in v."""
        return self.phase not in UNHEARD

    def working(self, velocity: Any) -> tuple[torch.device, torch.dtype]:
        """Device and precision that were asked for, else those of the data; the CPU for data in a file."""
        found, wanted = None, str(velocity.dtype if self.dtype is None else self.dtype).removeprefix("torch.")
        with contextlib.suppress(RuntimeError, TypeError):
            found = torch.device(getattr(velocity, "device", "cpu") if self.device is None else self.device)
        if found is None or found.type not in ("cpu", "cuda", "meta"):
            raise ValueError(f"unknown device {self.device!r}; use 'cpu', 'cuda' or 'cuda:1'")
        if found.type == "cuda" and (found.index or 0) >= torch.cuda.device_count():
            raise ValueError(
                f"device {str(found)!r} is asked for, and torch {torch.__version__} sees {torch.cuda.device_count()} "
                "CUDA devices; use device='cpu', or install a CUDA build of torch"
            )
        return found, getattr(torch, require_choice("dtype", wanted, DTYPES))

    def describe(self) -> dict[str, Any]:
        """Plain values for a file."""
        plain = dict(vars(self))
        if hasattr(self.background, "describe"):
            plain["background"] = self.background.describe()
        stated = {key: plain[key] for key in ("device", "dtype") if plain[key] is not None}
        return plain | {key: str(value).removeprefix("torch.") for key, value in stated.items()}
