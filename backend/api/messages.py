"""Messages of the interface: missing sessions and roles, too many websockets, requests that do not fit the state."""

from collections.abc import Sequence

from plant import catalogue_entry


@catalogue_entry
def not_signed_in() -> str:
    return (
        "not signed in: sign in again with the link that the service printed at its start, or with a token of the data "
        "folder"
    )


@catalogue_entry
def stop_without_session() -> str:
    return (
        "nothing was stopped, because you are not signed in: sign in again with the link that the service printed at "
        "its start, or with a token of the data folder"
    )


@catalogue_entry
def operator_needed(*, name: str, role: str) -> str:
    return f"{name} is signed in as {role}; this needs the operator's token"


@catalogue_entry
def pings_missing() -> str:
    return "this connection accepts only pings and needs them regularly"


@catalogue_entry
def websockets_opened_too_fast() -> str:
    return "this session opens WebSockets too fast: try again in a few seconds"


@catalogue_entry
def too_many_connections(*, name: str) -> str:
    return f"{name} has too many connections open: close other pages first"


@catalogue_entry
def bank_or_runs_needed() -> str:
    return "give either another bank or new identification runs"


@catalogue_entry
def temporary_tuning_active() -> str:
    return "a run has applied a temporary tuning: save after the run"


@catalogue_entry
def trial_in_progress() -> str:
    return "a trial is in progress: keep or revert its tuning first"


@catalogue_entry
def request_failed() -> str:
    return "the request failed; see the log of the service"


@catalogue_entry
def dashboard_not_built() -> str:
    return "The dashboard's pages are not built yet: run make frontend, then load this page again."


@catalogue_entry
def stale_files(*, names: Sequence[str], folder: str) -> str:
    return f"stale: {', '.join(names)}; run python -m backend.api.export {folder}"
