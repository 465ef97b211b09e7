"""Pressure in: on the facesheet, at the cavity bottom, along a line of microphones."""

from dataclasses import KW_ONLY
from typing import Any, ClassVar

from torchliner.records.burst_record import AWAY
from torchliner.records.case import AtProbes, finite_places, signal_tensor
from torchliner.records.declared import record, table_of, var
from torchliner.records.outlets import Written

LARGEST = "[-1e9, 1e9]"  # of a signal, Pa or m/s: its squares are summed; static pressures are allowed
FACE, BACK, MICROPHONES = ("facesheet", "time"), ("backplate", "time"), ("microphone", "time")


@record
class PressureRecord(Written, AtProbes):
    """Pressures around a liner on one time base, for the in situ method and for microphones.

    Facesheet and backplate go together; a record may hold them, microphones, or both. The facesheet's probe axes are
    (z, x), (x) or (probe). The backplate is (T,), one for all probes, (C, T), one per cell
    in rising z, then x, or of the facesheet's shape, one per probe.

    Raises:
        TypeError, ValueError: a signal is missing or not real floating point; a shape or a value that no record has.
    """

    facesheet: Any = var(
        *FACE, unit="Pa", range=LARGEST, name="facesheet_pressure", text="on the surface", default=None
    )
    backplate: Any = var(
        *BACK, unit="Pa", range=LARGEST, name="backplate_pressure", text="at the cavity bottom", default=None
    )
    _: KW_ONLY
    cavity_depth: float | None = var(unit="m", range="(0, inf)", text="from mouth to backplate", default=None)
    cavity_porosity: float = var(range="(0, 1]", text="share of the surface that is cavity", default=1.0)
    cavity_hydraulic_radius: float | None = var(unit="m", range="(0, inf)", text="of it, for losses", default=None)
    cell_pitch: float | None = var(unit="m", range="(0, inf)", text="sorts probes into cells", default=None)
    microphones: Any = var(
        *MICROPHONES, unit="Pa", range=LARGEST, name="microphone_pressure", text="along a line", default=None
    )
    microphone_y: Any = var("microphone", unit="m", text="distances from the surface", default=None)
    microphone_velocity: Any = var(
        *MICROPHONES, unit="m/s", range=LARGEST, text="away from the surface", default=None, positive=AWAY
    )
    microphone_mach: float = var(range="(-1, 1)", text="of a flow away from the surface", default=0.0)
    name: str = "pressure"

    SCHEMA: ClassVar = "torchliner pressure 1"

    def __post_init__(self) -> None:
        for label, unit in SIGNALS.items():
            if (value := getattr(self, label)) is not None:
                tensor = signal_tensor(value, label, self.name, unit)
                several = label in ("microphones", "microphone_velocity") and tensor.ndim == 1
                object.__setattr__(self, label, tensor[None] if several else tensor)
                if not 0 < tensor.ndim <= 3 or 0 in tensor.shape:
                    raise ValueError(
                        f"{self.name}: {label} has shape {tuple(tensor.shape)}; one or more samples are needed, time "
                        "last"
                    )
        face, back, sound, places = self.facesheet, self.backplate, self.microphones, self.microphone_y
        wrong = {
            "facesheet pressure is missing beside that of the backplate": face is None and back is not None,
            "backplate pressure is missing beside that of the facesheet": face is not None and back is None,
            "no pressure is given; give facesheet and backplate, or microphones": face is None and sound is None,
            "microphones have no pressure; give microphones": sound is None
            and (places is not None or self.microphone_velocity is not None),
            "microphone_y is missing, the distances in m": sound is not None and places is None,
            "backplate has another shape than the facesheet; (time), (cell, time) or that of the facesheet is needed": (
                back is not None and back.ndim == 3 and back.shape != face.shape
            ),
        }
        if why := next((text for text, found in wrong.items() if found), ""):
            raise ValueError(f"{self.name}: {why}")
        if places is not None:
            object.__setattr__(self, "microphone_y", finite_places(places, "microphone_y", self.name))
        self._check(sound[0] if face is None else face)

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Also of the backplate's probes, which are cells, or those of the facesheet, or none."""
        found = super().axes
        like = self.backplate is None or self.backplate.shape == self.facesheet.shape
        back = found["probes"] if like else ("cell",) if self.backplate.ndim == 2 else ()
        return {**found, "facesheet": found["probes"], "backplate": back}


SIGNALS = {
    row.field: row.unit
    for row in table_of(PressureRecord, "facesheet", "backplate", "microphones", "microphone_velocity")
}
