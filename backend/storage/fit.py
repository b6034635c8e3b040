"""What a document has to be, to be taken in as a record: what its columns hold, and what makes sense together."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, Boolean, Float, LargeBinary, String
from sqlalchemy.types import Integer

from backend.documents.bank_entry import EntryModel
from backend.documents.run_banks import LARGEST
from backend.plain_text import PlainTextError, require_line
from backend.storage.origins import BANKS, CALIBRATIONS
from backend.storage.runs import EndState, RunKind
from backend.storage.schema import Document, UtcDateTime

_OVER = [str(state) for state in EndState if state is not EndState.RUNNING]
_LISTS = ("criteria",)
"""Columns of JSON that hold a list."""
_MODELS = [name for name in EntryModel.__dataclass_fields__ if name != "version"]
_LINES = ("name", "title", "label", "symbol", "unit", "kind", "who", "parameters_name", "plant", "software", "method")
"""Parts of a document that are texts of one line, wherever they are."""
_LARGEST_NUMBER = 1e12
"""As of a bank that comes by a request."""
_CALIBRATION = {"step": str, "fingerprint": str, "calibrations": list}


class UnfitDocumentError(ValueError):
    """A document that is no record of its kind; the message says which part of it is wrong."""


def unfit(name: str, value: Any, needed: str) -> UnfitDocumentError:
    """Return the refusal of a part: what it is, what it would have to be, and what to do."""
    return UnfitDocumentError(f"{name} cannot be {str(value)[:40]!r}: it is {needed}; make the file anew from the run")


def require_fit(kind: str, column: Any, value: Any) -> None:
    """Raise UnfitDocumentError for what the column cannot hold."""
    if value is None and column.nullable:
        return
    assert isinstance(column.type, UtcDateTime | JSON | String | Boolean | Float | Integer | LargeBinary)
    if isinstance(column.type, UtcDateTime):
        fits, needed = _is_instant(value), "a moment with its time zone"
    elif isinstance(column.type, JSON):
        wanted = list if column.name in _LISTS else dict
        fits, needed = isinstance(value, wanted), "a list" if wanted is list else "an object"
    elif isinstance(column.type, String):  # Text too
        length = column.type.length
        fits = isinstance(value, str) and len(value) <= (length or len(value))
        needed = f"a text of {length} characters at most" if length else "a text"
    elif isinstance(column.type, Boolean):
        fits, needed = isinstance(value, bool), "true or false"
    else:
        numbers = int | float if isinstance(column.type, Float) else int
        fits = isinstance(value, numbers) and not isinstance(value, bool) and abs(value) <= LARGEST
        needed = f"a number between -{LARGEST} and {LARGEST}"
    if not fits:
        raise unfit(f"{column.name} of a {kind}", value, needed)


def _is_instant(value: Any) -> bool:
    try:
        moment = datetime.fromisoformat(value)
        return moment.tzinfo is not None and bool(moment.astimezone(UTC))
    except (TypeError, ValueError, OverflowError):
        return False


def require_run(document: Document) -> None:
    """Raise UnfitDocumentError for a run that cannot have been one, or was not over."""
    kinds, bank = [str(kind) for kind in RunKind], document["bank_id"]
    if document["kind"] not in kinds:
        raise unfit("kind of a run", document["kind"], f"one of {', '.join(kinds)}")
    if document["end_state"] == EndState.RUNNING:
        raise UnfitDocumentError("it is of a run that was not over: export it again once it is")
    if document["end_state"] not in _OVER:
        raise unfit("end_state of a run", document["end_state"], f"one of {', '.join(_OVER)}")
    began, ended = document["started_at"], document["ended_at"]
    if ended is None or datetime.fromisoformat(ended) < datetime.fromisoformat(began):
        raise unfit("ended_at of a run", ended, f"a moment after started_at, {began}")
    loop = document["settings"].get("loop")
    named = loop.get("bank") if isinstance(loop, Mapping) else None
    if named is not None and named != (bank or 0):
        raise unfit("settings.loop.bank of a run", named, f"its bank_id, {bank}")


def require_lines(document: Any) -> None:
    """Raise UnfitDocumentError for a name, title, label, symbol or unit in a document that is no text of one line."""
    parts = [document]
    try:
        while parts:
            part = parts.pop()
            if isinstance(part, Mapping):
                for name, value in part.items():
                    require_line(name)
                    if name in _LINES and isinstance(value, str):
                        require_line(value)
                    parts.append(value)
            elif isinstance(part, list):
                parts.extend(part)
    except PlainTextError as error:
        raise UnfitDocumentError(f"{error}; make the file anew from the run") from None


def require_entry(entry: Mapping[str, Any]) -> None:
    """Raise UnfitDocumentError for an entry of a bank that no loop could be made of."""
    if entry["S_nominal"] <= 0.0:
        raise unfit("S_nominal of a bank entry", entry["S_nominal"], "a stiffness above 0 N·m/rad")
    if not set(_MODELS) & set(entry["model"]):
        raise unfit("model of a bank entry", entry["model"], f"an object with {', '.join(_MODELS)}")
    for name in set(_MODELS) & set(entry["model"]):
        number = entry["model"][name]
        if not isinstance(number, int | float) or isinstance(number, bool) or not 0.0 < number <= _LARGEST_NUMBER:
            raise unfit(f"{name} of a bank entry", number, f"a number above 0, at most {_LARGEST_NUMBER:g}")


def require_carried(carried: Mapping[str, Any], *, of_run: bool) -> None:
    """Raise UnfitDocumentError for what goes with no record, or is not what it is called."""
    known = (CALIBRATIONS, BANKS) if of_run else ()
    for name in carried:
        if name not in known:
            raise unfit(
                "a part of what is carried", name, f"one of {', '.join(known)}" if known else "none, but with runs"
            )
    steps, numbers = carried.get(CALIBRATIONS, []), carried.get(BANKS, [])
    if not isinstance(steps, list) or not all(_is_calibration(one) for one in steps):
        raise unfit(f"carried.{CALIBRATIONS}", steps, f"a list of objects with {', '.join(_CALIBRATION)}")
    if not isinstance(numbers, list) or not all(type(one) is int and 0 < one <= LARGEST for one in numbers):
        raise unfit(f"carried.{BANKS}", numbers, f"a list of numbers from 1 to {LARGEST}")


def _is_calibration(one: Any) -> bool:
    return (
        isinstance(one, Mapping)
        and set(one) == set(_CALIBRATION)
        and all(isinstance(one[name], kind) for name, kind in _CALIBRATION.items())
    )
