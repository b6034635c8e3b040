"""Messages about stored data: missing records, the database and its file, stations, imports, tags and the search."""

from collections.abc import Sequence
from pathlib import Path

from backend.units import format_count, format_percent
from plant import catalogue_entry

# Records -------------------------------------------------------------------------------------------


@catalogue_entry
def record_not_found(*, record: str, number: int) -> str:
    return f"there is no {record} {number}"


@catalogue_entry
def name_too_similar(*, record: str, existing: str, name: str) -> str:
    return (
        f"{record} {existing!r} already exists, and its name is too similar to {name!r}: use the existing name, or "
        "choose a different one"
    )


@catalogue_entry
def text_too_long(*, column: str, text: str, maximum: int) -> str:
    return (
        f"{column} cannot be {text[:40]!r}...: the text has {len(text)} characters, but at most {maximum} are "
        "allowed: shorten it"
    )


@catalogue_entry
def bank_of_another_station(*, bank_id: int, station: str) -> str:
    owner = f"belongs to station {station}" if station else "belongs to no station"
    return f"bank {bank_id} {owner}: export it there and import it here to use it"


@catalogue_entry
def experiment_not_found(*, name: str, version: int | None) -> str:
    return f"there is no experiment {name}" + ("" if version is None else f"@{version}")


@catalogue_entry
def formula_not_found(*, name: str) -> str:
    return f"there is no formula {name}"


@catalogue_entry
def identification_without_model(*, run_id: int) -> str:
    return f"there is no identification {run_id} with a model"


@catalogue_entry
def run_not_recordable(*, run_id: int) -> str:
    return f"run {run_id} has ended or already has a recording: record the samples in a new run"


@catalogue_entry
def recording_removed(*, run_id: int, reason: str) -> str:
    return f"the recording of run {run_id} no longer exists: {reason}"


@catalogue_entry
def parameter_missing(*, run_id: int, parameter: str) -> str:
    return f"run {run_id}: its parameters do not contain a number {parameter}"


@catalogue_entry
def run_of_another_station(*, run_id: int, station: str) -> str:
    owner = f"belongs to station {station}" if station else "belongs to no station"
    return f"run {run_id} {owner}: change its annotations there"


@catalogue_entry
def remark_too_long(*, length: int, tags: int, maximum_length: int, maximum_tags: int) -> str:
    return (
        f"a note of {format_count(length, 'character')} and {format_count(tags, 'tag')}: at most {maximum_length} "
        f"and {maximum_tags} are allowed; shorten it"
    )


@catalogue_entry
def invalid_tag(*, tag: str, maximum: int, reserved: str) -> str:
    return (
        f"{tag[:maximum]!r} is not a valid tag: use 1 to {maximum} letters, digits and . : + - _ without a space, "
        f"and not {reserved!r}"
    )


@catalogue_entry
def tag_not_used(*, tag: str) -> str:
    return f"there is no run with the tag {tag}"


@catalogue_entry
def between_entries(*, low: str, high: str, share: float) -> str:
    return f"{low} to {high}, {100.0 * share:.0f} % of the interval"


def _format_error(percent: float | None) -> str:
    return "not measured" if percent is None else f"{percent:.3g} %"


@catalogue_entry
def quality_of_fit(
    *, grade: str | None, fit_percent: float | None, K_error_percent: float | None, T_error_percent: float | None
) -> str:
    fit = "not measured" if fit_percent is None else f"{format_percent(fit_percent)} %"
    errors = f"standard errors: K {_format_error(K_error_percent)}, T {_format_error(T_error_percent)}"
    return f"{'grade not recorded' if grade is None else grade}, fit {fit}, {errors}"


@catalogue_entry
def followed_by(*, text: str, followers: str) -> str:
    return f"{text} Followed by {followers}."


@catalogue_entry
def imported_from(*, file: str, kind: str, number: int) -> str:
    return f"imported from {file}, originally {kind} {number}"


@catalogue_entry
def unreadable_experiment() -> str:
    return "Unreadable experiment"


@catalogue_entry
def service_ended_during_run() -> str:
    return "the service ended during this run; detected at its next start"


@catalogue_entry
def run_began(*, title: str) -> str:
    return f"{title} began"


@catalogue_entry
def run_ended(*, title: str, end_state: str, detail: str) -> str:
    fault, colon, reason = detail.partition(":")
    ended = f"{title} {end_state.replace('_', ' ')}"
    return f"{ended}, {fault.replace('_', ' ')}{colon}{reason}" if detail else ended


# Stations and claims -------------------------------------------------------------------------------


@catalogue_entry
def station_has_rows(*, station: str, rows: int, table: str) -> str:
    return f"station {station} already has {format_count(rows, 'row')} of table {table}: choose a new name"


@catalogue_entry
def station_taken(*, service: str, station: str) -> str:
    named = f"as station {station}" if station else "without a station"
    return f"{service} uses this database {named}: stop it, or give this service its own name with --station"


@catalogue_entry
def claim_lost(*, service: str, life_s: float) -> str:
    return (
        f"{service} has taken over this database, because this service sent no heartbeat for {life_s:g} s: "
        "both write to it now. Stop one of the two"
    )


@catalogue_entry
def service_of_claim(*, version: str, process: int, host: str) -> str:
    return f"a service of version {version} (process {process} on {host})"


# Schema --------------------------------------------------------------------------------------------


@catalogue_entry
def schema_too_new(*, schema: str, newest: str) -> str:
    return (
        f"the database has schema {schema}, but this version supports schemas only up to {newest}: a newer version "
        "wrote the database; install that version, or choose another data folder"
    )


@catalogue_entry
def migration_breaks_references(*, tables: Sequence[str]) -> str:
    return f"the migration would break references in {', '.join(tables)}: nothing was changed"


@catalogue_entry
def schema_not_named() -> str:
    return (
        "the database has tables, but the table alembic_version, which names their schema, is "
        "empty: restore a backup with `sinew db restore FILE`"
    )


@catalogue_entry
def outdated_database_in_use(*, service: str, schema: str | None, version: str, newest: str) -> str:
    return (
        f"{service} uses this database, which has schema {schema}, but version {version} requires schema {newest}: "
        "stop that service first, or use the commands of its version"
    )


@catalogue_entry
def database_outdated(*, schema: str | None, version: str, newest: str, folder: Path) -> str:
    return (
        f"the database has schema {schema}, but version {version} requires schema {newest}: `sinew db upgrade --data "
        f"{folder}` migrates it and keeps a copy of its present state"
    )


@catalogue_entry
def schema_outdated(*, schema: str | None, newest: str) -> str:
    return f"the schema is {schema or 'empty'}, but this version requires {newest}: run `sinew db upgrade`"


@catalogue_entry
def tables_differ(*, schema: str, difference: str) -> str:
    return f"the tables are not those of schema {schema}: {difference}"


@catalogue_entry
def references_broken(*, table: str) -> str:
    return f"table {table} refers to rows that do not exist"


# Backups -------------------------------------------------------------------------------------------


@catalogue_entry
def server_has_own_backup(*, dialect: str) -> str:
    return f"back up a {dialect} database with its own tools (pg_dump)"


@catalogue_entry
def backup_exists(*, file: Path) -> str:
    return f"{file} already exists: choose another name"


@catalogue_entry
def connection_not_copyable() -> str:
    return "only connections of the standard library's sqlite3 can be copied"


@catalogue_entry
def backup_not_written(*, file: Path, reason: str) -> str:
    return f"{file} could not be written: {reason}"


@catalogue_entry
def backup_not_found(*, file: Path) -> str:
    return f"{file} does not exist: choose a file from DATA/backups"


@catalogue_entry
def restore_failed(*, file: Path, reason: str, begun: bool) -> str:
    outcome = "the next start completes it" if begun else "nothing was changed"
    return f"{file} cannot be restored: {reason}; {outcome}"


@catalogue_entry
def backup_damaged(*, file: Path, damage: str) -> str:
    return f"{file} is damaged: {damage}; nothing was changed"


@catalogue_entry
def backup_of_another_program(*, file: Path) -> str:
    return f"{file} is not a database of Sinew; nothing was changed"


@catalogue_entry
def restore_completed() -> str:
    return "an interrupted restore has been completed: the database now has the content of the backup"


@catalogue_entry
def restore_rolled_back() -> str:
    return "an interrupted restore has been rolled back: the database is in its earlier state"


@catalogue_entry
def unfinished_file_removed(*, name: str) -> str:
    return f"{name} was removed: the command that wrote it was killed"


@catalogue_entry
def unfinished_import_removed(*, name: str) -> str:
    return f"{name} was removed: the import that unpacked it was killed, and stored nothing"


# Database file -------------------------------------------------------------------------------------


@catalogue_entry
def database_file_replaced(*, file: Path, reason: str) -> str:
    return (
        f"{file} is no longer the file that this service opened: {reason}. Put it back where it was, "
        "or stop the service and start it again"
    )


@catalogue_entry
def database_empty(*, file: Path, remedy: str) -> str:
    return f"{file} is empty (0 bytes): it was truncated; {remedy}"


@catalogue_entry
def database_missing_beside_log(*, file: Path, log: str, remedy: str) -> str:
    return f"{file} is missing, but its log ({log}) still exists: put the database back; or {remedy}"


@catalogue_entry
def database_missing_beside_copies(*, file: Path, copies: Sequence[str], remedy: str) -> str:
    return (
        f"{file} is missing, but copies of it exist ({', '.join(copies)}): Sinew creates no empty database in its "
        f"place. Put the database back; or {remedy}; or choose another --data to begin with an empty one"
    )


@catalogue_entry
def database_damaged(*, file: Path, damage: str, remedy: str) -> str:
    return f"{file} is damaged ({damage}): {remedy}"


@catalogue_entry
def restore_a_backup(*, folder: Path, backups: Path, newest: Sequence[str]) -> str:
    return (
        f"restore a backup with `sinew db restore FILE --data {folder}`; "
        f"backups in {backups}, newest first: {', '.join(newest)}"
    )


@catalogue_entry
def no_backup(*, file: Path, backups: Path) -> str:
    return (
        f"there is no backup in {backups}; restore one from elsewhere with "
        f"`sinew db restore FILE --data {file.parent}`, or move {file.name} away to begin with an empty database"
    )


@catalogue_entry
def file_damaged(*, damage: str) -> str:
    return f"the file is damaged: {damage}"


@catalogue_entry
def replaced_by_another_file() -> str:
    return "another file has replaced it"


@catalogue_entry
def file_deleted() -> str:
    return "it was deleted"


@catalogue_entry
def account_may_only_read() -> str:
    return "this account may only read it"


# Database ------------------------------------------------------------------------------------------


@catalogue_entry
def database_unusable(*, file: Path, reason: str, remedy: str) -> str:
    return f"{file}: {reason}" + (f"; {remedy}" if remedy else "")


@catalogue_entry
def restore_in_progress() -> str:
    return "a restore of this database is in progress or was interrupted: wait until it ends, or repeat it"


@catalogue_entry
def data_folder_not_writable(*, folder: Path, reason: str) -> str:
    return (
        f"the data folder {folder} is not writable: {reason}. Sinew must write to the folder even to read from it: "
        "change its owner or mode, mount it writable, or copy it and name the copy with --data"
    )


@catalogue_entry
def database_error(*, reason: str) -> str:
    return reason


@catalogue_entry
def database_package_missing(*, package: str | None) -> str:
    return f"SINEW_DATABASE_URL requires the Python package {package}, which is not installed"


@catalogue_entry
def invalid_database_url(*, reason: str) -> str:
    return (
        f"SINEW_DATABASE_URL is not the address of a database: {reason}; "
        "write it as postgresql+psycopg://user@host:port/database"
    )


# Imports -------------------------------------------------------------------------------------------


@catalogue_entry
def part_unfit(*, part: str, value: object, needed: str) -> str:
    return f"{part} cannot be {str(value)[:40]!r}: it must be {needed}; create the file again from the run"


@catalogue_entry
def exported_run_not_over() -> str:
    return "the run was still in progress when it was exported: export it again after its end"


@catalogue_entry
def invalid_line_in_record(*, reason: str) -> str:
    return f"{reason}; create the file again from the run"


@catalogue_entry
def unknown_record_kind(*, record: object) -> str:
    return f"there are no records of kind {str(record)[:40]!r}"


@catalogue_entry
def wrong_parts_of_record(*, record: str, parts: Sequence[str]) -> str:
    return f"a record of kind {record} must have the fields {', '.join(parts)}"


@catalogue_entry
def wrong_parts_of_bank_entry(*, parts: Sequence[str]) -> str:
    return f"an entry of a bank must have the fields {', '.join(parts)}"


@catalogue_entry
def record_differs(*, record: str, number: int) -> str:
    return f"{record} {number} has the same time in this database, but different content"


# Search --------------------------------------------------------------------------------------------


@catalogue_entry
def invalid_search(*, place: int, reason: str, near: Sequence[str], known: Sequence[str]) -> str:
    hint = f"; did you mean {' or '.join(near)}?" if near else f"; known: {', '.join(known[:12])}" if known else ""
    more = f" and {len(known) - 12} more" if known and not near and len(known) > 12 else ""
    return f"search, character {place + 1}: {reason}{hint}{more}"


@catalogue_entry
def search_too_long(*, maximum: int) -> str:
    return f"a search may have at most {maximum} characters: shorten it"


@catalogue_entry
def unprintable_character() -> str:
    return "this character cannot be printed: delete it"


@catalogue_entry
def unexpected_token(*, token: str) -> str:
    return f"{token} is unexpected here: delete it, or write a term"


@catalogue_entry
def term_missing() -> str:
    return "the search ends where a term is expected: write a word, or NAME = VALUE"


@catalogue_entry
def nested_too_deep(*, maximum: int) -> str:
    return f"brackets and 'not' can be nested at most {maximum} levels deep: reduce the nesting"


@catalogue_entry
def bracket_not_closed() -> str:
    return "the bracket is not closed: write ) after its last term"


@catalogue_entry
def too_many_terms(*, maximum: int) -> str:
    return f"a search may have at most {maximum} terms: remove some"


@catalogue_entry
def not_a_term(*, token: str) -> str:
    return f"{token} is not a term: write a word, or NAME = VALUE"


@catalogue_entry
def too_many_values(*, operator: str) -> str:
    return f"{operator} accepts only one value: delete the others"


@catalogue_entry
def value_missing(*, token: str) -> str:
    return f"there is no value after {token}: write one, in quotes if it contains spaces"


@catalogue_entry
def quote_not_closed() -> str:
    return 'the quote is not closed: write " at its end'


@catalogue_entry
def meaningless_character(*, character: str) -> str:
    return f"{character} has no meaning here"


@catalogue_entry
def operator_not_for_text(*, name: str, operator: str) -> str:
    return f"{name} is text, to which {operator} does not apply: use = != ~"


@catalogue_entry
def station_ambiguous(*, name: str, stations: Sequence[str]) -> str:
    return f"{name!r} may be several stations: write {' or '.join(stations)}"


@catalogue_entry
def operator_not_for_choice(*, name: str, operator: str) -> str:
    return f"{name} is one of a few words, to which {operator} does not apply: use = !="


@catalogue_entry
def value_not_known(*, attribute: str, value: str) -> str:
    return f"there is no {attribute} {value!r}"


@catalogue_entry
def operator_not_for_tag(*, operator: str) -> str:
    return f"a tag is a word, to which {operator} does not apply: use = != ~"


@catalogue_entry
def operator_not_for_date() -> str:
    return "a date cannot be searched with ~: use = != < <= > >="


@catalogue_entry
def not_a_date(*, value: str) -> str:
    return f"{value!r} is not a date: write 2026-03-31, 2026-03 or 2026-03-31T10:30, in UTC"


@catalogue_entry
def operator_not_for_number(*, name: str) -> str:
    return f"{name} is a number, to which ~ does not apply: use = != < <= > >="


@catalogue_entry
def not_a_number(*, name: str, value: str) -> str:
    return f"{name} requires a number, and {value!r} is not a number: write it in SI units, or as 60°"


@catalogue_entry
def operator_not_for_word(*, name: str, operator: str) -> str:
    return f"{name} is a word, to which {operator} does not apply: use = != ~"


@catalogue_entry
def name_in_no_run(*, name: str) -> str:
    return f"no stored run has a value {name!r}"


@catalogue_entry
def name_ambiguous(*, name: str, candidates: Sequence[str]) -> str:
    return f"{name} is ambiguous: write {' or '.join(candidates)}"
