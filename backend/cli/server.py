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
MIN_FREE_BYTES = 2 * 10**9
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
    text = messages.checks_need_attention(open_points=open_points, checks=len(findings))
    console.print(text if open_points else messages.all_checks_passed(), highlight=False)


def _check_real_time() -> Iterator[DoctorFinding]:
    from backend.realtime import request_real_time

    granted = request_real_time()
    refusals = "; ".join(granted.refusals)
    priority = f"SCHED_FIFO {granted.priority}" if granted.priority else "standard"
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
    found = messages.pacing(
        median_us=late_us[TICKS // 2],
        late_us=late_us[int(0.99 * TICKS)],
        missed=pacer.overruns,
        resolution_ns=resolution_ns,
    )
    return DoctorFinding("1 ms period", found, messages.reserve_core() if pacer.overruns > TICKS // 100 else "")


def _check_cores() -> DoctorFinding:
    cores = len(os.sched_getaffinity(0))
    return DoctorFinding("processor cores", str(cores), "" if cores >= 2 else messages.two_cores_needed())


def _check_card() -> DoctorFinding:
    from plant import PlantChoice, PlantError, PlantKind, require_available

    try:
        require_available(PlantChoice(PlantKind.RIG))
        from plant import read_driver_version

        return DoctorFinding("DAQ card", read_driver_version())
    except PlantError as error:
        found, _, remedy = str(error).partition(": ")
        return DoctorFinding("DAQ card", messages.no_card(reason=found), messages.card_only_for_rig(remedy=remedy))


def _find_browser() -> DoctorFinding:
    found = next((name for name in _BROWSERS if shutil.which(name)), None)
    return DoctorFinding("browser", found or messages.no_browser(), "" if found else messages.use_other_machine())


def _check_pages() -> DoctorFinding:
    built = (Path(__file__).parents[1] / "static" / "index.html").is_file()
    return DoctorFinding("dashboard pages", "built" if built else "not built", "" if built else "make frontend")


def _check_disk(data: Path) -> DoctorFinding:
    folder = data.resolve()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if not os.access(folder, os.W_OK):
        found = messages.folder_not_writable(data=data)
        return DoctorFinding("data folder", found, messages.choose_other_folder())
    remedy = "" if free >= MIN_FREE_BYTES else messages.free_some_space()
    return DoctorFinding("data folder", messages.free_space(data=data, free_bytes=free), remedy)


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
        fail(messages.foxglove_not_installed())
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
        fail(messages.port_not_available(port=port, reason=error.strerror))
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
    enough = messages.nothing_to_delete(total_bytes=found.total_bytes, limit_GB=settings.recordings_GB)
    console.print(found.describe or enough, highlight=False, markup=False)
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
        text = messages.command_to_delete(run_ids=[run.run_id for run in found.may_go])
        console.print(text, highlight=False, markup=False)


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
        console.print(messages.schema_revision(revision=read_revision(database.engine)), highlight=False)


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
            text = messages.database_copied(file=target.name)
            events.add(session, events.EventKind.BACKUP, text, who=current_user())
    console.print(messages.wrote(files=str(target)), highlight=False, markup=False)


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
    console.print(messages.restored(file=file), highlight=False, markup=False)


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
        fail(messages.station_name_missing(), status=2)
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
        console.print(messages.runs_assigned(station=station, runs=run_count))


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
        console.print(messages.not_compared(part=left_out), highlight=False, markup=False, soft_wrap=True)
    if problems:
        fail("; ".join(problems))
    if not as_json:
        console.print(messages.database_consistent(recordings=checked.recordings))


# sinew serve and link ------------------------------------------------------------------------------


NOTICE_DELAY_S = 3.0


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

    notice = threading.Timer(NOTICE_DELAY_S, print, (messages.service_is_starting(),), {"flush": True})
    notice.daemon = True

    def announce(address: str, tokens: "Tokens | None") -> None:
        notice.cancel()
        addresses = [address, *([settings.public_url] if settings.public_url else [])]
        if tokens is not None and not shows_link:
            print(messages.running_without_link(addresses=_strip_slashes(addresses), data=settings.data), flush=True)
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
        print(messages.running_without_sign_in(address=base), flush=True)
        return
    print(messages.sign_in_link(address=base, token=tokens.operator), flush=True)
    print(messages.view_only_link(address=base, token=tokens.viewer), flush=True)
    for other in others:
        print(messages.link_on_this_machine(address=other, token=tokens.operator), flush=True)


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
        fail(messages.data_folder_missing(data=settings.data))
    roles = list(Role) if role is TokenOwner.BOTH else [Role(role)]
    replace_tokens(settings.data, roles)
    for one in roles:
        file = settings.data / TOKEN_FILES[one]
        print(messages.new_token(role=one, token=file.read_text().strip(), file=file))


# sinew touch ---------------------------------------------------------------------------------------


touch_app = typer.Typer(
    help="Bias of the estimated external force, in the running service: show, calibrate, clear.",
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
                text = messages.bias_point(point=progress.point, points=progress.points, S_ref=progress.S_ref)
                console.print(text)
            printed_point = progress.point
            time.sleep(_POLL_S)
            touch = _send_touch(service, {})  # a command, because a script without commands loses the control lease
    except KeyboardInterrupt:
        _send_touch(service, {"sweep": "stop"})
        raise
    _print_touch(touch, as_json=as_json)
    if progress is not None and progress.why:
        fail(messages.bias_calibration_ended(point=progress.point, points=progress.points, reason=progress.why))


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
        console.print(messages.calibrated_bias(S=point.S, F=point.F, std_N=point.std_N))
    if not touch.learned:
        console.print(messages.no_bias())
    armed = touch.contact_N
    console.print(messages.reaction_armed(threshold_N=armed) if armed else messages.reaction_disabled())


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
        fail(messages.not_an_angle(value=q_wall), status=2)
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
        console.print(messages.no_obstacle())
    else:
        angle = format_quantity(present.q_wall, "rad", angle_unit())
        console.print(messages.obstacle(side=present.side, angle=angle))
