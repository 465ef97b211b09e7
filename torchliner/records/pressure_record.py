"""Pressure in: on the facesheet, at the cavity bottom, along a line of microphones."""

from dataclasses import KW_ONLY
from typing import Any, ClassVar

from torchliner.records.burst_record import AWAY
from torchliner.records.case import AtProbes
from torchliner.records.declared import record, var
from torchliner.records.outlets import Written

FACE, BACK, MICROPHONES = ("facesheet", "time"), ("backplate", "time"), ("microphone", "time")


@record
class PressureRecord(Written, AtProbes):
    """Pressures around a liner on one time base, for the in situ method and for microphones.

    Facesheet and backplate go together; a record may hold them, microphones, or both. The facesheet's probe axes are
    (z, x), (x) or (probe). The backplate is (T,), one for all probes, (C, T), one per cell in rising z, then x, or of
    the facesheet's shape, one per probe.

    Raises:
        TypeError, ValueError: a signal is missing or not real floating point; a shape or a value that no record has.
    """

    facesheet: Any = var(
        *FACE, kind="signal", unit="Pa", name="facesheet_pressure", text="on the surface", default=None
    )
    backplate: Any = var(
        *BACK, kind="signal", unit="Pa", name="backplate_pressure", text="at the cavity bottom", default=None
    )
    _: KW_ONLY
    cavity_depth: float | None = var(unit="m", range="(0, inf)", text="from mouth to backplate", default=None)
    cavity_porosity: float = var(range="(0, 1]", text="share of the surface that is cavity", default=1.0)
    cavity_hydraulic_radius: float | None = var(unit="m", range="(0, inf)", text="of it, for losses", default=None)
    cell_pitch: float | None = var(unit="m", range="(0, inf)", text="sorts probes into cells", default=None)
    microphones: Any = var(
        *MICROPHONES, kind="signal", unit="Pa", name="microphone_pressure", text="along a line", default=None
    )
    microphone_y: Any = var("microphone", unit="m", kind="places", text="distances from the surface", default=None)
    microphone_velocity: Any = var(
        *MICROPHONES, kind="signal", unit="m/s", text="away from the surface", positive=AWAY, default=None
    )
    microphone_mach: float = var(range="(-1, 1)", text="of a flow away from the surface", default=0.0)
    name: str = "pressure"

    SCHEMA: ClassVar = "torchliner pressure 1"

    def __post_init__(self) -> None:
        for pair in (("facesheet", "backplate"), ("microphones", "microphone_y")):
            lost = [label for label in pair if getattr(self, label) is None]
            if len(lost) == 1:
                raise ValueError(f"{self.name}: {lost[0]} is missing; {' and '.join(pair)} go together")
        if self.facesheet is None and self.microphones is None:
            raise ValueError(f"{self.name}: no pressure is given; give facesheet and backplate, or microphones")
        super().__post_init__()

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(self.microphones.shape[-1:] if self.facesheet is None else self.facesheet.shape)

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Also of the backplate's probes, which are cells, or those of the facesheet, or none."""
        found = super().axes
        like = self.backplate is None or self.backplate.shape == self.facesheet.shape
        back = found["probes"] if like else ("cell",) if self.backplate.ndim == 2 else ()
        return {**found, "facesheet": found["probes"], "backplate": back}
