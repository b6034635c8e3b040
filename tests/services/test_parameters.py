"""Application of an identification: rejected unless all is at rest; loop, tuning and state use it, undo reverts it."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

import plant
from backend import app
from backend.banks.tuning_settings import TuningSettings
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.realtime.commands import SetMode
from backend.realtime.ipc import Setup
from backend.realtime.modes import Mode
from backend.realtime.supervisor import LoopExitedError, Supervisor
from backend.sample import INDEX
from backend.schemas.tuning import TrialRequest
from backend.services import messages
from backend.services import parameters as applied_parameters
from backend.services.parameters import ParametersApplied, ParameterService
from backend.services.tuning_state import ActiveTuning, make_active_tuning
from backend.storage import banks
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from plant import Message
from plant.interface import SIMULATOR
from plant.messages import parameter_out_of_range
from plant.parameters import PlantParameters, load_parameters
from tests.api.stepped_service import Parts, Stepped, stepped
from tests.experiments.test_applied_parameters import K, motors, spring, stored
from tests.refusals import refused

Sample = NDArray[np.float64]

IDEAL = load_parameters("ideal")
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def restarted(monkeypatch: pytest.MonkeyPatch) -> list[Setup]:
    """The setup of each restart of the loop; the stepped loop continues."""
    setups: list[Setup] = []

    async def restart(supervisor: Supervisor, _purpose: str) -> None:
        setups.append(supervisor.setup)

    monkeypatch.setattr(Supervisor, "restart", restart)
    return setups


def applied_with(parts: Parts, received: list[PlantParameters], base: PlantParameters = IDEAL) -> ParameterService:
    events = EventBus()
    events.subscribe(ParametersApplied, lambda applied: received.append(applied.parameters))
    return ParameterService(parts.actuator, parts.supervisor, parts.database, parts.tuning_store, base, events)


def test_loop_tuning_and_state_use_the_applied_parameters_until_undo(
    database: Database, restarted: list[Setup]
) -> None:
    found = stored(database, motors((2.3, 0.21), (2.4, 0.23)))
    with database.session() as session:
        bank = banks.add(session, "bench", [BankEntry(10.55, MODEL)], "Ana")
    received: list[PlantParameters] = []

    async def work(parts: Parts) -> None:
        live_state = parts.live_state
        live_state.tuning = make_active_tuning(IDEAL, TuningSettings(lam_q=0.8, lam_S=0.6), bank)
        parts.tuning_store.save(live_state.tuning, "Ana")
        applied = applied_with(parts, received)
        proposal = applied.build_view(found.id).proposal
        assert proposal is not None

        view = await applied.apply(found.id, "Ana")

        newest, file = view.versions
        assert (newest.number, newest.who, newest.estimate, newest.digest) == (1, "Ana", found.id, proposal.digest)
        assert newest.changes == proposal.changes
        assert [(one.name, one.side, one.before, one.after) for one in newest.changes] == [
            ("K_m", "A", 2.86, 2.3),
            ("T_m", "A", 0.22, 0.21),
            ("K_m", "B", 2.86, 2.4),
            ("T_m", "B", 0.22, 0.23),
        ]
        assert file.changes == []
        then = live_state.parameters
        assert (then.select_identified("A").K_m, then.select_identified("B").K_m) == (2.3, 2.4)
        assert received == [then]
        assert live_state.tuning.parameters == then
        assert (live_state.tuning.settings.lam_q, live_state.tuning.settings.lam_S, live_state.tuning.bank) == (
            0.8,
            0.6,
            None,
        )
        (setup,) = restarted
        assert IDEAL.with_identified(setup.identified) == then
        assert setup.tuning == live_state.tuning.build_command()

        undone = await applied.undo(1, "Ben")
        assert [one.number for one in undone.versions] == [2, 1, 0]
        assert undone.versions[0].digest == undone.versions[2].digest
        assert live_state.parameters == IDEAL
        assert live_state.tuning.bank == bank  # which was active with these numbers
        assert restarted[-1].identified == {}

    stepped(database, IDEAL, work)


def test_parameters_cannot_be_applied_unless_the_actuator_is_off(database: Database, restarted: list[Setup]) -> None:
    found = stored(database, spring())

    async def work(parts: Parts) -> None:
        applied = applied_with(parts, [])
        await parts.actuator.set_mode(Mode.PRETENSION, "Ana")
        before = parts.live_state.tuning
        with refused(RequestRejectedError, "parameters_need_mode_off", mode=Mode.PRETENSION):
            await applied.apply(found.id, "Ana")
        assert len(applied.build_view().versions) == 1
        assert (parts.live_state.parameters, parts.live_state.tuning) == (IDEAL, before)
        assert restarted == []

    stepped(database, IDEAL, work)


def test_a_parameter_outside_its_bounds_is_rejected_by_name(database: Database, restarted: list[Setup]) -> None:
    beyond = stored(database, motors((2.3, 0.21), (2400.0, 0.23)))

    async def work(parts: Parts) -> None:
        applied = applied_with(parts, [])
        proposal = applied.build_view(beyond.id).proposal
        assert proposal is not None
        assert (
            parameter_out_of_range(
                label="identified_B.K_m", value=2400.0, unit="rad/(V·s)", minimum=0.001, maximum=1000.0
            )
            in proposal.problem
        )
        with refused(RequestRejectedError, "parameters_not_applicable", reason=proposal.problem):
            await applied.apply(beyond.id, "Ana")
        assert restarted == []

    stepped(database, IDEAL, work)


def test_parameters_cannot_be_applied_during_a_step_run_trial_or_change_of_tuning(
    database: Database, restarted: list[Setup], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Checked before and after the wait for the lock: events during the wait count, too."""
    found = stored(database, motors((2.3, 0.21), (2.4, 0.23)))

    async def work(parts: Parts) -> None:
        live_state, applied = parts.live_state, applied_with(parts, [])

        async def is_refused(code: str, **values: object) -> None:
            with refused(RequestRejectedError, code, **values):
                await applied.apply(found.id, "Ana")
            assert [one.number for one in applied.build_view().versions] == [0]
            assert (live_state.parameters, restarted) == (IDEAL, [])

        homing = messages.step_occupies_rig(title="Homing")
        with monkeypatch.context() as during:
            during.setattr(live_state, "occupied_by", homing)
            await is_refused("rig_is_occupied", reason=homing)
        with monkeypatch.context() as during:
            during.setattr(live_state, "overridden_tuning", live_state.tuning)
            await is_refused("run_prevents_change_of_parameters")
        before = live_state.tuning
        await parts.actuator.tuning_service.start_trial(TrialRequest(lam_q=0.9, duration_s=60.0), "Ana")
        await is_refused("trial_in_progress")
        await parts.actuator.tuning_service.end_trial(keep=False, who="Ana")

        choose_for_parameters = parts.tuning_store.choose_for_parameters

        def meanwhile(now: ActiveTuning, parameters: PlantParameters) -> ActiveTuning:
            live_state.tuning = make_active_tuning(IDEAL, TuningSettings(lam_q=0.9), None)
            return choose_for_parameters(now, parameters)

        with monkeypatch.context() as during:
            during.setattr(parts.tuning_store, "choose_for_parameters", meanwhile)
            await is_refused("tuning_changed_meanwhile")
        live_state.tuning = before
        parts.supervisor.dead = True
        with refused(RequestRejectedError, "loop_is_not_running"):
            await applied.apply(found.id, "Ana")
        assert restarted == []

    stepped(database, IDEAL, work)


def test_the_second_of_two_concurrent_applications_or_undos_is_rejected(
    database: Database, restarted: list[Setup]
) -> None:
    found = stored(database, motors((2.3, 0.21), (2.4, 0.23)))

    async def work(parts: Parts) -> None:
        applied = applied_with(parts, [])
        both = await asyncio.gather(*(applied.apply(found.id, who) for who in ("Ana", "Ben")), return_exceptions=True)
        (refusal,) = (one for one in both if isinstance(one, RequestRejectedError))
        reason = refusal.message.values["reason"]
        assert isinstance(reason, Message)
        assert (refusal.message.code, reason.code) == ("parameters_not_applicable", "values_are_active_already")
        assert [one.number for one in applied.build_view().versions] == [1, 0]
        both = await asyncio.gather(*(applied.undo(1, who) for who in ("Ana", "Ben")), return_exceptions=True)
        (refusal,) = (one for one in both if isinstance(one, RequestRejectedError))
        reason = refusal.message.values["reason"]
        assert isinstance(reason, Message)
        assert (reason.code, reason.values) == ("other_version_is_active", {"active": 2, "version": 1})
        assert parts.live_state.parameters == IDEAL
        assert len(restarted) == 2

    stepped(database, IDEAL, work)


def test_applied_parameters_survive_a_failed_loop_start_and_can_be_undone(
    database: Database, restarted: list[Setup], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = stored(database, motors((2.3, 0.21), (2.4, 0.23)))

    async def work(parts: Parts) -> None:
        received: list[PlantParameters] = []
        applied = applied_with(parts, received)

        async def dies(supervisor: Stepped, _purpose: str) -> None:
            supervisor.dead = True
            raise LoopExitedError("the control loop is not running: killed by SIGKILL")

        with monkeypatch.context() as during:
            during.setattr(Supervisor, "restart", dies)
            with refused(
                LoopExitedError,
                "change_takes_effect_at_next_start",
                reason="the control loop is not running: killed by SIGKILL",
            ):
                await applied.apply(found.id, "Ana")
        then = parts.live_state.parameters
        newest = applied.build_view().versions[0]
        assert (newest.number, newest.digest) == (1, applied_parameters.AppliedVersion(1, then).digest)
        assert received == [then]
        assert IDEAL.with_identified(parts.supervisor.setup.identified) == then
        assert parts.supervisor.setup.tuning == parts.live_state.tuning.build_command()

        await applied.undo(1, "Ana")
        assert parts.live_state.parameters == IDEAL
        assert [setup.identified for setup in restarted] == [{}]

    stepped(database, IDEAL, work)


def test_a_changed_parameter_file_is_reported_now_and_at_the_next_start(
    database: Database, restarted: list[Setup], tmp_path: Path
) -> None:
    """The loop reads the file at each start: it would use other numbers than the service."""
    file = tmp_path / "mine.toml"
    source_text = (Path(plant.__file__).parent / "parameters" / "ideal.toml").read_text(encoding="utf-8")
    file.write_text(source_text, encoding="utf-8")
    mine, found = load_parameters(file), stored(database, motors((2.3, 0.21), (2.4, 0.23)))

    async def work(parts: Parts) -> None:
        parts.supervisor.setup = replace(parts.supervisor.setup, parameters=str(file))
        applied = applied_with(parts, [], mine)
        await applied.apply(found.id, "Ana")
        file.write_text(source_text.replace("value = 2.86", "value = 2.87"), encoding="utf-8")
        assert load_parameters(file) != mine
        with refused(RequestRejectedError, "parameter_file_has_changed"):
            await applied.undo(1, "Ana")
        assert len(restarted) == 1

    stepped(database, mine, work)
    version, said_of_it = app.load_parameter_version(database, mine)
    assert (version.number, said_of_it) == (1, "parameters of Ana restored: version 1 over mine")
    version, said_of_it = app.load_parameter_version(database, load_parameters(file))
    assert version.number == 0
    assert said_of_it.startswith(
        "the active parameters are those of the file mine: the parameters that Ana applied last belong to another file"
    )


@pytest.mark.live
def test_the_loop_process_estimates_stiffness_with_the_applied_spring(database: Database) -> None:
    """With both tendons pulled, S = r_j² (F_A'(x_A) + F_B'(x_B)) of the springs that the loop uses."""
    applied = applied_parameters.build_proposal(IDEAL, IDEAL, stored(database, spring()))
    sections = applied_parameters.build_identified_sections(applied)
    then = IDEAL.with_identified(sections)

    async def pulled() -> Sample:
        tuning = make_active_tuning(then, TuningSettings()).build_command()
        supervisor = Supervisor(Setup(SIMULATOR, "ideal", 0, tuning, identified=sections))
        await supervisor.start()
        try:
            await supervisor.send(SetMode(Mode.PRETENSION))
            await supervisor.advance(8.0)
            newest = supervisor.ring.newest()
            assert newest is not None
            return newest
        finally:
            await supervisor.stop()

    row = asyncio.run(pulled())
    assert min(row[INDEX["F_A"]], row[INDEX["F_B"]]) > 1.0
    S = float(row[INDEX["S"]])
    assert (
        pytest.approx(by_polynomials(row, then.select_identified("A").k, then.select_identified("B").k), rel=1e-6) == S
    )
    assert pytest.approx(by_polynomials(row, K, K), rel=0.03) == S
    assert (
        pytest.approx(by_polynomials(row, IDEAL.select_identified("A").k, IDEAL.select_identified("B").k), rel=0.03)
        != S
    )


def by_polynomials(row: Sample, k_A: tuple[float, ...], k_B: tuple[float, ...]) -> float:
    """Return the joint stiffness [N·m/rad] at the row's angles, for spring coefficients ``k_A`` and ``k_B``."""
    r_m, r_j = IDEAL.geometry.r_m, IDEAL.geometry.r_j
    q, theta_A, theta_B = (float(row[INDEX[name]]) for name in ("q", "theta_A", "theta_B"))
    slope_A = Polynomial(k_A).deriv()(r_m * theta_A - r_j * q)
    slope_B = Polynomial(k_B).deriv()(r_m * theta_B + r_j * q)
    return float(r_j**2 * (slope_A + slope_B))
