"""Messages of the command line: options, files and databases that a command cannot use."""

from plant import catalogue_entry

# Identification ------------------------------------------------------------------------------------


@catalogue_entry
def not_a_text_table(*, file: str) -> str:
    return f"{file} is not a text table, which --header and --decimal require"


@catalogue_entry
def unknown_file_format(*, file: str) -> str:
    return f"{file} is not .csv, .mat or .parquet: save the columns in one of these formats"


@catalogue_entry
def unknown_decimal_mark(*, value: str) -> str:
    return f"--decimal {value}: write point or comma"


@catalogue_entry
def invalid_range(*, value: str) -> str:
    return f"--range {value}: write two times in seconds FROM:TO, for example 2:30 or 2:"


@catalogue_entry
def invalid_controller(*, value: str) -> str:
    return f"--controller {value}: write two numbers kp,ki, for example 200,256"


@catalogue_entry
def unknown_method(*, name: str, known: str) -> str:
    return f"method '{name}' does not exist: choose one of {known}"


# Database ------------------------------------------------------------------------------------------


@catalogue_entry
def folder_used_by_another_version(*, folder: str) -> str:
    return (
        f"a service or command of another version uses {folder}, and this version would migrate its database: stop "
        "the other one first"
    )


@catalogue_entry
def database_is_on_a_server() -> str:
    return "SINEW_DATABASE_URL is set: restore this database with the tools of its database server"


@catalogue_entry
def database_in_use(*, holder: str, file: str) -> str:
    return f"{holder} uses {file} from another folder: stop it first; nothing was changed"


# Reports -------------------------------------------------------------------------------------------


@catalogue_entry
def not_a_regular_file(*, file: str) -> str:
    return f"{file} is not a regular file"


@catalogue_entry
def page_of_pdf_missing(*, page: str) -> str:
    return f"a PDF has no report manifest, and its page {page} is not in the same folder"


@catalogue_entry
def run_not_stored() -> str:
    return "its run is not stored in this data folder: sign the report on the installation that stores the run"


@catalogue_entry
def page_of_several_runs_needed() -> str:
    return (
        "a report of several runs is verified from its page and the stored runs: specify the .html file and no samples"
    )


# Rig -----------------------------------------------------------------------------------------------


@catalogue_entry
def input_ended() -> str:
    return "no answer: standard input has ended"


@catalogue_entry
def given_up() -> str:
    return "cancelled by the operator"
