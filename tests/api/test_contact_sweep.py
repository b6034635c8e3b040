"""Calibration of the bias of the external force over S."""

import asyncio
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest

from backend.control import disturbance_observer
from backend.errors import RequestRejectedError
from backend.execution.progress import RunPhase
from backend.faults import Fault
from backend.realtime import commands
from backend.realtime.modes import Mode
from backend.realtime.supervisor import LoopExited
from backend.sample import INDEX
from backend.schemas.state import PushRequest, SweepView, TaskView, TouchOrder
from backend.services import contact, messages
from backend.services.contact import SWEEP_POINTS
from backend.storage import events
from backend.storage.database import Database, open_database
from plant import Message
from plant.dynamics import Obstacle, spring_elongation, spring_slope, tendon_tension
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.api.conftest import problem
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.api.test_contact import at_rest
from tests.cli.test_report import sinew
from tests.closed_loop.test_promises import unlike_sides
from tests.e2e.service import Service
from tests.refusals import refused

# The sweep that calibrates the bias: its ends, refusals and failures.

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
    """Advance until the sweep has ended or ``reached()`` is true; return its view."""
    while sweep_of(parts).under_way and not reached():
        await asyncio.sleep(0)
    return sweep_of(parts)


async def calibrate_two_points(parts: Parts) -> None:
    await at_rest(parts)
    await parts.actuator.contact.apply(BEGIN, WHO)
    await until(parts, lambda: sweep_of(parts).point == 3)
    assert sweep_of(parts).S_ref == pytest.approx(11.5)


def reference(parts: Parts) -> tuple[float, float | None]:
    references = parts.state().references
    return references.q_ref, references.S_ref


def test_stop_restores_S_ref(database: Database) -> None:
    async def stop(parts: Parts) -> None:
        with refused(RequestRejectedError, "no_sweep_to_stop"):
            await parts.actuator.contact.apply(STOP, WHO)
        await calibrate_two_points(parts)
        view = await parts.actuator.contact.apply(STOP, WHO)
        assert view.sweep == SweepView(under_way=False, point=3, points=5, S_ref=11.5, why="stopped on request")
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.0))
        assert len(parts.state().touch.learned) == 2
        assert (await parts.actuator.contact.apply(TouchOrder(forget=True), WHO)).sweep is None

    stepped(database, load_parameters("lab"), stop)
    with database.reading() as session:
        texts = [(event.text, event.who) for event in events.find(session)]
    reason = messages.sweep_stopped_on_request()
    assert (messages.sweep_ended(point=3, points=5, S_ref=11.5, reason=reason), WHO) in texts


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
            (by_reference, messages.other_references_set(), (-0.1, 9.0)),
            (by_control, messages.sweep_without_operator(), (0.2, 11.5)),
            (by_push, messages.joint_is_pushed(), (0.2, 10.0)),
            (by_mode, messages.mode_changed_in_sweep(mode=Mode.COMPLIANCE), None),
            (by_stop, messages.mode_changed_in_sweep(mode=Mode.TRIPPED), None),
        ):
            await calibrate_two_points(parts)
            known = parts.state().touch.learned
            assert len(known) == 2
            await end()
            sweep = await until(parts)
            assert (sweep.under_way, sweep.point, sweep.why) == (False, 3, why)
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
    async def occupied(parts: Parts) -> None:
        async def refusal(order: TouchOrder) -> Message:
            with pytest.raises(RequestRejectedError) as error:
                await parts.actuator.contact.apply(order, WHO)
            return error.value.message

        async def why() -> tuple[str, Mapping[str, object]]:
            message = await refusal(BEGIN)
            reason = message.values["reason"]
            assert isinstance(reason, Message)
            assert message.code == "sweep_not_possible"
            return reason.code, reason.values

        assert await why() == ("sweep_needs_mode_run", {"mode": Mode.OFF})
        await at_rest(parts)
        assert (await refusal(TouchOrder(sweep="begin", learn=True))).code == "sweep_with_other_field"
        parts.live_state.task = TaskView(
            kind="tracking", run=4, elapsed_s=1.0, duration_s=9.0, phase=RunPhase.STARTING, part=None, number=1
        )
        assert await why() == ("run_prevents_sweep", {"run": 4, "kind": "tracking"})
        parts.live_state.task = None
        await parts.actuator.contact.apply(TouchOrder(learn=True, contact_N=2.0), WHO)
        assert await why() == ("contact_reaction_is_armed", {})
        await parts.actuator.contact.apply(TouchOrder(contact_N=0.0), WHO)
        await parts.supervisor.send(commands.ApplyPush(1.0, 0.5))
        await parts.supervisor.advance(0.1)
        assert await why() == ("joint_is_pushed", {})
        await parts.supervisor.advance(2.0)
        await parts.supervisor.send(commands.Obstruct(Obstacle(1.0, 0.25, 5e3, 1.0)))
        await parts.actuator.set_references(0.27, 10.0, WHO)
        await parts.supervisor.advance(3.0)
        assert await why() == ("joint_presses_obstacle", {})
        await parts.supervisor.send(commands.Obstruct(None))
        await parts.supervisor.advance(2.0)
        assert parts.state().touch.sweep is None
        await parts.actuator.contact.apply(BEGIN, WHO)
        assert await why() == ("sweep_in_progress_already", {})
        assert (await parts.actuator.contact.apply(TouchOrder(), WHO)).sweep == sweep_of(parts)
        for order in (TouchOrder(learn=True), TouchOrder(forget=True), TouchOrder(contact_N=2.0)):
            assert (await refusal(order)).code == "sweep_in_progress"
        assert (await until(parts)).why == ""

    stepped(database, load_parameters("lab"), occupied)


@pytest.mark.parametrize(
    ("S", "F", "code", "values"),
    [
        (8.0, 0.0, "", {}),
        (8.6, 0.0, "stiffness_not_reached", {"S": pytest.approx(8.6)}),
        (8.0, 0.5, "estimate_drifts", {"drift_N": pytest.approx(0.5), "maximum_N": contact.DRIFT_N}),
        (
            8.0,
            math.nan,
            "estimate_drifts",
            {"drift_N": pytest.approx(math.nan, nan_ok=True), "maximum_N": contact.DRIFT_N},
        ),
    ],
)
def test_explain_drift_names_the_cause_and_rejects_nan(
    S: float, F: float, code: str, values: dict[str, object]
) -> None:
    rows = np.zeros((1000, len(INDEX)))
    rows[:, INDEX["S"]] = S
    rows[500:, INDEX["F_ext_hat"]] = F
    why = contact._explain_drift(rows, 8.0)
    assert bool(why) == bool(code)
    assert not why or (isinstance(why, Message) and (why.code, why.values) == (code, values))


def test_point_without_rest_ends_the_sweep(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    async def restless(parts: Parts) -> None:
        await at_rest(parts)
        monkeypatch.setattr(contact, "compute_drift", lambda rows: 0.5)
        await parts.actuator.contact.apply(BEGIN, WHO)
        begun = parts.supervisor.ring.count
        sweep = await until(parts)
        drifts = messages.estimate_drifts(drift_N=0.5, maximum_N=contact.DRIFT_N)
        assert sweep.why == messages.no_rest_in_sweep(S_ref=8.0, duration_s=20.0, reason=drifts)
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
        await calibrate_two_points(parts)
        contact = parts.actuator.contact
        if cancelled:
            assert contact.sweep._task is not None
            contact.sweep._task.cancel()
        else:
            monkeypatch.setattr("backend.services.contact._explain_drift", broken)
        sweep = await until(parts)
        cause: str = messages.sweep_task_cancelled() if cancelled else "ZeroDivisionError: of a test"
        assert sweep.why == messages.end_of_failed_sweep(cause=cause)
        assert contact.sweep.problem == messages.sweep_failed(cause=cause)
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
        failures = [event for event in events.find(session) if "it failed" in event.text]
    assert [event.kind for event in failures] == ["fault"]


def test_loop_exit_ends_the_sweep_without_restoring_S_ref(database: Database) -> None:
    async def dies(parts: Parts) -> None:
        await calibrate_two_points(parts)
        parts.supervisor.dead = True
        parts.actuator.contact._handle_event(LoopExited("killed"))
        sweep = sweep_of(parts)
        assert (sweep.under_way, sweep.point, sweep.why) == (False, 3, messages.bias_lost_with_loop())
        assert parts.state().touch.learned == []  # as in a new loop
        await asyncio.sleep(0.1)
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 11.5))
        assert parts.actuator.contact.sweep.problem == ""

    stepped(database, load_parameters("lab"), dies)


@pytest.mark.live
def test_calibration_from_the_command_line(service: Service, running: httpx.Client) -> None:
    nothing = json.loads(sinew("touch", "show", "--json", folder=service.data).stdout)
    assert (nothing["learned"], nothing["sweep"]) == ([], None)
    refused = running.put("/api/touch", json={"sweep": "again"})
    assert (refused.status_code, problem(refused)["path"]) == (422, ["sweep"])
    swept = sinew("touch", "sweep", folder=service.data)
    assert (swept.returncode, swept.stderr) == (0, "")
    for expected in (
        "1 of 5: 8 N·m/rad",
        "5 of 5: 15 N·m/rad",
        "N without external force",
        "contact reaction disabled",
    ):
        assert expected in swept.stdout
    learned = json.loads(sinew("touch", "show", "--json", folder=service.data).stdout)["learned"]
    assert [point["S"] for point in learned] == pytest.approx([8.0, 9.75, 11.5, 13.25, 15.0], abs=0.2)
    begun = running.put("/api/touch", json={"sweep": "begin"}).json()["sweep"]
    assert begun["under_way"]
    assert "wait until it ends, or stop it" in sinew("touch", "forget", folder=service.data).stderr
    assert running.post("/api/mode", json={"mode": "pretension"}).status_code == 200
    ended = running.get("/api/state").json()["touch"]["sweep"]
    assert (ended["under_way"], ended["why"]) == (False, messages.mode_changed_in_sweep(mode=Mode.PRETENSION))
    assert "held in mode run" in sinew("touch", "sweep", folder=service.data).stderr
    assert "no bias calibrated" in sinew("touch", "forget", folder=service.data).stdout


# The bias after a sweep, between its points, compared with springs and true angles.


def zeros_off() -> PlantParameters:
    """Springs that differ, and load cells so noisy that the motors' zeros are found elsewhere."""
    unlike = unlike_sides()
    return replace(unlike, sensors=replace(unlike.sensors, force_noise=10.0 * unlike.sensors.force_noise))


def bias_of_springs(parameters: PlantParameters, S: np.ndarray) -> np.ndarray:
    """Return the bias [N] of the identified springs at the true equilibrium by identified stiffness, without zeros."""
    true_A, true_B = parameters.make_dynamics().spring_A, parameters.make_dynamics().spring_B
    identified_A, identified_B = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    held = np.linspace(5.0, 47.0, 800)
    x_A, x_B = (np.array([spring_elongation(spring, F) for F in held]) for spring in (true_A, true_B))
    stiff = parameters.geometry.r_j**2 * np.array(
        [spring_slope(identified_A, a) + spring_slope(identified_B, b) for a, b in zip(x_A, x_B, strict=True)]
    )
    difference = np.array(
        [tendon_tension(identified_B, b) - tendon_tension(identified_A, a) for a, b in zip(x_A, x_B, strict=True)]
    )
    between: np.ndarray = np.interp(S, stiff, difference)
    return between


class Truth:
    """The bias [N] at true angles, without the encoders' steps; the zeros of the motors are those of the loop."""

    def __init__(self, parameters: PlantParameters, plant: Simulator) -> None:
        self._springs = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
        self._geometry, self._plant = parameters.geometry, plant

    async def at_rest(self, parts: Parts) -> float:
        errors = []
        for _ in range(50):
            await parts.supervisor.advance(0.02)
            row, x = parts.supervisor.ring.newest(), self._plant.x
            assert row is not None
            # measured less accurately: the zero, and an encoder step that the mean over a move lacks
            errors.append((row[INDEX["theta_A"]] - x.theta_A, row[INDEX["theta_B"]] - x.theta_B))
        off_A, off_B = np.mean(errors, axis=0)
        spring_A, spring_B = self._springs
        r_m, r_j, x = self._geometry.r_m, self._geometry.r_j, self._plant.x
        F_A = tendon_tension(spring_A, r_m * (x.theta_A + off_A) - r_j * x.q)
        F_B = tendon_tension(spring_B, r_m * (x.theta_B + off_B) + r_j * x.q)
        return float(F_B - F_A)


@pytest.mark.parametrize("name", ["lab", "unlike"])
def test_bias_is_linear_between_the_points(name: str) -> None:
    parameters = load_parameters("lab") if name == "lab" else unlike_sides()
    S = np.linspace(8.0, 15.0, 300)
    points = np.linspace(8.0, 15.0, SWEEP_POINTS)
    true = bias_of_springs(parameters, S)
    assert np.ptp(true) > 0.3  # the bias is not zero
    by_lines = np.interp(S, points, bias_of_springs(parameters, points))
    assert np.max(np.abs(by_lines - true)) < 0.01  # requested: 0.05


@pytest.mark.parametrize("name", ["lab", "unlike"])
def test_sweep_calibrates_between_the_points_and_restores_S(database: Database, name: str) -> None:
    parameters = load_parameters("lab") if name == "lab" else zeros_off()
    plant = Simulator(parameters, 3)
    off: list[float] = []

    async def learn(parts: Parts) -> None:
        await at_rest(parts, 10.4)
        begun = (await parts.actuator.contact.apply(BEGIN, WHO)).sweep
        assert begun == SweepView(under_way=True, point=1, points=SWEEP_POINTS, S_ref=8.0, why="")
        seen: list[SweepView] = []
        while sweep_of(parts).under_way:
            seen.append(sweep_of(parts))
            await asyncio.sleep(0)
        ended = sweep_of(parts)
        assert [sweep.point for n, sweep in enumerate(seen) if seen[n - 1] != sweep] == [1, 2, 3, 4, 5]
        assert (ended.under_way, ended.why) == (False, "")
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.4))
        assert parts.live_state.mode is Mode.RUN
        points = parts.state().touch.learned
        assert [point.S for point in points] == pytest.approx(np.linspace(8.0, 15.0, SWEEP_POINTS), abs=0.1)
        assert all(0.0 < point.std_N < 0.2 for point in points)
        bias = np.array([(point.S, point.F) for point in points])
        truth = Truth(parameters, plant)
        for S in np.linspace(8.1, 14.9, 20):
            await parts.actuator.set_references(0.2, float(S), WHO)
            await parts.supervisor.advance(4.0)
            row = parts.supervisor.ring.newest()
            assert row is not None
            off.append(disturbance_observer.interpolate_bias(bias, float(row[INDEX["S"]])) - await truth.at_rest(parts))

    stepped(database, parameters, learn, plant)
    error = np.array(off)
    # half a count of the joint's encoder is 0.16 N at the stiffest, and each point was measured within one
    assert np.max(np.abs(error)) < 0.2
    assert np.sqrt(np.mean(error**2)) < 0.12
