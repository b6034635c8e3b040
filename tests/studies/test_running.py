"""A study on this machine: its rows, also after killed processes, a stop and a resumption."""

import asyncio
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.cli.study import _format_duration
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments import messages as experiment_messages
from backend.experiments.library import find_experiment
from backend.experiments.plans import LoopSettings
from backend.services import record_messages
from backend.services.studies import Studies
from backend.storage import banks, studies
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.storage.messages import record_not_found
from backend.storage.studies import StudyPoint
from backend.studies import point
from backend.studies.executor import CRASHES_MAX, ComputePoint, LocalExecutor
from backend.studies.point import FAILED, LOOP_METRICS, LOST, REFUSED, UNSTABLE, OtherSoftwareError, StudyBase
from backend.studies.runner import Progress, TakenError, run_study, use_local_processes
from backend.studies.stored import parse_design
from backend.tuning.gains import designed_point
from plant.parameters import load_parameters
from tests.refusals import refused
from tests.studies import studying
from tests.studies.studying import SHORT, begun, in_folder, table


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return open_database(tmp_path / "data")


def with_work(work: ComputePoint, folder: Path, jobs: int = 2) -> Callable[[StudyBase], LocalExecutor]:
    return lambda base: LocalExecutor(in_folder(base, folder), jobs, work)


def test_a_study_uses_the_bank_active_at_its_creation(database: Database) -> None:
    lab = load_parameters("lab")
    point = designed_point(lab)
    models = {name: getattr(point, name) for name in ("K_q", "T_q", "K_S", "T_S")}
    entries = [BankEntry(S, models, None) for S in (8.5, 14.0)]
    with database.session() as session:
        bank = banks.add(session, "two", entries, "Ana")
    tuning = TuningSettings(bank=bank.id).to_document()
    text = SHORT.replace("draws: 2", "draws: 1").replace("seeds: 2", "seeds: 1")
    study = Studies(database).create(text, "Ana", lab, tuning).id
    with database.reading() as session:
        assert parse_design(studies.get(session, study)).base.banks == (bank,)
    assert run_study(database, study, use_local_processes(2))
    assert {row.state for row in table(database, study)} == {"completed"}


def test_a_row_equals_the_result_of_the_experiment_exactly(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    assert run_study(database, study, use_local_processes(2))
    rows = table(database, study)
    assert [row.number for row in rows] == list(range(16))
    lab = load_parameters("lab")
    for row in (rows[0], rows[7], rows[-1]):
        values: dict[str, Any] = dict(row.values)
        parameters = replace(
            lab,
            motor=replace(lab.motor, c0=values["motor.c0"]),
            sensors=replace(lab.sensors, force_noise=values["sensors.force_noise"]),
        )
        plan = find_experiment("tracking").make_plan({"q_duration_s": 0.5, "S_duration_s": 0.5, "S_high": 12.0})
        settings = LoopSettings(lam_q=values["lam_q"], seed=values["seed"])
        with open_headless_rig(database, parameters, settings) as station:
            outcome = asyncio.run(run_experiment(station, RunRequest(plan, settings, "Ana")))
        assert outcome.evaluation.result is not None
        expected = {item.name: item.value for item in outcome.evaluation.result.metrics.figures}
        assert {name: row.figures[name] for name in expected} == expected
        assert row.state == outcome.run.end_state == "completed"


def test_an_invalid_point_has_a_row_with_a_reason(database: Database) -> None:
    axes = "axes: [{over: lam_q, values: [0.1]}]"
    study = begun(database, f"format: 1\nname: a\ntitle: A\n{axes}")
    assert run_study(database, study, use_local_processes(1))
    (row,) = table(database, study)
    assert row.state == "refused"
    assert row.figures["M_s_q"] == row.figures["gain_margin_q_true"] == UNSTABLE
    assert row.figures.keys() == LOOP_METRICS.keys()
    assert "M_s exceeds 1.7" in row.detail


def test_a_killed_worker_loses_no_points(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    assert run_study(database, study, with_work(studying.die_once, tmp_path))
    assert (tmp_path / "died").exists()
    assert [(row.number, row.state) for row in table(database, study)] == [(n, "completed") for n in range(16)]


def test_a_point_that_kills_every_worker_is_reported_and_affects_no_other(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    assert run_study(database, study, with_work(studying.die_always, tmp_path))
    rows = table(database, study)
    assert [row.number for row in rows if row.state != "completed"] == [5]
    assert rows[5].state == LOST
    assert f"died {CRASHES_MAX} times" in rows[5].detail


def test_a_stopped_study_continues_with_the_missing_points(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    stopped_at: list[int] = []

    def notify(progress: Progress) -> None:
        if stopped_at:  # the request has been read
            (tmp_path / "go").touch()
        elif progress.done == 4:
            stopped_at.append(progress.done)
            with database.session() as session:
                studies.ask_to_stop(session, study)

    assert not run_study(database, study, with_work(studying.patient, tmp_path, jobs=1), notify)
    assert [row.number for row in table(database, study)] == list(range(6))  # submitted points were waited for
    stopped = Studies(database).load_view(study)
    assert (stopped.state, stopped.problem) == ("stopped", "")
    Studies(database).resume(study)
    assert run_study(database, study, with_work(studying.patient, tmp_path))
    assert computed_in(tmp_path) == list(range(16))
    assert Studies(database).load_view(study).state == "done"


def test_a_study_that_another_runner_computes_is_rejected(database: Database) -> None:
    study = begun(database)
    with database.session() as session:
        studies.claim(session, study, "elsewhere:1")
    with refused(TakenError, "computed_elsewhere", study=study, runner="elsewhere:1"):
        run_study(database, study, use_local_processes(1))


def test_a_different_software_version_computes_no_points_of_a_study(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = begun(database)
    monkeypatch.setattr(point, "__version__", "99.0")
    with refused(OtherSoftwareError, "other_software", installed="99.0"):
        run_study(database, study, use_local_processes(1))
    with pytest.raises(OtherSoftwareError):
        Studies(database).resume(study)
    assert table(database, study) == []
    with pytest.raises(OtherSoftwareError):
        point.run_point(StudyBase("", "", "", {}, {}, software="1.0"), point.Point(0, {}, {}))


def test_failed_and_lost_points_are_recomputed_on_request(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    rows = [StudyPoint(number, state, "", None, {}, {}) for number, state in enumerate((FAILED, LOST, REFUSED))]
    with database.session() as session:
        studies.add_points(session, study, rows)
    assert run_study(database, study, with_work(studying.quick, tmp_path))
    assert table(database, study)[:3] == rows
    assert run_study(database, study, with_work(studying.quick, tmp_path), again=True)
    assert [row.state for row in table(database, study)] == ["completed"] * 2 + [REFUSED] + ["completed"] * 13


def test_a_requested_stop_is_effective_until_the_study_is_resumed(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    Studies(database).request_stop(study)
    assert not run_study(database, study, with_work(studying.quick, tmp_path))
    assert table(database, study) == []
    assert Studies(database).resume(study).state == "stopped"
    assert run_study(database, study, with_work(studying.quick, tmp_path))


def test_a_stopping_study_is_not_resumed_before_its_stop(database: Database) -> None:
    study = begun(database)
    with database.session() as session:
        studies.claim(session, study, "elsewhere:1")
    assert Studies(database).request_stop(study).state == "stopping"
    with refused(TakenError, "computed_elsewhere", study=study, runner="elsewhere:1"):
        Studies(database).resume(study)
    assert Studies(database).load_view(study).state == "stopping"


KILLED = """
import sys
from pathlib import Path
from backend.storage import open_database
from backend.studies.executor import LocalExecutor
from backend.studies.runner import run_study
from tests.studies.studying import in_folder, patient
if __name__ == "__main__":
    folder = Path(sys.argv[1])
    database = open_database(folder / "data")
    run_study(database, int(sys.argv[2]), lambda base: LocalExecutor(in_folder(base, folder), 2, patient))
"""


def test_a_killed_study_continues_with_the_missing_points(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    script = tmp_path / "killed.py"
    script.write_text(KILLED)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen([sys.executable, str(script), str(tmp_path), str(study)], env=environment)
    until(lambda: len(table(database, study)) == 4)
    with pytest.raises(TakenError):
        run_study(database, study, use_local_processes(1))
    workers = children(process.pid)
    process.send_signal(signal.SIGKILL)
    process.wait()
    killed = Studies(database).load_view(study)
    assert killed.state == "stopped"
    assert killed.problem == record_messages.study_process_died()
    until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))  # all workers have ended
    (tmp_path / "go").touch()
    assert run_study(database, study, with_work(studying.patient, tmp_path))
    assert [row.number for row in table(database, study)] == list(range(16))
    assert computed_in(tmp_path) == list(range(16))  # each once


def computed_in(folder: Path) -> list[int]:
    """Return the numbers of the points that have a marker file in the folder."""
    return sorted(int(path.name.split("-")[0]) for path in folder.glob("*-*"))


def children(process: int) -> list[int]:
    return [int(word) for path in Path(f"/proc/{process}/task").glob("*/children") for word in path.read_text().split()]


def until(reached: Callable[[], bool]) -> None:
    while not reached():  # bounded by the time limit of the test
        time.sleep(0.02)


@pytest.mark.parametrize(("seconds", "text"), [(59.7, "00:01:00"), (108_000.0, "30:00:00"), (360_000.0, "100:00:00")])
def test_a_remaining_time_above_one_day_is_formatted(seconds: float, text: str) -> None:
    assert _format_duration(seconds) == text


def test_the_command_prints_a_study_as_json(tmp_path: Path) -> None:
    file = tmp_path / "study.yaml"
    file.write_text(studying.SHORT.replace("draws: 2\nseeds: 2", ""))
    data = ("--data", str(tmp_path / "data"), "--json")

    def sinew(*words: str, options: tuple[str, ...] = data) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "backend", "study", *words, *options], capture_output=True, text=True, check=False
        )

    done = json.loads(sinew("run", str(file), "--jobs", "1").stdout)
    assert (done["study"]["state"], done["study"]["done"]) == ("done", 4)
    rows = json.loads(sinew("show", "1").stdout)["rows"]
    drawn = tmp_path / "map.png"
    over = ("--over", "lam_q", "sensors.force_noise")
    shown = json.loads(sinew("map", "1", "--figure", "min_tension_N", *over, "--out", str(drawn)).stdout)
    assert shown["cells"] == [
        [row["figures"]["min_tension_N"] for row in rows if row["values"]["sensors.force_noise"] == noise]
        for noise in (0.0, 0.2)
    ]
    assert drawn.read_bytes().startswith(b"\x89PNG")
    assert shown["pick"] == "least"
    output = sinew("map", "1", "--figure", "rmse_q", *over, "--pick", "mean", options=data[:-1]).stdout
    assert "RMSE of q [°], mean of the runs in a cell" in output
    assert "sensors.force_noise [N] \\ λ_q [s]" in output
    in_degrees = [math.degrees(row["figures"]["rmse_q"]) for row in rows]
    numbers = [float(number) for number in re.findall(r"(?<=│ )[0-9.]+(?= )", output)]
    assert all(pytest.approx(value, rel=1e-3) in numbers for value in in_degrees)
    assert "metric 'weight' does not exist" in sinew("map", "1", "--figure", "weight").stderr
    assert (
        "use one of the suffixes .png, .svg, .pdf"
        in sinew("map", "1", *over, "--out", str(tmp_path / "map.bmp")).stderr
    )
    assert "--again requires --resume" in sinew("run", str(file), "--again").stderr
    assert json.loads(sinew("run", "--resume", "1", "--again").stdout)["study"]["done"] == 4
    assert record_not_found(record="study", number=9) in sinew("stop", "9").stderr
    file.write_text("format: 2")
    unknown_format = experiment_messages.at_place(
        line=1, place="format", reason=experiment_messages.unknown_format(value=2, known=1)
    )
    assert unknown_format in " ".join(sinew("run", str(file)).stderr.split())
