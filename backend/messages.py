"""Messages of the top-level modules: texts, the data folder, settings and worker processes."""

from collections.abc import Sequence
from pathlib import Path

from plant import catalogue_entry

# Plain text ----------------------------------------------------------------------------------------


@catalogue_entry
def character_not_allowed(*, text: str, position: int, description: str) -> str:
    near = ascii(text[max(0, position - 20) : position + 20])
    return (
        f"the text contains the character U+{ord(text[position]):04X}, {description}, at position {position + 1} "
        f"(near {near}), which is not allowed in any text: delete it"
    )


@catalogue_entry
def character_not_allowed_in_line(*, text: str, position: int, description: str) -> str:
    near = ascii(text[max(0, position - 20) : position + 20])
    return (
        f"the text contains the character U+{ord(text[position]):04X}, {description}, at position {position + 1} "
        f"(near {near}), which is not allowed in a name, title or other text of one line: delete it"
    )


@catalogue_entry
def text_is_blank(*, text: str) -> str:
    return f"the text {text!r} is blank: enter visible characters"


# Data folder ---------------------------------------------------------------------------------------


@catalogue_entry
def data_folder_lost(*, folder: Path, reason: str) -> str:
    return (
        f"the data folder {folder} was deleted, moved or replaced while the service uses it ({reason}): new "
        "recordings are lost. Restore it, or restart the service"
    )


@catalogue_entry
def data_folder_lock_lost(*, lock: Path, reason: str) -> str:
    return (
        f"the lock in the data folder {lock} was deleted, moved or replaced while the service uses it ({reason}): new "
        "recordings are lost. Restore it, or restart the service"
    )


@catalogue_entry
def data_folder_path_in_use(*, folder: Path) -> str:
    return f"another service uses the folder {folder}, or an earlier folder at this path: stop it or choose --data"


@catalogue_entry
def data_folder_in_use(*, folder: Path) -> str:
    return f"another service uses the folder {folder}: stop it or choose --data"


@catalogue_entry
def service_is_starting(*, folder: Path) -> str:
    return f"the service that uses the folder {folder} is still starting: try again after it has printed its address"


@catalogue_entry
def no_service(*, folder: Path) -> str:
    return f"no service uses the folder {folder}: start it with `sinew serve`, or choose --data"


@catalogue_entry
def data_folder_not_permitted(*, path: Path | str, reason: str | None) -> str:
    return f"{path} cannot be used: {reason}; change its owner or mode, or choose another --data"


@catalogue_entry
def data_folder_is_a_file(*, folder: Path) -> str:
    return f"the data folder {folder} is a file or lies below one: choose another --data"


@catalogue_entry
def data_folder_unusable(*, folder: Path, path: Path | str | None, reason: str | None) -> str:
    return f"the data folder {folder} cannot be used: {reason} ({path}); choose another --data"


# Settings ------------------------------------------------------------------------------------------


@catalogue_entry
def password_file_unreadable(*, variable: str, file: Path, reason: str) -> str:
    return f"{variable}={file}: the file cannot be read: {reason}"


@catalogue_entry
def password_file_empty(*, variable: str, file: Path) -> str:
    return f"{variable}={file}: the file is empty: write the password to it"


@catalogue_entry
def unusable_settings(*, reasons: Sequence[str]) -> str:
    return "; ".join(reasons)


# Worker processes ----------------------------------------------------------------------------------


@catalogue_entry
def worker_died_twice() -> str:
    return "the worker process for this computation died twice: check whether the machine is short of memory"


@catalogue_entry
def writer_of_file_died() -> str:
    return "the process that writes this file died: check whether the machine is short of memory"


@catalogue_entry
def work_limit_exceeded(*, quantity: str, maximum: float | None, unit: str, remedy: str) -> str:
    allowed = "than the machine has" if maximum is None else f"than the {maximum:g} {unit} that it may use"
    return f"{quantity}: the computation needs more {allowed}, and was stopped: {remedy}"
