"""``sinew report``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, errors, fail, out, print_json
from backend.cli.place import DataFolder, database_of, settings_with
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.recording.columns import Columns
    from backend.reports.evidence import Evidence

app = typer.Typer(help="Reports: whether one holds.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def _reports() -> None:
    """Keep ``verify`` a word of its own."""


@app.command()
def verify(
    file: Annotated[Path, typer.Argument(help="report.html of a run.")],
    samples: Annotated[
        Path | None,
        typer.Option("--samples", help="CSV or Parquet of its samples; else data.csv beside it, else the stored run."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Compute every number of a report again from its samples and say whether they hold.

    Ends with 0 where all hold, 1 where something differs, 2 where it cannot be told.
    """
    from backend.reports.evidence import EvidenceError, read
    from backend.reports.samples_file import SamplesFileError
    from backend.reports.verification import verify as verified_by

    try:
        page = file.read_bytes().decode("utf-8")
        columns, origin = _columns(file, samples, settings_with(data=data), read(page))
        found = verified_by(page, columns)
    except (OSError, UnicodeDecodeError, EvidenceError, SamplesFileError) as error:
        fail(f"{file}: it cannot be told whether it holds: {error}", status=2)
        raise
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
        words = f"{file} holds: every number, criterion, parameter and hash, computed again from {origin}"
        out.print(words, highlight=False, markup=False, soft_wrap=True)


def _columns(
    file: Path, samples: Path | None, settings: Settings, evidence: "Evidence"
) -> "tuple[Columns | None, str]":
    """Return the samples, and where they are from: the file that is named, one beside the report, the stored run."""
    from backend.reports.samples_file import SUFFIXES, read_samples_file

    beside = (file.with_name(f"data{suffix}") for suffix in SUFFIXES)
    named = samples or next((one for one in beside if one.exists()), None)
    if named is not None:
        return read_samples_file(named), str(named)
    return _stored(settings, evidence), f"run {evidence.run.id} of the data folder"


def _stored(settings: Settings, evidence: "Evidence") -> "Columns | None":
    """Return the samples of the stored run that began at the same moment, None where there is none."""
    from backend.recording.columns import recorded_columns
    from backend.storage import runs
    from backend.storage.records import UnknownRecordError

    with database_of(settings) as database:
        try:
            with database.reading() as session:
                run = runs.get(session, evidence.run.id)
        except UnknownRecordError:
            return None
        return recorded_columns(database, run.id)[0] if run.started_at == evidence.run.started_at else None
