"""Why nothing could be identified. Each message says what was wrong and what to do about it."""


class IdentificationError(ValueError):
    """Base of everything the estimators refuse or fail at."""


class RecordError(IdentificationError):
    """A record from which nothing can be identified: which quantity, its value, the bound, the unit, what to do.

    ``minimum`` or ``maximum`` is None where that side has no bound.
    """

    def __init__(
        self,
        quantity: str,
        value: float,
        minimum: float | None,
        maximum: float | None,
        unit: str,
        remedy: str,
    ) -> None:
        bounds = [f"at least {minimum:.6g}"] if minimum is not None else []
        bounds += [f"at most {maximum:.6g}"] if maximum is not None else []
        shown_unit = "" if unit == "1" else f" {unit}"
        super().__init__(f"{quantity} is {value:.6g}{shown_unit}, must be {' and '.join(bounds)}{shown_unit}: {remedy}")
        self.quantity = quantity
        self.value = value
        self.minimum = minimum
        self.maximum = maximum
        self.unit = unit
        self.remedy = remedy


class DataFileError(IdentificationError):
    """A file that cannot be read as columns of numbers."""


class StructureError(IdentificationError):
    """A structure that does not exist; the message lists those that do."""


class NoStartError(IdentificationError):
    """No starting value gives a stable model."""


class NotConvergedError(IdentificationError):
    """The iteration found no minimum; the record does not determine this structure."""


class NotContinuousError(IdentificationError):
    """A sampled model that no continuous-time system of the same order can have produced."""


class UnstableModelError(IdentificationError):
    """Parameters that describe no stable system with poles in the sampled band."""
