"""Isolate this process and its children from network and mounts, so that no test data can leave."""

import ctypes
import fcntl
import os
import socket
import struct
from functools import cache

_CLONE_NEWNS, _CLONE_NEWUSER, _CLONE_NEWNET = 0x00020000, 0x10000000, 0x40000000
_SIOCSIFFLAGS, _IFF_UP, _IFF_RUNNING = 0x8914, 0x1, 0x40
_MS_REC, _MS_PRIVATE = 0x4000, 0x40000
_LIBC = ctypes.CDLL(None, use_errno=True)


class NotIsolatedError(OSError):
    """The machine grants no own namespaces."""


@cache
def isolate() -> None:
    """Move this process to a network with only a loopback, and to own mounts. Raises NotIsolatedError."""
    own = _CLONE_NEWNET | _CLONE_NEWNS
    user, group = os.getuid(), os.getgid()
    if _LIBC.unshare(own) != 0:
        if _LIBC.unshare(own | _CLONE_NEWUSER) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise NotIsolatedError(f"no network namespace can be had ({reason}): run as root, or allow user namespaces")
        _write("/proc/self/setgroups", "deny")
        _write("/proc/self/uid_map", f"0 {user} 1")
        _write("/proc/self/gid_map", f"0 {group} 1")
    _check(_LIBC.mount(b"none", b"/", None, _MS_REC | _MS_PRIVATE, None), "private mounts")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", _IFF_UP | _IFF_RUNNING))


def mount_small(folder: str, megabytes: int) -> None:
    """Mount an empty file system of ``size_MB`` in memory on ``folder``, visible to this process and its children."""
    isolate()
    _check(_LIBC.mount(b"tmpfs", folder.encode(), b"tmpfs", 0, f"size={megabytes}m".encode()), f"mounting {folder}")


def unmount(folder: str) -> None:
    _check(_LIBC.umount2(folder.encode(), 0), f"unmounting {folder}")


def _write(path: str, text: str) -> None:
    with open(path, "w", encoding="ascii") as file:
        file.write(text)


def _check(result: int, what: str) -> None:
    if result != 0:
        raise NotIsolatedError(f"{what}: {os.strerror(ctypes.get_errno())}")
