"""docs/reference/security.md agrees with the numbers and costs of the code."""

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute, APIRouter

from backend import logs
from backend.api import dependencies, routers
from backend.api.app import create_app
from backend.api.costs import COSTS, Cost
from backend.auth import authentication, control_lease, sessions
from backend.faults import Fault
from backend.realtime import heartbeat
from backend.reports import sheet
from backend.server import connections, security
from backend.settings import Settings
from tests.docs.faults_page import SECTIONS, documented_ms
from tests.soak.attack import kill_service, kill_watchdog, parts, tally

# docs/reference/security.md has the numbers of the code, and the tests and attacks that it names exist.

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "security.md").read_text(encoding="utf-8")


def cells(heading: str, columns: int) -> list[list[str]]:
    """Return the rows of the first table under a heading."""
    under = PAGE.split(f"{heading}\n", 1)[1]
    rows = [line.strip("|").split("|") for line in under.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in row] for row in rows if len(row) == columns]


def test_numbers_on_the_page_equal_those_of_the_code() -> None:
    settings = Settings()
    assert dict(cells("### Numbers\n", 2)[:22]) == {
        "largest body of a request": f"{security.MAX_BODY_BYTES // 1024} kB",
        "largest sheet of charts for a PDF": f"{security.MAX_SHEET_BYTES // 1024} kB",
        "anonymous connections": f"{connections.MAX_ANONYMOUS}",
        "connections in total, as far as descriptors allow": f"{connections.MOST_SLOTS}",
        "connections of one browser session": f"{connections.BROWSER_SLOTS}",
        "descriptors reserved for all other purposes": f"{connections.RESERVE}",
        "largest headers of a request, and of a WebSocket handshake": f"{security.LONGEST_HEAD // 1024} kB",
        "time for the headers of a request, and for its body": f"{connections.HEAD_S:g} s each",
        "time for a sheet of charts, at the same rate as other bodies": (f"{connections.body_s(security.SHEETS):g} s"),
        "time without progress of a response": f"{connections.STALL_S:g} s",
        "wrong tokens of one address per minute before it is slowed": f"{authentication.ATTEMPTS}",
        "sign-ins of one address per minute with the token of one role": f"{authentication.SIGN_INS}",
        "frames of a WebSocket per second, sustained and burst": (
            f"{connections.FRAMES_PER_S:g}, {connections.FRAMES_AT_ONCE:g}"
        ),
        "bytes of a WebSocket per second, sustained and burst": (
            f"{connections.BYTES_PER_S / 1024:g} kB, {connections.BYTES_AT_ONCE / 1024:g} kB"
        ),
        "time until a WebSocket with a higher rate is closed": f"{connections.READ_TIMEOUT_S:g} s",
        "WebSockets opened by a session per second, sustained and burst": (
            f"{connections.SOCKETS_PER_S:g}, {connections.SOCKETS_AT_ONCE}"
        ),
        "idle time after which a session ends, while the service runs": (f"{sessions.IDLE_S / 86_400:g} days"),
        "lines of one kind in the log; events of `--log-level info` are not counted": (
            f"{logs.LINES_PER_WINDOW} in {logs.WINDOW_S:g} s"
        ),
        "time until a page with control is lost": f"{control_lease.LOST_S:g} s",
        "time for which references are held afterwards": f"{control_lease.HOLD_S:g} s",
        "flight records of trips, and the same number of trigger captures; the oldest are deleted": (
            f"{settings.flight_records}, {settings.flight_records_MB} MB"
        ),
        "size from which recordings are reported; a person selects which to delete": f"{settings.recordings_GB:g} GB",
    }
    assert connections.HEAD_S == connections.BODY_S
    assert authentication.ATTEMPTS_WINDOW_S == 60.0


def test_reaction_times_to_failures_equal_those_of_the_faults() -> None:
    outputs = {row[0]: row[1] for row in cells("### Failures and reactions\n", 3)}
    for dead, fault in {
        "the page in control": Fault.OPERATOR_LOST,
        "the service, killed or suspended": Fault.SERVICE_LOST,
        "the control loop, killed or hanging": Fault.WATCHDOG,
        "the card's watchdog": Fault.WATCHDOG_DEAD,
    }.items():
        within = documented_ms(fault)
        assert f"{within} ms" in outputs[dead] or f"{within / 1000:g} s" in outputs[dead], dead
    both = outputs["watchdog and control loop at once"]
    assert f"every {1000 * heartbeat.POLL_S:g} ms" in both
    assert f"for {heartbeat.LAST_RESORT_S:g} s" in both
    assert f"within {kill_watchdog.BOTH_DEAD_S:g} s" in both
    assert f"within {kill_watchdog.BOTH_DEAD_S:g} s of the control loop's last write" in SECTIONS[Fault.WATCHDOG_DEAD]


def test_guarantees_equal_the_limits_of_the_soak_attack() -> None:
    text = " ".join(PAGE.split())
    assert f"within {tally.STOP_S:g} s" in text
    assert f"reported within {tally.REPORTED_S:g} s" in text
    assert f"at most {kill_service.BEHIND_TICKS / 1000:g} s behind" in text
    assert f"{parts.KILLS_IN_ALL} kills in all" in text


def test_tests_and_attacks_named_on_the_page_exist() -> None:
    named = set(re.findall(r"`(tests/[\w/]+\.py)`", PAGE))
    assert len(named) > 20
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
    attacks = {part for row in cells("## Tests of the guarantees\n", 3) for part in re.findall(r"`([\w-]+)`", row[2])}
    assert attacks == set(parts.NAMES)


# Every route declares its cost, and docs/reference/security.md lists the computing routes.

APPLICATION = create_app()
METHODS = ("get", "put", "post", "delete", "patch", "head", "options", "trace")


def described() -> set[str]:
    """Return method and path of each route in the OpenAPI document."""
    paths = APPLICATION.openapi()["paths"]
    return {f"{method.upper()} {path}" for path, item in paths.items() for method in item if method in METHODS}


def calls(dependant: Dependant) -> set[object]:
    return {dependant.call}.union(*(calls(inner) for inner in dependant.dependencies))


def who(route: APIRoute) -> str:
    """Return who may send the request, from the dependencies of the route."""
    needed = calls(route.dependant)
    if dependencies._get_actuator_operator in needed:
        return "holder of the control lease"
    if dependencies._get_operator in needed:
        return "operators"
    return (
        "viewers"
        if dependencies._get_signed_in_user in needed or dependencies._get_stop_requester in needed
        else "anybody"
    )


def routes() -> Iterator[APIRoute]:
    """Yield each route of the interface."""
    for found in iter_modules(routers.__path__):
        module = import_module(f"{routers.__name__}.{found.name}")
        for router in (value for value in vars(module).values() if isinstance(value, APIRouter)):
            yield from (route for route in router.routes if isinstance(route, APIRoute))


def asking() -> Iterator[tuple[str, str]]:
    """Yield each route of the interface with the people who may use it."""
    for route in routes():
        yield from ((f"{method} {route.path}", who(route)) for method in route.methods or ())


def documented(name: str, cost: Cost, asks: str) -> list[str]:
    time = "" if cost.limits.limit_s is None else f"{cost.limits.limit_s:g} s"
    memory = "" if cost.limits.memory_bytes is None else f"{cost.limits.memory_bytes / 1e9:g} GB"
    return [f"`{name}`", asks, cost.where, time, memory, cost.at_a_time]


def test_every_route_declares_its_cost() -> None:
    assert described() == set(COSTS)


def test_the_page_lists_the_computing_routes_with_their_limits() -> None:
    asks = dict(asking())
    expected = [documented(name, cost, asks[name]) for name, cost in COSTS.items() if cost.is_computation]
    assert cells("### Cost of requests\n", 6) == expected


def test_routes_that_evaluate_texts_have_time_memory_and_concurrency_limits() -> None:
    for name in (
        "POST /api/experiments/check",
        "POST /api/experiments/own",
        "GET /api/runs/{id}/planned",
        "POST /api/chart-sheet.pdf",
        "POST /api/experiments/dry-run",
    ):
        cost = COSTS[name]
        assert cost.limits.limit_s is not None, name
        assert cost.limits.memory_bytes is not None, name
        assert "per person" in cost.at_a_time, name


def test_the_page_states_the_limits_of_a_chart_sheet() -> None:
    text = " ".join(PAGE.split())
    for bound in (
        f"{sheet.MOST_ELEMENTS} elements",
        f"{sheet.DEEPEST} nested",
        f"{sheet.MOST_TEXTS} texts",
        f"{sheet.MOST_LETTERS_OF_A_TEXT} characters of a text",
        f"{sheet.MOST_LETTERS} characters in",
        f"{sheet.MOST_OF_A_PATH} characters of a path",
        f"{sheet.MOST_OF_A_TITLE} characters of the title",
    ):
        assert bound in text, bound
