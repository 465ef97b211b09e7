# ruff: noqa
# fmt: off
"""Public names of torchliner; written by scripts/make_stub.py."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

import torch

from torchliner.studies.variants import Study
from torchliner.liners.model import Liner
from torchliner.velocity.reading import Progress, Reduce

from torchliner.bursts.arrivals import onto_grid as onto_grid
from torchliner.bursts.arrivals import tone_attenuation as tone_attenuation
from torchliner.bursts.line import educe_bursts as educe_bursts
from torchliner.bursts.stations import burst_moments as burst_moments
from torchliner.bursts.stations import validate_bursts as validate_bursts
from torchliner.campaign.follow import GrowingMoments as GrowingMoments
from torchliner.checks import DataWarning as DataWarning
from torchliner.conversions import absorption_from_reflection as absorption_from_reflection
from torchliner.conversions import impedance_from_reflection as impedance_from_reflection
from torchliner.conversions import reflection_from_impedance as reflection_from_impedance
from torchliner.duct.dispersion import impedance_from_wavenumber as impedance_from_wavenumber
from torchliner.duct.dispersion import wavenumber_from_impedance as wavenumber_from_impedance
from torchliner.duct.flow_profiles import TabulatedProfile as TabulatedProfile
from torchliner.duct.flow_profiles import TanhProfile as TanhProfile
from torchliner.duct.modes import duct_modes as duct_modes
from torchliner.duct.presets import load_duct as load_duct
from torchliner.duct.settled import solve_settled as solve_settled
from torchliner.duct.solver import DuctSolver as DuctSolver
from torchliner.engine.kernels import VelocityGrid as VelocityGrid
from torchliner.engine.kernels import build_kernels as build_kernels
from torchliner.engine.moments import Moments as Moments
from torchliner.fluid import Fluid as Fluid
from torchliner.io.burst_sources import list_stations as list_stations
from torchliner.io.burst_sources import read_bursts as read_bursts
from torchliner.io.microphone_file import read_microphones as read_microphones
from torchliner.io.microphone_file import read_pressure as read_pressure
from torchliner.io.microphone_file import read_signal as read_signal
from torchliner.io.moments_file import read_moments as read_moments
from torchliner.io.own_file import read_line as read_line
from torchliner.io.own_file import read_map as read_map
from torchliner.io.own_file import read_points as read_points
from torchliner.io.own_file import read_wall as read_wall
from torchliner.io.planes import read_plane as read_plane
from torchliner.liners.catalogue import load_liner as load_liner
from torchliner.liners.catalogue import preset_names as preset_names
from torchliner.liners.layered import Cavity as Cavity
from torchliner.liners.layered import LayeredLiner as LayeredLiner
from torchliner.liners.layered import sheet as sheet
from torchliner.liners.multipole import Multipole as Multipole
from torchliner.liners.multipole import fit_multipole as fit_multipole
from torchliner.liners.plates import goodrich_resistance as goodrich_resistance
from torchliner.liners.sdof import AdjustedSDoFLiner as AdjustedSDoFLiner
from torchliner.liners.sdof import EndLossSDoFLiner as EndLossSDoFLiner
from torchliner.liners.sdof import SDoFLiner as SDoFLiner
from torchliner.liners.tabulated import TabulatedLiner as TabulatedLiner
from torchliner.pressure.dean import in_situ as in_situ
from torchliner.pressure.fit_field import fit_field as fit_field
from torchliner.pressure.plane_waves import decompose_waves as decompose_waves
from torchliner.pressure.plane_waves import sort_waves as sort_waves
from torchliner.pressure.two_waves import two_wave_fit as two_wave_fit
from torchliner.pressure.waves import kumaresan_tufts as kumaresan_tufts
from torchliner.records import BurstRecord as BurstRecord
from torchliner.records import FieldFit as FieldFit
from torchliner.records import ImpedanceLine as ImpedanceLine
from torchliner.records import ImpedanceMap as ImpedanceMap
from torchliner.records import MicrophoneLine as MicrophoneLine
from torchliner.records import PointImpedances as PointImpedances
from torchliner.records import PressureRecord as PressureRecord
from torchliner.records import VelocityPlane as VelocityPlane
from torchliner.records import WallEduction as WallEduction
from torchliner.records.incident import BandNoise as BandNoise
from torchliner.records.incident import Recorded as Recorded
from torchliner.records.incident import Sweep as Sweep
from torchliner.records.incident import Tones as Tones
from torchliner.studies.audit import audit as audit
from torchliner.studies.calibrate import calibrate as calibrate
from torchliner.studies.calibrate import identify as identify
from torchliner.studies.compare import compare as compare
from torchliner.studies.compare import compare_models as compare_models
from torchliner.velocity.ir_tdibc import LevelCurve as LevelCurve
from torchliner.velocity.ir_tdibc import ir_tdibc as ir_tdibc
from torchliner.velocity.replay import replay as replay
from torchliner.names import __version__ as __version__

__all__: list[str]

class _Choices(TypedDict, total=False):
    averaging: str
    phase: str
    drive: str
    running_window: float | None
    mean: str
    interval: float | None
    wall_filter: float | None
    missing: str
    background: Any
    minimum_coherence: float
    level_limit: float
    level_uncertainty: float
    level_matched: bool
    allow_short: bool
    device: str | torch.device | None
    dtype: str | torch.dtype | None
def educe(plane: Any, liner: Liner, frequency: Any=None, *, reference_phase: Any=None, pressure: Any=None, progress: Progress | None=None, **choices: Unpack[_Choices]) -> ImpedanceMap: ...
def moments(plane: VelocityPlane, liner: Liner | None=None, frequency: Any=None, *, cell_pitch: float | None=None, progress: Progress | None=None, run: Reduce | None=None, **choices: Unpack[_Choices]) -> Moments: ...
def sensitivities(plane: VelocityPlane | Moments, liner: Liner, frequency: Any=None, parameters: Sequence[str] | None=None, *, tolerances: Mapping[str, float] | None=None, progress: Progress | None=None, **choices: Unpack[_Choices]) -> Study: ...
