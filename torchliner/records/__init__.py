"""The records everything passes through."""

from torchliner.records.burst_record import BurstRecord
from torchliner.records.educed import Educed, Interval, PointImpedances
from torchliner.records.impedance_line import ImpedanceLine, LineAverage
from torchliner.records.impedance_map import ImpedanceMap
from torchliner.records.level_check import Gap, LevelCheck
from torchliner.records.microphone_line import MicrophoneLine
from torchliner.records.pressure_record import PressureRecord
from torchliner.records.velocity_plane import StoredVelocity, VelocityPlane
from torchliner.records.wall_eduction import FieldFit, WallEduction

__all__ = [
    "BurstRecord",
    "Educed",
    "FieldFit",
    "Gap",
    "ImpedanceLine",
    "ImpedanceMap",
    "Interval",
    "LevelCheck",
    "LineAverage",
    "MicrophoneLine",
    "PointImpedances",
    "PressureRecord",
    "StoredVelocity",
    "VelocityPlane",
    "WallEduction",
]
