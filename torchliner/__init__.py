"""torchliner: acoustic liner impedance from time-resolved velocity data (DIR-TDIBC)."""

import importlib
from typing import Any

from torchliner.names import __version__

_NAMES = {  # module: public names that live in it
    "checks": "DataWarning",
    "conversions": "reflection_from_impedance impedance_from_reflection absorption_from_reflection",
    "fluid": "Fluid",
    "records": "VelocityPlane ImpedanceMap PressureRecord MicrophoneLine BurstRecord "
    "ImpedanceLine WallEduction FieldFit PointImpedances",
    "records.incident": "Tones Sweep BandNoise Recorded",
    "io.planes": "read_plane",
    "io.moments_file": "read_moments",
    "io.own_file": "read_map read_wall read_line read_points",
    "io.microphone_file": "read_microphones read_pressure read_signal",
    "io.burst_sources": "read_bursts list_stations",
    "liners.sdof": "SDoFLiner EndLossSDoFLiner AdjustedSDoFLiner",
    "liners.layered": "LayeredLiner Cavity sheet",
    "liners.tabulated": "TabulatedLiner",
    "liners.catalogue": "load_liner preset_names",
    "liners.plates": "goodrich_resistance",
    "liners.multipole": "fit_multipole Multipole",
    "engine.moments": "Moments",
    "engine.kernels": "VelocityGrid build_kernels",
    "velocity.educe": "educe moments",
    "velocity.replay": "replay",
    "velocity.ir_tdibc": "LevelCurve ir_tdibc",
    "campaign.follow": "GrowingMoments",
    "bursts.line": "educe_bursts",
    "bursts.stations": "validate_bursts burst_moments",
    "bursts.arrivals": "onto_grid tone_attenuation",
    "pressure.dean": "in_situ",
    "pressure.plane_waves": "decompose_waves sort_waves",
    "pressure.waves": "kumaresan_tufts",
    "pressure.two_waves": "two_wave_fit",
    "pressure.fit_field": "fit_field",
    "duct.dispersion": "impedance_from_wavenumber wavenumber_from_impedance",
    "duct.flow_profiles": "TanhProfile TabulatedProfile",
    "duct.presets": "load_duct",
    "duct.solver": "DuctSolver",
    "duct.settled": "solve_settled",
    "duct.modes": "duct_modes",
    "studies.audit": "audit",
    "studies.compare": "compare compare_models",
    "studies.sensitivities": "sensitivities",
    "studies.calibrate": "calibrate identify",
}
_HOMES = {name: f"torchliner.{module}" for module, names in _NAMES.items() for name in names.split()}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """Public names are imported when first used, so that ``import torchliner`` is quick."""
    if name in _HOMES:
        found = globals()[name] = getattr(importlib.import_module(_HOMES[name]), name)
        return found
    raise AttributeError(f"module 'torchliner' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
