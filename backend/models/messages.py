"""Messages about stored documents that cannot be read."""

from plant import catalogue_entry


@catalogue_entry
def document_of_newer_version(*, owner: str, label: str, version: int, supported: int) -> str:
    return (
        f"{owner}: {label} of version {version} cannot be read: a newer version of Sinew wrote it; "
        f"this version reads versions up to {supported}"
    )


@catalogue_entry
def document_unreadable(*, owner: str, label: str, field: str, reason: str) -> str:
    place = f", field {field}" if field else ""
    return f"{owner}: {label} cannot be read{place}: {reason}"
