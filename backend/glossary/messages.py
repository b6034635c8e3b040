"""Messages about documents that lack what the glossary needs, and about terms that are defined twice."""

from plant import catalogue_entry


@catalogue_entry
def term_or_meaning_missing(*, heading: str) -> str:
    return f"docs/glossary.md, {heading}: a row has no term or no meaning"


@catalogue_entry
def limits_not_explained(*, limits: str) -> str:
    return f"docs/reference/faults.md does not explain the limits {limits}"


@catalogue_entry
def code_name_or_meaning_missing(*, symbol: str) -> str:
    return f"docs/reference/notation.md: {symbol!r} needs a code name and a meaning"


@catalogue_entry
def fault_not_explained(*, fault: str, needed: str) -> str:
    return f"docs/reference/faults.md: {fault} needs {needed}"


@catalogue_entry
def section_missing(*, heading: str) -> str:
    return f"there is no section {heading!r}"


@catalogue_entry
def term_explained_twice(*, key: str) -> str:
    return f"{key} is explained twice"
