"""One service for each data folder, beside commands that play there, and a look at whether the folder is still there.

Two locks, as each covers what the other cannot see: one on a file in the folder, found by whoever reaches that file by
any path; one on the folder's path, found after the folder was deleted and another made in its place.
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

from backend.supervision import Part
from plant import ErrorCode, SinewError

# Data folder ---------------------------------------------------------------------------------------


DATA_FOLDER_PART = Part("The look at the data folder", "Nothing tells meanwhile whether it was deleted or replaced.")
LOCK = "service.lock"
COMMANDS = "commands.lock"
LOOK_S = 0.5


class AlreadyRunningError(SinewError):
    """Another service works on this data folder."""

    category = ErrorCode.NOT_NOW


class DataFolderError(SinewError):
    """The data folder cannot be used; the message says why and what to do."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True)
class HeldFolder:
    """A data folder that is held by this process; ``folder`` and ``lock`` are descriptors of it and of its lock."""

    path: Path
    folder: int
    lock: int

    def say_address(self, address: str, public_url: str | None = None) -> None:
        """Leave the address at which the service answers for ``address_of_service``, and that of a proxy before it."""
        os.ftruncate(self.lock, 0)
        os.pwrite(self.lock, "\n".join((address, *([public_url] if public_url else []))).encode(), 0)

    def problem(self) -> str:
        """Return why what is written to the folder is not kept, "" while all is well."""
        for path, descriptor in ((self.path, self.folder), (self.path / LOCK, self.lock)):
            ours = os.fstat(descriptor)
            try:
                there = path.stat()
            except OSError as error:
                return self._told(path, error.strerror or str(error))
            if (there.st_dev, there.st_ino) != (ours.st_dev, ours.st_ino):
                return self._told(path, "another one stands in its place")
        return ""

    def _told(self, path: Path, why: str) -> str:
        what = "the data folder" if path == self.path else "the lock in the data folder"
        return (
            f"{what} {path} was deleted, moved or replaced while the service works on it ({why}): what is recorded now "
            "is not kept. Put it back where it was, or stop the service and start it again"
        )


@contextmanager
def only_service_on(data: Path) -> Iterator[HeldFolder]:
    """Hold the data folder, so that no second service takes its open runs for interrupted ones.

    Raises AlreadyRunningError, DataFolderError.
    """
    with ExitStack() as stack:
        path = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        try:
            path.bind(_name_of(data))
        except OSError:
            raise AlreadyRunningError(
                f"another service works on the folder {data}, or on one that was there before: stop it or choose --data"
            ) from None
        try:
            data.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder = os.open(data, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, folder)
            lock = os.open(data / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
            stack.callback(os.close, lock)
        except OSError as error:
            raise DataFolderError(_refused(data, error)) from None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AlreadyRunningError(f"another service works on the folder {data}: stop it or choose --data") from None
        held = HeldFolder(data, folder, lock)
        held.say_address("")
        yield held
        held.say_address("")


@contextmanager
def playing_in(data: Path) -> Iterator[None]:
    """Let nobody take the open runs of this command for interrupted ones; other commands may play beside it."""
    with (data / COMMANDS).open("ab") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        yield


@contextmanager
def held_by_nobody(data: Path) -> Iterator[bool]:
    """Give whether neither a service nor a command plays in a folder; in the block none begins to."""
    with ExitStack() as stack:
        try:
            stack.enter_context(only_service_on(data))
            fcntl.flock(stack.enter_context((data / COMMANDS).open("ab")), fcntl.LOCK_EX | fcntl.LOCK_NB)
            free = True
        except (AlreadyRunningError, DataFolderError, OSError):
            free = False
        yield free


def address_of_service(data: Path) -> str | None:
    """Return where the service of a data folder answers, None when there is none. Raises DataFolderError."""
    return next(iter(addresses_of_service(data)), None)


def why_no_address(data: Path) -> str:
    """Return in words why ``addresses_of_service`` is empty: none works there, or one has not begun to answer."""
    try:
        is_starting = _is_held(data / LOCK)
    except OSError:
        is_starting = False
    if is_starting:
        return f"the service on the folder {data} is still starting: try again once it has printed where it answers"
    return f"no service works on the folder {data}: start it with `sinew serve`, or choose --data"


def _is_held(lock: Path) -> bool:
    """Return whether a service holds the lock. Raises OSError where the file cannot be opened."""
    with lock.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def addresses_of_service(data: Path) -> list[str]:
    """Return where the service of a data folder answers, behind it its public URL where it has one.

    Empty when there is no service. Raises DataFolderError.
    """
    try:
        addresses = (data / LOCK).read_text(encoding="utf-8").splitlines()
        # held by the service that wrote it, not left behind by one that was killed
        return addresses if addresses and _is_held(data / LOCK) else []
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DataFolderError(_refused(data, error)) from None


class FolderWatch:
    """Looks again and again whether what is written is still kept; ``problem`` says why it is not.

    ``looks`` return a sentence each, "" while all is well; ``changed`` is told when the answer is another one.
    """

    def __init__(self, looks: Sequence[Callable[[], str]], changed: Callable[[], None] = lambda: None) -> None:
        self.problem = ""
        self._looks = looks
        self._changed = changed

    async def run(self) -> None:
        """Look until cancelled, in a thread: a network drive may let a look wait."""
        while True:
            found = await asyncio.to_thread(self._look)
            if found != self.problem:
                self.problem = found
                self._changed()
            await asyncio.sleep(LOOK_S)

    def _look(self) -> str:
        return next((said for look in self._looks if (said := look())), "")


def _name_of(data: Path) -> bytes:
    """Name of a socket that stands for a path; it is in no file system and ends with the process that holds it."""
    return b"\0sinew-data-" + hashlib.sha256(os.fsencode(data.resolve())).hexdigest().encode()


def _refused(data: Path, error: OSError) -> str:
    if isinstance(error, PermissionError):
        remedy = "change its owner or mode, or choose another --data"
        return f"{error.filename or data} cannot be used: {error.strerror}; {remedy}"
    if isinstance(error, FileExistsError | NotADirectoryError):
        return f"the data folder {data} is a file or lies below one: choose another --data"
    return f"the data folder {data} cannot be used: {error.strerror} ({error.filename}); choose another --data"


# Private -------------------------------------------------------------------------------------------
#
# Keeps what the service writes to its owner: no other account of the machine reads tokens, sessions
# or recordings.


FOLDER, FILE = 0o700, 0o600
UMASK = 0o077
"""For the whole process from its start on: what SQLite and others create is born private."""

_OURS = ("sinew*.db*", "token", "viewer-token", "signing-key", "*.new", "sessions.json", "service.lock", "backups/*")


def make_private(data: Path) -> list[str]:
    """Create the data folder, and take from others what they may do there, old files of ours included.

    Returns a sentence for each place that could not be changed; a folder that everyone shares is left as it is.
    """
    data.mkdir(mode=FOLDER, parents=True, exist_ok=True)
    return [sentence for path, mode in _places(data) if (sentence := _tighten(path, mode))]


def write_private(path: Path, text: str) -> None:
    """Put a file in the place of ``path``, whole or not at all, readable by its owner only. Raises OSError."""
    fresh = path.with_name(f"{path.name}.new")
    descriptor = os.open(fresh, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_NOFOLLOW, FILE)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        os.fchmod(file.fileno(), FILE)
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(fresh, path)


def _places(data: Path) -> Iterator[tuple[Path, int]]:
    if not data.stat().st_mode & stat.S_ISVTX:  # such as /tmp
        yield data, FOLDER
    if (data / "backups").is_dir():
        yield data / "backups", FOLDER
    for pattern in _OURS:
        for path in data.glob(pattern):
            if path.is_file() and not path.is_symlink():
                yield path, FILE


def _tighten(path: Path, mode: int) -> str | None:
    if stat.S_IMODE(path.stat().st_mode) & ~mode == 0:
        return None
    try:
        path.chmod(mode)
    except PermissionError:
        return f"{path} can be used by other accounts and belongs to another one: change its mode to {mode:o}"
    return None
