"""The sweep that calibrates the bias: its ends, refusals and failures."""

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from backend.errors import RequestRejectedError
from backend.execution.progress import RunPhase
from backend.faults import Fault
from backend.realtime import commands
from backend.realtime.modes import Mode
from backend.realtime.supervisor import LoopExited
from backend.sample import INDEX
from backend.schemas.state import PushRequest, SweepView, TaskView, TouchOrder
from backend.services import contact
from backend.storage import events
from backend.storage.database import Database, open_database
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from tests.api.conftest import problem
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.api.test_touch import at_rest
from tests.cli.test_report import sinew
from tests.e2e.service import Service

WHO = OPERATOR.name
BEGIN, STOP = TouchOrder(sweep="begin"), TouchOrder(sweep="stop")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def sweep_of(parts: Parts) -> SweepView:
    sweep = parts.state().touch.sweep
    assert sweep is not None
    return sweep


async def until(parts: Parts, reached: Callable[[], bool] = lambda: False) -> SweepView:
    """Let it go on until it has ended, or ``reached()``; return how it stands."""
    while sweep_of(parts).under_way and not reached():
        await asyncio.sleep(0)
    return sweep_of(parts)


async def learned_two(parts: Parts) -> None:
    await at_rest(parts)
    await parts.actuator.contact.apply(BEGIN, WHO)
    await until(parts, lambda: sweep_of(parts).point == 3)
    assert sweep_of(parts).S_ref == pytest.approx(11.5)


def reference(parts: Parts) -> tuple[float, float | None]:
    references = parts.state().references
    return references.q_ref, references.S_ref


def test_stop_restores_S_ref(database: Database) -> None:
    async def stop(parts: Parts) -> None:
        with pytest.raises(RequestRejectedError, match="nothing to stop"):
            await parts.actuator.contact.apply(STOP, WHO)
        await learned_two(parts)
        told = await parts.actuator.contact.apply(STOP, WHO)
        assert told.sweep == SweepView(under_way=False, point=3, points=5, S_ref=11.5, why="it was stopped")
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.0))
        assert len(parts.state().touch.learned) == 2
        assert (await parts.actuator.contact.apply(TouchOrder(forget=True), WHO)).sweep is None

    stepped(database, load_parameters("lab"), stop)
    with database.reading() as session:
        told = [(event.text, event.who) for event in events.find(session)]
    assert ("learning over S ended at point 3 of 5, 11.5 N·m/rad: it was stopped", WHO) in told


def test_other_motion_aborts_the_sweep_and_keeps_its_points(database: Database) -> None:
    async def ended(parts: Parts) -> None:
        async def by_reference() -> None:
            await parts.actuator.set_references(-0.1, 9.0, WHO)

        async def by_mode() -> None:
            await parts.actuator.set_mode(Mode.COMPLIANCE, WHO)

        async def by_control() -> None:
            parts.actuator.release_push()

        async def by_push() -> None:
            await parts.actuator.push(PushRequest(F_push=1.0, duration_s=0.3), WHO)

        async def by_stop() -> None:
            await parts.supervisor.send(commands.Stop())

        for end, why, then in (
            (by_reference, "other references were set", (-0.1, 9.0)),
            (by_control, "does not hold control any more", (0.2, 11.5)),
            (by_push, "the joint is pushed", (0.2, 10.0)),
            (by_mode, "the mode is compliance now", None),
            (by_stop, "the mode is tripped now", None),
        ):
            await learned_two(parts)
            known = parts.state().touch.learned
            assert len(known) == 2
            await end()
            sweep = await until(parts)
            assert why in sweep.why
            assert (sweep.under_way, sweep.point) == (False, 3)
            assert parts.state().touch.learned == known
            await parts.supervisor.advance(0.5)
            if then is not None:
                assert reference(parts) == pytest.approx(then)
            if parts.live_state.mode is not Mode.TRIPPED:
                await parts.actuator.contact.apply(TouchOrder(forget=True), WHO)
                await parts.actuator.set_mode(Mode.PRETENSION, WHO)
                await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        assert parts.live_state.fault is Fault.STOP_PRESSED
        assert parts.actuator.contact.sweep.problem == ""

    stepped(database, load_parameters("lab"), ended)


def test_sweep_is_refused_with_a_reason_and_excludes_other_calibration(database: Database) -> None:
    async def refused(parts: Parts) -> None:
        async def why(order: TouchOrder = BEGIN) -> str:
            with pytest.raises(RequestRejectedError) as told:
                await parts.actuator.contact.apply(order, WHO)
            return str(told.value)

        assert "held in run, and the mode is off" in await why()
        await at_rest(parts)
        assert "ordered alone" in await why(TouchOrder(sweep="begin", learn=True))
        parts.live_state.task = TaskView(
            kind="tracking", run=4, elapsed_s=1.0, duration_s=9.0, phase=RunPhase.STARTING, part=None, number=1
        )
        assert "run 4, tracking, is under way" in await why()
        parts.live_state.task = None
        await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=2.0), WHO)
        assert "gives way to contacts" in await why()
        await parts.actuator.contact.apply(TouchOrder(contact_N=0.0), WHO)
        await parts.supervisor.send(commands.ApplyPush(1.0, 0.5))
        await parts.supervisor.advance(0.1)
        assert "pushed" in await why()
        await parts.supervisor.advance(2.0)
        await parts.supervisor.send(commands.Obstruct(Obstacle(1.0, 0.25, 5e3, 1.0)))
        await parts.actuator.set_references(0.27, 10.0, WHO)
        await parts.supervisor.advance(3.0)
        assert "presses on a wall" in await why()
        await parts.supervisor.send(commands.Obstruct(None))
        await parts.supervisor.advance(2.0)
        assert parts.state().touch.sweep is None
        await parts.actuator.contact.apply(BEGIN, WHO)
        assert "under way already" in await why()
        assert (await parts.actuator.contact.apply(TouchOrder(), WHO)).sweep == sweep_of(parts)
        for order in (TouchOrder(learn=True), TouchOrder(forget=True), TouchOrder(contact_N=2.0)):
            assert "wait for its end or stop it" in await why(order)
        assert (await until(parts)).why == ""

    stepped(database, load_parameters("lab"), refused)


@pytest.mark.parametrize(
    ("S", "F", "why"),
    [
        (8.0, 0.0, ""),
        (8.6, 0.0, "the stiffness stands at 8.60"),
        (8.0, 0.5, "the estimate moves by 0.50 N"),
        (8.0, float("nan"), "the estimate moves by "),
    ],
)
def test_explain_drift_names_the_cause_and_rejects_nan(S: float, F: float, why: str) -> None:
    rows = np.zeros((1000, len(INDEX)))
    rows[:, INDEX["S"]] = S
    rows[500:, INDEX["F_ext_hat"]] = F
    said = contact._explain_drift(rows, 8.0)
    assert said.startswith(why)
    assert bool(said) == bool(why)


def test_point_without_rest_ends_the_sweep(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    async def restless(parts: Parts) -> None:
        await at_rest(parts)
        monkeypatch.setattr(contact, "compute_drift", lambda rows: 0.5)
        await parts.actuator.contact.apply(BEGIN, WHO)
        begun = parts.supervisor.ring.count
        sweep = await until(parts)
        assert "at 8 N·m/rad nothing could be learned within 20 s: the estimate moves by 0.50 N" in sweep.why
        assert parts.supervisor.ring.count - begun == pytest.approx(20_000, abs=200)
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.0))

    stepped(database, load_parameters("lab"), restless)


@pytest.mark.parametrize("cancelled", [False, True])
def test_failure_of_the_sweep_is_reported(
    database: Database, monkeypatch: pytest.MonkeyPatch, *, cancelled: bool
) -> None:
    def broken(rows: object, S_ref: float) -> str:
        raise ZeroDivisionError("of a test")

    async def dies(parts: Parts) -> None:
        await learned_two(parts)
        contact = parts.actuator.contact
        if cancelled:
            assert contact.sweep._task is not None
            contact.sweep._task.cancel()
        else:
            monkeypatch.setattr("backend.services.contact._explain_drift", broken)
        sweep = await until(parts)
        cause = "its task was cancelled" if cancelled else "ZeroDivisionError: of a test"
        assert sweep.why == f"it died ({cause})"
        assert cause in contact.sweep.problem
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.0))
        assert len(parts.state().touch.learned) == 2
        monkeypatch.undo()
        await parts.supervisor.advance(2.0)
        await contact.apply(BEGIN, WHO)
        assert contact.sweep.problem == ""
        assert (await until(parts)).why == ""

    stepped(database, load_parameters("lab"), dies)
    with database.reading() as session:
        told = [event for event in events.find(session) if "it died" in event.text]
    assert [event.kind for event in told] == ["fault"]


def test_loop_exit_ends_the_sweep_without_restoring_S_ref(database: Database) -> None:
    async def dies(parts: Parts) -> None:
        await learned_two(parts)
        parts.supervisor.dead = True
        parts.actuator.contact._handle_event(LoopExited("killed"))
        sweep = sweep_of(parts)
        assert (sweep.under_way, sweep.point, sweep.why) == (False, 3, "the control loop died")
        assert parts.state().touch.learned == []  # as in a new loop
        await asyncio.sleep(0.1)
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 11.5))
        assert parts.actuator.contact.sweep.problem == ""

    stepped(database, load_parameters("lab"), dies)


@pytest.mark.live
def test_from_the_command_line(service: Service, running: httpx.Client) -> None:
    nothing = json.loads(sinew("touch", "show", "--json", folder=service.data).stdout)
    assert (nothing["learned"], nothing["sweep"]) == ([], None)
    refused = running.put("/api/touch", json={"sweep": "again"})
    assert (refused.status_code, problem(refused)["path"]) == (422, ["sweep"])
    swept = sinew("touch", "sweep", folder=service.data)
    assert (swept.returncode, swept.stderr) == (0, "")
    for said in ("1 of 5: 8 N·m/rad", "5 of 5: 15 N·m/rad", "N with nothing outside", "gives way to no contact"):
        assert said in swept.stdout
    learned = json.loads(sinew("touch", "show", "--json", folder=service.data).stdout)["learned"]
    assert [point["S"] for point in learned] == pytest.approx([8.0, 9.75, 11.5, 13.25, 15.0], abs=0.2)
    begun = running.put("/api/touch", json={"sweep": "begin"}).json()["sweep"]
    assert begun["under_way"]
    assert "wait for its end or stop it" in sinew("touch", "forget", folder=service.data).stderr
    assert running.post("/api/mode", json={"mode": "pretension"}).status_code == 200
    ended = running.get("/api/state").json()["touch"]["sweep"]
    assert (ended["under_way"], ended["why"]) == (False, "the mode is pretension now")
    assert "held in run" in sinew("touch", "sweep", folder=service.data).stderr
    assert "nothing is learned" in sinew("touch", "forget", folder=service.data).stdout
