"""A bank as a file, to take it to another data folder: JSON that says what it is, checked when it comes in."""

import json
from typing import Any

from backend.experiments.banks.bank_building import require_name
from backend.experiments.banks.bank_consistency import MODEL_NAMES, BankError, NamedEntry, require_consistent
from backend.plain_text import PlainTextError, as_line, require_plain_texts
from backend.storage import banks
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database
from plant.parameters import PlantParameters

FORMAT = "sinew-bank"
VERSION = 1
MAX_ENTRIES = 20
MAX_BYTES = 100_000

_ENTRY_NAMES = ("S_nominal", *MODEL_NAMES, "tension_N")
_UNITS = {
    "S_nominal": "N·m/rad",
    "K_q": "rad/rad",
    "T_q": "s",
    "K_S": "N·m/rad per rad",
    "T_S": "s",
    "tension_N": "N",
}


def to_document(bank: Bank) -> dict[str, Any]:
    """Return a bank as the file says it; lineage stays behind, it is of the data folder the bank came from."""
    made = f"{bank.created_at:%FT%TZ}"
    entries = [{"S_nominal": entry.S_nominal, **_known(entry.model)} for entry in bank.entries]
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": as_line(bank.name),
        "exported_from": {"bank": bank.id, "version": bank.version, "who": as_line(bank.who), "made": made},
        "units": _UNITS,
        "entries": entries,
    }


def read_file(text: str) -> dict[str, Any]:
    """Return the document of a file's text. Raises BankError."""
    if len(text.encode()) > MAX_BYTES:
        raise BankError(f"the file is larger than {MAX_BYTES} bytes: that is no bank")
    try:
        document = json.loads(text)
        require_plain_texts(document)
    except PlainTextError as error:
        raise BankError(f"the file: {error}") from None
    except (ValueError, RecursionError) as error:
        raise BankError(f"the file is not JSON: {error}") from None
    if not isinstance(document, dict):
        raise BankError("the file is not a bank: it holds no JSON object")
    return document


def import_bank(
    database: Database, parameters: PlantParameters, document: dict[str, Any], who: str, name: str = ""
) -> Bank:
    """Store an exported bank as the next version of its name, or of ``name``. Raises BankError."""
    if document.get("format") != FORMAT or document.get("version") != VERSION:
        raise BankError(f"the file is not a bank: it needs format = {FORMAT!r} and version = {VERSION}")
    called, listed = name or document.get("name"), document.get("entries")
    if not isinstance(called, str) or len(called) > 60:
        raise BankError("the bank in the file needs a name of at most 60 characters")
    require_name(called)
    if not isinstance(listed, list) or not 0 < len(listed) <= MAX_ENTRIES:
        raise BankError(f"the bank in the file needs 1 to {MAX_ENTRIES} entries")
    entries = require_consistent(parameters, [_named(position, item) for position, item in enumerate(listed, start=1)])
    origin = document.get("exported_from")
    note = f"imported; exported from {json.dumps(origin, ensure_ascii=False)[:200]}" if origin else "imported"
    with database.session() as session:
        return banks.add(session, called.strip(), entries, who, note)


def _named(position: int, item: Any) -> NamedEntry:
    name = f"entry {position}"
    tension_N = item.get("tension_N") if isinstance(item, dict) else None
    if isinstance(tension_N, int | float) and not isinstance(tension_N, bool):
        name = f"the {tension_N:g} N entry"
    if not isinstance(item, dict) or not set(item) <= set(_ENTRY_NAMES):
        raise BankError(f"{name} may have {', '.join(_ENTRY_NAMES)} and nothing else")
    for key, value in item.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BankError(f"{name} has {key} = {value!r}: it must be a number")
    S_nominal = item.get("S_nominal")
    if S_nominal is None:
        raise BankError(f"{name} has no S_nominal")
    return NamedEntry(name, BankEntry(float(S_nominal), _known(item)))


def _known(model: dict[str, Any]) -> dict[str, Any]:
    return {key: model[key] for key in (*MODEL_NAMES, "tension_N") if model.get(key) is not None}
