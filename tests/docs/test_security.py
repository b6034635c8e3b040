"""docs/reference/security.md has the code's numbers, and the tests and attacks that it names are there."""

import re
from pathlib import Path

from backend import logs
from backend.auth import authentication, control_lease, sessions
from backend.faults import Fault
from backend.realtime import heartbeat
from backend.server import connections, security
from backend.settings import Settings
from tests.docs.faults_page import SECTIONS, documented_ms
from tests.soak.attack import kill_service, kill_watchdog, parts, tally

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "security.md").read_text(encoding="utf-8")


def cells(heading: str, columns: int) -> list[list[str]]:
    """Rows of the first table under a heading."""
    under = PAGE.split(f"{heading}\n", 1)[1]
    rows = [line.strip("|").split("|") for line in under.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in row] for row in rows if len(row) == columns]


def test_numbers_are_those_of_the_code() -> None:
    settings = Settings()
    assert dict(cells("### Numbers\n", 2)[:22]) == {
        "largest body of a request": f"{security.MAX_BODY_BYTES // 1024} kB",
        "largest sheet of charts to be made a PDF": f"{security.MAX_SHEET_BYTES // 1024} kB",
        "connections of those who have not shown who they are": f"{connections.GUESTS}",
        "connections in all, as far as descriptors allow": f"{connections.MOST_PLACES}",
        "connections of one browser session": f"{connections.BROWSER_PLACES}",
        "descriptors kept for everything else": f"{connections.RESERVE}",
        "largest head of a request, of a websocket too": f"{security.LONGEST_HEAD // 1024} kB",
        "time for the head of a request, and for its body": f"{connections.HEAD_S:g} s each",
        "time for a sheet of charts, which has to come as fast as other bodies": (
            f"{connections.body_s(security.SHEETS):g} s"
        ),
        "time without a byte taken of an answer": f"{connections.STALL_S:g} s",
        "wrong tokens of one address in a minute before it is slowed": f"{authentication.ATTEMPTS}",
        "sessions that one address may begin in a minute with the token of one role": f"{authentication.SIGN_INS}",
        "frames of a websocket in a second, in the long run and at once": (
            f"{connections.FRAMES_PER_S:g}, {connections.FRAMES_AT_ONCE:g}"
        ),
        "bytes of a websocket in a second, in the long run and at once": (
            f"{connections.BYTES_PER_S / 1024:g} kB, {connections.BYTES_AT_ONCE / 1024:g} kB"
        ),
        "a websocket that sends more than that is closed after": f"{connections.PATIENCE_S:g} s",
        "websockets that a session may open in a second, in the long run and at once": (
            f"{connections.SOCKETS_PER_S:g}, {connections.SOCKETS_AT_ONCE}"
        ),
        "a session ends after so long without a sign of life, while the service runs": (
            f"{sessions.IDLE_S / 86_400:g} days"
        ),
        "lines of one kind in the log; events, which `--log-level info` adds, are not counted": (
            f"{logs.LINES} in {logs.WINDOW_S:g} s"
        ),
        "a page in control is lost after": f"{control_lease.LOST_S:g} s",
        "references are held for it for": f"{control_lease.HOLD_S:g} s",
        "flight records of trips, and as many captures of triggers; the oldest give way": (
            f"{settings.flight_records}, {settings.flight_records_MB} MB"
        ),
        "recordings of this size are reported; a person says what goes": f"{settings.recordings_GB:g} GB",
    }
    assert connections.HEAD_S == connections.BODY_S
    assert authentication.ATTEMPTS_WINDOW_S == 60.0


def test_what_follows_a_death_has_the_times_of_the_faults() -> None:
    outputs = {row[0]: row[1] for row in cells("### What dies, and what follows\n", 3)}
    for dead, fault in {
        "the page in control": Fault.OPERATOR_LOST,
        "the service, killed or hanging": Fault.SERVICE_LOST,
        "the loop, killed or hanging": Fault.WATCHDOG,
        "the card's watchdog": Fault.WATCHDOG_DEAD,
    }.items():
        within = documented_ms(fault)
        assert f"{within} ms" in outputs[dead] or f"{within / 1000:g} s" in outputs[dead], dead
    both = outputs["watchdog and loop at once"]
    assert f"every {1000 * heartbeat.LOOK_S:g} ms" in both
    assert f"for {heartbeat.LAST_RESORT_S:g} s" in both
    assert f"within {kill_watchdog.BOTH_DEAD_S:g} s" in both
    assert f"within {kill_watchdog.BOTH_DEAD_S:g} s of the loop's last write" in SECTIONS[Fault.WATCHDOG_DEAD]


def test_promises_are_those_that_the_attack_measures_by() -> None:
    assert f"within {tally.STOP_S:g} s" in PAGE
    assert f"told within {tally.TOLD_S:g} s" in PAGE
    assert f"at most {kill_service.BEHIND_TICKS / 1000:g} s behind" in PAGE
    assert f"{parts.KILLS_IN_ALL} kills in all" in PAGE


def test_tests_and_attacks_that_it_names_are_there() -> None:
    named = set(re.findall(r"`(tests/[\w/]+\.py)`", PAGE))
    assert len(named) > 20
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
    attacks = {part for row in cells("## How it was tried\n", 3) for part in re.findall(r"`([\w-]+)`", row[2])}
    assert attacks == set(parts.NAMES)
