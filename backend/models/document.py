"""Reads and writes stored documents as dataclasses, and their digests. Pure."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from plant import ErrorCode, SinewError

# Digest --------------------------------------------------------------------------------------------
#
# What a document says, as one number: the same for the same content, however it is written down.
# Pure.


def document_digest(document: Any) -> str:
    """Return the sha256 of a JSON document, in hex: of its text without spaces, keys in order, UTF-8."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


# Edge ----------------------------------------------------------------------------------------------
#
# Where a stored document becomes a dataclass, and a dataclass a document. Pure.
#
# A document carries its ``version``; one from before there were versions carries none, and is read
# as one of the first. One that is broken, or of a newer version, is refused in a sentence that says
# whose it is. What was written in another form, ``upgrades`` rewrites before it is read.


Document = dict[str, Any]
T = TypeVar("T")
ABSENT = {"absent": True}
"""Metadata of a part that a document may not have: None, and then not written."""


class UnreadableDocumentError(SinewError):
    """A stored document that cannot be read: which field of what, and why."""

    category = ErrorCode.UNAVAILABLE


class DocumentCodec(Generic[T]):
    """Reads and writes one kind of document.

    ``what`` names it in a sentence, ``version`` is the one that is written, 0 for parts of a document that tells it.
    """

    def __init__(self, form: Any, what: str, version: int) -> None:
        self._adapter: TypeAdapter[T] = TypeAdapter(form)
        self._what = what
        self._version = version

    def read(self, document: Any, of: str) -> T:
        """Return what a document of ``of``, "run 12", says. Raises UnreadableDocumentError."""
        stored = document.get("version", 0) if isinstance(document, Mapping) else 0
        if type(stored) is not int or stored < 0:
            raise UnreadableDocumentError(
                f"{of}: {self._what} cannot be read, field version: it should be a whole number"
            )
        if stored > self._version:
            raise UnreadableDocumentError(
                f"{of}: {self._what} is of version {stored}, written by a newer Sinew; this one reads versions up to "
                f"{self._version}: open it with the newer one"
            )
        try:
            return self._adapter.validate_json(json.dumps(document), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            at = f", field {place}" if place else ""
            raise UnreadableDocumentError(f"{of}: {self._what} cannot be read{at}: {_told(first)}") from None

    def write(self, value: T) -> Any:
        """Return the document that says it, with null for nan and infinity, which JSON does not have."""
        return _ready(value)


def _told(error: ErrorDetails) -> str:
    """Return what is wrong with a field: "it is missing", "it should be a valid number"."""
    if error["type"] == "missing":
        return "it is missing"
    return error["msg"].replace("Input should be ", "it should be ").removeprefix("Value error, ")


def _is_left_out(value: Any, item: "Field[Any]") -> bool:
    return item.metadata == ABSENT and getattr(value, item.name) is None


def replace_non_finite(document: Mapping[str, Any]) -> Document:
    """Return the same document with null for nan and infinity, which JSON does not have."""
    return {name: _ready(value) for name, value in document.items()}


def _ready(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        parts = {item.name: getattr(value, item.name) for item in fields(value) if not _is_left_out(value, item)}
        return replace_non_finite(parts)
    if isinstance(value, Mapping):
        return replace_non_finite(value)
    if isinstance(value, list | tuple):
        return [_ready(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
