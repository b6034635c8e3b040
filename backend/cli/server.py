"""``sinew serve``, ``link``, ``db``, ``token``, ``doctor``, ``foxglove``, ``touch`` and ``wall``."""

import asyncio
import os
import secrets
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.experiments import current_user
from backend.cli.options import (
    CardAddress,
    DataFolder,
    ParameterSet,
    PlantName,
    Recording,
    RunningService,
    StationName,
    VirtualCard,
    WiringFile,
    find_running_service,
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, angle_unit, console, fail, print_json, print_table, restore_garbage_collection
from backend.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from backend.auth import Tokens
    from backend.schemas import TouchView
    from backend.settings import Settings


# Doctor --------------------------------------------------------------------------------------------
#
# ``sinew doctor``.


TICKS = 1000
LEAST_FREE_BYTES = 2 * 1024**3
"""A day at the bench: 80 MB an hour of recording."""

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")


@dataclass(frozen=True)
class DoctorFinding:
    """One thing that was looked at; ``remedy`` is empty where all is well."""

    what: str
    found: str
    remedy: str = ""


def doctor(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Tell what this machine can do for a 1 kHz loop, with a remedy for what it cannot."""
    settings = load_settings(data=data)
    findings = [*_real_time(), _beat(), _cores(), _card(), _browser(), _pages(), _disk(settings.data)]
    if as_json:
        print_json([asdict(finding) for finding in findings])
        return
    print_table(("what", "found", "remedy"), [(f.what, f.found, f.remedy) for f in findings])
    open_points = sum(bool(finding.remedy) for finding in findings)
    console.print(
        "all well" if not open_points else f"{open_points} of {len(findings)} could be better", highlight=False
    )


def _real_time() -> Iterator[DoctorFinding]:
    from backend.realtime import request_real_time

    granted = request_real_time()
    refusals = "; ".join(granted.refusals)
    priority = f"SCHED_FIFO {granted.priority}" if granted.priority else "ordinary"
    yield DoctorFinding(
        "scheduling", priority, "" if granted.priority else _naming("FIFO", granted.refusals) or refusals
    )
    locked = "locked" if granted.memory_locked else "not locked"
    yield DoctorFinding(
        "memory", locked, "" if granted.memory_locked else _naming("memory", granted.refusals) or refusals
    )
    yield DoctorFinding("timer slack", f"{granted.timer_slack_ns} ns")


def _naming(word: str, refusals: tuple[str, ...]) -> str:
    return next((refusal for refusal in refusals if word in refusal), "")


def _beat() -> DoctorFinding:
    """Keep 1 ms for a second, as the loop does but without its work."""
    from backend.realtime import Pacer
    from plant import T_s

    pacer = Pacer(T_s)
    late_us = sorted(1e6 * pacer.wait() for _ in range(TICKS))
    resolution_ns = 1e9 * time.get_clock_info("monotonic").resolution
    found = f"late by {late_us[TICKS // 2]:.0f} µs (median), {late_us[int(0.99 * TICKS)]:.0f} µs (99 %)"
    missed = f", {pacer.overruns} deadlines missed" if pacer.overruns else ""
    remedy = "close other programs, or give the loop a core of its own" if pacer.overruns > TICKS // 100 else ""
    return DoctorFinding("1 ms beat", f"{found}{missed}; clock {resolution_ns:.0f} ns", remedy)


def _cores() -> DoctorFinding:
    cores = len(os.sched_getaffinity(0))
    return DoctorFinding(
        "processor cores", str(cores), "" if cores >= 2 else "the loop and the dashboard want a core each"
    )


def _card() -> DoctorFinding:
    from plant import PlantChoice, PlantError, PlantKind, require_available

    try:
        require_available(PlantChoice(PlantKind.RIG))
        from plant import read_driver_version

        return DoctorFinding("DAQ card", read_driver_version())
    except PlantError as error:
        found, _, remedy = str(error).partition(": ")
        return DoctorFinding("DAQ card", f"none: {found}", f"the simulator needs none; for a rig {remedy}")


def _browser() -> DoctorFinding:
    found = next((name for name in _BROWSERS if shutil.which(name)), None)
    return DoctorFinding(
        "browser", found or "none on this machine", "" if found else "open the dashboard from another one"
    )


def _pages() -> DoctorFinding:
    built = (Path(__file__).parents[1] / "static" / "index.html").is_file()
    return DoctorFinding("dashboard pages", "built" if built else "not built", "" if built else "make frontend")


def _disk(data: Path) -> DoctorFinding:
    folder = data.resolve()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if not os.access(folder, os.W_OK):
        return DoctorFinding(
            "data folder", f"{data} cannot be written", "choose another with --data, or change its owner"
        )
    remedy = "" if free >= LEAST_FREE_BYTES else "free some space: a recording takes 80 MB an hour"
    return DoctorFinding("data folder", f"{data}: {free / 1024**3:.1f} GB free", remedy)


# Foxglove ------------------------------------------------------------------------------------------
#
# ``sinew foxglove``.


PORT = 8765
"""Where Foxglove looks first."""


def foxglove(
    data: DataFolder = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of this machine to listen on, 0 for any free one.")
    ] = PORT,
) -> None:
    """Show the live stream of the running service in Foxglove or Lichtblick, until interrupted."""
    from backend.auth import load_tokens
    from backend.data_folder import read_service_address

    try:
        from backend.foxglove import LiveSource, OtherVersionError, serve_foxglove
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        fail("this needs the extra foxglove: pip install 'sinew[foxglove]'")
    from backend.workers import BACKGROUND_NICENESS

    os.setpriority(os.PRIO_PROCESS, 0, BACKGROUND_NICENESS)  # the loop and the page come first
    settings = load_settings(data=data)
    if read_service_address(settings.data) is None:
        fail(f"no service works on the folder {settings.data}: start it with `sinew serve`, or choose --data")
    without_token = secrets.token_urlsafe(24)
    """The key where the service asks for none: a page of anybody may open a connection to a port of this machine."""

    def look() -> "LiveSource | None":
        address = read_service_address(settings.data)
        if address is None:
            return None
        return LiveSource(address, load_tokens(settings.data).viewer if settings.require_token else "")

    def say(words: str) -> None:
        print(words, flush=True)

    try:
        asyncio.run(serve_foxglove(look, lambda source: source.token or without_token, port, say))
    except OSError as error:
        fail(f"port {port} of this machine cannot be listened on: {error.strerror}; choose another with --port")
    except OtherVersionError as error:
        fail(str(error))


# Recordings ----------------------------------------------------------------------------------------
#
# ``sinew db recordings``.


def recordings(
    delete: Annotated[
        list[int] | None,
        typer.Option("--delete", help="Delete the samples of this run of the list; once for each run."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Say how much recordings take, and list the runs whose samples may go. Deletes only runs named one by one."""
    from backend.recording import NotRemovableError, RetentionRule, delete_recordings, summarise_retention

    settings = load_settings(data=data)
    rule = RetentionRule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days)
    with open_configured_database(settings) as database:
        try:
            found = (
                delete_recordings(database, rule, delete, current_user())
                if delete
                else summarise_retention(database, rule)
            )
        except NotRemovableError as error:
            fail(str(error), status=2)
    if as_json:
        may_go = [{"run": run.run_id, "started": run.started_at, "size_bytes": run.size_bytes} for run in found.may_go]
        print_json({"total_bytes": found.total_bytes, "limit_bytes": rule.max_bytes, "may_go": may_go})
        return
    total, limit = f"{found.total_bytes / 1e9:.3f} GB", f"{settings.recordings_GB:g} GB"
    console.print(
        found.describe or f"recordings take {total}, limit {limit}: nothing has to go", highlight=False, markup=False
    )
    if found.may_go:
        rows = [
            (
                run.run_id,
                f"{run.started_at:%Y-%m-%d %H:%M}",
                run.kind,
                run.who,
                f"{run.size_bytes / 1e6:.1f} MB",
                run.note,
            )
            for run in found.may_go
        ]
        print_table(("run", "started (UTC)", "kind", "by", "samples", "note"), rows)
        named = " ".join(f"--delete {run.run_id}" for run in found.may_go)
        console.print(f"to delete these samples: sinew db recordings {named}", highlight=False, markup=False)


# Database ------------------------------------------------------------------------------------------
#
# ``sinew db``.


database_app = typer.Typer(
    help="The database: bring it up to date, copy it, check it.", no_args_is_help=True, rich_markup_mode=None
)

database_app.command()(recordings)


@database_app.command()
def upgrade(data: DataFolder = None) -> None:
    """Migrate to the newest schema; an SQLite database is copied to DATA/backups first."""
    from backend.storage import read_revision

    with open_configured_database(load_settings(data=data)) as database:
        console.print(f"schema {read_revision(database.engine)}", highlight=False)


@database_app.command()
def backup(
    file: Annotated[Path | None, typer.Argument(help="Copy to write; a new file. [DATA/backups/TIME.db]")] = None,
    data: DataFolder = None,
) -> None:
    """Copy the database while it may be in use; the log says so."""
    from backend.cli.experiments import current_user
    from backend.storage import backup_database as copy
    from backend.storage import events, next_backup_path

    settings = load_settings(data=data)
    wanted = file or next_backup_path(settings.data)
    with open_configured_database(settings) as database:
        copy(database.engine, wanted)
        with database.session() as session:
            events.add(session, events.EventKind.BACKUP, f"database copied to {wanted.name}", who=current_user())
    console.print(f"wrote {wanted}", highlight=False, markup=False)


@database_app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="Backup to bring back.")],
    data: DataFolder = None,
) -> None:
    """Bring a backup back; refused while a service works on the folder. What was there before is kept beside it."""
    from backend.data_folder import lock_for_service
    from backend.storage import FILE_NAME, BackupError
    from backend.storage import restore_database as bring_back

    settings = load_settings(data=data)
    if settings.database_url is not None:
        raise BackupError("a database given by SINEW_DATABASE_URL is restored with its own tools")
    with lock_for_service(settings.data):
        target = (settings.data / FILE_NAME).resolve()
        if target.exists() and (by := _claimed_by(settings)):
            raise BackupError(f"{by} works on {target}, from another folder: end it first; nothing was changed")
        bring_back(file, target)
    console.print(f"restored {file}", highlight=False, markup=False)


def _claimed_by(settings: "Settings") -> str:
    """Say which service works on the database; "" where none does, or where the file cannot be read."""
    from backend.storage import StorageError, connect_database, describe_claim, sqlite_url

    engine = connect_database(sqlite_url(settings.data))
    try:
        return describe_claim(engine)
    except StorageError:
        return ""
    finally:
        engine.dispose()


@database_app.command("name-station")
def name_station(
    station: Annotated[str, typer.Argument(help="Name of the station that gets what is of none.")],
    data: DataFolder = None,
) -> None:
    """Give all that a database without stations holds to one; refused while a service works on it."""
    from backend.data_folder import lock_for_service
    from backend.errors import check_station_name
    from backend.storage import HeldClaim, HeldStation, assign_unowned_rows

    if not check_station_name(station):
        fail("say what the station is to be called", status=2)
    settings = load_settings(data=data, station="")
    with lock_for_service(settings.data), open_configured_database(settings, owns_folder=True) as database:
        held = HeldStation(database.engine, "")
        claim = HeldClaim(database.engine, "")
        try:
            with database.session() as session:
                given = assign_unowned_rows(session, station)
        finally:
            claim.let_go()
            held.let_go()
    with open_configured_database(settings):  # what runs are searched by is renewed
        console.print(f"{given} runs are of station {station} now; start its service with --station {station}")


@database_app.command()
def check(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Check that the database is whole and that its recordings hold what was recorded; exit 1 when not.

    Every sample is read: it takes some seconds for an hour of recordings.
    """
    from backend.recording import RecordingsCheck, check_recordings
    from backend.storage import find_database_errors as problems_of

    with open_configured_database(load_settings(data=data), read_only=True) as database:
        problems = problems_of(database.engine)
        # what a damaged file still gives of its samples says nothing
        checked = RecordingsCheck(0, (), ()) if problems else check_recordings(database)
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
        console.print(f"not compared: {left_out}", highlight=False, markup=False, soft_wrap=True)
    if problems:
        fail("; ".join(problems))
    if not as_json:
        console.print(f"the database is whole; recordings that hold what was recorded: {checked.recordings}")


# Serve ---------------------------------------------------------------------------------------------
#
# ``sinew serve`` and ``sinew link``.


SAID_AFTER_S = 3.0
STILL_STARTING = "Sinew is starting. The first start after an installation compiles: that takes up to a minute."


def serve(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free one. [8000]")] = None,
    public_url: Annotated[
        str | None,
        typer.Option(help="Address that browsers open at a reverse proxy, such as https://rig.lab/sinew/."),
    ] = None,
    trusted_proxy: Annotated[
        list[str] | None,
        typer.Option(help="Address or network of that proxy, once for each. [127.0.0.0/8 and ::1]"),
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
    show_link: Annotated[
        bool | None,
        typer.Option("--show-link/--hide-link", help="Print the sign-in link. [on a terminal only: logs are kept]"),
    ] = None,
    log_level: Annotated[
        str | None,
        typer.Option(help="Least level of the log: debug, info, warning or error. [warning]"),
    ] = None,
) -> None:
    """Run the dashboard and the control loop until interrupted."""
    from backend.main import serve as run_service
    from backend.server import describe_served_addresses
    from plant import require_available

    settings = load_settings(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        recording=recording,
        params=params,
        host=host,
        port=port,
        public_url=public_url,
        trusted_proxies=tuple(trusted_proxy) if trusted_proxy else None,
        data=data,
        station=station,
        show_link=show_link,
        log_level=log_level,
    )
    require_available(settings.plant_choice)
    shows_link = sys.stdout.isatty() if settings.show_link is None else settings.show_link

    slow = threading.Timer(SAID_AFTER_S, print, (STILL_STARTING,), {"flush": True})
    slow.daemon = True

    def tell(address: str, tokens: "Tokens | None") -> None:
        slow.cancel()
        addresses = [address, *([settings.public_url] if settings.public_url else [])]
        if tokens is not None and not shows_link:
            answers = " and ".join(_bases(addresses))
            print(f"Sinew answers at {answers}. The sign-in link: sinew link --data {settings.data}", flush=True)
        else:
            _print_links(addresses, tokens)
        if served := describe_served_addresses(settings.host):
            print(served, flush=True)

    restore_garbage_collection()
    slow.start()
    try:
        run_service(settings, tell)
    finally:
        slow.cancel()


def link(data: DataFolder = None) -> None:
    """Print the sign-in links of the service that works on the data folder; exit 1 when there is none."""
    from backend.auth import load_tokens
    from backend.data_folder import describe_missing_address, read_service_addresses

    settings = load_settings(data=data)
    addresses = read_service_addresses(settings.data)
    if not addresses:
        fail(describe_missing_address(settings.data))
    _print_links(addresses, load_tokens(settings.data) if settings.require_token else None)


def _print_links(addresses: Sequence[str], tokens: "Tokens | None") -> None:
    """Print the links to sign in at the last of the addresses, the public one where there is one."""
    *others, base = _bases(addresses)
    if tokens is None:
        print(f"Sinew answers at {base} without sign-in", flush=True)
        return
    print(f"Sinew answers. Sign in: {base}/?token={tokens.operator}", flush=True)
    print(f"To watch only:          {base}/?token={tokens.viewer}", flush=True)
    for other in others:
        print(f"At this machine:        {other}/?token={tokens.operator}", flush=True)


def _bases(addresses: Sequence[str]) -> list[str]:
    return [address.rstrip("/") for address in addresses]


# Token ---------------------------------------------------------------------------------------------
#
# ``sinew token``.


token_app = typer.Typer(help="The tokens that open the dashboard.", no_args_is_help=True, rich_markup_mode=None)


class TokenOwner(StrEnum):
    """Whose token is meant."""

    OPERATOR = "operator"
    VIEWER = "viewer"
    BOTH = "both"


@token_app.callback()
def _group() -> None:
    """Keep ``rotate`` a word of its own."""


@token_app.command()
def rotate(
    role: Annotated[TokenOwner, typer.Option(help="Whose token to replace.")] = TokenOwner.BOTH,
    data: DataFolder = None,
) -> None:
    """Replace tokens. A running service notices within a second; all sessions of the old ones end then."""
    from backend.auth import TOKEN_FILES, replace_tokens
    from backend.schemas import Role

    settings = load_settings(data=data)
    if not settings.data.is_dir():
        fail(f"there is no data folder {settings.data}: choose one with --data")
    roles = list(Role) if role is TokenOwner.BOTH else [Role(role)]
    replace_tokens(settings.data, roles)
    for one in roles:
        file = settings.data / TOKEN_FILES[one]
        print(f"{one}: /?token={file.read_text().strip()}  (kept in {file})")


# Touch ---------------------------------------------------------------------------------------------
#
# ``sinew touch``: what the running service's estimate of the outside force has learned, and to
# learn it.


touch_app = typer.Typer(
    help="The outside force at the running service: what it reads with nothing outside.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
_LOOK_S = 0.5


@touch_app.command()
def show(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Print what was learned and from what force on the joint gives way."""
    from backend.schemas import State

    _tell(_service(data).request("GET", "/state", None, State).touch, as_json=as_json)


@touch_app.command()
def learn(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Learn at the stiffness that is held now, in run, with nobody at the joint."""
    _tell(_order_touch(_service(data), {"learn": True}), as_json=as_json)


@touch_app.command()
def sweep(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Learn over all of the stiffness, point by point, in run, with nobody at the joint; Ctrl+C stops it."""
    service = _service(data)
    touch = _order_touch(service, {"sweep": "begin"})
    told = 0
    try:
        while (at := touch.sweep) is not None and at.under_way:
            if at.point != told and not as_json:
                console.print(f"{at.point} of {at.points}: {at.S_ref:.4g} N·m/rad")
            told = at.point
            time.sleep(_LOOK_S)
            touch = _order_touch(service, {})  # a script that commands nothing for long holds control no longer
    except KeyboardInterrupt:
        _order_touch(service, {"sweep": "stop"})
        raise
    _tell(touch, as_json=as_json)
    if at is not None and at.why:
        fail(f"learning over S ended at {at.point} of {at.points}: {at.why}")


@touch_app.command()
def forget(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Forget what was learned."""
    _tell(_order_touch(_service(data), {"forget": True}), as_json=as_json)


def _service(data: Any) -> RunningService:
    return find_running_service(load_settings(data=data))


def _order_touch(service: RunningService, order: dict[str, Any]) -> "TouchView":
    from backend.schemas import TouchView

    return service.request("PUT", "/touch", order, TouchView)


def _tell(touch: "TouchView", *, as_json: bool) -> None:
    if as_json:
        print_json(touch.model_dump(mode="json"))
        return
    for point in touch.learned:
        console.print(f"{point.S:.2f} N·m/rad reads {point.F:.2f} ± {point.std_N:.2f} N with nothing outside")
    if not touch.learned:
        console.print("nothing is learned")
    armed = touch.contact_N
    console.print(
        f"the joint gives way to contacts from {armed:g} N on" if armed else "the joint gives way to no contact"
    )


# Wall ----------------------------------------------------------------------------------------------
#
# ``sinew wall``: a wall in the way of the simulated joint of the running service, put up and taken
# away in flight.


wall_app = typer.Typer(
    help="A wall in the simulated joint's way, at the running service.", no_args_is_help=True, rich_markup_mode=None
)


@wall_app.command(context_settings={"ignore_unknown_options": True})  # -0.4 is an angle
def up(
    q_wall: Annotated[str, typer.Argument(help="Where it stands, in rad; 15deg is an angle.")],
    below: Annotated[bool, typer.Option("--below", help="It stands below that angle, not above it.")] = False,
    stiffness: Annotated[float, typer.Option(help="In N/m, at the joint pulley.")] = 20000.0,
    damping: Annotated[float, typer.Option(help="In s/m: its force grows by 1 + damping times the speed.")] = 1.0,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Put a wall up, or in the place of the one that stands."""
    side = "below" if below else "above"
    try:
        at = parse_quantity(q_wall, "rad")
    except ValueError:
        fail(f"angle of the wall: {q_wall!r} is no number; give one in rad, or in degrees as 15deg", status=2)
    wall = {"q_wall": at, "side": side, "k_wall": stiffness, "c_wall": damping}
    _order_wall(wall, data, as_json=as_json)


@wall_app.command()
def down(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Take the wall away."""
    _order_wall(None, data, as_json=as_json)


def _order_wall(wall: dict[str, Any] | None, data: Any, *, as_json: bool) -> None:
    from backend.schemas import WallOrder

    stands = find_running_service(load_settings(data=data)).request("PUT", "/wall", {"wall": wall}, WallOrder).wall
    if as_json:
        print_json({"wall": stands and stands.model_dump(mode="json")})
    elif stands is None:
        console.print("no wall stands in the joint's way")
    else:
        console.print(f"a wall stands {stands.side} {format_quantity(stands.q_wall, 'rad', angle_unit())}")
