"""What is said when a value is refused: which quantity, its value, the bounds, the unit, and what to do."""


class OutOfRangeError(ValueError):
    """A number outside what is allowed. ``minimum`` or ``maximum`` is None where that side has no bound."""

    def __init__(
        self,
        quantity: str,
        value: float,
        minimum: float | None,
        maximum: float | None,
        unit: str,
        remedy: str = "",
    ) -> None:
        self.quantity = quantity
        self.value = value
        self.minimum = minimum
        self.maximum = maximum
        self.unit = unit
        self.remedy = remedy
        super().__init__(_sentence(quantity, value, minimum, maximum, unit, remedy))


def _sentence(quantity: str, value: float, minimum: float | None, maximum: float | None, unit: str, remedy: str) -> str:
    shown_unit = "" if unit == "1" else f" {unit}"
    bounds = []
    if minimum is not None:
        bounds.append(f"at least {minimum:.4g}")
    if maximum is not None:
        bounds.append(f"at most {maximum:.4g}")
    sentence = (
        f"{quantity} = {_shown(value)}{shown_unit} is out of range: it must be {' and '.join(bounds)}{shown_unit}"
    )
    return f"{sentence}; {remedy}" if remedy else sentence


def _shown(value: float) -> str:
    try:
        return f"{value:.6g}"
    except OverflowError:  # a whole number beyond the largest float
        return f"a number of {len(str(abs(int(value))))} digits"


def require_within(
    quantity: str, value: float, minimum: float | None, maximum: float | None, unit: str, remedy: str = ""
) -> None:
    """Raise OutOfRangeError unless minimum <= value <= maximum; nan and infinities are refused too."""
    above = minimum is None or value >= minimum
    below = maximum is None or value <= maximum
    if not (above and below and abs(value) < float("inf")):
        raise OutOfRangeError(quantity, value, minimum, maximum, unit, remedy)
