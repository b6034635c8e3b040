"""How a run ended, as its samples and the loop's events say it."""

import pytest

from backend.faults import FAULT_CODE, Fault
from backend.loop.commands import ProgramEnded
from backend.recording.recorder import Recorder
from backend.storage import Database
from backend.storage.runs import EndState
from tests.recording.stand_in import Writer, new_run, stored_run


@pytest.mark.parametrize(
    ("fault", "end_state"),
    [
        (Fault.STOP_PRESSED, EndState.STOPPED),
        (Fault.OPERATOR_LOST, EndState.LINK_LOST),
        (Fault.SERVICE_LOST, EndState.SERVICE_DIED),
        (Fault.FORCE_LIMIT, EndState.TRIPPED),
        (Fault.SAFETY_MODULE, EndState.TRIPPED),
    ],
)
def test_the_sample_after_a_run_says_why_it_ended(
    database: Database, writer: Writer, fault: Fault, end_state: EndState
) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    writer.write(10, run.id)
    writer.write(1, fault=FAULT_CODE[fault])
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (end_state, fault.value)


def test_a_run_ended_with_the_service_says_by_what(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    recorder.ended_by = "service ended by SIGTERM"
    writer.write(10, run.id)
    writer.write(1, fault=FAULT_CODE[Fault.SERVICE_ENDED])
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (EndState.STOPPED, "service ended by SIGTERM")


def test_programs_ended_early_are_all_stopped_though_their_samples_are_stored_at_once(
    database: Database, writer: Writer
) -> None:
    ended_early = [new_run(database), new_run(database)]
    complete = new_run(database)
    recorder = Recorder(database, writer.ring)
    for run in (*ended_early, complete):
        writer.write(10, run.id)
        recorder.hear(ProgramEnded(tick=10, run=run.id, completed=run is complete))
    writer.write(1)
    recorder.drain()
    stopped = [stored_run(database, run.id) for run in ended_early]
    assert [(run.end_state, run.end_detail) for run in stopped] == [
        (EndState.STOPPED, "the program was ended before its end")
    ] * 2
    assert stored_run(database, complete.id).end_state == EndState.COMPLETED


@pytest.mark.parametrize("told", ["before", "between", "after"])
def test_a_program_ended_early_is_stopped_whenever_that_is_told(database: Database, writer: Writer, told: str) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    ended_early = ProgramEnded(tick=10, run=run.id, completed=False)
    if told == "before":
        recorder.hear(ended_early)
        recorder.drain()
    writer.write(10, run.id)
    recorder.drain()
    if told == "between":
        recorder.hear(ended_early)
    writer.write(1)
    recorder.drain()
    if told == "after":
        recorder.hear(ended_early)
    recorder.drain()
    assert stored_run(database, run.id).end_state == EndState.STOPPED


@pytest.mark.parametrize(
    ("fault", "end"), [(Fault.SLACK, EndState.TRIPPED), (Fault.SERVICE_LOST, EndState.SERVICE_DIED)]
)
def test_a_fault_stays_the_reason_although_its_program_ended_early(
    database: Database, writer: Writer, fault: Fault, end: EndState
) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    writer.write(10, run.id)
    recorder.hear(ProgramEnded(tick=10, run=run.id, completed=False))
    writer.write(1, fault=FAULT_CODE[fault])
    recorder.drain()
    assert stored_run(database, run.id).end_state == end
