"""Mean-flow profiles of a duct and their integral measures."""

from torchliner.flow_profiles.law_of_the_wall import LawOfTheWallProfile
from torchliner.flow_profiles.mean_flow import FlowProfile, MeanFlow
from torchliner.flow_profiles.simple import (
    THIN_SHEAR,
    THINNEST_SHEAR,
    ParabolicProfile,
    TanhProfile,
    UniformProfile,
)
from torchliner.flow_profiles.tabulated_profile import TabulatedProfile, displacement_thickness

__all__ = [
    "THINNEST_SHEAR", "THIN_SHEAR", "FlowProfile", "LawOfTheWallProfile", "MeanFlow",
    "ParabolicProfile", "TabulatedProfile", "TanhProfile", "UniformProfile",
    "displacement_thickness",
]  # fmt: skip
