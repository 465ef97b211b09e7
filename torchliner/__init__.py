"""torchliner: acoustic liner impedance from time-resolved velocity data (DIR-TDIBC)."""

from __future__ import annotations

import importlib
from typing import Any

from torchliner.version import __version__

_HOMES = {
    "Fluid": "torchliner.fluid",
    "displacement_thickness": "torchliner.duct.flow_table",
    "TanhProfile": "torchliner.duct.flow_profiles",
    "DataWarning": "torchliner.checks",
    "SDoFLiner": "torchliner.liners.sdof",
    "EndLossSDoFLiner": "torchliner.liners.sdof",
    "LayeredLiner": "torchliner.liners.layered",
    "Cavity": "torchliner.liners.layered",
    "sheet": "torchliner.liners.layered",
    "TabulatedLiner": "torchliner.liners.tabulated",
    "load_liner": "torchliner.liners.catalogue",
    "preset_names": "torchliner.liners.catalogue",
    "goodrich_resistance": "torchliner.liners.plates",
    "VelocityPlane": "torchliner.records",
    "Holes": "torchliner.records",
    "ImpedanceMap": "torchliner.records",
    "PressureRecord": "torchliner.records",
    "MicrophoneLine": "torchliner.records",
    "BurstRecord": "torchliner.records",
    "ReferenceChannel": "torchliner.records",
    "ImpedanceLine": "torchliner.records",
    "WallEduction": "torchliner.records",
    "FieldFit": "torchliner.records",
    "PointImpedances": "torchliner.records",
    "read_plane": "torchliner.io.planes",
    "read_holes": "torchliner.io.holes",
    "read_moments": "torchliner.io.moments_file",
    "read_map": "torchliner.io.own_file",
    "read_pressure": "torchliner.io.pressure_file",
    "read_microphones": "torchliner.io.microphone_file",
    "read_wall": "torchliner.io.own_file",
    "read_bursts": "torchliner.io.burst_sources",
    "list_stations": "torchliner.io.burst_sources",
    "read_line": "torchliner.io.own_file",
    "read_points": "torchliner.io.own_file",
    "fit_multipole": "torchliner.liners.multipole",
    "Multipole": "torchliner.liners.multipole",
    "educe": "torchliner.velocity.educe",
    "moments": "torchliner.velocity.educe",
    "sum_share": "torchliner.velocity.educe",
    "replay": "torchliner.velocity.replay",
    "GrowingMoments": "torchliner.campaign.growing",
    "Moments": "torchliner.engine.moments",
    "ir_tdibc": "torchliner.velocity.ir_tdibc",
    "LevelCurve": "torchliner.velocity.level_curve",
    "educe_bursts": "torchliner.bursts.line",
    "BurstFilters": "torchliner.bursts.stations",
    "validate_bursts": "torchliner.bursts.stations",
    "burst_moments": "torchliner.bursts.stations",
    "in_situ": "torchliner.pressure.dean",
    "decompose_waves": "torchliner.pressure.plane_waves",
    "kumaresan_tufts": "torchliner.pressure.kumaresan_tufts",
    "two_wave_fit": "torchliner.pressure.two_waves",
    "sort_waves": "torchliner.pressure.plane_waves",
    "impedance_from_wavenumber": "torchliner.duct.dispersion",
    "wavenumber_from_impedance": "torchliner.duct.dispersion",
    "audit": "torchliner.studies.audit",
    "compare": "torchliner.studies.compare",
    "figure_style": "torchliner.report.figure",
    "compare_models": "torchliner.studies.compare_models",
    "onto_grid": "torchliner.bursts.arrivals",
    "tone_attenuation": "torchliner.bursts.tone_damping",
    "load_duct": "torchliner.duct.presets",
    "DuctSolver": "torchliner.duct.solver",
    "duct_modes": "torchliner.duct.modes",
    "growing_wave": "torchliner.duct.growing_wave",
    "solve_settled": "torchliner.duct.settled",
    "fit_field": "torchliner.pressure.fit_field",
    "sensitivities": "torchliner.studies.sensitivities",
    "calibrate": "torchliner.studies.calibrate",
    "identify": "torchliner.studies.identify",
    "AdjustedSDoFLiner": "torchliner.liners.sdof",
    "Tones": "torchliner.records.incident",
    "Sweep": "torchliner.records.incident",
    "BandNoise": "torchliner.records.incident",
    "Recorded": "torchliner.records.incident",
    "read_signal": "torchliner.io.signal_file",
    "VelocityGrid": "torchliner.engine.kernels",
    "build_kernels": "torchliner.engine.kernels",
    "reflection_from_impedance": "torchliner.conversions",
    "impedance_from_reflection": "torchliner.conversions",
    "absorption_from_reflection": "torchliner.conversions",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """Public names are imported when first used, so that ``import torchliner`` is quick."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'torchliner' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
