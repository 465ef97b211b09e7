"""The gas above and inside the liner."""

from __future__ import annotations

from dataclasses import dataclass

from torchliner.checks import make_plain, require_positive

GAS_CONSTANT_AIR = 287.05  # J/(kg K)
SUTHERLAND_VISCOSITY = 1.458e-6  # kg/(m s sqrt(K)), U.S. Standard Atmosphere 1976
SUTHERLAND_TEMPERATURE = 110.4  # K
FLUID_TOLERANCE = 1e-3  # by which two gases may differ without a word


@dataclass(frozen=True)
class Fluid:
    r"""A gas at rest, SI units. The defaults are air at 20 C and 101 325 Pa.

    Args:
        sound_speed: c, m/s.
        density: rho, kg/m3.
        dynamic_viscosity: eta, Pa s.
        heat_capacity_ratio: gamma; 1 for an isothermal gas, which has no thermal losses.
        prandtl: Pr = nu/kappa.
    Raises:
        ValueError: a value is not finite and positive, or gamma < 1.
    Source: Roncen et al. (2026), below eq. (2.2). Departure from print: kappa, there a "thermal conductivity", has to
        be the diffusivity nu/Pr for k_kappa = sqrt(j omega/kappa) to be a wavenumber.
    """

    sound_speed: float = 343.2
    density: float = 1.204
    dynamic_viscosity: float = 1.813e-5
    heat_capacity_ratio: float = 1.4
    prandtl: float = 0.71

    def __post_init__(self) -> None:
        make_plain(self, "fluid ", tensors=True)
        for name in self.__dataclass_fields__:
            require_positive(f"fluid {name}", getattr(self, name))
        if float(self.heat_capacity_ratio) < 1:
            raise ValueError(f"fluid heat_capacity_ratio is {self.heat_capacity_ratio:g}; it is at least 1")

    @classmethod
    def from_temperature(cls, temperature: float = 293.15, pressure: float = 101325.0) -> Fluid:
        """Dry air as a perfect gas with Sutherland's viscosity.

        Args:
            temperature: K, 150 to 1500 (range of the viscosity law, else ValueError).
            pressure: Pa.
        """
        if not 150.0 <= temperature <= 1500.0:
            raise ValueError(f"temperature is {temperature:g} K; Sutherland's law: 150 to 1500 K (20 C is 293.15)")
        require_positive("pressure", pressure)
        return cls(
            sound_speed=(1.4 * GAS_CONSTANT_AIR * temperature) ** 0.5,
            density=pressure / (GAS_CONSTANT_AIR * temperature),
            dynamic_viscosity=SUTHERLAND_VISCOSITY * temperature**1.5 / (temperature + SUTHERLAND_TEMPERATURE),
        )

    @property
    def kinematic_viscosity(self) -> float:
        """nu = eta/rho, m2/s."""
        return self.dynamic_viscosity / self.density

    @property
    def thermal_diffusivity(self) -> float:
        """kappa = nu/Pr, m2/s."""
        return self.kinematic_viscosity / self.prandtl

    @property
    def characteristic_impedance(self) -> float:
        """rho c, rayl (Pa s/m)."""
        return self.density * self.sound_speed


def gas_warnings(liner: Fluid, around: Fluid, name: str) -> list[str]:
    """What a liner's gas and that around it, of ``name``, state differently."""
    pairs = {each: (getattr(liner, each), getattr(around, each)) for each in ("sound_speed", "density")}
    return [
        f"{label} is {float(mine):.5g} in the liner and {float(theirs):.5g} in {name} (SI); the liner's is used for "
        "the model (liner.replace(fluid=...) takes another)"
        for label, (mine, theirs) in pairs.items()
        if abs(float(mine) / float(theirs) - 1) > FLUID_TOLERANCE
    ]
