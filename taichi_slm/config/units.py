"""Quantities in a config: a plain SI number, or a string with a unit ("54 um", "2 m/s").

Everything inside the program is SI. The annotated types made by :func:`quantity` are the only place
where a unit is read, and the only place where a number is checked to be finite.
"""

import math
from functools import lru_cache
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # slow to import, and a config of plain numbers does not need it

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def to_si(value: Any, unit: str) -> float:
    """Return ``value`` in ``unit`` (an SI unit, e.g. "m").

    Accepts a finite int or float (already SI) or a string that pint can read.
    Raises ValueError with a sentence a user can act on.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected a number or a string with a unit such as '1 {unit}'")
    if isinstance(value, str):
        value = _parse(value, unit)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{value} is not a finite number")
    return number


def _parse(text: str, unit: str) -> float:
    import pint

    if len(text) > 80:
        raise ValueError("a quantity of more than 80 characters is not a quantity")
    if "**" in text or "^" in text[text.find(" ") + 1 :].replace("^2", "").replace("^3", ""):
        raise ValueError(f"'{text}': powers other than ^2 and ^3 are not read")
    try:
        parsed = _registry().Quantity(text)
        return float(parsed.magnitude) if parsed.unitless and parsed.dimensionless else float(parsed.to(unit).magnitude)
    except pint.DimensionalityError as error:
        raise ValueError(f"'{text}' is in {error.units1}, which is not a unit of {unit or 'a plain number'}") from None
    except Exception:  # pint raises a dozen kinds on malformed text; all mean the same to a user
        raise ValueError(f"'{text}' is not a number with a unit such as '1 {unit}'") from None


def quantity(unit: str, **bounds: float) -> Any:
    """An annotated float in SI ``unit`` with pydantic ``bounds`` (gt, ge, lt, le)."""
    schema: dict[str, Any] = {"anyOf": [{"type": "number"}, {"type": "string"}], "description": f"[{unit or '-'}]"}
    return Annotated[
        float, BeforeValidator(lambda value: to_si(value, unit)), Field(**bounds), WithJsonSchema(schema)
    ]


Length = quantity("m")
PositiveLength = quantity("m", gt=0)
NonNegativeLength = quantity("m", ge=0)
Time = quantity("s", ge=0)
PositiveTime = quantity("s", gt=0)
Temperature = quantity("K", gt=0)
TemperatureDifference = quantity("K", gt=0)
Power = quantity("W", ge=0)
Speed = quantity("m/s")
PositiveSpeed = quantity("m/s", gt=0)
Acceleration = quantity("m/s^2")
Frequency = quantity("Hz", gt=0)
Number = quantity("")
Fraction = quantity("", ge=0, le=1)
PositiveNumber = quantity("", gt=0)
NonNegativeNumber = quantity("", ge=0)
