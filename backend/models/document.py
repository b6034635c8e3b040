"""Converts between stored JSON documents and dataclasses; computes digests. Pure.

A document has a ``version``; one without it, from before versions existed, counts as version 0. ``upgrades`` rewrites
documents of earlier forms before they are read.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from backend.models import messages
from plant import ErrorCode, SinewError

Document = dict[str, Any]
T = TypeVar("T")
ABSENT = {"absent": True}
"""Metadata of a field that is not written to the document if it is None."""


def document_digest(document: Any) -> str:
    """Return the SHA-256 of a JSON document in hex.

    It does not depend on spaces and the order of keys.
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


class UnreadableDocumentError(SinewError):
    """A stored document is invalid or of a newer version."""

    category = ErrorCode.UNAVAILABLE


class DocumentCodec(Generic[T]):
    """Reads and writes one kind of document.

    ``model`` is the dataclass or type, ``label`` names the document in error messages. ``version`` is the version that
    is written, 0 for a part of a document that has the version.
    """

    def __init__(self, model: Any, label: str, version: int) -> None:
        self._adapter: TypeAdapter[T] = TypeAdapter(model)
        self._label = label
        self._version = version

    def read(self, document: Any, owner: str) -> T:
        """Return the value of a document.

        Error messages name its ``owner``, such as "run 12". Raises UnreadableDocumentError.
        """
        version = document.get("version", 0) if isinstance(document, Mapping) else 0
        if type(version) is not int or version < 0:
            reason = "it should be a whole number"
            raise UnreadableDocumentError(
                messages.document_unreadable(owner=owner, label=self._label, field="version", reason=reason)
            )
        if version > self._version:
            raise UnreadableDocumentError(
                messages.document_of_newer_version(
                    owner=owner, label=self._label, version=version, supported=self._version
                )
            )
        try:
            return self._adapter.validate_json(json.dumps(document), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field, reason = ".".join(str(part) for part in first["loc"]), _describe_error(first)
            raise UnreadableDocumentError(
                messages.document_unreadable(owner=owner, label=self._label, field=field, reason=reason)
            ) from None

    def write(self, value: T) -> Any:
        """Return the document of a value, with null for nan and infinity."""
        return _to_json_value(value)


def _describe_error(error: ErrorDetails) -> str:
    """Return what is wrong with a field, such as "it is missing"."""
    if error["type"] == "missing":
        return "it is missing"
    return error["msg"].replace("Input should be ", "it should be ").removeprefix("Value error, ")


def _is_omitted(value: Any, item: "Field[Any]") -> bool:
    return item.metadata == ABSENT and getattr(value, item.name) is None


def replace_non_finite(document: Mapping[str, Any]) -> Document:
    """Return the document with null for nan and infinity, which JSON lacks."""
    return {name: _to_json_value(value) for name, value in document.items()}


def _to_json_value(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        parts = {item.name: getattr(value, item.name) for item in fields(value) if not _is_omitted(value, item)}
        return replace_non_finite(parts)
    if isinstance(value, Mapping):
        return replace_non_finite(value)
    if isinstance(value, list | tuple):
        return [_to_json_value(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
