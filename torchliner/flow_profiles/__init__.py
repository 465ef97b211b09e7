"""Mean-flow profiles of a duct and their integral measures."""

from torchliner.flow_profiles.displacement import displacement_thickness
from torchliner.flow_profiles.law_of_the_wall import LawOfTheWallProfile
from torchliner.flow_profiles.mean_flow import FlowProfile, MeanFlow
from torchliner.flow_profiles.simple import ParabolicProfile, UniformProfile
from torchliner.flow_profiles.tabulated_profile import TabulatedProfile
from torchliner.flow_profiles.tanh import THIN_SHEAR, THINNEST_SHEAR, TanhProfile

__all__ = [
    "THINNEST_SHEAR",
    "THIN_SHEAR",
    "FlowProfile",
    "LawOfTheWallProfile",
    "MeanFlow",
    "ParabolicProfile",
    "TabulatedProfile",
    "TanhProfile",
    "UniformProfile",
    "displacement_thickness",
]
