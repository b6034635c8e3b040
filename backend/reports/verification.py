"""Verifies a report: recomputes all of it from its samples and compares."""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import unescape
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from backend.analysis import NoSamplesError, compute_result, load_bank_points
from backend.experiments import parse_stored_plan
from backend.exports import (
    Batch,
    DataFormat,
    Facts,
    ImportRefusedError,
    describe_columns,
    find_heading_problem,
    find_schema_problem,
    read_export,
    require_matching_facts,
)
from backend.models import CRITERIA, DEFINITIONS, METRICS, Metrics, RunCriterion, upgrades
from backend.recording import Columns, count_missing_ticks, read_recorded_columns
from backend.reports import messages
from backend.reports.build import build_metrics_document, build_report
from backend.reports.evidence import (
    BLOCK_S,
    DRAWING,
    HASHED,
    LAYOUT,
    MANIFEST,
    SINEW,
    EvidenceError,
    ReportManifest,
    SeriesEvidence,
    StoredEstimate,
    compute_block_hashes,
    compute_hashes,
    compute_manifest_hash,
    find_element,
    get_unverified_defaults,
    made_with,
    of_samples,
    read_manifest,
    rebuild_run_data,
    to_element,
    to_stored_estimate,
    without_element,
)
from backend.reports.model import to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData
from backend.reports.series import series_report
from backend.sample import ADDED_LATER, STORED_NAMES
from backend.storage import Database, RunKind, runs
from plant import ErrorCode, SinewError, parse_parameters

# Differences ---------------------------------------------------------------------------------------
# Differences between a report and its recomputation, and the comparison of two documents.


LIKE = 1e-9
"""Relative tolerance of numbers that another machine recomputed."""

LIKE_ESTIMATE = 1e-4
"""The same for results of an optimizer; their standard errors are known to five digits."""

_MAX_REASON = 200
"""Maximum number of characters of the reason why a part cannot be recomputed."""

MOST = 50
"""Maximum number of differences in a verification result."""


@dataclass(frozen=True)
class ReportDifference:
    """A difference: its name, the reported value, and the value found."""

    name: str
    said: str
    found: str

    @property
    def sentence(self) -> str:
        """Return the difference as a sentence."""
        return messages.report_differs(name=self.name, reported=self.said, found=self.found)


@dataclass(frozen=True)
class Verified:
    """The result of a verification: differences, omissions with reasons, and scope."""

    differences: tuple[ReportDifference, ...]
    left_out: tuple[str, ...]
    compared: str = messages.every_number_compared()

    @property
    def holds(self) -> bool | None:
        """Return whether the report holds; None if nothing differs but parts were omitted."""
        if self.differences:
            return False
        return None if self.left_out else True


def not_made(name: str, wanted: str, error: Exception) -> ReportDifference:
    """Return the difference for a part of a report that cannot be recomputed."""
    reason = error.message if isinstance(error, SinewError) else str(error)
    found = messages.recomputation_failed(error=type(error).__name__, reason=reason, maximum=_MAX_REASON)
    return ReportDifference(name, wanted, found)


def compare_documents(
    name: str, reported: Any, found: Any, like: float = LIKE, floor: float = 1e-15
) -> Iterator[ReportDifference]:
    """Compare two documents recursively; list items are named by their own "name".

    Numbers may differ by the relative tolerance ``like`` (in a list, relative to its largest number) and by ``floor``.
    """
    if isinstance(reported, Mapping) and isinstance(found, Mapping):
        for part in dict.fromkeys([*reported, *found]):
            yield from compare_documents(f"{name}, {part}", reported.get(part), found.get(part), like)
    elif _is_list(reported) and _is_list(found) and len(reported) == len(found):
        largest = max((abs(one) for one in found if isinstance(one, float)), default=0.0)
        for place, (one, other) in enumerate(zip(reported, found, strict=True)):
            called = one.get("name") if isinstance(one, Mapping) else None
            yield from compare_documents(f"{name}, {called or place + 1}", one, other, like, max(floor, like * largest))
    elif not _is_close(reported, found, like, floor):
        yield ReportDifference(name, _short(reported), _short(found))


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_close(reported: Any, found: Any, like: float, floor: float) -> bool:
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (reported, found))
    try:
        return math.isclose(reported, found, rel_tol=like, abs_tol=floor) if numbers else bool(reported == found)
    except OverflowError:  # an integer beyond the range of floats
        return bool(reported == found)


def _short(value: Any) -> str:
    return messages.nothing() if value is None else str(value)[:80]


# Page comparison -----------------------------------------------------------------------------------
# Comparison of a page with its recomputed version, by lines and drawings.


_TAG = re.compile(r"<[^<>]*>")
_SET = re.compile(r"</?(?:i|b|sub|sup)>")
_OPEN, _CLOSE = "<svg", "</svg>"
_PLACE = "<svg/>"
_LINE = 2000
"""Maximum number of characters of a line in a difference; longer lines occur only in forged pages."""

_XML = re.compile(r"<(/?)([A-Za-z][\w:.-]*)([^<>]*)>")
_ATTRIBUTE = re.compile(r'\s+([A-Za-z][\w:.-]*)="([^"<>]*)"')
_COMMENT = re.compile(r"<!--[^<>]*-->")
_REST = re.compile(r"\s*/?")
_NAMESPACES = {"xmlns", "xmlns:xlink", "xmlns:rdf", "xmlns:dc", "xmlns:cc"}
_DRAWS: dict[str, set[str]] = {
    "svg": {"role", "aria-label", "width", "height", "viewBox", "version"} | _NAMESPACES,
    "g": {"id", "style", "transform", "clip-path"},
    "defs": set(),
    "path": {"id", "style", "transform", "clip-path", "d"},
    "use": {"style", "transform", "x", "y", "xlink:href", "clip-path"},
    "clipPath": {"id"},
    "rect": {"x", "y", "width", "height", "style"},
    "image": {"id", "style", "transform", "x", "y", "width", "height", "xlink:href", "clip-path"},
    "metadata": set(),
    "style": {"type"},
    "rdf:RDF": set(_NAMESPACES),
    "cc:Work": set(),
    "dc:type": {"rdf:resource"},
    "dc:format": set(),
    "title": set(),
}
"""Elements and attributes in drawings of a report. None of them covers the page or fetches anything."""
_STYLES = {
    *("fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-linecap", "stroke-linejoin", "opacity"),
    *("stroke-opacity", "stroke-dasharray", "stroke-dashoffset", "stroke-miterlimit", "image-rendering"),
}
_STYLE_SHEET = "*{stroke-linejoin: round; stroke-linecap: butt}"


def compare_pages(page: str, manifest: ReportManifest | SeriesEvidence, make_again: Callable[[], str]) -> Verified:
    """Compare a page, from which the manifest was read, with the page made anew.

    The versions in the manifest decide nothing, because anybody can change them. They only explain why a page that
    differs may have been written by another version. Such a page is not verified; it does not hold.
    """
    here = made_with()
    reported = manifest.made_with if isinstance(manifest, ReportManifest) else manifest.runs[0].made_with
    foreign = tuple(_foreign(page))
    try:
        again = make_again()
    except Exception as error:
        return Verified(
            (not_made(messages.the_page(), messages.one_that_can_be_reproduced(), error), *foreign)[:MOST], ()
        )
    others = [name for name, other in here.items() if reported.get(name) != other] + [*({*reported} - {*here})]
    if SINEW in others or LAYOUT in others:
        left_out = messages.page_of_another_version(
            reported=reported.get(SINEW),
            reported_layout=reported.get(LAYOUT, "unknown"),
            installed=here[SINEW],
            installed_layout=here[LAYOUT],
        )
        return Verified(foreign[:MOST], (left_out,), messages.all_but_visible_page())
    differences = [*_compare_manifest(page, manifest), *_pages(page, again, with_drawings=DRAWING not in others)]
    version_differences = (
        messages.output_of_another_version(name=name, reported=reported.get(name), installed=here.get(name))
        for name in others
    )
    return Verified((*differences, *foreign)[:MOST], tuple(version_differences))


def _foreign(page: str) -> Iterator[ReportDifference]:
    """Yield foreign elements, attributes, styles and addresses of drawings of a page."""
    for number, drawing in enumerate(_drawings(page), start=1):
        found = next(_find_foreign_markup(drawing), None)
        if found is not None:
            yield ReportDifference(
                messages.drawing_of_figure(number=number), f"“{found[:80]}”", messages.only_lines_letters_and_areas()
            )


def _find_foreign_markup(drawing: str) -> Iterator[str]:
    end, before = 0, ""
    for tag in _XML.finditer(drawing):
        between = _COMMENT.sub("", drawing[end : tag.start()])
        if "<" in between or ">" in between:
            yield between.strip()
        if before == "style" and between.strip() and between.strip() != _STYLE_SHEET:
            yield between.strip()
        end, name = tag.end(), tag[2]
        before = "" if tag[1] else name
        if name not in _DRAWS:
            yield tag[0]
            continue
        if tag[1]:
            continue
        attributes = list(_ATTRIBUTE.finditer(tag[3]))
        rest = tag[3][attributes[-1].end() :] if attributes else tag[3]
        if sum(len(one[0]) for one in attributes) + len(rest) != len(tag[3]) or not _REST.fullmatch(rest):
            yield tag[0]
        for one in attributes:
            if one[1] not in _DRAWS[name] or not _is_harmless(name, one[1], unescape(one[2])):
                yield one[0].strip()


def _is_harmless(element: str, attribute: str, value: str) -> bool:
    if attribute == "style":
        named = {part.split(":")[0].strip() for part in value.split(";") if part.strip()}
        return named <= _STYLES and "url(" not in value
    if attribute == "xlink:href":
        return value.startswith("data:image/png;base64,") if element == "image" else value.startswith("#")
    if attribute == "clip-path":
        return value.startswith("url(#")
    return True


def _compare_manifest(page: str, manifest: ReportManifest | SeriesEvidence) -> Iterator[ReportDifference]:
    """Compare the manifest text with the parsed manifest; nothing else may be in it."""
    reported, found = find_element(page), to_element(manifest)
    if reported != found:
        yield ReportDifference(messages.manifest_as_written(), *find_difference(reported, found))


def _pages(page: str, again: str, *, with_drawings: bool) -> Iterator[ReportDifference]:
    """Compare the visible page by lines and drawings; only the number of these if not ``with_drawings``."""
    reported, found = without_element(page), without_element(again)
    drawn = [list(_drawings(text)) for text in (reported, found)]
    counts = [len(each) for each in drawn]
    if counts[0] != counts[1]:
        yield ReportDifference(messages.number_of_drawings(), str(counts[0]), str(counts[1]))
    elif with_drawings:
        for number, (one, other) in enumerate(zip(*drawn, strict=True), start=1):
            if one != other:
                yield ReportDifference(
                    messages.drawing_of_figure(number=number),
                    messages.another_drawing(),
                    messages.drawing_from_samples(),
                )
    lines = [_without_drawings(text).replace("<dt>", "\n<dt>").split("\n") for text in (reported, found)]
    for number, (one, other) in enumerate(zip(*lines, strict=False), start=1):
        if one != other:
            yield ReportDifference(_name_line(one[:_LINE], number), *find_difference(one, other))
    sizes = [len(each) for each in lines]
    if sizes[0] != sizes[1]:
        yield ReportDifference(
            messages.length_of_page(), messages.lines_of_page(lines=sizes[0]), messages.lines_of_page(lines=sizes[1])
        )


def _drawings(text: str) -> Iterator[str]:
    """Yield the drawings of a page in order, in a single pass."""
    for begin, end in _places(text):
        yield text[begin:end]


def _without_drawings(text: str) -> str:
    parts, after = [], 0
    for begin, end in _places(text):
        parts += [text[after:begin], _PLACE]
        after = end
    return "".join((*parts, text[after:]))


def _places(text: str) -> Iterator[tuple[int, int]]:
    end = 0
    while (begin := text.find(_OPEN, end)) >= 0:
        close = text.find(_CLOSE, begin)
        if close < 0:
            return
        end = close + len(_CLOSE)
        yield begin, end


def _name_line(line: str, number: int) -> str:
    if row := re.match(r"<tr><t[dh][^>]*>(.*?)</t[dh]>", line):
        return messages.row_of_table(title=_plain(row.group(1)))
    if fact := re.match(r"<dt>(.*?)</dt>", line):
        return messages.line_of_heading(label=_plain(fact.group(1)))
    return messages.line_of_page(number=number)


def _plain(line: str) -> str:
    return " ".join(unescape(_TAG.sub(" ", _SET.sub("", line.replace("<sub>", "_")))).split())


def find_difference(one: str, other: str) -> tuple[str, str]:
    """Return the text around the first difference of two lines.

    Markup is removed, unless only the markup differs.
    """
    first = next(place for place, (left, right) in enumerate(zip_longest(one, other)) if left != right)
    near = slice(max(0, first - _LINE), first + _LINE)
    reported, found = _plain(one[near]), _plain(other[near])
    if reported == found:
        reported, found = one[near], other[near]
    same = next(place for place, (left, right) in enumerate(zip_longest(reported, found)) if left != right)
    part = slice(max(0, same - 30), same + 40)
    return f"“{reported[part]}”", f"“{found[part]}”"


# Samples file --------------------------------------------------------------------------------------
# Samples of a run read back from an exported file.


SUFFIXES = tuple(f".{kind}" for kind in DataFormat)


class SamplesFileError(SinewError, ValueError):
    """A file that does not hold the samples of a run."""

    category = ErrorCode.BAD_VALUE


def read_samples_file(file: Path) -> tuple[Columns, tuple[ReportDifference, ...]]:
    """Return the columns of an export, and how the file differs from its export.

    The columns are ``t`` [s] and every stored signal. Raises SamplesFileError.
    """
    try:
        facts, batches = read_export(file)
        parts = list(batches)
    except (ImportRefusedError, OSError) as error:
        reason = error.message if isinstance(error, ImportRefusedError) else str(error)
        raise SamplesFileError(messages.samples_file_unreadable(file=file, reason=reason)) from None
    missing = [name for name in STORED_NAMES if name not in facts.names and name not in ADDED_LATER]
    if "t" not in facts.names or "q" in missing:
        raise SamplesFileError(messages.column_missing(file=file, column=missing[0]))
    names = ("t", *(name for name in STORED_NAMES if name in facts.names))
    columns = {name: np.concatenate([part[name] for part in parts]).astype(np.float64) for name in names}
    # A signal that an older version did not store was not measured; it differs if the manifest has its checksum.
    columns |= {name: np.full(columns["t"].size, np.nan) for name in missing}
    return columns, tuple(_problems(file, facts, parts))


def _problems(file: Path, facts: Facts, parts: Sequence[Batch]) -> Iterator[ReportDifference]:
    try:
        require_matching_facts(facts, parts)
    except ImportRefusedError as error:
        yield ReportDifference(messages.file_of_samples(), messages.samples_as_exported(), error.message)
    known = {column.name: column.unit for column in describe_columns(facts.fields)}
    for column in facts.columns:
        if column.unit != known[column.name]:
            yield ReportDifference(
                messages.unit_in_file(column=column.name, file=file.name), f"[{column.unit}]", f"[{known[column.name]}]"
            )
    if file.suffix == ".csv" and (problem := find_heading_problem(file, facts)):
        yield ReportDifference(messages.units_and_meanings_in_file(file=file.name), messages.lines_of_export(), problem)
    if file.suffix == ".parquet" and (problem := find_schema_problem(file, facts)):
        yield ReportDifference(
            messages.units_and_meanings_in_file(file=file.name), messages.columns_of_export(), problem
        )


# Stored samples ------------------------------------------------------------------------------------
# The stored run of a report, found by its content, because another installation may number it differently.


def read_stored_samples(database: Database, manifest: ReportManifest) -> tuple[Columns | None, int | None]:
    """Return the stored samples of the run of a manifest and its number here.

    Both are None if there is none. Among runs that began at the same moment it is the one with the hash of the samples,
    else the first one, so that the differences can be listed.
    """
    with database.reading() as session:
        began = runs.began_at(session, manifest.run.started_at)
    found: list[tuple[Columns, int]] = []
    for run in began:
        columns, _ = read_recorded_columns(database, run.id)
        if of_samples(columns) == manifest.hashes.get("samples"):
            return columns, run.id
        found.append((columns, run.id))
    return found[0] if found else (None, None)


# Verification --------------------------------------------------------------------------------------
# Whether a report holds: all of it is recomputed from the samples that it names, and compared.
#
# Each difference has a name: a figure, a criterion, a parameter, a sample, a hash, a version, or a line of the page.


_Result = tuple[Metrics | None, tuple[RunCriterion, ...], StoredEstimate | None]


@dataclass(frozen=True)
class AccompanyingFiles:
    """Other sources to compare: metrics.json as text, and stored samples by name."""

    metrics: str | None = None
    stored: Columns | None = None
    stored_as: str = ""


NO_FILES = AccompanyingFiles()


def verify_report(page: str, columns: Columns | None, files: AccompanyingFiles = NO_FILES) -> Verified:
    """Compare a report with its manifest, and both with samples and ``files``.

    Raises EvidenceError for a page without a manifest, and if there are no samples.
    """
    manifest = _of_a_run(page)
    return _verify_files(*_verify_page(page, manifest, columns), manifest, files)


def _verify_files(
    found: Verified, source: RunData | None, manifest: ReportManifest, files: AccompanyingFiles
) -> Verified:
    """Return the result with differences of metrics.json and of the stored run added."""
    differences = list(found.differences)
    left_out = list(found.left_out)
    if files.stored is not None:
        stored = _samples(manifest, _without_unrecorded(manifest, files.stored))
        differences += (replace(one, name=f"{files.stored_as}, {one.name}") for one in stored)
    if files.metrics is not None and source is None:
        left_out.append(messages.metrics_file_not_comparable())
    elif files.metrics is not None and source is not None:
        differences += _metrics_file(files.metrics, source, manifest)
    return replace(found, differences=tuple(differences[:MOST]), left_out=tuple(left_out))


def _metrics_file(text: str, source: RunData, manifest: ReportManifest) -> Iterator[ReportDifference]:
    """Compare metrics.json with the same document made here.

    Texts are compared only if the same version wrote them.
    """
    try:
        reported = json.loads(text)
    except (ValueError, RecursionError) as error:
        yield ReportDifference("metrics.json", messages.json_document(), str(error)[:200])
        return
    if not isinstance(reported, dict):
        yield ReportDifference("metrics.json", messages.json_object(), type(reported).__name__)
        return
    reported = _metrics_in_present_form(reported, source)
    found = json.loads(json.dumps(build_metrics_document(source)))
    same = all(manifest.made_with.get(name) == made_with()[name] for name in (SINEW, LAYOUT))
    words = () if same else ("labels", "verdict", "problem")
    for document in (reported, found):
        for name in words:
            document.pop(name, None)
        if isinstance(document.get("identification"), dict):
            document["identification"].pop("estimate", None)  # its number in storage
            if not same:
                document["identification"] = _without_sentences(document["identification"])
    yield from compare_documents(
        "metrics.json", reported, found, LIKE if source.identification is None else LIKE_ESTIMATE
    )


def _metrics_in_present_form(document: dict[str, Any], source: RunData) -> dict[str, Any]:
    """Return metrics.json with its documents upgraded to the present form."""
    estimate, found = document.get("identification"), source.identification
    if isinstance(estimate, dict) and found is not None:
        quality = upgrades.upgrade_quality(found.kind, estimate.get("model"), estimate.get("quality"))
        document = {**document, "identification": {**estimate, "quality": quality}}
    upgraded = {
        "settings": upgrades.upgrade_run_settings(document.get("settings")),
        "criteria": upgrades.upgrade_criteria(document.get("criteria")),
    }
    return {**document, **{name: part for name, part in upgraded.items() if name in document}}


def _verify_page(page: str, manifest: ReportManifest, columns: Columns | None) -> tuple[Verified, RunData | None]:
    """Return the result of the comparison, and the recomputed source data."""
    if columns is None:
        raise EvidenceError(messages.samples_missing())
    again, source = computed_again(manifest, columns)
    if source is None:
        return again, None
    return join_verified(again, compare_pages(page, manifest, lambda: to_html(build_report(source)))), source


def join_verified(*found: Verified) -> Verified:
    """Return several results as one; the scope is that of the last, the page."""
    differences = tuple(one for each in found for one in each.differences)
    left_out = dict.fromkeys(one for each in found for one in each.left_out)
    return Verified(differences[:MOST], tuple(left_out), found[-1].compared)


def verify_pdf(pdf: bytes, page: str, columns: Columns | None, files: AccompanyingFiles = NO_FILES) -> Verified:
    """Verify the page that belongs to a PDF, then the PDF against its recomputation.

    A PDF has no manifest; it is made again and compared byte by byte. Raises EvidenceError.
    """
    manifest = _of_a_run(page)
    verified, source = _verify_page(page, manifest, columns)
    verified = _verify_files(verified, source, manifest, files)
    if verified.differences or source is None:
        return verified
    if manifest.made_with != made_with():
        words = messages.page_beside_pdf_compared(compared=verified.compared)
        return replace(verified, left_out=(*verified.left_out, messages.pdf_of_another_version()), compared=words)
    try:
        same = to_pdf(build_report(source)) == pdf
    except Exception as error:
        return Verified((not_made(messages.the_pdf(), messages.one_that_can_be_reproduced(), error),), ())
    if same:
        return verified
    return Verified(
        (ReportDifference(messages.the_pdf(), messages.other_pages(), messages.pages_of_html_report()),), ()
    )


def _of_a_run(page: str) -> ReportManifest:
    manifest = read_manifest(page)
    if isinstance(manifest, SeriesEvidence):
        raise EvidenceError(messages.report_of_a_series())
    return manifest


def computed_again(manifest: ReportManifest, columns: Columns) -> tuple[Verified, RunData | None]:
    """Compare a manifest with samples; return differences and recomputed source data.

    The source data is None if recomputing fails for any reason.
    """
    differences: list[ReportDifference] = []
    columns = _without_unrecorded(manifest, columns)
    try:
        differences += _samples(manifest, columns)
        differences += _hashes(
            manifest.hashes, {**compute_hashes(manifest, columns), MANIFEST: compute_manifest_hash(manifest)}
        )
        manifest = _in_present_form(manifest)
        again = _recompute_result(manifest, columns)
        if manifest.metrics is None and again[0] is not None:
            source = rebuild_run_data(manifest, columns, None, (), None)
            return Verified(tuple(differences[:MOST]), (messages.result_not_in_report(),)), source
        older = _describe_older_definitions(manifest)
        left_out = (*older, *_list_unverified_fields(manifest))
        others = [] if older else list(_results(manifest, again))
        is_complete = bool(older) or not others
        source = rebuild_run_data(manifest, columns, *(_normalize_result(manifest) if is_complete else again))
    except Exception as error:
        problem = not_made(messages.the_source_data(), messages.run_that_can_be_recomputed(), error)
        return Verified((*differences, problem)[:MOST], ()), None
    return Verified((*differences, *others)[:MOST], left_out), source


def _in_present_form(manifest: ReportManifest) -> ReportManifest:
    """Return a manifest with its documents upgraded to the present form.

    Its hashes remain those of the documents as they were embedded.
    """
    estimate = manifest.identification
    if estimate is not None:
        quality = upgrades.upgrade_quality(estimate.kind, estimate.model, estimate.quality)
        estimate = replace(estimate, quality=quality)
    return replace(
        manifest,
        run=replace(manifest.run, settings=upgrades.upgrade_run_settings(manifest.run.settings)),
        metrics=upgrades.upgrade_metrics(manifest.metrics),
        criteria=upgrades.upgrade_criteria(manifest.criteria),
        identification=estimate,
    )


def _describe_older_definitions(manifest: ReportManifest) -> tuple[str, ...]:
    """Return the reason why a result of older definitions is not compared; else empty."""
    if manifest.metrics is None or manifest.metrics.get("definitions", 0) == DEFINITIONS:
        return ()
    definitions = manifest.metrics.get("definitions", 0)
    reason = messages.result_of_other_definitions(version=definitions, current=DEFINITIONS, run_id=manifest.run.id)
    return (reason,)


def _list_unverified_fields(manifest: ReportManifest) -> tuple[str, ...]:
    """Return the fields of the run that neither pages nor samples show.

    Reports of the present version omit them.
    """
    missing = [
        name
        for name, nothing in get_unverified_defaults(manifest.metrics).items()
        if getattr(manifest.run, name) != nothing
    ]
    return (messages.fields_not_in_report(names=missing),) if missing else ()


def _hashes(reported: Mapping[str, str], found: Mapping[str, str]) -> Iterator[ReportDifference]:
    for name in dict.fromkeys([*reported, *found]):
        if reported.get(name) != found.get(name):
            yield ReportDifference(
                messages.hash_of_input(name=name),
                reported.get(name, messages.nothing()),
                found.get(name, messages.nothing()),
            )


def _recompute_result(manifest: ReportManifest, columns: Columns) -> _Result:
    run = manifest.run
    plan = parse_stored_plan(run.kind, run.set_to.plan or {})
    parameters = parse_parameters(run.parameters_name, run.parameters)
    missed = manifest.missed_before + count_missing_ticks(columns)
    try:
        result, estimate = compute_result(
            columns=columns,
            missed=missed,
            parameters=parameters,
            plan=plan,
            run=run,
            points=load_bank_points(manifest.bank),
        )
    except NoSamplesError:
        return None, (), None
    return result.metrics, result.criteria, None if estimate is None else to_stored_estimate(estimate)


def _normalize_result(manifest: ReportManifest) -> _Result:
    """Return the result as the report has it, so that rounding changes no hash."""
    metrics, of = manifest.metrics, f"run {manifest.run.id}"
    criteria = CRITERIA.read(manifest.criteria, of)
    return None if metrics is None else METRICS.read(metrics, of), criteria, manifest.identification


def _results(manifest: ReportManifest, again: _Result) -> Iterator[ReportDifference]:
    metrics, criteria, estimate = again
    like = LIKE if estimate is None else LIKE_ESTIMATE
    yield from compare_documents("metrics", manifest.metrics, None if metrics is None else METRICS.write(metrics), like)
    yield from compare_documents("criteria", manifest.criteria, CRITERIA.write(criteria))
    reported, found = _document(manifest.identification), _document(estimate)
    if manifest.made_with.get(LAYOUT) != made_with()[LAYOUT]:  # another state of the code may phrase it differently
        reported, found = _without_sentences(reported), _without_sentences(found)
    yield from compare_documents("identification", reported, found, like)


def _without_sentences(document: Any) -> Any:
    """Return a document without texts of several words; names and grades are one word."""
    if isinstance(document, Mapping):
        return {name: _without_sentences(part) for name, part in document.items()}
    if isinstance(document, list):
        return [_without_sentences(part) for part in document]
    return "" if isinstance(document, str) and " " in document else document


def _document(estimate: StoredEstimate | None) -> dict[str, Any] | None:
    return None if estimate is None else vars(estimate)


def _without_unrecorded(manifest: ReportManifest, columns: Columns) -> Columns:
    """Return columns without all-NaN signals that have no checksum in the report.

    An export adds such signals.
    """
    return {
        name: column
        for name, column in columns.items()
        if name == "t" or name in manifest.blocks or not np.isnan(column).all()
    }


def _samples(manifest: ReportManifest, columns: Columns) -> Iterator[ReportDifference]:
    size = columns["t"].size
    if size != manifest.samples:
        yield ReportDifference(messages.number_of_samples(), str(manifest.samples), str(size))
        return
    found = compute_block_hashes(columns)
    for name in HASHED:
        reported = manifest.blocks.get(name, [])
        for place, (one, other) in enumerate(zip(reported, found.get(name, []), strict=False)):
            if one != other:
                start = place * BLOCK_S
                yield ReportDifference(
                    messages.samples_of_signal(signal=name, start_s=start, end_s=start + BLOCK_S), one, other
                )
        if len(reported) != len(found.get(name, [])):
            yield ReportDifference(
                messages.checksums_of_signal(signal=name), str(len(reported)), str(len(found.get(name, [])))
            )


# Series verification -------------------------------------------------------------------------------
# Verification of the report of a series: each of its runs is recomputed from its stored samples, then the page.


def verify_series_report(
    page: str, manifest: SeriesEvidence, find: Callable[[ReportManifest], Columns | None]
) -> Verified:
    """Compare the report of a series with the samples that ``find`` returns.

    Each manifest is compared with the samples of its run, then the page with the same page made anew. Raises
    EvidenceError if the samples of a run are missing.
    """
    if len(manifest.runs) < 2 or any(one.run.kind == RunKind.SESSION for one in manifest.runs):
        raise EvidenceError(messages.not_a_series())
    found, sources = [], []
    for one in manifest.runs:
        columns = find(one)
        if columns is None:
            raise EvidenceError(messages.samples_of_run_missing(run_id=one.run.id))
        again, source = computed_again(one, columns)
        found.append(_of_run(one.run.id, again))
        if source is not None:
            sources.append(source)
    if len(sources) == len(manifest.runs):
        found.append(compare_pages(page, manifest, lambda: to_html(series_report(sources))))
    return join_verified(*found)


def _of_run(number: int, again: Verified) -> Verified:
    differences = tuple(
        replace(one, name=messages.part_of_run(run_id=number, part=one.name)) for one in again.differences
    )
    left_out = tuple(messages.part_of_run(run_id=number, part=one) for one in again.left_out)
    return replace(again, differences=differences, left_out=left_out)
