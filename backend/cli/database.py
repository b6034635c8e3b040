"""``sinew db``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, fail, out, print_json
from backend.cli.place import DataFolder, database_of, settings_with
from backend.cli.recordings import recordings

if TYPE_CHECKING:
    from backend.settings import Settings

app = typer.Typer(
    help="The database: bring it up to date, copy it, check it.", no_args_is_help=True, rich_markup_mode=None
)

app.command()(recordings)


@app.command()
def upgrade(data: DataFolder = None) -> None:
    """Migrate to the newest schema; an SQLite database is copied to DATA/backups first."""
    from backend.storage.database import revision

    with database_of(settings_with(data=data)) as database:
        out.print(f"schema {revision(database.engine)}", highlight=False)


@app.command()
def backup(
    file: Annotated[Path | None, typer.Argument(help="Copy to write; a new file. [DATA/backups/TIME.db]")] = None,
    data: DataFolder = None,
) -> None:
    """Copy the database while it may be in use; the log says so."""
    from backend.cli.ordering import current_user
    from backend.storage import events
    from backend.storage.database import backup as copy
    from backend.storage.database import next_copy

    settings = settings_with(data=data)
    wanted = file or next_copy(settings.data)
    with database_of(settings) as database:
        copy(database.engine, wanted)
        with database.session() as session:
            events.add(session, events.EventKind.BACKUP, f"database copied to {wanted.name}", who=current_user())
    out.print(f"wrote {wanted}", highlight=False, markup=False)


@app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="Backup to bring back.")],
    data: DataFolder = None,
) -> None:
    """Bring a backup back; refused while a service works on the folder. What was there before is kept beside it."""
    from backend.data_folder import only_service_on
    from backend.storage.database import FILE_NAME, BackupError
    from backend.storage.database import restore as bring_back

    settings = settings_with(data=data)
    if settings.database_url is not None:
        raise BackupError("a database given by SINEW_DATABASE_URL is restored with its own tools")
    with only_service_on(settings.data):
        target = (settings.data / FILE_NAME).resolve()
        if target.exists() and (by := _claimed_by(settings)):
            raise BackupError(f"{by} works on {target}, from another folder: end it first; nothing was changed")
        bring_back(file, target)
    out.print(f"restored {file}", highlight=False, markup=False)


def _claimed_by(settings: "Settings") -> str:
    """Say which service works on the database; "" where none does, or where the file cannot be read."""
    from backend.storage.claims import claimed_by
    from backend.storage.database import connect, sqlite_url
    from backend.storage.orm import StorageError

    engine = connect(sqlite_url(settings.data))
    try:
        return claimed_by(engine)
    except StorageError:
        return ""
    finally:
        engine.dispose()


@app.command("name-station")
def name_station(
    station: Annotated[str, typer.Argument(help="Name of the station that gets what is of none.")],
    data: DataFolder = None,
) -> None:
    """Give all that a database without stations holds to one; refused while a service works on it."""
    from backend.data_folder import only_service_on
    from backend.errors import require_station_name
    from backend.storage.claims import HeldClaim
    from backend.storage.stations import HeldStation, give_all

    if not require_station_name(station):
        fail("say what the station is to be called", status=2)
    settings = settings_with(data=data, station="")
    with only_service_on(settings.data), database_of(settings, held=True) as database:
        held = HeldStation(database.engine, "")
        claim = HeldClaim(database.engine, "")
        try:
            with database.session() as session:
                given = give_all(session, station)
        finally:
            claim.let_go()
            held.let_go()
    with database_of(settings):  # what runs are searched by is renewed
        out.print(f"{given} runs are of station {station} now; start its service with --station {station}")


@app.command()
def check(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Check that the database is whole and that its recordings hold what was recorded; exit 1 when not.

    Every sample is read: it takes some seconds for an hour of recordings.
    """
    from backend.recording.verification import Checked, check_recordings
    from backend.storage.database import check as problems_of

    with database_of(settings_with(data=data), reading=True) as database:
        problems = problems_of(database.engine)
        # what a damaged file still gives of its samples says nothing
        checked = Checked(0, (), ()) if problems else check_recordings(database)
    problems += checked.problems
    if as_json:
        print_json(
            {
                "whole": not problems,
                "problems": problems,
                "recordings": checked.recordings,
                "not_compared": list(checked.not_compared),
            }
        )
    for left_out in () if as_json else checked.not_compared:
        out.print(f"not compared: {left_out}", highlight=False, markup=False, soft_wrap=True)
    if problems:
        fail("; ".join(problems))
    if not as_json:
        out.print(f"the database is whole; recordings that hold what was recorded: {checked.recordings}")
