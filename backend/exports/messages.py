"""Messages about exports and imports: runs that cannot be exported, and files that are refused or damaged."""

from collections.abc import Mapping, Sequence

from plant import catalogue_entry

# Metadata and samples ------------------------------------------------------------------------------


@catalogue_entry
def nested_too_deeply() -> str:
    return "it is nested too deeply"


@catalogue_entry
def not_a_number(*, text: str) -> str:
    return f"{text} is not a finite number"


@catalogue_entry
def number_too_large(*, number: str) -> str:
    return f"the number {number[:40]} is beyond 1.8e308"


@catalogue_entry
def too_many_digits(*, number: str, digits: int, maximum: int) -> str:
    return f"the whole number {number[:20]}... has {digits} digits, but at most {maximum} are stored"


@catalogue_entry
def metadata_of_another_format(*, version: int) -> str:
    return f"its metadata are not of format {version}: use the version of Sinew that wrote the file"


@catalogue_entry
def metadata_changed() -> str:
    return "its metadata were changed: their sha256 differs"


@catalogue_entry
def invalid_metadata(*, name: str | int, reason: str) -> str:
    return f"its metadata: {name}: {reason}"


@catalogue_entry
def metadata_unreadable(*, reason: str) -> str:
    return f"its metadata cannot be read: {reason}"


@catalogue_entry
def metadata_inconsistent() -> str:
    return "its metadata: period, samples or columns are inconsistent"


@catalogue_entry
def formulas_not_found(*, names: Sequence[str]) -> str:
    return f"unknown derived signal: {', '.join(names)}"


@catalogue_entry
def run_not_exportable(*, run_id: int, reason: str) -> str:
    return f"run {run_id} cannot be exported: {reason}"


@catalogue_entry
def notation() -> str:
    return (
        "SI units, angles in rad. t is relative to the first sample. _ref: a reference, _gov: after reference "
        "governor or trajectory, _dot: a derivative, A and B: the two motors with their tendons, lam: lambda. "
        "Equations: docs/reference/notation.md."
    )


@catalogue_entry
def column_of_earlier_version() -> str:
    return "column of an earlier version"


@catalogue_entry
def meaning_of_formula(*, meaning: str, expression: str) -> str:
    return f"{meaning}, computed: {expression}" if meaning else f"computed: {expression}"


@catalogue_entry
def heading(*, content: str, software: str, notation: str) -> str:
    return f"{content}, Sinew {software}; {notation}"


# CSV and Parquet -----------------------------------------------------------------------------------


@catalogue_entry
def csv_without_metadata() -> str:
    return "no line identifies its samples: it is not an export of a run"


@catalogue_entry
def heading_line_differs(*, line_number: int, line: str, expected: str, maximum: int) -> str:
    return f"line {line_number} is “{line[:maximum]}”, but must be “{expected[:maximum]}”"


@catalogue_entry
def header_row_differs() -> str:
    return "its header row does not name the columns of its metadata"


@catalogue_entry
def parquet_without_metadata() -> str:
    return "its metadata do not identify its samples: it is not an export of a run"


@catalogue_entry
def columns_or_samples_differ() -> str:
    return "its columns or samples differ from its metadata"


@catalogue_entry
def row_groups_too_large() -> str:
    return "its row groups are larger than those of an export"


@catalogue_entry
def column_metadata_differ(*, column: str, metadata: Mapping[str, str]) -> str:
    listed = ", ".join(f"{name} = {value}" for name, value in metadata.items())
    return f"the metadata of {column} are {listed or 'missing'}"


# MATLAB --------------------------------------------------------------------------------------------


@catalogue_entry
def too_many_samples_for_matlab(*, content: str, samples: int, maximum: int) -> str:
    return (
        f"{content} has {samples} samples, but a MATLAB file of version 5 can contain at most {maximum}: choose "
        "Parquet, which MATLAB reads with parquetread"
    )


@catalogue_entry
def matlab_without_metadata(*, name: str) -> str:
    return f"its text variable {name} is missing: it is not an export of a run"


@catalogue_entry
def column_incomplete(*, column: str, samples: int) -> str:
    return f"{column} does not have {samples} samples: the file was truncated or saved by another program"


@catalogue_entry
def file_truncated() -> str:
    return "the file is truncated"


@catalogue_entry
def file_compressed() -> str:
    return "it is compressed, unlike an export: another program saved it"


@catalogue_entry
def metadata_not_utf8(*, name: str) -> str:
    return f"its text variable {name} is not UTF-8: another program saved the file"


@catalogue_entry
def matlab_header(*, content: str, software: str) -> str:
    return f"MATLAB 5.0 MAT-file, {content}, Sinew {software}"


# MCAP ----------------------------------------------------------------------------------------------


@catalogue_entry
def mcap_without_metadata() -> str:
    return "it does not identify its samples: it is not an export of a run"


@catalogue_entry
def unknown_compression(*, compression: str) -> str:
    return f"a chunk of it is compressed with {compression[:20]}; an export uses zstd"


@catalogue_entry
def chunk_too_large(*, size: int, maximum: int) -> str:
    return (
        f"a chunk of it decompresses to {size} bytes, but at most {maximum} are accepted, and a chunk of an export "
        "has a million: export the run again"
    )


# Formats -------------------------------------------------------------------------------------------


@catalogue_entry
def file_type_not_supported(*, supported: Sequence[str]) -> str:
    return f"its type is not supported: choose one of {', '.join(f'.{kind}' for kind in supported)}"


@catalogue_entry
def file_damaged(*, reason: str) -> str:
    return f"it is damaged or of another type: {reason}"


# Bundle --------------------------------------------------------------------------------------------


@catalogue_entry
def run_not_ended(*, run_id: int) -> str:
    return f"run {run_id} has not ended: export the bundle after its end"


@catalogue_entry
def run_computes_bank(*, run_id: int, expression: str) -> str:
    return (
        f"run {run_id} computes the number of a bank that it changes to, {expression[:80]}, "
        "which may select a different bank in another data folder: export only the samples of the run"
    )


@catalogue_entry
def archive_changed() -> str:
    return "its archive structure was changed, or its end is missing"


@catalogue_entry
def not_a_bundle(*, reason: str) -> str:
    return f"it is not a bundle, or was truncated or changed: {reason}"


@catalogue_entry
def member_not_allowed(*, member: str) -> str:
    return f"a bundle cannot contain the member {member[:80]!r}, or contains it more than once"


@catalogue_entry
def member_compressed(*, member: str) -> str:
    return f"{member} is compressed or encrypted: members of a bundle are neither"


@catalogue_entry
def member_too_large(*, member: str, size: int) -> str:
    return f"{member} has a stated size of {size} bytes, which is too large"


@catalogue_entry
def members_larger_than_file() -> str:
    return "the stated sizes of its members exceed the size of the file"


@catalogue_entry
def bundle_without_member(*, member: str) -> str:
    return f"it has no {member}: it is not a bundle of a run"


@catalogue_entry
def manifest_of_another_format(*, manifest: str, version: int) -> str:
    return f"{manifest} is not of format {version}: use the version of Sinew that wrote the file"


@catalogue_entry
def manifest_incomplete(*, manifest: str) -> str:
    return f"{manifest} lists no run, no records or no members"


@catalogue_entry
def member_missing(*, member: str) -> str:
    return f"{member[:80]} is missing"


@catalogue_entry
def member_not_in_manifest(*, member: str, manifest: str) -> str:
    return f"{member} is in the file, but {manifest} does not list it"


@catalogue_entry
def content_changed(*, name: str, manifest: str) -> str:
    return f"{name} was changed: its sha256 differs from the one in {manifest}"


@catalogue_entry
def records_of_another_run(*, run_id: int, manifest: str, records: str) -> str:
    return f"{manifest} is of run {run_id}, but {records} is of another run"


@catalogue_entry
def record_differs_from_manifest(*, record: str, manifest: str) -> str:
    return f"{record} differs from the one in {manifest}"


@catalogue_entry
def records_differ_from_manifest(*, manifest: str, records: str) -> str:
    return f"{manifest} and {records} list different records"


@catalogue_entry
def invalid_records(*, records: str, maximum: int) -> str:
    return f"{records} is not a list of records, each of a kind with a number from 1 to {maximum}"


@catalogue_entry
def member_unreadable(*, member: str, reason: str) -> str:
    return f"{member} cannot be read: {reason}"


@catalogue_entry
def no_recording() -> str:
    return "the run has no recording"


@catalogue_entry
def nothing_recorded() -> str:
    return "nothing was recorded"


@catalogue_entry
def samples_missing(*, run_id: int, reason: str) -> str:
    return f"samples of run {run_id}: {reason}"


# Import --------------------------------------------------------------------------------------------


@catalogue_entry
def wrong_number_of_samples(*, samples: int, stated: int) -> str:
    return f"the number of its samples is {samples}, but its metadata state {stated}"


@catalogue_entry
def samples_changed(*, sha256: str) -> str:
    return f"its samples differ from the exported ones: their sha256 is {sha256}"


@catalogue_entry
def not_of_a_run(*, content: str) -> str:
    return f"it is an export of {content}, not of a run"


@catalogue_entry
def invalid_run(*, reason: str) -> str:
    return f"its run: {reason}"


@catalogue_entry
def run_with_other_samples(*, run_id: int) -> str:
    return f"stored run {run_id} is the same run, but its samples differ"


@catalogue_entry
def times_not_multiples(*, period_s: float) -> str:
    return f"its times t are not multiples of {period_s:g} s"


@catalogue_entry
def times_do_not_increase(*, t: float) -> str:
    return f"its times t do not increase from 0: see t = {t:g} s"


@catalogue_entry
def bundle_without_its_run(*, run_id: int) -> str:
    return f"run {run_id}, to which the bundle belongs, is not among its records"


@catalogue_entry
def recording_of_another_run() -> str:
    return "it belongs to another run"


@catalogue_entry
def recording_refused(*, member: str, reason: str) -> str:
    return f"{member}: {reason}"


@catalogue_entry
def member_of_no_run(*, member: str) -> str:
    return f"{member} belongs to no run of the bundle"


@catalogue_entry
def record_refused(*, record: str, reason: str) -> str:
    return f"{record}: {reason}"


@catalogue_entry
def computed_bank_number(*, expression: str) -> str:
    return f"it computes the number of a bank, {expression[:80]}: import only its samples"


@catalogue_entry
def record_not_before(*, kind: str, number: object) -> str:
    return f"it refers to {kind} {number}, which does not precede it in the bundle"
