"""A push on the joint by command: on a simulated plant only, and let go of when control is lost."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.auth.authentication import User
from backend.auth.control_lease import LOST_S, POLL_S, ControlLease, ControlReleased
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.experiments.library import experiments_by_name
from backend.experiments.plans import LoopSettings
from backend.realtime.modes import Mode
from backend.sample import INDEX
from backend.schemas.session import Role
from backend.schemas.state import PushRequest
from backend.services.jobs import list_experiment_kinds
from backend.storage import events
from backend.storage.database import Database, open_database
from plant.interface import PlantChoice, PlantKind
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped

ANA = User("Ana", Role.OPERATOR, "a")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


async def in_run(parts: Parts) -> None:
    await parts.actuator.set_mode(Mode.PRETENSION, OPERATOR.name)
    await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
    await parts.actuator.set_mode(Mode.RUN, OPERATOR.name)


def pushed_by(parts: Parts) -> float:
    row = parts.supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX["F_push"]])


def test_a_push_is_let_go_as_soon_as_the_page_is_not_heard(database: Database) -> None:
    async def lost(parts: Parts) -> None:
        await in_run(parts)
        now = 100.0
        control = ControlLease(
            parts.events, parts.actuator.stop_after_operator_loss, parts.actuator.log_control_change, lambda: now
        )
        parts.events.subscribe(ControlReleased, lambda _: parts.actuator.release_push())
        control.take(ANA, is_page=True)
        await parts.actuator.push(PushRequest(F_push=6.0, duration_s=10.0), ANA.name)
        for _ in range(round((LOST_S + 3 * POLL_S) / POLL_S)):
            assert pushed_by(parts) in (0.0, 6.0)
            now += POLL_S
            await control.check()
            await parts.supervisor.advance(0.01)
        assert parts.live_state.mode is Mode.RUN  # long before the soft stop
        for _ in range(100):
            await parts.supervisor.advance(0.01)
            if pushed_by(parts) == 0.0:
                break
        assert pushed_by(parts) == 0.0

    stepped(database, load_parameters("ideal"), lost)
    with database.reading() as session:
        told = [event.text for event in events.find(session)]
    assert "push of 6.0 N for 10.0 s" in told
    assert "push let go: control is lost" in told


def test_what_only_pushes_or_loads_is_offered_where_something_can(database: Database) -> None:
    async def offered(parts: Parts) -> None:
        def why_not(kind: PlantKind) -> dict[str, str]:
            tuning, offers = parts.live_state.tuning.view(0.0), experiments_by_name().values()
            return {one.name: one.why_not for one in list_experiment_kinds(offers, LoopSettings(), tuning, kind)}

        assert set(why_not(PlantKind.VIRTUAL_CARD).values()) == set(why_not(PlantKind.SIMULATOR).values()) == {""}
        for kind in (PlantKind.RIG, PlantKind.REPLAY):
            told = why_not(kind)
            assert "pushes the joint by command" in told["compliance"]
            assert "load its motors' shafts" in told["robustness"]
            assert "no wall can be put in this joint's way" in told["impact"]
            beyond = {"compliance", "robustness", "disturbance_battery", "impact"}
            assert {name for name, why in told.items() if why} == beyond

    stepped(database, load_parameters("ideal"), offered)


def test_a_push_is_bounded_and_refused_where_nothing_can_push(database: Database) -> None:
    async def refused(parts: Parts) -> None:
        with pytest.raises(RequestRejectedError, match="in run and compliance; the mode is off"):
            await parts.actuator.push(PushRequest(F_push=5.0), OPERATOR.name)
        await in_run(parts)
        for push, quantity in (
            (PushRequest(F_push=31.0), "F_push"),
            (PushRequest(F_push=5.0, duration_s=11.0), "duration_s"),
        ):
            with pytest.raises(OutOfRangeError) as refused_value:
                await parts.actuator.push(push, OPERATOR.name)
            assert refused_value.value.quantity == quantity
        assert parts.state().limits.F_push_max == 30.0
        for kind, words in ((PlantKind.REPLAY, "is the replay$"), (PlantKind.RIG, "is the rig: push it by hand$")):
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            with pytest.raises(RequestRejectedError, match=words):
                await parts.actuator.push(PushRequest(F_push=5.0), OPERATOR.name)
        assert parts.state().limits.F_push_max == 0.0
        await parts.supervisor.advance(0.01)
        assert pushed_by(parts) == 0.0

    stepped(database, load_parameters("ideal"), refused)
