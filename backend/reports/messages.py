"""Messages about reports: refusals, and reasons why a verification finds differences or omits parts."""

from collections.abc import Sequence
from pathlib import Path

from plant import catalogue_entry

# Report manifest -----------------------------------------------------------------------------------


@catalogue_entry
def no_manifest() -> str:
    return "it contains no report manifest: it is not a report of a run, or an older version of Sinew wrote it"


@catalogue_entry
def manifest_of_another_format(*, version: int) -> str:
    return f"its report manifest is not of format {version}: use the version of Sinew that made it"


@catalogue_entry
def manifest_unreadable(*, reason: str) -> str:
    return f"its report manifest cannot be read: {reason}"


@catalogue_entry
def plan_without_tension(*, run_id: int) -> str:
    return f"run {run_id}: its plan has no tension_N"


# Verification --------------------------------------------------------------------------------------


@catalogue_entry
def report_differs(*, name: str, reported: str, found: str) -> str:
    return f"{name}: the report has {reported}, found {found}"


@catalogue_entry
def recomputation_failed(*, error: str, reason: str, maximum: int) -> str:
    return f"{error}: {reason}"[:maximum]


@catalogue_entry
def page_of_another_version(
    *, reported: str | None, reported_layout: str, installed: str, installed_layout: str
) -> str:
    return (
        f"the visible page: Sinew {reported}, layout {reported_layout} wrote it, but this installation has Sinew "
        f"{installed}, layout {installed_layout}"
    )


@catalogue_entry
def output_of_another_version(*, name: str, reported: str | None, installed: str | None) -> str:
    return f"the output of {name}: the report manifest names version {reported}, but this installation has {installed}"


@catalogue_entry
def samples_file_unreadable(*, file: Path, reason: str) -> str:
    return f"{file} cannot be read: {reason}"


@catalogue_entry
def column_missing(*, file: Path, column: str) -> str:
    return f"{file}: the column {column} is missing; it is not an export of a run's samples"


@catalogue_entry
def result_not_in_report() -> str:
    return (
        "the result: the report contains none, but a result can be computed from its samples: sinew runs evaluate RUN"
    )


@catalogue_entry
def pdf_of_another_version() -> str:
    return (
        "the PDF: the report was made with other versions of the drawing and typesetting software, so that its bytes "
        "differ"
    )


@catalogue_entry
def metrics_file_not_comparable() -> str:
    return "metrics.json: the source of its numbers cannot be recomputed"


@catalogue_entry
def samples_missing() -> str:
    return (
        "the samples of the report are missing: give their file with --samples, or the folder that contains their run"
    )


@catalogue_entry
def report_of_a_series() -> str:
    return "it is a report of a series: give the data folder of its runs with --data"


@catalogue_entry
def result_of_other_definitions(*, version: int, current: int, run_id: int) -> str:
    return (
        f"the result: it was computed by version {version} of the definitions of metrics and criteria, but this "
        f"version of Sinew uses version {current}: recompute it with `sinew runs evaluate {run_id}`, and export the "
        "report again"
    )


@catalogue_entry
def fields_not_in_report(*, names: Sequence[str]) -> str:
    return f"{', '.join(names)} of the run: nothing in the report depends on it"


@catalogue_entry
def not_a_series() -> str:
    return "its report manifest is not of a series: a series has two or more runs, none of them a session"


@catalogue_entry
def samples_of_run_missing(*, run_id: int) -> str:
    return f"the samples of its run {run_id} are missing: give the folder that contains its runs"


@catalogue_entry
def part_of_run_omitted(*, run_id: int, reason: str) -> str:
    return f"run {run_id}, {reason}"


# Signature -----------------------------------------------------------------------------------------


@catalogue_entry
def not_a_public_key(*, key_type: str, text: str) -> str:
    return (
        f"not a public key: a public key has the form “{key_type} AAAA…”, as `sinew report key` prints it; "
        f"found “{text[:60]}”"
    )


@catalogue_entry
def key_file_unreadable(*, file: str, key_type: str, reason: str) -> str:
    return f"{file[:200]}: neither a public key, “{key_type} AAAA…”, nor a file with one: {reason}"


@catalogue_entry
def wrong_number_of_keys(*, file: str, lines: int) -> str:
    return f"{file[:200]} has {lines} lines: a public key file has one"


@catalogue_entry
def signing_key_unusable(*, file: Path) -> str:
    return (
        f"{file} holds no usable signing key: restore it from a copy, or delete it so that a new key "
        "is created; the old public key still verifies what the old key signed"
    )


@catalogue_entry
def page_not_signable() -> str:
    return "it contains no report manifest: only reports of runs and of series can be signed"


@catalogue_entry
def two_signatures() -> str:
    return "it has two signatures: export the report again"


@catalogue_entry
def invalid_signature_element() -> str:
    return "an element that is not a signature of a report"


@catalogue_entry
def signature_elsewhere() -> str:
    return "a signature that does not follow the report manifest"


@catalogue_entry
def page_not_signed_by_key() -> str:
    return "a page that this key has not signed"


@catalogue_entry
def not_signed_by_given_key(*, fingerprint: str) -> str:
    return f"none by the given key, {fingerprint}"


# Series --------------------------------------------------------------------------------------------


@catalogue_entry
def wrong_number_of_runs(*, runs: int, minimum: int, maximum: int) -> str:
    return f"number of runs: {runs} is outside {minimum} to {maximum}: choose another number of runs"


@catalogue_entry
def run_is_a_session(*, run_id: int) -> str:
    return f"run {run_id} is a session without computed results: leave it out"


@catalogue_entry
def run_not_ended(*, run_id: int) -> str:
    return f"run {run_id} has not ended: leave it out, or wait for its end"


@catalogue_entry
def too_many_samples(*, samples: int, maximum: int) -> str:
    return f"samples of all runs: {samples} is above {maximum}: choose fewer runs"


# Chart sheet ---------------------------------------------------------------------------------------


@catalogue_entry
def sheet_too_large(*, quantity: str, number: int, maximum: int, remedy: str) -> str:
    return f"{quantity}: this sheet of charts has {number} or more, but at most {maximum} are drawn: {remedy}"


@catalogue_entry
def not_a_sheet(*, reason: str) -> str:
    return (
        f"this is not a chart sheet: {reason}. Send the SVG as the charts save it, or convert it with a drawing program"
    )


@catalogue_entry
def not_well_formed(*, problem: str, line: int) -> str:
    return f"it is not well-formed XML: {problem}, line {line}"


@catalogue_entry
def root_is_not_svg(*, element: str) -> str:
    return f"it begins with <{element}> instead of <svg>"


@catalogue_entry
def element_not_allowed(*, element: str, allowed: Sequence[str]) -> str:
    return f"it has an element <{element}>; a sheet may contain only {', '.join(allowed)}"


@catalogue_entry
def attribute_not_allowed(*, element: str, attribute: str, value: str) -> str:
    return f'its <{element}> has {attribute}="{value}", which is not allowed in a chart sheet'


@catalogue_entry
def svg_without_attribute(*, attribute: str) -> str:
    return f"its <svg> has no {attribute}"


@catalogue_entry
def side_out_of_range(*, side: str, length_mm: float, minimum_mm: float, maximum_mm: float) -> str:
    return f"its {side} of {length_mm:g} mm is outside {minimum_mm:g} to {maximum_mm:g} mm"


@catalogue_entry
def document_type_not_allowed() -> str:
    return "it has a document type (<!DOCTYPE>), which is not allowed in a chart sheet"


@catalogue_entry
def instruction_not_allowed(*, instruction: str) -> str:
    return f"it has a processing instruction <?{instruction}?>, which is not allowed in a chart sheet"
