"""How a run ended: as the loop says it, whatever is stored when, and as what is known where the loop says nothing."""

import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import RunEnded
from backend.realtime.modes import Cause, ModeCause
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import LoopExited
from backend.recording.recorder import Recorder
from backend.storage.database import Database
from backend.storage.runs import EndState
from tests.recording.stand_in import Writer, new_run, stored_run

EARLY = "the program was ended before its end"


@pytest.mark.parametrize(
    ("why", "detail", "end_state", "kept"),
    [
        (Cause.ASKED_FOR, "", EndState.STOPPED, EARLY),
        (Fault.STOP_PRESSED, "", EndState.STOPPED, "stop_pressed"),
        (Fault.OPERATOR_LOST, "", EndState.LINK_LOST, "operator_lost"),
        (Fault.SERVICE_LOST, "", EndState.SERVICE_DIED, "service_lost"),
        (Fault.FORCE_LIMIT, "F_A = 161 N", EndState.TRIPPED, "force_limit: F_A = 161 N"),
        (Fault.SERVICE_ENDED, "service ended by SIGTERM", EndState.STOPPED, "service ended by SIGTERM"),
    ],
)
@pytest.mark.parametrize("told", ["before its samples are stored", "between", "after them", "after the next began"])
def test_a_run_ends_as_the_loop_says_whenever_that_is_told(
    database: Database, writer: Writer, told: str, why: ModeCause, detail: str, end_state: EndState, kept: str
) -> None:
    run, following = new_run(database), new_run(database)
    recorder = Recorder(database, writer.ring)
    end = RunEnded(tick=1010, run=run.id, completed=False, why=why, detail=detail)
    writer.write(1010, run.id)
    if told == "before its samples are stored":
        recorder.on_event(end)
    recorder.drain()
    if told == "between":
        recorder.on_event(end)
    writer.write(1)
    recorder.drain()
    if told == "after them":
        recorder.on_event(end)
    writer.write(1100, following.id)
    recorder.drain()
    if told == "after the next began":
        assert stored_run(database, run.id).end_state == EndState.RUNNING
        recorder.on_event(end)
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (end_state, kept)
    assert stored_run(database, following.id).end_state == EndState.RUNNING
    recorder.close()


def test_what_samples_show_ends_no_run(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    writer.write(10, run.id)
    writer.write(1, fault=FAULT_CODE[Fault.SLACK])
    recorder.drain()
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (EndState.LINK_LOST, "the loop process died: killed by SIGKILL")


@pytest.mark.parametrize("sampled", [0, 10])
def test_an_end_told_before_the_loop_died_stays(database: Database, writer: Writer, sampled: int) -> None:
    """Also where the run was over before it had a sample."""
    run, open_still = new_run(database), new_run(database)
    recorder = Recorder(database, writer.ring)
    if sampled:
        writer.write(sampled, run.id)
    recorder.on_event(RunEnded(sampled, run.id, completed=False, why=Fault.STOP_PRESSED))
    writer.write(10, open_still.id)
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.follow(Ring.create(16))
    recorder.drain()
    ended = [stored_run(database, one.id) for one in (run, open_still)]
    assert [one.end_state for one in ended] == [EndState.STOPPED, EndState.LINK_LOST]
    assert ended[0].end_detail == "stop_pressed"


def test_programs_ended_early_are_all_stopped_though_their_samples_are_stored_at_once(
    database: Database, writer: Writer
) -> None:
    format_early_end = [new_run(database), new_run(database)]
    complete = new_run(database)
    recorder = Recorder(database, writer.ring)
    for run in (*format_early_end, complete):
        writer.write(10, run.id)
        recorder.on_event(RunEnded(10, run.id, completed=run is complete, why=Cause.ASKED_FOR))
    writer.write(1)
    recorder.drain()
    stopped = [stored_run(database, run.id) for run in format_early_end]
    assert [(run.end_state, run.end_detail) for run in stopped] == [(EndState.STOPPED, EARLY)] * 2
    assert stored_run(database, complete.id).end_state == EndState.COMPLETED
