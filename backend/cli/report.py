"""``sinew report``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, angles, errors, fail, out, print_json
from backend.cli.place import DataFolder, database_of, has_database, settings_with
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.recording.columns import Columns
    from backend.reports.differences import Difference, Verified
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
    with database_of(settings_with(data=data), reading=True) as database:
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

    metrics.json beside it, the units in the comments of data.csv and, where the data folder has the run, its stored
    samples are compared too. A PDF is verified by the page of the same name beside it. Ends with 0 where all hold, 1
    where something differs, 2 where something could not be compared: then it is not verified ("holds": null).
    """
    from backend.recording.codec import CodecError
    from backend.reports.evidence import EvidenceError
    from backend.reports.samples_file import SamplesFileError
    from backend.storage import StorageError
    from backend.storage.migrate import SchemaError

    try:
        found, origin, checked = _verified(file, samples, settings_with(data=data))
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
                "holds": found.holds,
                "samples": origin,
                "checked": list(checked),
                "differences": [vars(one) for one in found.differences],
                "left_out": list(found.left_out),
            }
        )
    for left_out in () if as_json else found.left_out:
        out.print(f"not compared: {left_out}", highlight=False, markup=False)
    if found.differences:
        for one in () if as_json else found.differences:
            errors.print(one.sentence, highlight=False, markup=False, soft_wrap=True)
        if not as_json and len(checked) > 1:
            words = f"computed from {origin}; compared with it: {', '.join(checked[1:])}"
            errors.print(words, highlight=False, markup=False, soft_wrap=True)
        fail(f"{file} does not hold: {len(found.differences)} differences")
    if found.holds is None:
        fail(f"{file} is not verified: nothing differs, but not all of it was compared", status=2)
    if not as_json:
        words = f"{file} holds: {found.compared}, computed again from {origin}"
        if len(checked) > 1:
            words += f"; so do {', '.join(checked[1:])}"
        out.print(words, highlight=False, markup=False, soft_wrap=True)


def _verified(file: Path, samples: Path | None, settings: Settings) -> "tuple[Verified, str, tuple[str, ...]]":
    """Return what was found, where the samples are from that it was computed from, and all that was checked."""
    from backend.reports import verification
    from backend.reports.evidence import EvidenceError, SeriesEvidence, read
    from backend.reports.series_verification import verify_series

    for one in (file, samples):
        if one is not None and one.exists() and not one.is_file():
            raise EvidenceError(f"{one} is no ordinary file")
    of_pdf = file.suffix == ".pdf"
    page_file = file.with_suffix(".html")
    if of_pdf and not page_file.exists():
        raise EvidenceError(f"a PDF carries no account of its numbers, and its page {page_file.name} is not beside it")
    page = (page_file if of_pdf else file).read_bytes().decode("utf-8")
    evidence = read(page)
    if isinstance(evidence, SeriesEvidence):
        if of_pdf or samples is not None:
            raise EvidenceError("a series is verified by its page, from the stored runs")
        found = verify_series(page, evidence, lambda one: _stored(settings, one)[0])
        return found, "its stored runs", ("its stored runs",)
    sources = _sources(file, samples, settings, evidence)
    metrics = file.with_name("metrics.json")
    told = metrics.read_text(encoding="utf-8") if metrics.is_file() else None
    beside = verification.Beside(told, sources.stored if sources.file else None, sources.stored_as)
    columns = sources.columns if sources.file else sources.stored
    if of_pdf:
        found = verification.verify_pdf(file.read_bytes(), page, columns, beside)
    else:
        found = verification.verify(page, columns, beside)
    checked = tuple(name for name in (sources.file, sources.stored_as, "" if told is None else str(metrics)) if name)
    left_out = (*found.left_out, *sources.left_out)
    whole = replace(found, differences=(*found.differences, *sources.problems), left_out=left_out)
    return whole, sources.file or sources.stored_as, checked


@dataclass(frozen=True)
class _Sources:
    """Samples of a file, whose name is "" where there is none, and of the stored run; ``problems`` of the file."""

    file: str = ""
    columns: "Columns | None" = None
    problems: "tuple[Difference, ...]" = ()
    stored: "Columns | None" = None
    stored_as: str = ""
    left_out: tuple[str, ...] = ()


def _sources(file: Path, samples: Path | None, settings: Settings, evidence: "Evidence") -> _Sources:
    """Return the samples of the file that is named, or of one beside the report, and those of the stored run.

    Where there is a file, a database that cannot be read is left out with the reason.
    """
    from backend.recording.codec import CodecError
    from backend.reports.differences import Difference
    from backend.reports.samples_file import SUFFIXES, read_samples_file
    from backend.storage import StorageError
    from backend.storage.migrate import SchemaError

    beside = (file.with_name(f"data{suffix}") for suffix in SUFFIXES)
    named = samples or next((one for one in beside if one.is_file()), None)
    if named is None:
        stored, number = _stored(settings, evidence)
        return _Sources(stored=stored, stored_as=f"run {number} of the data folder")
    columns, problems = read_samples_file(named)
    found = _Sources(file=str(named), columns=columns, problems=problems)
    try:
        stored, number = _stored(settings, evidence)
    except CodecError as error:
        damage = Difference("the stored run", "samples that can be read", str(error)[:200])
        return replace(found, problems=(*problems, damage), stored_as="the stored run")
    except (SchemaError, StorageError) as error:
        return replace(found, left_out=(f"the stored run: {error}",))
    if stored is None or stored["t"].size == 0:  # never here, or deleted to make room
        return found
    return replace(found, stored=stored, stored_as=f"run {number} of the data folder")


def _stored(settings: Settings, evidence: "Evidence") -> "tuple[Columns | None, int | None]":
    from backend.reports.stored_samples import stored_samples

    if not has_database(settings):
        return None, None
    with database_of(settings, reading=True) as database:
        return stored_samples(database, evidence)
