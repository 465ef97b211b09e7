"""The records everything passes through."""

from torchliner.records.burst_record import BurstRecord as BurstRecord
from torchliner.records.educed import Educed as Educed
from torchliner.records.educed import Interval as Interval
from torchliner.records.educed import PointImpedances as PointImpedances
from torchliner.records.impedance_line import ImpedanceLine as ImpedanceLine
from torchliner.records.impedance_line import LineAverage as LineAverage
from torchliner.records.impedance_map import ImpedanceMap as ImpedanceMap
from torchliner.records.level_check import Gap as Gap
from torchliner.records.level_check import LevelCheck as LevelCheck
from torchliner.records.microphone_line import MicrophoneLine as MicrophoneLine
from torchliner.records.pressure_record import PressureRecord as PressureRecord
from torchliner.records.slabs import StoredVelocity as StoredVelocity
from torchliner.records.velocity_plane import VelocityPlane as VelocityPlane
from torchliner.records.wall_eduction import FieldFit as FieldFit
from torchliner.records.wall_eduction import WallEduction as WallEduction
