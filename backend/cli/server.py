"""Commands about service, database and machine.

``sinew serve``, ``link``, ``db``, ``token``, ``doctor``, ``foxglove``, ``touch`` and ``wall``.
"""

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

from backend.cli import messages
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
from backend.messages import no_service
from backend.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from backend.auth import Tokens
    from backend.schemas import TouchView
    from backend.settings import Settings


# sinew doctor --------------------------------------------------------------------------------------


TICKS = 1000
MIN_FREE_BYTES = 2 * 1024**3
"""Disk space for a day of recordings, at 80 MB per hour."""

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")


@dataclass(frozen=True)
class DoctorFinding:
    """Result of one check; ``remedy`` is empty if there is nothing to improve."""

    what: str
    found: str
    remedy: str = ""


def doctor(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Check this machine for a 1 kHz control loop, with a remedy for each weakness."""
    settings = load_settings(data=data)
    findings = [
        *_check_real_time(),
        _check_pacing(),
        _check_cores(),
        _check_card(),
        _find_browser(),
        _check_pages(),
        _check_disk(settings.data),
    ]
    if as_json:
        print_json([asdict(finding) for finding in findings])
        return
    print_table(("check", "result", "remedy"), [(f.what, f.found, f.remedy) for f in findings])
    open_points = sum(bool(finding.remedy) for finding in findings)
    console.print(
        f"{open_points} of {len(findings)} checks need attention" if open_points else "all checks passed",
        highlight=False,
    )


def _check_real_time() -> Iterator[DoctorFinding]:
    from backend.realtime import request_real_time

    granted = request_real_time()
    refusals = "; ".join(granted.refusals)
    priority = f"SCHED_FIFO {granted.priority}" if granted.priority else "ordinary"
    yield DoctorFinding(
        "scheduling", priority, "" if granted.priority else _find_refusal("FIFO", granted.refusals) or refusals
    )
    locked = "locked" if granted.memory_locked else "not locked"
    yield DoctorFinding(
        "memory", locked, "" if granted.memory_locked else _find_refusal("memory", granted.refusals) or refusals
    )
    yield DoctorFinding("timer slack", f"{granted.timer_slack_ns} ns")


def _find_refusal(word: str, refusals: tuple[str, ...]) -> str:
    """Return the first refusal that contains a word, or an empty text."""
    return next((refusal for refusal in refusals if word in refusal), "")


def _check_pacing() -> DoctorFinding:
    """Pace 1 ms ticks for a second, without computing anything."""
    from backend.realtime import Pacer
    from plant import T_s

    pacer = Pacer(T_s)
    late_us = sorted(1e6 * pacer.wait() for _ in range(TICKS))
    resolution_ns = 1e9 * time.get_clock_info("monotonic").resolution
    found = f"lateness {late_us[TICKS // 2]:.0f} µs (median), {late_us[int(0.99 * TICKS)]:.0f} µs (99 %)"
    missed = f", {pacer.overruns} deadlines missed" if pacer.overruns else ""
    remedy = "close other programs, or reserve a core for the control loop" if pacer.overruns > TICKS // 100 else ""
    return DoctorFinding("1 ms period", f"{found}{missed}; clock {resolution_ns:.0f} ns", remedy)


def _check_cores() -> DoctorFinding:
    cores = len(os.sched_getaffinity(0))
    return DoctorFinding(
        "processor cores", str(cores), "" if cores >= 2 else "the control loop and the dashboard need one core each"
    )


def _check_card() -> DoctorFinding:
    from plant import PlantChoice, PlantError, PlantKind, require_available

    try:
        require_available(PlantChoice(PlantKind.RIG))
        from plant import read_driver_version

        return DoctorFinding("DAQ card", read_driver_version())
    except PlantError as error:
        found, _, remedy = str(error).partition(": ")
        return DoctorFinding("DAQ card", f"none: {found}", f"the simulator needs none; for a rig {remedy}")


def _find_browser() -> DoctorFinding:
    found = next((name for name in _BROWSERS if shutil.which(name)), None)
    return DoctorFinding(
        "browser", found or "none on this machine", "" if found else "open the dashboard on another machine"
    )


def _check_pages() -> DoctorFinding:
    built = (Path(__file__).parents[1] / "static" / "index.html").is_file()
    return DoctorFinding("dashboard pages", "built" if built else "not built", "" if built else "make frontend")


def _check_disk(data: Path) -> DoctorFinding:
    folder = data.resolve()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if not os.access(folder, os.W_OK):
        return DoctorFinding(
            "data folder", f"{data} is not writable", "choose another folder with --data, or change its owner"
        )
    remedy = "" if free >= MIN_FREE_BYTES else "free some space: recordings take 80 MB per hour"
    return DoctorFinding("data folder", f"{data}: {free / 1024**3:.1f} GB free", remedy)


# sinew foxglove ------------------------------------------------------------------------------------


PORT = 8765
"""Default port of Foxglove."""


def foxglove(
    data: DataFolder = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on, 0 for any free port.")] = PORT,
) -> None:
    """Serve the live stream to Foxglove or Lichtblick until interrupted."""
    from backend.auth import load_tokens
    from backend.data_folder import read_service_address

    try:
        from backend.foxglove import LiveSource, OtherVersionError, serve_foxglove
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        fail("this command requires the extra foxglove: pip install 'sinew[foxglove]'")
    from backend.workers import BACKGROUND_NICENESS

    os.setpriority(os.PRIO_PROCESS, 0, BACKGROUND_NICENESS)  # below the control loop and the service
    settings = load_settings(data=data)
    if read_service_address(settings.data) is None:
        fail(no_service(folder=settings.data))
    local_token = secrets.token_urlsafe(24)
    """Token if the service requires none: any web page may open a connection to a port of this machine."""

    def find_source() -> "LiveSource | None":
        address = read_service_address(settings.data)
        if address is None:
            return None
        return LiveSource(address, load_tokens(settings.data).viewer if settings.require_token else "")

    def print_line(text: str) -> None:
        print(text, flush=True)

    try:
        asyncio.run(serve_foxglove(find_source, lambda source: source.token or local_token, port, print_line))
    except OSError as error:
        fail(f"port {port} of this machine is not available: {error.strerror}; choose another with --port")
    except OtherVersionError as error:
        fail(str(error))


# sinew db recordings -------------------------------------------------------------------------------


def recordings(
    delete: Annotated[
        list[int] | None,
        typer.Option("--delete", help="Listed run whose samples to delete; repeatable."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Show the size of the recordings and the runs whose samples may be deleted.

    --delete deletes the samples of a run.
    """
    from backend.recording import NotRemovableError, RetentionRule, delete_recordings, summarize_retention

    settings = load_settings(data=data)
    rule = RetentionRule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days)
    with open_configured_database(settings) as database:
        try:
            found = (
                delete_recordings(database, rule, delete, current_user())
                if delete
                else summarize_retention(database, rule)
            )
        except NotRemovableError as error:
            fail(str(error), status=2)
    if as_json:
        may_go = [{"run": run.run_id, "started": run.started_at, "size_bytes": run.size_bytes} for run in found.may_go]
        print_json({"total_bytes": found.total_bytes, "limit_bytes": rule.max_bytes, "may_go": may_go})
        return
    total, limit = f"{found.total_bytes / 1e9:.3f} GB", f"{settings.recordings_GB:g} GB"
    console.print(
        found.describe or f"recordings use {total}, limit {limit}: nothing needs to be deleted",
        highlight=False,
        markup=False,
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


# sinew db ------------------------------------------------------------------------------------------


database_app = typer.Typer(
    help="The database: migrate, back up, restore, check.", no_args_is_help=True, rich_markup_mode=None
)

database_app.command()(recordings)


@database_app.command()
def upgrade(data: DataFolder = None) -> None:
    """Migrate to the newest schema.

    An SQLite database is first copied to DATA/backups.
    """
    from backend.storage import read_revision

    with open_configured_database(load_settings(data=data)) as database:
        console.print(f"schema {read_revision(database.engine)}", highlight=False)


@database_app.command()
def backup(
    file: Annotated[Path | None, typer.Argument(help="New file to write. [DATA/backups/TIME.db]")] = None,
    data: DataFolder = None,
) -> None:
    """Copy the database, even while a service uses it, and log the copy."""
    from backend.storage import backup_database, events, next_backup_path

    settings = load_settings(data=data)
    target = file or next_backup_path(settings.data)
    with open_configured_database(settings) as database:
        backup_database(database.engine, target)
        with database.session() as session:
            events.add(session, events.EventKind.BACKUP, f"database copied to {target.name}", who=current_user())
    console.print(f"wrote {target}", highlight=False, markup=False)


@database_app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="Backup to restore.")],
    data: DataFolder = None,
) -> None:
    """Restore a backup, unless a service uses the folder.

    The previous database is kept in the data folder as sinew.before-restore-TIME.db.
    """
    from backend.data_folder import lock_for_service
    from backend.storage import FILE_NAME, BackupError, restore_database

    settings = load_settings(data=data)
    if settings.database_url is not None:
        raise BackupError(messages.database_is_on_a_server())
    with lock_for_service(settings.data):
        target = (settings.data / FILE_NAME).resolve()
        if target.exists() and (holder := _describe_claim_holder(settings)):
            raise BackupError(messages.database_in_use(holder=holder, file=str(target)))
        restore_database(file, target)
    console.print(f"restored {file}", highlight=False, markup=False)


def _describe_claim_holder(settings: "Settings") -> str:
    """Return a text with the service that has claimed the database.

    The text is empty if none has, or the file is unreadable.
    """
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
    station: Annotated[str, typer.Argument(help="Name of the station.")],
    data: DataFolder = None,
) -> None:
    """Assign all records without a station to a station, unless a service uses the database."""
    from backend.data_folder import lock_for_service
    from backend.errors import check_station_name
    from backend.storage import HeldClaim, HeldStation, assign_unowned_rows

    if not check_station_name(station):
        fail("the name of the station is missing", status=2)
    settings = load_settings(data=data, station="")
    with lock_for_service(settings.data), open_configured_database(settings, owns_folder=True) as database:
        station_lock = HeldStation(database.engine, "")
        claim = HeldClaim(database.engine, "")
        try:
            with database.session() as session:
                run_count = assign_unowned_rows(session, station)
        finally:
            claim.release()
            station_lock.release()
    with open_configured_database(settings):  # opening it rebuilds the search index
        console.print(f"runs assigned to {station}: {run_count}; start its service with --station {station}")


@database_app.command()
def check(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Check the integrity of the database and of all recorded samples.

    Exit 1 on errors. The check reads every sample, which takes some seconds per hour of recordings.
    """
    from backend.recording import RecordingsCheck, check_recordings
    from backend.storage import find_database_errors

    with open_configured_database(load_settings(data=data), read_only=True) as database:
        problems = find_database_errors(database.engine)
        # samples read from a damaged file would prove nothing
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
        console.print(f"the database is consistent; intact recordings: {checked.recordings}")


# sinew serve and link ------------------------------------------------------------------------------


NOTICE_DELAY_S = 3.0
STARTING_NOTICE = "Sinew is starting. The first start after an installation compiles code, which takes up to a minute."


def serve(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free port. [8000]")] = None,
    public_url: Annotated[
        str | None,
        typer.Option(help="Address of the page behind a reverse proxy, such as https://rig.lab/sinew/."),
    ] = None,
    trusted_proxy: Annotated[
        list[str] | None,
        typer.Option(help="Address or network of the reverse proxy; repeatable. [127.0.0.0/8 and ::1]"),
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
    show_link: Annotated[
        bool | None,
        typer.Option(
            "--show-link/--hide-link", help="Print the sign-in link. [only on a terminal, to keep it out of logs]"
        ),
    ] = None,
    log_level: Annotated[
        str | None,
        typer.Option(help="Minimum log level: debug, info, warning or error. [warning]"),
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

    notice = threading.Timer(NOTICE_DELAY_S, print, (STARTING_NOTICE,), {"flush": True})
    notice.daemon = True

    def announce(address: str, tokens: "Tokens | None") -> None:
        notice.cancel()
        addresses = [address, *([settings.public_url] if settings.public_url else [])]
        if tokens is not None and not shows_link:
            joined = " and ".join(_strip_slashes(addresses))
            print(f"Sinew is running at {joined}. For the sign-in link: sinew link --data {settings.data}", flush=True)
        else:
            _print_links(addresses, tokens)
        if served := describe_served_addresses(settings.host):
            print(served, flush=True)

    restore_garbage_collection()
    notice.start()
    try:
        run_service(settings, announce)
    finally:
        notice.cancel()


def link(data: DataFolder = None) -> None:
    """Print the sign-in links of the service that uses the data folder.

    Exit 1 without a running service.
    """
    from backend.auth import load_tokens
    from backend.data_folder import describe_missing_address, read_service_addresses

    settings = load_settings(data=data)
    addresses = read_service_addresses(settings.data)
    if not addresses:
        fail(describe_missing_address(settings.data))
    _print_links(addresses, load_tokens(settings.data) if settings.require_token else None)


def _print_links(addresses: Sequence[str], tokens: "Tokens | None") -> None:
    """Print sign-in links for the last address and for the others.

    The last one is the public address, if there is one.
    """
    *others, base = _strip_slashes(addresses)
    if tokens is None:
        print(f"Sinew is running at {base} without sign-in", flush=True)
        return
    print(f"Sinew is running. Sign in: {base}/?token={tokens.operator}", flush=True)
    print(f"View only:                {base}/?token={tokens.viewer}", flush=True)
    for other in others:
        print(f"On this machine:          {other}/?token={tokens.operator}", flush=True)


def _strip_slashes(addresses: Sequence[str]) -> list[str]:
    return [address.rstrip("/") for address in addresses]


# sinew token ---------------------------------------------------------------------------------------


token_app = typer.Typer(help="Tokens for sign-in: replace.", no_args_is_help=True, rich_markup_mode=None)


class TokenOwner(StrEnum):
    """Role, or both roles, whose token to replace."""

    OPERATOR = "operator"
    VIEWER = "viewer"
    BOTH = "both"


@token_app.callback()
def _group() -> None:
    """Make typer keep ``rotate`` as a subcommand although it is the only one."""


@token_app.command()
def rotate(
    role: Annotated[TokenOwner, typer.Option(help="Role whose token to replace.")] = TokenOwner.BOTH,
    data: DataFolder = None,
) -> None:
    """Replace tokens.

    A running service ends all sessions of the old tokens within a second.
    """
    from backend.auth import TOKEN_FILES, replace_tokens
    from backend.schemas import Role

    settings = load_settings(data=data)
    if not settings.data.is_dir():
        fail(f"the data folder {settings.data} does not exist: choose one with --data")
    roles = list(Role) if role is TokenOwner.BOTH else [Role(role)]
    replace_tokens(settings.data, roles)
    for one in roles:
        file = settings.data / TOKEN_FILES[one]
        print(f"{one}: /?token={file.read_text().strip()}  (stored in {file})")


# sinew touch ---------------------------------------------------------------------------------------


touch_app = typer.Typer(
    help="Bias of the external force estimated by the running service: show, calibrate, clear.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
_POLL_S = 0.5


@touch_app.command()
def show(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Print the calibrated bias and the threshold of the contact reaction."""
    from backend.schemas import State

    _print_touch(_find_service(data).request("GET", "/state", None, State).touch, as_json=as_json)


@touch_app.command()
def learn(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Calibrate the bias at the current stiffness, in mode run.

    Do not touch the joint during the calibration.
    """
    _print_touch(_send_touch(_find_service(data), {"learn": True}), as_json=as_json)


@touch_app.command()
def sweep(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Calibrate the bias over the stiffness range, in mode run; Ctrl+C stops it.

    Do not touch the joint during the calibration.
    """
    service = _find_service(data)
    touch = _send_touch(service, {"sweep": "begin"})
    printed_point = 0
    try:
        while (progress := touch.sweep) is not None and progress.under_way:
            if progress.point != printed_point and not as_json:
                console.print(f"{progress.point} of {progress.points}: {progress.S_ref:.4g} N·m/rad")
            printed_point = progress.point
            time.sleep(_POLL_S)
            touch = _send_touch(service, {})  # a command, because a script without commands loses the control lease
    except KeyboardInterrupt:
        _send_touch(service, {"sweep": "stop"})
        raise
    _print_touch(touch, as_json=as_json)
    if progress is not None and progress.why:
        fail(f"the bias calibration over S ended at point {progress.point} of {progress.points}: {progress.why}")


@touch_app.command()
def forget(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Clear the calibrated bias."""
    _print_touch(_send_touch(_find_service(data), {"forget": True}), as_json=as_json)


def _find_service(data: Any) -> RunningService:
    return find_running_service(load_settings(data=data))


def _send_touch(service: RunningService, changes: dict[str, Any]) -> "TouchView":
    from backend.schemas import TouchView

    return service.request("PUT", "/touch", changes, TouchView)


def _print_touch(touch: "TouchView", *, as_json: bool) -> None:
    if as_json:
        print_json(touch.model_dump(mode="json"))
        return
    for point in touch.learned:
        console.print(f"{point.S:.2f} N·m/rad: estimate {point.F:.2f} ± {point.std_N:.2f} N without external force")
    if not touch.learned:
        console.print("no bias calibrated")
    armed = touch.contact_N
    console.print(f"contact reaction armed at {armed:g} N" if armed else "contact reaction disabled")


# sinew wall ----------------------------------------------------------------------------------------


wall_app = typer.Typer(
    help="Simulated obstacle that blocks the joint: add, remove.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@wall_app.command(context_settings={"ignore_unknown_options": True})  # -0.4 is an angle
def up(
    q_wall: Annotated[str, typer.Argument(help="Angle of the obstacle in rad, or as 15deg.")],
    below: Annotated[bool, typer.Option("--below", help="Block motion below this angle instead of above it.")] = False,
    stiffness: Annotated[float, typer.Option(help="Stiffness [N/m] at the joint pulley.")] = 20000.0,
    damping: Annotated[
        float, typer.Option(help="Damping [s/m]; it multiplies the force by 1 + damping × speed.")
    ] = 1.0,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Add an obstacle, or replace the existing one."""
    side = "below" if below else "above"
    try:
        at = parse_quantity(q_wall, "rad")
    except ValueError:
        fail(f"angle of the obstacle: {q_wall!r} is not a number; specify it in rad, or in degrees as 15deg", status=2)
    wall = {"q_wall": at, "side": side, "k_wall": stiffness, "c_wall": damping}
    _send_wall(wall, data, as_json=as_json)


@wall_app.command()
def down(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Remove the obstacle."""
    _send_wall(None, data, as_json=as_json)


def _send_wall(wall: dict[str, Any] | None, data: Any, *, as_json: bool) -> None:
    from backend.schemas import WallOrder

    present = find_running_service(load_settings(data=data)).request("PUT", "/wall", {"wall": wall}, WallOrder).wall
    if as_json:
        print_json({"wall": present and present.model_dump(mode="json")})
    elif present is None:
        console.print("no obstacle")
    else:
        console.print(f"obstacle {present.side} {format_quantity(present.q_wall, 'rad', angle_unit())}")
