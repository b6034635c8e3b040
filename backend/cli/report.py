"""``sinew report``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, angles, errors, fail, out, print_json
from backend.cli.place import DataFolder, database_of, has_database, settings_with
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.recording.columns import Columns
    from backend.reports.differences import Verified
    from backend.reports.evidence import Evidence

app = typer.Typer(help="Reports: of a series, and whether one holds.", no_args_is_help=True, rich_markup_mode=None)


@app.command()
def series(
    numbers: Annotated[list[int], typer.Argument(metavar="RUN...", help="Numbers of the runs, in order.")],
    to: Annotated[
        list[Path] | None, typer.Option("--to", help="File to write, .html or .pdf; series.html if left out.")
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Write one report of many runs: what differs between them, their metrics beside each other, their curves."""
    from backend.reports.rendering import render_series
    from backend.reports.series_source import load_series

    kinds, files = {".html": "html", ".pdf": "pdf"}, to or [Path("series.html")]
    unknown = next((file for file in files if file.suffix not in kinds), None)
    if unknown is not None:
        fail(f"{unknown}: a report is written as .html or .pdf")
    with database_of(settings_with(data=data)) as database:
        sources = load_series(database, numbers, angles())
    for file in files:
        file.write_bytes(render_series(sources, kinds[file.suffix]))
    if as_json:
        print_json({"runs": [source.run.id for source in sources], "files": [str(file) for file in files]})
        return
    out.print(f"written: {', '.join(map(str, files))}", highlight=False, markup=False, soft_wrap=True)


@app.command()
def verify(
    file: Annotated[Path, typer.Argument(help="report.html or report.pdf of a run, or the report of a series.")],
    samples: Annotated[
        Path | None,
        typer.Option("--samples", help="CSV or Parquet of its samples; else data.csv beside it, else the stored run."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Compute every number of a report again from its samples and say whether they hold.

    A PDF is verified by the page of the same name beside it. Ends with 0 where all hold, 1 where something differs, 2
    where it cannot be told.
    """
    from backend.recording.codec import CodecError
    from backend.reports.evidence import EvidenceError
    from backend.reports.samples_file import SamplesFileError
    from backend.storage import StorageError
    from backend.storage.migrate import SchemaError

    try:
        found, origin = _verified(file, samples, settings_with(data=data))
    except (
        OSError,
        UnicodeDecodeError,
        EvidenceError,
        SamplesFileError,
        CodecError,
        SchemaError,
        StorageError,
    ) as error:
        fail(f"{file}: it cannot be told whether it holds: {error}", status=2)
    if as_json:
        print_json(
            {
                "holds": not found.differences,
                "samples": origin,
                "differences": [vars(one) for one in found.differences],
                "left_out": list(found.left_out),
            }
        )
    for left_out in () if as_json else found.left_out:
        out.print(f"not compared: {left_out}", highlight=False, markup=False)
    if found.differences:
        for one in () if as_json else found.differences:
            errors.print(one.sentence, highlight=False, markup=False, soft_wrap=True)
        fail(f"{file} does not hold: {len(found.differences)} differences")
    if not as_json:
        words = f"{file} holds: {found.compared}, computed again from {origin}"
        out.print(words, highlight=False, markup=False, soft_wrap=True)


def _verified(file: Path, samples: Path | None, settings: Settings) -> "tuple[Verified, str]":
    """Return what was found, and where the samples are from."""
    from backend.reports import verification
    from backend.reports.differences import Difference
    from backend.reports.evidence import EvidenceError, SeriesEvidence, read
    from backend.reports.series_verification import verify_series

    of_pdf = file.suffix == ".pdf"
    beside = file.with_suffix(".html")
    if of_pdf and not beside.exists():
        raise EvidenceError(f"a PDF carries no account of its numbers, and its page {beside.name} is not beside it")
    page = (beside if of_pdf else file).read_bytes().decode("utf-8")
    evidence = read(page)
    if isinstance(evidence, SeriesEvidence):
        if of_pdf or samples is not None:
            raise EvidenceError("a series is verified by its page, from the stored runs")
        return verify_series(page, evidence, lambda one: _stored(settings, one)[0]), "its stored runs"
    columns, origin, problem = _columns(file, samples, settings, evidence)
    found = verification.verify_pdf(file.read_bytes(), page, columns) if of_pdf else verification.verify(page, columns)
    others = [Difference("the file of the samples", "samples as they were exported", problem)] if problem else []
    return replace(found, differences=(*found.differences, *others)), origin


def _columns(
    file: Path, samples: Path | None, settings: Settings, evidence: "Evidence"
) -> "tuple[Columns | None, str, str]":
    """Return the samples, where they are from, and why a file does not hold what was exported, "" where it does.

    They are from the file that is named, one beside the report, or the stored run.
    """
    from backend.reports.samples_file import SUFFIXES, read_samples_file

    beside = (file.with_name(f"data{suffix}") for suffix in SUFFIXES)
    named = samples or next((one for one in beside if one.exists()), None)
    if named is not None:
        columns, problem = read_samples_file(named)
        return columns, str(named), problem
    stored, number = _stored(settings, evidence)
    return stored, f"run {number} of the data folder", ""


def _stored(settings: Settings, evidence: "Evidence") -> "tuple[Columns | None, int | None]":
    from backend.reports.stored_samples import stored_samples

    if not has_database(settings):
        return None, None
    with database_of(settings) as database:
        return stored_samples(database, evidence)
