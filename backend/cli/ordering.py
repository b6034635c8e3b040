"""What ``experiment`` and ``identify`` share: settings from words, a headless run, its result on the screen."""

import asyncio
import getpass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backend.cli.output import fail, meter, out, print_json, print_table
from backend.cli.place import database_of
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.experiments.runner import Order, Outcome


def values_of(words: list[str]) -> dict[str, object]:
    """Return named values from ``key=value`` words; one that is not of that form ends the command."""
    values: dict[str, object] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            fail(f"--set {word}: write key=value, for example --set lam_q=0.6", status=2)
        values[name.strip()] = value.strip()
    return values


def run_headless(settings: Settings, order: "Order", folder: Path | None, *, as_json: bool) -> None:
    """Play an order on the simulator, store it, and show what came of it; exit 1 when it did not complete."""
    from backend.experiments.headless_station import headless_station
    from backend.experiments.runner import run_experiment
    from backend.reports.files import metrics_document, write_files
    from backend.reports.source import load_source
    from plant.parameters import load_parameters

    if settings.plant != "simulator":
        fail("headless runs are simulated; on the rig start them from the dashboard of sinew serve")
    parameters = load_parameters(settings.params)
    duration_s = order.plan.program().duration_s
    with database_of(settings) as database:
        with (
            headless_station(database, parameters, order.loop_settings) as station,
            meter(duration_s, hidden=as_json) as progress,
        ):
            outcome = asyncio.run(run_experiment(station, order, progress))
        written = write_files(database, outcome.run.id, folder) if folder else ()
        document = metrics_document(load_source(database, outcome.run.id))
        if as_json:
            print_json({**document, "files": [str(path) for path in written]})
        else:
            _show(document)
            for path in written:
                out.print(f"wrote {path}", highlight=False, markup=False)
    _end_status(outcome)


def current_user() -> str:
    """Return who runs the command, for the record."""
    return getpass.getuser()


def _show(document: dict[str, Any]) -> None:
    out.print(f"run {document['run']}, {document['kind']}: {document['end_state']}", highlight=False, style="bold")
    units = document["units"]
    rows = [(name, value, units[name]) for name, value in document["metrics"].items()]
    if rows:
        print_table(("figure", "value", "unit"), rows)
    judged = {True: "passed", False: "FAILED", None: "no figure"}
    criteria = [
        (item["title"], item["figure"], f"{item['relation']} {item['bound']:g}", item["unit"], judged[item["passed"]])
        for item in document["criteria"]
    ]
    if criteria:
        print_table(("criterion", "value", "bound", "unit", "verdict"), criteria)
    if document["identification"]:
        out.print(document["identification"]["verdict"], highlight=False, markup=False)


def _end_status(outcome: "Outcome") -> None:
    from backend.storage.runs import EndState

    if outcome.run.end_state != EndState.COMPLETED:
        fail(f"run {outcome.run.id} {outcome.run.end_state}: {outcome.run.end_detail or 'no further reason known'}")
    if outcome.evaluation.problem:
        fail(f"run {outcome.run.id}: {outcome.evaluation.problem}", status=2)
