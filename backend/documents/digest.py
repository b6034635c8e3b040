"""What a document says, as one number: the same for the same content, however it is written down. Pure."""

import hashlib
import json
from typing import Any


def digest_of(document: Any) -> str:
    """Return the sha256 of a JSON document, in hex: of its text without spaces, keys in order, UTF-8."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
