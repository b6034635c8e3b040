"""Messages about access: rejected sign-ins and names, commands without control, and handovers of control."""

from plant import catalogue_entry

# Authentication ------------------------------------------------------------------------------------


@catalogue_entry
def too_many_wrong_tokens(*, wait_s: int) -> str:
    return f"too many wrong tokens; try again in {wait_s} s"


@catalogue_entry
def too_many_sign_ins(*, wait_s: int) -> str:
    return f"too many new sessions from this address; try again in {wait_s} s"


@catalogue_entry
def script_cannot_be_renamed() -> str:
    return "only a browser that is signed in with a token can change its name"


@catalogue_entry
def name_not_allowed() -> str:
    return "a name must not be empty or the name of a role: enter your own name"


@catalogue_entry
def wrong_token_at_sign_in() -> str:
    return "wrong token; use the sign-in link that the service printed at its start"


@catalogue_entry
def service_without_tokens() -> str:
    return "this service runs without tokens: it has no tokens to replace"


@catalogue_entry
def tokens_not_written(*, reason: str) -> str:
    return f"the new tokens cannot be written: {reason}"


@catalogue_entry
def wrong_token() -> str:
    return "wrong token; use the one in the data folder"


# Control lease -------------------------------------------------------------------------------------


@catalogue_entry
def command_out_of_order() -> str:
    return "nothing was done: the command is a repetition or older than one that was executed"


@catalogue_entry
def too_many_commands(*, maximum: int) -> str:
    return f"{maximum} commands of this page are already waiting: nothing was done"


@catalogue_entry
def invalid_command_token(*, header: str) -> str:
    return f"{header} must be the key of the page, a dot and a whole number"


@catalogue_entry
def control_held(*, holder: str) -> str:
    return f"{holder} holds control: take over control to send commands"


@catalogue_entry
def control_released() -> str:
    return "no one holds control: take control first"


@catalogue_entry
def control_taken_over(*, holder: str) -> str:
    return f"this page no longer holds control, {holder} does: nothing was done"


@catalogue_entry
def command_without_token(*, header: str) -> str:
    return f"a page must take control first and send its command token ({header})"


# Handover ------------------------------------------------------------------------------------------


@catalogue_entry
def recipient_not_connected(*, name: str) -> str:
    return f"no other operator named {name} has an open page: choose a connected operator"


@catalogue_entry
def control_not_handed_over() -> str:
    return "control was not handed over to this page: nothing was done"


@catalogue_entry
def only_holder_hands_over() -> str:
    return "only the holder of control can hand it over: nothing changed"


@catalogue_entry
def control_already_handed_over(*, recipient: str) -> str:
    return f"control is already being handed over to {recipient}: nothing changed"


@catalogue_entry
def too_many_requests(*, maximum: int) -> str:
    return f"{maximum} requests for control are already open: try again later"


@catalogue_entry
def session_without_page() -> str:
    return "only a session with an open page can request control: nothing changed"


@catalogue_entry
def control_is_free() -> str:
    return "no one holds control: take control directly"


@catalogue_entry
def own_page_holds_control() -> str:
    return "another of your pages holds control: take it over"


@catalogue_entry
def script_holds_control() -> str:
    return "a script holds control: take it over"


@catalogue_entry
def handover_already_open(*, name: str) -> str:
    return f"{name} already has an open request or offer of control: answer that first"


@catalogue_entry
def handover_in_progress(*, recipient: str) -> str:
    return f"control is being handed over to {recipient}: withdraw that first"


@catalogue_entry
def control_needed() -> str:
    return "only the page that holds control can do this: take control first"


@catalogue_entry
def handover_closed() -> str:
    return "this request for control is closed: nothing was done"


@catalogue_entry
def reason_missing() -> str:
    return "a reason is required: enter a few words"


# Sessions and tokens -------------------------------------------------------------------------------


@catalogue_entry
def sessions_not_written(*, reason: str) -> str:
    return (
        f"sessions cannot be written ({reason}): "
        "users who sign out now are signed in again after a restart of the service"
    )


@catalogue_entry
def no_usable_token(*, file: str) -> str:
    return f"{file} contains no usable token; delete the file and start again"
