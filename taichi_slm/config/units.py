"""Quantities in a config: a plain SI number, or a string with a unit ("54 um", "2 m/s").

Everything inside the program is SI. The annotated types made by :func:`quantity` are the only place
where a unit is read, and the only place where a number is checked to be finite.
"""

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from typing import Annotated, Any, get_args

from pydantic import BaseModel, BeforeValidator, Field, WithJsonSchema

# The units that nearly every config uses, as powers of ten, so that reading it does not wait 0.4 s for pint.
_DECADES: dict[str, dict[str, int]] = {
    "m": {"m": 0, "cm": -2, "mm": -3, "um": -6, "µm": -6, "μm": -6, "nm": -9},
    "s": {"s": 0, "ms": -3, "us": -6, "µs": -6, "μs": -6, "ns": -9},
    "W": {"W": 0, "mW": -3, "kW": 3},
    "K": {"K": 0},
    "m/s": {"m/s": 0, "mm/s": -3, "um/us": 0},
    "m/s^2": {"m/s^2": 0},
    "Hz": {"Hz": 0, "kHz": 3},
}
_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s^].*)?")
_UNIT = re.compile(r"(?:[^\W\d_]|[%°/· ()]|(?:\^|\*\*)-?[1-9]\b|\*)*")


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # slow to import, and a config of plain numbers does not need it

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def _expected(unit: str) -> str:
    return f"expected a number or a string with a unit such as '1 {unit}'" if unit else "expected a number"


def _no_switch(value: Any) -> Any:
    if isinstance(value, bool):  # pydantic reads `true` as 1
        raise ValueError("expected a whole number")
    return value


NO_SWITCH = BeforeValidator(_no_switch)
"""Of a whole number, behind its bounds: `true` is none."""


def to_si(value: Any, unit: str) -> float:
    """Return ``value`` in ``unit`` (an SI unit, e.g. "m").

    Accepts a finite int or float (already SI) or a string such as "54 um" with any unit that pint knows.
    Raises ValueError with a sentence a user can act on.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(_expected(unit))
    if isinstance(value, str):
        number = _parse(value.strip(), unit)
    else:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{_short(value)} is not a finite number")
    return number


def _short(value: Any) -> str:
    try:
        text = str(value)
    except ValueError:  # an int of more than 4300 digits
        return "this"
    return text if len(text) <= 40 else text[:37] + "..."


def _parse(text: str, unit: str) -> float:
    if len(text) > 80:
        raise ValueError("a quantity of more than 80 characters is not a quantity")
    if text.lower().lstrip("+-.") in ("inf", "infinity", "nan"):
        return math.nan
    parts = _QUANTITY.fullmatch(text)
    if parts is None:
        raise ValueError(f"'{text}' is not a number" + (f" with a unit such as '1 {unit}'" if unit else ""))
    digits, given = parts.groups()
    if given is None:
        return float(digits)
    decade = _DECADES.get(unit, {}).get(given)
    if decade is not None:
        try:
            return float(Decimal(digits).scaleb(decade))
        except ArithmeticError:  # an exponent beyond all reason
            return math.inf
    return _by_pint(float(digits), given, unit)


def _by_pint(number: float, given: str, unit: str) -> float:
    import pint

    if not _UNIT.fullmatch(given):
        raise ValueError(
            f"'{_short(given)}' is not a unit" + (f"; expected one such as '{unit}'" if unit else "")
        )
    try:
        return float(_registry().Quantity(number, given).to(unit).magnitude)
    except pint.DimensionalityError as error:
        wanted = f"cannot be turned into {unit}" if unit else "is not a plain number"
        raise ValueError(f"'{number:g} {given}' is in {error.units1}, which {wanted}") from None
    except Exception:  # pint raises a dozen kinds on malformed text; all mean the same to a user
        raise ValueError(
            f"'{given}' is not a unit" + (f"; expected one such as '{unit}'" if unit else "")
        ) from None


_SCHEMA_BOUNDS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}


@dataclass(frozen=True)
class Unit:
    """What a quantity's annotation says of it: its SI unit, "" for a plain number."""

    symbol: str


def quantity(unit: str, **bounds: Any) -> Any:
    """An annotated float in SI ``unit`` with pydantic ``bounds`` (gt, ge, lt, le)."""
    number = {"type": "number", **{_SCHEMA_BOUNDS[name]: value for name, value in bounds.items()}}
    schema: dict[str, Any] = {"anyOf": [number, {"type": "string"}], "description": f"[{unit or '-'}]"}
    check = BeforeValidator(lambda value: to_si(value, unit))
    return Annotated[float, check, Field(**bounds), WithJsonSchema(schema), Unit(unit)]


def unit_at(model: BaseModel, key: str) -> str:
    """The SI unit of the value at ``key`` ("laser.path.0.speed") of a config; "" where it has none."""
    value: Any = model
    kinds: tuple[Any, ...] = ()
    for word in key.split("."):
        if isinstance(value, BaseModel):
            field = type(value).model_fields.get(word)
            kinds = (field.annotation, *field.metadata) if field else ()
            value = getattr(value, word, None)
        elif isinstance(value, list | tuple):
            value = value[int(word)] if word.isdigit() and int(word) < len(value) else None
        else:
            value = value.get(word) if isinstance(value, dict) else None
    return _symbol(kinds) if isinstance(value, float) else ""


def _symbol(kinds: tuple[Any, ...]) -> str:
    """The first unit among ``kinds``, annotations and what they consist of."""
    for kind in kinds:
        found = (
            kind.symbol
            if isinstance(kind, Unit)
            else _symbol((*getattr(kind, "__metadata__", ()), *get_args(kind)))
        )
        if found:
            return str(found)
    return ""


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
