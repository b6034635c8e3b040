"""A database with many runs that differ in all searchable properties, as functions of their number."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any

from sqlalchemy import text

from backend.models.run import MeasuredFigure, Metrics, RunCriterion
from backend.storage import results, runs, tags
from backend.storage.database import Database
from backend.storage.results import NewResult
from backend.storage.runs import EndState, NewRun, RunKind
from plant.parameters import load_parameters

KINDS = (RunKind.SESSION, RunKind.TRACKING, RunKind.COMPLIANCE, RunKind.ACTUATOR_IDENTIFICATION)
PEOPLE = ("Ana", "Bo", "Chidi", "Dana Öztürk")
ENDS = (EndState.COMPLETED, EndState.COMPLETED, EndState.COMPLETED, EndState.TRIPPED, EndState.STOPPED)
FIGURES = 30
FIRST = datetime(2026, 1, 1, tzinfo=UTC)
_AT_ONCE = 500


@dataclass(frozen=True)
class Made:
    """The properties of run ``number``."""

    number: int

    @property
    def kind(self) -> RunKind:
        return KINDS[self.number % len(KINDS)]

    @property
    def who(self) -> str:
        return PEOPLE[self.number // 7 % len(PEOPLE)]

    @property
    def end(self) -> EndState:
        return ENDS[self.number // 3 % len(ENDS)]

    @property
    def r_j(self) -> float:
        return 0.07 + 0.0005 * (self.number % 20)

    @property
    def overshoot(self) -> float | None:
        return None if self.kind is RunKind.SESSION or self.number % 11 == 0 else float(self.number * 7919 % 1000) / 100

    @property
    def note(self) -> str:
        return f"tendon {self.number % 97} is worn" if self.number % 5 == 0 else ""

    @property
    def tag(self) -> str:
        return "paper" if self.number % 13 == 0 else ""

    @property
    def started(self) -> datetime:
        return FIRST + timedelta(minutes=10 * self.number)

    @cached_property
    def lam_q(self) -> float:
        return 0.3 + 0.01 * (self.number % 40)

    def new(self, parameters: dict[str, Any]) -> NewRun:
        geometry = {**parameters["geometry"], "r_j": {**parameters["geometry"]["r_j"], "value": self.r_j}}
        settings: dict[str, Any] = {"loop": {"lam_q": self.lam_q, "lam_S": 0.6, "b": 0.0, "seed": self.number}}
        if self.kind is not RunKind.SESSION:
            settings["plan"] = {"q_amplitude": 0.01 * (self.number % 100), "controller": "cascade"}
        return NewRun(
            kind=self.kind,
            plant="simulator",
            parameters_name="lab",
            parameters={**parameters, "geometry": geometry},
            who=self.who,
            software="1.0.0",
            settings=settings,
            note=self.note,
        )

    def result(self, run_id: int) -> NewResult:
        first = MeasuredFigure(
            "overshoot_q_percent", "%", "Overshoot of q", "", self.overshoot, "" if self.overshoot else "not seen"
        )
        others = [
            MeasuredFigure(f"figure_{n}", "1", f"Figure {n}", "", float(self.number % (n + 2)))
            for n in range(1, FIGURES)
        ]
        metrics = Metrics(complete=True, played_s=60.0, planned_s=60.0, figures=(first, *others))
        passed = None if self.overshoot is None else self.overshoot < 5.0
        criterion = RunCriterion(
            "overshoot_q", "Overshoot of q", "<", 5.0, self.overshoot, "%", passed, "" if passed else "?"
        )
        return NewResult(run_id, metrics, (criterion,), "1.0.0")


def make_runs(database: Database, count: int) -> dict[int, Made]:
    """Store ``count`` completed runs with results; return them by their numbers in the database."""
    parameters = load_parameters("lab").to_document()
    made: dict[int, Made] = {}
    for first in range(0, count, _AT_ONCE):
        with database.session() as session:
            for number in range(first, min(first + _AT_ONCE, count)):
                one = Made(number)
                run = runs.create(session, one.new(parameters))
                runs.end(session, run.id, one.end)
                if one.kind is not RunKind.SESSION:
                    results.add(session, one.result(run.id))
                if one.tag:
                    tags.add(session, run.id, one.tag)
                at = {"at": one.started.replace(tzinfo=None), "id": run.id}
                session.execute(text("UPDATE run SET started_at = :at, ended_at = :at WHERE id = :id"), at)
                made[run.id] = replace(one)
            session.expire_all()
    return made
