"""What an alloy file or an inline material may say: one law per property and phase, each with its source."""

from itertools import pairwise
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from taichi_slm.config.units import (
    Fraction,
    NonNegativeNumber,
    Number,
    PositiveNumber,
    Temperature,
)


class Frozen(BaseModel):
    """Base of every part of a config: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Line(Frozen):
    """value + slope (T - at)."""

    value: Number
    slope: Number
    at: Number = Field(description="temperature at which the line has `value` [K]")


class Sulphur(Frozen):
    """Surface tension of liquid iron with sulphur, paper eq. (50) in corrected units [N/m]."""

    pure: Number = Field(
        1.943, description="surface tension of the pure metal at `melting_temperature` [N/m]"
    )
    slope: Number = Field(
        4.3e-4, description="A: minus its temperature slope [N/(m K)]; the paper prints 5e-4"
    )
    melting_temperature: Temperature = 1809.0
    sulphur_wt_percent: NonNegativeNumber = 0.0022


class Law(Frozen):
    """A property as a function of temperature T [K], SI. Exactly one form."""

    constant: Number | None = None
    polynomial: list[Number] | None = Field(None, description="coefficients of T^0, T^1, T^2 ...")
    line: Line | None = None
    table: list[tuple[Number, Number]] | None = Field(None, description="[T, value] pairs, T increasing")
    log10_arrhenius: tuple[Number, Number, PositiveNumber] | None = Field(
        None, description="[a, b, unit]: 10^(a/T + b) times unit"
    )
    sulphur: Sulphur | None = None
    source: str = ""

    @model_validator(mode="after")
    def _one_form(self) -> "Law":
        forms = [name for name in LAW_FORMS if getattr(self, name) is not None]
        if len(forms) != 1:
            raise ValueError(f"a law needs exactly one of {', '.join(LAW_FORMS)}; got {len(forms)}")
        if self.table is not None:
            temperatures = [row[0] for row in self.table]
            if len(temperatures) < 2 or any(b <= a for a, b in pairwise(temperatures)):
                raise ValueError("a table needs two or more rows with increasing temperature")
        return self


LAW_FORMS = ("constant", "polynomial", "line", "table", "log10_arrhenius", "sulphur")


class PhaseLaw(Frozen):
    """A property below the solidus and above the liquidus; linear in T between their end values (eq. 40)."""

    solid: Law | None = None
    liquid: Law


class Evaporation(Frozen):
    """Clausius-Clapeyron data for heat loss and recoil pressure."""

    latent_heat: PositiveNumber = Field(description="[J/kg]")
    molar_mass: PositiveNumber = Field(description="[kg/mol]")
    boiling_temperature: Temperature
    source: str = ""


class MaterialFields(Frozen):
    """The properties of a material, all optional: what an override may change."""

    description: str | None = None
    solidus: Temperature | None = None
    liquidus: Temperature | None = None
    latent_heat: NonNegativeNumber | None = Field(None, description="of melting [J/kg]")
    density: PhaseLaw | None = Field(None, description="[kg/m^3]")
    heat_capacity: PhaseLaw | None = Field(None, description="[J/(kg K)]")
    conductivity: PhaseLaw | None = Field(None, description="[W/(m K)]")
    viscosity: PhaseLaw | None = Field(
        None, description="dynamic [Pa s]; the solid's value counts at the solidus only"
    )
    mushy_viscosity_factor: PositiveNumber | None = Field(
        None, description="viscosity at the solidus over that of the liquid; replaces viscosity.solid"
    )
    surface_tension: Law | None = Field(None, description="[N/m]")
    emissivity: Fraction | None = None
    absorptivity: Fraction | None = Field(None, description="absorbed fraction of the laser power")
    evaporation: Evaporation | None = None
    maximum_temperature: Temperature | None = Field(None, description="end of the property tables [K]")
    sources: dict[str, str] | None = None


class MaterialOverride(MaterialFields):
    """A material in a config: its own laws, or those of another one (`extends`) with changes."""

    extends: str | None = Field(None, description="name of an alloy that ships, or of another entry")
    scale: dict[
        Literal["density", "heat_capacity", "conductivity", "viscosity", "surface_tension"], PositiveNumber
    ] = Field(default_factory=dict, description="factor per property, applied last")


class Material(MaterialFields):
    """A complete material.

    Without solidus and liquidus it is a liquid at every temperature.
    """

    name: str
    density: PhaseLaw
    heat_capacity: PhaseLaw
    conductivity: PhaseLaw
    viscosity: PhaseLaw
    latent_heat: NonNegativeNumber = 0.0
    emissivity: Fraction = 0.0
    absorptivity: Fraction = 1.0
    maximum_temperature: Temperature = 12000.0
    scale: dict[str, PositiveNumber] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _phases(self) -> "Material":
        if (self.solidus is None) != (self.liquidus is None):
            raise ValueError("give both solidus and liquidus, or neither")
        if self.solidus is not None and self.liquidus is not None:
            if self.liquidus <= self.solidus:
                raise ValueError(f"solidus {self.solidus:g} K is not below liquidus {self.liquidus:g} K")
            boiling = self.evaporation.boiling_temperature if self.evaporation else None
            if boiling is not None and boiling <= self.liquidus:
                raise ValueError(f"liquidus {self.liquidus:g} K is not below boiling {boiling:g} K")
            if self.maximum_temperature <= self.liquidus:
                raise ValueError("maximum_temperature is not above the liquidus")
        return self

    @property
    def melts(self) -> bool:
        """Whether the material has a solid phase at all."""
        return self.solidus is not None


__all__: list[str] = [
    "Evaporation",
    "Frozen",
    "Law",
    "Line",
    "Material",
    "MaterialFields",
    "MaterialOverride",
    "PhaseLaw",
    "Sulphur",
]
