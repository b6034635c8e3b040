"""``sinew runs export`` and what goes with it."""

from pathlib import Path
from typing import Annotated

import typer

from backend.cli.ordering import current_user
from backend.cli.output import AsJson, fail, out, print_json
from backend.cli.place import DataFolder, StationName, database_of, settings_with


def export(
    run: Annotated[int, typer.Argument(help="Number of the run.")],
    file: Annotated[Path, typer.Argument(help="File to write; .csv, .parquet, .mat or .mcap says the format.")],
    formula: Annotated[
        list[str] | None, typer.Option(help="Derived signal as a further column, once for each.")
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write all samples of a run to a file, with their notation and the facts of the run; SI units."""
    from backend.exports.base import ExportError, of_run
    from backend.exports.formats import DataFormat, write_file
    from backend.storage.orm import UnknownRecordError

    kind = file.suffix.removeprefix(".")
    if kind not in set(DataFormat):
        fail(f"{file}: name the file .csv, .parquet, .mat or .mcap", status=2)
    with database_of(settings_with(data=data, station=station), reading=True) as database:
        try:
            write_file(of_run(database, run, list(dict.fromkeys(formula or ()))), DataFormat(kind), file)
        except (UnknownRecordError, ExportError) as error:
            fail(str(error), status=2)
    out.print(f"wrote {file}", highlight=False, markup=False)


def layout(file: Annotated[Path, typer.Argument(help="File to write, .json.")]) -> None:
    """Write the layout that shows an MCAP export, or the live stream, in Foxglove and Lichtblick."""
    from backend.exports import mcap
    from backend.exports.formats import write_whole

    write_whole((mcap.layout().encode(),), file)
    out.print(f"wrote {file}", highlight=False, markup=False)


def take_in(
    file: Annotated[Path, typer.Argument(help="Export of a run: .csv, .parquet, .mat or .mcap; or its bundle, .zip.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Take in a run that was exported, or bundled with all that it came from; whole, or not at all."""
    from backend.archive.imports import take_in as store
    from backend.exports.base import ImportRefusedError

    settings = settings_with(data=data, station=station)
    with database_of(settings) as database:
        try:
            taken = store(database, file, current_user(), settings.data)
        except (ImportRefusedError, OSError) as error:
            fail(f"{file} is not taken in, and nothing of it: {error}", status=2)
            raise
    if as_json:
        print_json(vars(taken))
    elif taken.new:
        out.print(f"run {taken.was} is taken in as run {taken.run}", highlight=False, markup=False)
    else:
        out.print(
            f"run {taken.was} is here already, as run {taken.run}: nothing is done", highlight=False, markup=False
        )


def bundle(
    run: Annotated[int, typer.Argument(help="Number of the run.")],
    file: Annotated[Path, typer.Argument(help="File to write, .zip.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write a run with all that it came from to a file that another installation takes in."""
    from backend.archive.bundling import bundle_pieces
    from backend.exports.base import ExportError
    from backend.exports.formats import write_whole
    from backend.storage.orm import UnknownRecordError

    settings = settings_with(data=data, station=station)
    with database_of(settings, reading=True) as database:
        try:
            write_whole(bundle_pieces(database, run, settings.data), file)
        except (UnknownRecordError, ExportError) as error:
            fail(str(error), status=2)
    out.print(f"wrote {file}", highlight=False, markup=False)
