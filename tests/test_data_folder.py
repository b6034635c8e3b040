"""One service per data folder, even if the folder is moved or replaced."""

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
    """Return ``text``, checked to be a message."""
    assert isinstance(text, Message)
    return text


def is_refused(data: Path) -> bool:
    """Return whether a second process is refused the data folder."""
    program = "import sys, pathlib, backend.data_folder as d\nwith d.lock_for_service(pathlib.Path(sys.argv[1])): pass"
    ended = subprocess.run([sys.executable, "-c", program, str(data)], capture_output=True, text=True, check=False)
    assert ended.returncode == 0 or AlreadyRunningError.__name__ in ended.stderr, ended.stderr
    return ended.returncode != 0


def test_a_replaced_folder_is_reported_and_accepts_no_second_service(data: Path) -> None:
    with lock_for_service(data) as locked:
        assert locked.problem() == ""
        shutil.rmtree(data)
        problem = as_message(locked.problem())
        assert (problem.code, problem.values["folder"]) == ("data_folder_lost", data)
        assert is_refused(data)
        assert not data.exists()
        data.mkdir()
        (data / "service.lock").touch()
        assert as_message(locked.problem()).values == {"folder": data, "reason": "it was replaced"}
        assert is_refused(data)
    assert not is_refused(data)


def test_a_moved_folder_is_reported_until_it_is_moved_back(data: Path) -> None:
    with lock_for_service(data) as locked:
        moved = data.rename(data.with_name("aside"))
        assert as_message(locked.problem()).code == "data_folder_lost"
        assert is_refused(moved)
        assert is_refused(data)
        moved.rename(data)
        assert locked.problem() == ""


def test_a_deleted_lock_file_is_reported(data: Path) -> None:
    with lock_for_service(data) as locked:
        (data / "service.lock").unlink()
        problem = as_message(locked.problem())
        assert (problem.code, problem.values["lock"]) == ("data_folder_lock_lost", data / "service.lock")
        assert is_refused(data)


def test_a_symbolic_link_to_the_folder_accepts_no_second_service(data: Path, tmp_path: Path) -> None:
    with lock_for_service(data):
        (tmp_path / "link").symlink_to(data)
        assert is_refused(tmp_path / "link")


def test_the_address_is_read_only_from_a_running_service(data: Path) -> None:
    assert read_service_address(data) is None
    with lock_for_service(data) as locked:
        assert read_service_address(data) is None
        locked.write_address("http://127.0.0.1:1234")
        assert read_service_address(data) == "http://127.0.0.1:1234"
    assert read_service_address(data) is None
    (data / "service.lock").write_text("http://127.0.0.1:1234")  # as a killed service leaves it
    assert read_service_address(data) is None


def test_a_killed_process_releases_its_folder(data: Path) -> None:
    program = (
        "import sys, os, signal, pathlib, backend.data_folder as d\n"
        "with d.lock_for_service(pathlib.Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", program, str(data)], check=False)
    with lock_for_service(data) as locked:
        assert isinstance(locked, LockedFolder)


def test_services_and_commands_lock_the_folder(data: Path) -> None:
    def is_free() -> bool:
        with lock_if_unused(data) as free:
            assert not free or is_refused(data)
            return free

    assert is_free()
    with lock_for_service(data):
        assert not is_free()
    with lock_for_command(data), lock_for_command(data):
        assert not is_free()
    assert is_free()


def test_a_starting_service_is_distinguished_from_a_missing_one(data: Path) -> None:
    assert as_message(describe_missing_address(data)).code == "no_service"
    with lock_for_service(data) as locked:
        assert read_service_addresses(data) == []
        assert as_message(describe_missing_address(data)).code == "service_is_starting"
        locked.write_address("http://127.0.0.1:8000")
        assert read_service_addresses(data) == ["http://127.0.0.1:8000"]
    missing = as_message(describe_missing_address(data))
    assert (missing.code, missing.values) == ("no_service", {"folder": data})
