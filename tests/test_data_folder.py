"""One service per data folder, whatever happens to the folder while it runs."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from backend.data_folder import (
    AlreadyRunningError,
    LockedFolder,
    describe_missing_address,
    lock_for_command,
    lock_for_service,
    lock_if_unused,
    read_service_address,
    read_service_addresses,
)
from plant import Message


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


def as_message(text: str) -> Message:
    """Return a text as the message that it is."""
    assert isinstance(text, Message)
    return text


def refused(data: Path) -> bool:
    """Whether a second process may not work on ``data``."""
    program = "import sys, pathlib, backend.data_folder as d\nwith d.lock_for_service(pathlib.Path(sys.argv[1])): pass"
    ended = subprocess.run([sys.executable, "-c", program, str(data)], capture_output=True, text=True, check=False)
    assert ended.returncode == 0 or AlreadyRunningError.__name__ in ended.stderr, ended.stderr
    return ended.returncode != 0


def test_a_folder_that_was_replaced_is_told_and_takes_no_second_service(data: Path) -> None:
    with lock_for_service(data) as held:
        assert held.problem() == ""
        shutil.rmtree(data)
        problem = as_message(held.problem())
        assert (problem.code, problem.values["folder"]) == ("data_folder_lost", data)
        assert refused(data)
        assert not data.exists()
        data.mkdir()
        (data / "service.lock").touch()
        assert as_message(held.problem()).values == {"folder": data, "reason": "it was replaced"}
        assert refused(data)
    assert not refused(data)


def test_a_folder_that_was_moved_is_told_until_it_is_back(data: Path) -> None:
    with lock_for_service(data) as held:
        aside = data.rename(data.with_name("aside"))
        assert as_message(held.problem()).code == "data_folder_lost"
        assert refused(aside)
        assert refused(data)
        aside.rename(data)
        assert held.problem() == ""


def test_a_lock_that_was_deleted_is_told(data: Path) -> None:
    with lock_for_service(data) as held:
        (data / "service.lock").unlink()
        problem = as_message(held.problem())
        assert (problem.code, problem.values["lock"]) == ("data_folder_lock_lost", data / "service.lock")
        assert refused(data)


def test_the_same_folder_by_another_path_takes_no_second_service(data: Path, tmp_path: Path) -> None:
    with lock_for_service(data):
        (tmp_path / "link").symlink_to(data)
        assert refused(tmp_path / "link")


def test_the_address_is_that_of_a_service_that_lives(data: Path) -> None:
    assert read_service_address(data) is None
    with lock_for_service(data) as held:
        assert read_service_address(data) is None
        held.write_address("http://127.0.0.1:1234")
        assert read_service_address(data) == "http://127.0.0.1:1234"
    assert read_service_address(data) is None
    (data / "service.lock").write_text("http://127.0.0.1:1234")  # as one that was killed leaves it
    assert read_service_address(data) is None


def test_a_held_folder_ends_with_its_process(data: Path) -> None:
    program = (
        "import sys, os, signal, pathlib, backend.data_folder as d\n"
        "with d.lock_for_service(pathlib.Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", program, str(data)], check=False)
    with lock_for_service(data) as held:
        assert isinstance(held, LockedFolder)


def test_a_folder_is_held_by_services_and_by_commands_that_play(data: Path) -> None:
    def is_free() -> bool:
        with lock_if_unused(data) as free:
            assert not free or refused(data)
            return free

    assert is_free()
    with lock_for_service(data):
        assert not is_free()
    with lock_for_command(data), lock_for_command(data):
        assert not is_free()
    assert is_free()


def test_a_service_that_has_not_begun_to_answer_is_told_from_none(data: Path) -> None:
    assert as_message(describe_missing_address(data)).code == "no_service"
    with lock_for_service(data) as held:
        assert read_service_addresses(data) == []
        assert as_message(describe_missing_address(data)).code == "service_is_starting"
        held.write_address("http://127.0.0.1:8000")
        assert read_service_addresses(data) == ["http://127.0.0.1:8000"]
    missing = as_message(describe_missing_address(data))
    assert (missing.code, missing.values) == ("no_service", {"folder": data})
