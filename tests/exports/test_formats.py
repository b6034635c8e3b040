"""Files are written completely or not at all: on a full disk, by a killed process, over existing files."""

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.exports.formats import write_file_whole, write_files_whole

BOUND = 4096
"""Bytes that a file may have where the disk is full."""


@pytest.fixture
def small_files() -> Iterator[None]:
    """Bound the size of files: writing beyond the bound fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handled = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (BOUND, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handled)


@pytest.fixture(params=[True, False], ids=["content without a name", "file systems without it"])
def without_name(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    if not request.param:
        monkeypatch.delattr("os.O_TMPFILE")
    return bool(request.param)


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.usefixtures("without_name")
def test_a_replaced_file_retains_its_permissions(tmp_path: Path) -> None:
    (tmp_path / "there").write_bytes(b"old")
    (tmp_path / "there").chmod(0o640)
    (tmp_path / "link").symlink_to("there")
    write_files_whole({tmp_path / "link": (b"a", b"b"), tmp_path / "new": (b"c",)})
    assert contents(tmp_path) == {"there": b"ab", "link": b"ab", "new": b"c"}
    assert (tmp_path / "there").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "link").is_symlink()


@pytest.mark.usefixtures("without_name", "small_files")
def test_a_full_disk_leaves_all_files_unchanged_and_the_error_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "first").write_bytes(b"old")
    with pytest.raises(OSError, match="File too large") as refused:
        write_files_whole({tmp_path / "first": (b"new",), tmp_path / "second": (bytes(BOUND), b"more")})
    assert refused.value.filename == str(tmp_path / "second")
    assert contents(tmp_path) == {"first": b"old"}


@pytest.mark.usefixtures("without_name")
def test_an_error_while_generating_content_leaves_no_file(tmp_path: Path) -> None:
    def pieces() -> Iterator[bytes]:
        yield b"begun"
        raise LookupError

    with pytest.raises(LookupError):
        write_file_whole(pieces(), tmp_path / "file")
    assert contents(tmp_path) == {}


@pytest.mark.parametrize(("name", "error"), [("no/file", FileNotFoundError), ("folder", IsADirectoryError)])
def test_the_error_names_a_path_that_cannot_be_written(tmp_path: Path, name: str, error: type[OSError]) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(error) as refused:
        write_file_whole((b"",), tmp_path / name)
    assert refused.value.filename == str(tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == ["folder"]


def test_a_killed_process_leaves_no_partial_file(tmp_path: Path) -> None:
    program = (
        "import time; from pathlib import Path; from backend.exports import write_file_whole\n"
        "def pieces():\n yield bytes(1 << 20); print(flush=True); time.sleep(60)\n"
        f"write_file_whole(pieces(), Path({str(tmp_path / 'file')!r}))"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"\n"
        time.sleep(0.05)
        writer.kill()
    assert contents(tmp_path) == {}
