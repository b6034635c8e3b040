"""Locks the data folder for one service or for commands, and restricts its access.

Two locks complement each other. A lock on a file in the folder is found through every path to the folder; a lock on
the folder's path is found even after the folder was deleted and created again.
"""

import asyncio
import fcntl
import hashlib
import os
import socket
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from backend import messages
from backend.supervision import Part
from plant import ErrorCode, SinewError

# Locks ---------------------------------------------------------------------------------------------
DATA_FOLDER_PART = Part(
    "The check of the data folder", "Until the monitor restarts, a deleted or replaced folder is not detected."
)
SERVICE_LOCK_FILE = "service.lock"
COMMAND_LOCK_FILE = "commands.lock"
CHECK_PERIOD_S = 0.5


class AlreadyRunningError(SinewError):
    """Another service uses this data folder."""

    category = ErrorCode.NOT_NOW


class DataFolderError(SinewError):
    """The data folder cannot be used; the message has the reason and the remedy."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True)
class LockedFolder:
    """A data folder that this process has locked.

    ``folder`` and ``lock`` are descriptors of the folder and of its lock file.
    """

    path: Path
    folder: int
    lock: int

    def write_address(self, address: str, public_url: str | None = None) -> None:
        """Write the service's address, and that of its proxy, for other processes."""
        os.ftruncate(self.lock, 0)
        os.pwrite(self.lock, "\n".join((address, *([public_url] if public_url else []))).encode(), 0)

    def problem(self) -> str:
        """Return why written files are lost, "" when there is no problem."""
        for path, descriptor in ((self.path, self.folder), (self.path / SERVICE_LOCK_FILE, self.lock)):
            opened = os.fstat(descriptor)
            try:
                found = path.stat()
            except OSError as error:
                return self._describe_loss(path, error.strerror or str(error))
            if (found.st_dev, found.st_ino) != (opened.st_dev, opened.st_ino):
                return self._describe_loss(path, "it was replaced")
        return ""

    def _describe_loss(self, path: Path, why: str) -> str:
        if path == self.path:
            return messages.data_folder_lost(folder=path, reason=why)
        return messages.data_folder_lock_lost(lock=path, reason=why)


@contextmanager
def lock_for_service(data: Path) -> Iterator[LockedFolder]:
    """Lock the data folder for the only service that may use it.

    A second service would take the open runs of the first for interrupted ones. Raises AlreadyRunningError,
    DataFolderError.
    """
    with ExitStack() as stack:
        path = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        try:
            path.bind(_lock_socket_name(data))
        except OSError:
            raise AlreadyRunningError(messages.data_folder_path_in_use(folder=data)) from None
        try:
            data.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder = os.open(data, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, folder)
            lock = os.open(data / SERVICE_LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o600)
            stack.callback(os.close, lock)
        except OSError as error:
            raise DataFolderError(_describe_os_error(data, error)) from None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AlreadyRunningError(messages.data_folder_in_use(folder=data)) from None
        held = LockedFolder(data, folder, lock)
        held.write_address("")
        yield held
        held.write_address("")


@contextmanager
def lock_for_command(data: Path) -> Iterator[None]:
    """Protect the open runs of a command from being taken for interrupted ones.

    Several commands can hold this lock at the same time.
    """
    with (data / COMMAND_LOCK_FILE).open("ab") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        yield


@contextmanager
def lock_if_unused(data: Path) -> Iterator[bool]:
    """Lock a folder that neither a service nor a command uses.

    The context yields whether the lock was taken; until it ends no service or command can start.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(lock_for_service(data))
            fcntl.flock(stack.enter_context((data / COMMAND_LOCK_FILE).open("ab")), fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_locked = True
        except (AlreadyRunningError, DataFolderError, OSError):
            is_locked = False
        yield is_locked


def read_service_address(data: Path) -> str | None:
    """Return the address of a data folder's service, None without a service.

    Raises DataFolderError.
    """
    return next(iter(read_service_addresses(data)), None)


def describe_missing_address(data: Path) -> str:
    """Return why ``read_service_addresses`` is empty: no service, or it is starting."""
    try:
        is_starting = _is_locked(data / SERVICE_LOCK_FILE)
    except OSError:
        is_starting = False
    if is_starting:
        return messages.service_is_starting(folder=data)
    return messages.no_service(folder=data)


def _is_locked(lock: Path) -> bool:
    """Return whether a service holds the lock. Raises OSError if it cannot be opened."""
    with lock.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def read_service_addresses(data: Path) -> list[str]:
    """Return the address of a data folder's service, followed by its public URL.

    The list is empty without a service. Raises DataFolderError.
    """
    try:
        addresses = (data / SERVICE_LOCK_FILE).read_text(encoding="utf-8").splitlines()
        # locked by the service that wrote it, not left over from one that was killed
        return addresses if addresses and _is_locked(data / SERVICE_LOCK_FILE) else []
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DataFolderError(_describe_os_error(data, error)) from None


class DataFolderMonitor:
    """Checks periodically that written files are not lost.

    ``checks`` return a problem each, "" if there is none; ``problem`` is the first of them. ``on_change`` is called
    when it changes.
    """

    def __init__(self, checks: Sequence[Callable[[], str]], on_change: Callable[[], None] = lambda: None) -> None:
        self.problem = ""
        self._checks = checks
        self._on_change = on_change

    async def run(self) -> None:
        """Check until cancelled, in a thread: a network drive may block."""
        while True:
            problem = await asyncio.to_thread(self._find_problem)
            if problem != self.problem:
                self.problem = problem
                self._on_change()
            await asyncio.sleep(CHECK_PERIOD_S)

    def _find_problem(self) -> str:
        return next((problem for check in self._checks if (problem := check())), "")


def _lock_socket_name(data: Path) -> bytes:
    """Return the name of the abstract socket that locks a path.

    The socket is in no file system and disappears with the process that bound it.
    """
    return b"\0sinew-data-" + hashlib.sha256(os.fsencode(data.resolve())).hexdigest().encode()


def _describe_os_error(data: Path, error: OSError) -> str:
    if isinstance(error, PermissionError):
        return messages.data_folder_not_permitted(path=error.filename or data, reason=error.strerror)
    if isinstance(error, FileExistsError | NotADirectoryError):
        return messages.data_folder_is_a_file(folder=data)
    return messages.data_folder_unusable(folder=data, path=error.filename, reason=error.strerror)


# Access rights -------------------------------------------------------------------------------------
# No other account of the machine may read tokens, sessions or recordings.


FOLDER_MODE, FILE_MODE = 0o700, 0o600
UMASK = 0o077
"""Mask for the whole process: files that SQLite and others create are private."""

_PRIVATE_FILES = (
    "sinew*.db*",
    "token",
    "viewer-token",
    "signing-key",
    "*.new",
    "sessions.json",
    "service.lock",
    "backups/*",
)


def make_private(data: Path) -> list[str]:
    """Create the data folder and remove the access rights of other accounts.

    Existing files of the service are included; a folder that all accounts share (sticky bit) keeps its rights. Returns
    a message for each path whose rights could not be changed.
    """
    data.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    return [problem for path, mode in _list_private_paths(data) if (problem := _restrict_mode(path, mode))]


def write_private(path: Path, text: str) -> None:
    """Replace a file atomically, readable by its owner only. Raises OSError."""
    new = path.with_name(f"{path.name}.new")
    descriptor = os.open(new, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_NOFOLLOW, FILE_MODE)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        os.fchmod(file.fileno(), FILE_MODE)
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(new, path)


def _list_private_paths(data: Path) -> Iterator[tuple[Path, int]]:
    if not data.stat().st_mode & stat.S_ISVTX:  # such as /tmp
        yield data, FOLDER_MODE
    if (data / "backups").is_dir():
        yield data / "backups", FOLDER_MODE
    for pattern in _PRIVATE_FILES:
        for path in data.glob(pattern):
            if path.is_file() and not path.is_symlink():
                yield path, FILE_MODE


def _restrict_mode(path: Path, mode: int) -> str | None:
    if stat.S_IMODE(path.stat().st_mode) & ~mode == 0:
        return None
    try:
        path.chmod(mode)
    except PermissionError:
        return f"{path} is accessible to other accounts and is owned by another account: change its mode to {mode:o}"
    return None
