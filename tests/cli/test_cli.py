"""The command line: its output, its refusals and unusual environments."""

import getpass
import importlib.metadata
import json
import math
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Thread

import pytest

from backend import main
from backend.banks import tuning_settings
from backend.banks.tuning_settings import TuningSettings
from backend.cli import messages
from backend.cli import server as serve
from backend.cli.options import RunningService, load_settings
from backend.recording.messages import recordings_deletable, runs_not_removable
from backend.schemas.experiment import QueuePlace
from backend.storage import events, runs
from backend.storage.database import FILE_NAME, Database, open_database
from plant.parameters import ParameterError, load_parameters
from plant.wiring import WiringError, load_wiring
from tests.cli.conftest import Command
from tests.experiments.parameter_files import weak_motors
from tests.reasons import assert_reason
from tests.recording.test_retention import recorded
from tests.refusals import refused
from tests.storage.test_lineage import NEW_RUN

# The command line: its output, its refusals and its exit status.
#
# A separate process takes seconds of imports. It is used where the process matters: for the files of an experiment,
# the modules that help loads, and the system checks of the doctor. The rest calls the same ``main`` in this process.

SHORT = ["--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--set", "lam_q=0.6", "--set", "seed=3"]


def process(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "backend", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """A data folder with one tracking run, and the output of its command."""
    folder = tmp_path_factory.mktemp("cli")
    data, out = folder / "data", folder / "out"
    ended = process(
        "experiment", "tracking", "--params", "ideal", "--data", str(data), "--out", str(out), "--json", *SHORT
    )
    assert ended.returncode == 0, ended.stderr
    return folder, json.loads(ended.stdout)


def test_an_experiment_writes_report_data_and_metrics(tracked: tuple[Path, dict[str, object]]) -> None:
    folder, printed = tracked
    out = folder / "out"
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF-")
    assert "<html" in (out / "report.html").read_text()
    header, *rows = [line for line in (out / "data.csv").read_text().splitlines() if not line.startswith("#")]
    assert header.startswith("t,q,q_ref,S,S_ref,theta_A,theta_B,F_A,F_B,u_A,u_B")
    assert len(rows) == pytest.approx(7000, abs=2)
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["metrics"] == printed["metrics"]
    assert metrics["metrics"]["min_tension_N"] > 5.0
    assert metrics["settings"]["loop"]["lam_q"] == 0.6
    assert metrics["settings"]["loop"]["seed"] == 3


def test_an_experiment_starts_with_the_active_tuning_and_prints_it(command: Command, tmp_path: Path) -> None:
    parameters, order = load_parameters("ideal"), ["experiment", "sequence", "--params", "ideal", "--data"]
    with closing(open_database(tmp_path)) as database:
        tuning_settings.store_tuning(database, TuningSettings(lam_q=0.7, b=0.5), parameters, "A. Operator")
    segments = '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'
    ended = command(*order, str(tmp_path), "--set", f"segments={segments}", "--set", "b=1", "--set", "bank=0")
    assert ended.returncode == 0, ended.stderr
    parts = [
        ("λ_q 0.7 s", "active"),
        ("λ_S 0.42 s", "active"),
        ("λ_motor 0.0854 s", "active"),
        ("b 1", "set"),
        ("geometric gains", "set"),
        ("switching between operating points", "active"),
        ("lambda motion", "active"),
    ]
    assert ended.stdout.splitlines()[0] == messages.tuning_of_run(parts=parts)
    with closing(open_database(tmp_path)) as database:
        with database.reading() as session:
            used = runs.find(session, limit=1)[0].settings["loop"]
        saved = tuning_settings.load_last_tuning(database, parameters)
    assert TuningSettings.from_values(used) == TuningSettings(lam_q=0.7, b=1.0)
    assert saved is not None
    assert saved.tuning == TuningSettings(lam_q=0.7, b=0.5)  # the settings of an experiment are not retained


def test_an_experiment_prints_the_lambda_that_replaces_an_unsafe_default(command: Command, tmp_path: Path) -> None:
    order = ["experiment", "sequence", "--params", str(weak_motors(tmp_path)), "--data", str(tmp_path)]
    ended = command(*order, "--set", 'segments=[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]')
    assert ended.returncode == 0, ended.stderr
    moved, lam_q = ended.stderr.splitlines()[0].rsplit(" → ", 1)
    assert (
        moved == "the method's default is outside the safe range of these models; the nearest safe tuning is: λ_q 0.5"
    )
    tuning = messages.tuning_of_run(parts=[(f"λ_q {lam_q}", "default"), ("λ_S 0.42 s", "default")])
    assert ended.stdout.startswith(f"{tuning}, ")


def test_a_stored_run_is_listed_shown_and_exported(command: Command, tracked: tuple[Path, dict[str, object]]) -> None:
    folder, printed = tracked
    data = ["--data", str(folder / "data")]
    listed = json.loads(command("runs", "list", "--json", *data).stdout)
    assert [(run["id"], run["kind"], run["end_state"]) for run in listed] == [(printed["run"], "tracking", "completed")]
    assert (
        json.loads(command("runs", "show", str(printed["run"]), "--json", *data).stdout)["metrics"]
        == printed["metrics"]
    )
    seen = command("runs", "show", str(printed["run"]), *data).stdout
    metrics = printed["metrics"]
    assert isinstance(metrics, dict)
    units = printed["units"]
    assert isinstance(units, dict)
    for name, figure in metrics.items():
        read = math.degrees(figure) if figure is not None and units[name] == "rad" else figure
        assert ("not measured" if read is None else f"{read:.4g}") in seen
    assert "λ_q" in seen
    assert str(printed["verdict"]) in " ".join(seen.split())
    assert not set(metrics) & set(seen.split())  # labels, not the names for programs
    csv = folder / "again.csv"
    assert command("runs", "export", str(printed["run"]), str(csv), *data).returncode == 0
    assert csv.read_text() == (folder / "out" / "data.csv").read_text()
    assert command("db", "check", *data).returncode == 0
    assert command("db", "backup", str(folder / "copy.db"), *data).returncode == 0
    assert (folder / "copy.db").stat().st_size > 100_000
    with closing(open_database(folder / "data")) as database, database.reading() as session:
        (event,) = events.find(session, kind="backup")
    assert (event.text, event.who) == ("database copied to copy.db", getpass.getuser())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["experiment", "levitation"], "tracking"),
        (["experiment", "tracking", "--set", "lam_q=0.1"], "λ_q: 0.1 s is"),
        (["experiment", "tracking", "--set", "q_amplitude=2"], "114.592° is outside 0.573 to 80.2°"),
        (["experiment", "tracking", "--set", "speed=2"], "speed"),
        (["experiment", "tracking", "--set", "lam_q"], "key=value"),
        (["experiment", "tracking", "--params", "nowhere.toml"], "nowhere.toml"),
        (["identify", "actuator", "--set", "tension_N=70"], "70 N is outside 8 to 42 N"),
        (["identify", "motor", "--set", "u_high=12"], "12 V is outside 0.5 to 9.5 V"),
        (["identify", "actuator", "--tensions", "20,70"], "70 N is outside 8 to 42 N"),
        (["identify", "spring", "--table", "nowhere.csv"], "nowhere.csv"),
        (["runs", "show", "7"], "no run 7"),
        (["runs", "export", "7", "file.doc"], ".csv"),
        (["bank", "show", "7"], "no bank 7"),
        (["bank", "build", "b", "7"], "no identification 7"),
        (["serve", "--port", "70000"], "port"),
    ],
)
def test_an_error_is_printed_in_one_line_and_sets_the_status(
    command: Command, tmp_path: Path, words: list[str], expected: str
) -> None:
    ended = command(*words, "--data", str(tmp_path))
    assert ended.returncode in (1, 2)
    assert expected in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
    assert ended.stdout == ""


def test_a_service_that_cannot_start_prints_the_reason(command: Command, tmp_path: Path) -> None:
    ended = command("serve", "--params", "nowhere", "--port", "0", "--data", str(tmp_path))
    assert ended.returncode == 1
    assert "nowhere" in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1


def test_help_states_units_and_loads_no_large_packages() -> None:
    assert "[rad]" in process("experiment", "--help").stdout
    loaded = "import sys, backend.cli; print([m for m in ('numba', 'scipy', 'fastapi', 'viser') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_printed_version_is_that_of_the_package() -> None:
    assert process("--version").stdout == f"sinew {importlib.metadata.version('sinew')}\n"


def test_doctor_prints_json(tmp_path: Path) -> None:
    findings = json.loads(process("doctor", "--json", "--data", str(tmp_path)).stdout)
    assert {"scheduling", "memory", "1 ms period", "DAQ card"} <= {finding["what"] for finding in findings}
    assert all(set(finding) == {"what", "found", "remedy"} for finding in findings)


def test_doctor_reports_a_rig_that_cannot_start(command: Command, tmp_path: Path) -> None:
    """The computer of these tests has no card: the doctor states the problem with the text of the refused start."""
    findings = json.loads(process("doctor", "--json", "--data", str(tmp_path)).stdout)
    card = next(finding for finding in findings if "DAQ" in finding["what"])
    ended = command("serve", "--plant", "rig", "--port", "0", "--data", str(tmp_path / "rig"))
    assert ended.returncode == 1
    assert card["found"].startswith("none: ")
    assert card["found"].removeprefix("none: ") in " ".join(ended.stderr.split())
    assert card["remedy"].startswith(messages.card_only_for_rig(remedy=""))


def test_recordings_beyond_the_limit_are_listed_and_deleted_by_number(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = open_database(tmp_path)
    run = recorded(database, days=90)
    database.close()
    words = ["db", "recordings", "--data", str(tmp_path)]
    held = json.loads(command(*words, "--json").stdout)
    enough = messages.nothing_to_delete(total_bytes=held["total_bytes"], limit_GB=held["limit_bytes"] / 1e9)
    assert enough in " ".join(command(*words).stdout.split())
    monkeypatch.setenv("SINEW_RECORDINGS_GB", "0.00001")
    listed = command(*words).stdout
    excess = recordings_deletable(
        total_bytes=held["total_bytes"], max_bytes=10_000, keep_days=30, runs=1, freed_bytes=held["total_bytes"]
    )
    assert excess in " ".join(listed.split())
    assert messages.command_to_delete(run_ids=[run]) in listed
    assert json.loads(command(*words, "--json").stdout)["may_go"][0]["run"] == run
    refused = command(*words, "--delete", str(run + 1))
    reason = runs_not_removable(refused=[run + 1], removable=[run])
    assert (refused.returncode, reason in refused.stderr) == (2, True)
    assert json.loads(command(*words, "--delete", str(run), "--json").stdout)["total_bytes"] == 0


# The command line where terminal, environment or data folder are unusual.

SINEW = str(Path(sys.executable).with_name("sinew"))
SHIPPED = Path(__file__).parents[2] / "plant"


def sinew(*words: str, before: tuple[str, ...] = (), **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*before, SINEW, *words], env={**os.environ, **environment}, capture_output=True, check=False, timeout=300
    )


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "ascii", "utf-8"])
def test_characters_that_the_terminal_lacks_are_escaped(encoding: str, tmp_path: Path) -> None:
    ended = sinew("experiments", "text", "lambda_sweep", "--data", str(tmp_path), PYTHONIOENCODING=encoding)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert ("λ" if encoding == "utf-8" else "\\u03bb") in ended.stdout.decode(encoding)


@pytest.mark.parametrize("words", [("doctor",), ("serve", "--port", "0"), ("experiment", "tracking")])
def test_disabled_compilation_of_numba_is_rejected_in_one_line(words: tuple[str, ...], tmp_path: Path) -> None:
    ended = sinew(*words, "--data", str(tmp_path / "data"), NUMBA_DISABLE_JIT="1")
    assert ended.returncode == 1
    (line,) = ended.stderr.decode().splitlines()
    assert "NUMBA_DISABLE_JIT" in line
    assert not (tmp_path / "data").exists()


def test_a_tilde_in_the_data_folder_is_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SINEW_DATA", "~/x")
    assert load_settings().data == tmp_path / "x"
    assert load_settings(data=Path("~/y")).data == tmp_path / "y"


@pytest.mark.parametrize("name", ["what?mode=ro", "50%20", "a#b", "a b&c=d", "[ü]", "sqlite:", "?", "file:x"])
def test_the_database_is_in_the_data_folder_for_any_folder_name(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    with_run(folder)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    database = open_database(folder)
    assert database.file == folder.resolve() / FILE_NAME
    again, arguments = database.__reduce__()
    other: Database = again(*arguments)
    with other.reading() as session:
        assert [run.id for run in runs.find(session)] == [1]
    other.close()
    database.close()


def with_run(folder: Path) -> None:
    database = open_database(folder)
    with database.session() as session:
        runs.create(session, NEW_RUN)
    database.close()


def test_a_read_only_data_folder_is_reported_with_a_remedy(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with_run(folder)
    folder.chmod(0o500)
    (folder / FILE_NAME).chmod(0o400)
    before: tuple[str, ...] = ()
    if os.geteuid() == 0:  # a user who may write everywhere gives up that right
        assert shutil.which("setpriv"), "this test needs setpriv (util-linux) when root runs it"
        before = ("setpriv", "--bounding-set", "-dac_override", "--inh-caps", "-all")
    ended = sinew("runs", "list", "--data", str(folder), before=before)
    folder.chmod(0o700)
    assert ended.returncode == 1
    (line,) = ended.stderr.decode().splitlines()
    assert str(folder) in line
    assert "not writable" in line
    assert "--data" in line


def test_80_columns_show_the_complete_start_time_of_a_run(tmp_path: Path) -> None:
    with_run(tmp_path)
    database = open_database(tmp_path)
    with database.reading() as session:
        began = runs.get(session, 1).started_at
    database.close()
    ended = sinew("runs", "list", "--data", str(tmp_path), COLUMNS="80", PYTHONIOENCODING="utf-8")
    assert f"{began:%Y-%m-%d %H:%M}" in ended.stdout.decode()


def test_parameters_and_wirings_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    for read, shipped in ((load_parameters, "lab"), (load_wiring, "pcie-6323")):
        (source,) = SHIPPED.rglob(f"{shipped}.toml")
        file = tmp_path / source.name
        file.write_bytes(b"\xef\xbb\xbf" + source.read_bytes())
        assert read(file) == read(shipped)


def test_a_file_whose_name_is_too_long_for_a_run_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / f"{'x' * 201}.toml"
    file.write_text("")
    with refused(ParameterError, "parameters_name_too_long", maximum=200):
        load_parameters(file)
    with pytest.raises(WiringError) as caught:
        load_wiring(file)
    (wrong,) = caught.value.problems
    assert_reason(wrong.text, "wiring_name_too_long", length=201, maximum=200)


# Any program may answer in place of a service: the command reports it in one line.

OK, REFUSED = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n", b"HTTP/1.1 409 Conflict\r\nConnection: close\r\n\r\n"


def answer(reply: bytes) -> object:
    """Send a request to a server that gives this answer to every client."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(10_000)
                connection.sendall(reply)

        thread = Thread(target=serve)
        thread.start()
        try:
            return RunningService(f"http://127.0.0.1:{server.getsockname()[1]}", "").request(
                "GET", "/place", None, QueuePlace
            )
        finally:
            thread.join(10)


def of_other_program(status: int, response: bytes) -> str:
    return messages.other_program_responds(address="@", status=status, response=response)


@pytest.mark.parametrize(
    ("reply", "why"),
    [
        (b"SSH-2.0-OpenSSH\r\n", messages.service_does_not_respond(address="@", reason="")),
        (b"", messages.service_does_not_respond(address="@", reason="")),
        (OK + b"<html>", of_other_program(200, b"<html>")),
        (REFUSED + b'{"detail": "no"}', of_other_program(409, b'{"detail": "no"}')),
        (REFUSED + b"[]", of_other_program(409, b"[]")),
        (REFUSED, of_other_program(409, b"")),
        (OK + b'{"place": "behind"}', of_other_program(200, b'{"place": "behind"}')),
        (OK + b'{"place": 3, "mode": "off"}', of_other_program(200, b'{"place": 3, "mode": "off"}')),
        (REFUSED + b'{"error": {"code": "busy", "message": "busy now"}}', "sinew: busy now"),
    ],
)
def test_an_invalid_answer_of_a_server_is_reported_in_one_message(
    reply: bytes, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        answer(reply)
    assert why in re.sub(r"http://127\.0\.0\.1:\d+", "@", capsys.readouterr().err)


def test_a_valid_answer_is_parsed() -> None:
    assert answer(OK + b'{"place": 3}') == QueuePlace(place=3)


def test_only_a_slow_start_prints_a_notice(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    starts = iter((0.3, 0.0))

    def start(_settings: object, ready: Callable[[str, None], None]) -> None:
        time.sleep(next(starts))
        ready("http://127.0.0.1:8000", None)

    monkeypatch.setattr(main, "serve", start)
    monkeypatch.setattr(serve, "NOTICE_DELAY_S", 0.05)
    noticed = []
    for _ in range(2):
        serve.serve(plant="simulator", data=tmp_path)
        noticed.append(messages.service_is_starting() in capsys.readouterr().out)
    assert noticed == [True, False]
