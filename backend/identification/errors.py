"""Why nothing could be identified. Each message says what was wrong and what to do about it."""

from enum import StrEnum


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


class FileFault(StrEnum):
    """What is wrong with a file of samples, for programs and tests."""

    UNREADABLE = "unreadable"
    FORMAT = "format"
    ENCODING = "encoding"
    TOO_LONG = "too_long"
    NO_HEADING = "no_heading"
    AMBIGUOUS_HEADING = "ambiguous_heading"
    ROW_WIDTH = "row_width"
    NOT_A_NUMBER = "not_a_number"
    AMBIGUOUS_DECIMALS = "ambiguous_decimals"
    MIXED_DECIMALS = "mixed_decimals"
    NO_COLUMN = "no_column"
    AMBIGUOUS_COLUMN = "ambiguous_column"
    OBJECTS = "objects"
    NO_TIME = "no_time"
    AMBIGUOUS_TIME = "ambiguous_time"
    TIME_UNIT = "time_unit"
    DATES = "dates"
    ROWS = "rows"
    OPTION = "option"


class DataFileError(IdentificationError):
    """A file that cannot be read as columns of numbers: which fault, and where.

    ``option`` is the option of the command line that resolves it, None where only another file does.
    """

    def __init__(
        self,
        message: str,
        fault: FileFault,
        *,
        column: str | None = None,
        line: int | None = None,
        option: str | None = None,
    ) -> None:
        super().__init__(message)
        self.fault = fault
        self.column = column
        self.line = line
        self.option = option


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
