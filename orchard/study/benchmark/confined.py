"""Rights that the process of a policy gives up before it imports the policy's module: to read
hidden files, to look into other processes, and to send them signals.

Only Linux can do that. It uses prctl, capset, resource limits and Landlock, each by a system call,
because Python has no functions for them. Processes that this one starts have given up the same.
"""

import ctypes
import os
import resource
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

# Numbers from the headers of Linux, under other names.
# linux/prctl.h: PR_SET_PDEATHSIG, PR_SET_NO_NEW_PRIVS. SIGKILL.
_DIE_WITH_PARENT = 1
_NO_NEW_PRIVILEGES = 38
_SIGKILL = 9
# linux/capability.h: _LINUX_CAPABILITY_VERSION_3, which takes six words of 32 bits.
_CAPABILITIES_VERSION = 0x20080522
_CAPABILITY_WORDS = 6
# linux/landlock.h. First its three system calls, which have these numbers on each processor of 64
# bits; then their flags.
_CREATE_RULESET = 444
_ADD_RULE = 445
_RESTRICT_SELF = 446
_TELL_VERSION = 1
_PATH_BENEATH = 1
_READ_FILE = 1 << 2
_OWN_SIGNALS_ONLY = 1 << 1
# The version of Landlock that can keep signals in, of Linux 6.12.
_KNOWS_SIGNALS = 6


class _Ruleset(ctypes.Structure):
    """Landlock's attributes of a ruleset: what it forbids unless a rule allows it."""

    _fields_ = (
        ("handled_files", ctypes.c_uint64),
        ("handled_network", ctypes.c_uint64),
        ("scoped", ctypes.c_uint64),
    )


class _PathRule(ctypes.Structure):
    """Landlock's rule for a folder or a file: what is allowed there and below."""

    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def drop_rights() -> None:
    """Give up all capabilities of this process, and let it end with its parent.

    So it cannot look into other processes. A program that it starts gets no right back, even if the
    program belongs to root and is marked to run as root.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    library.prctl(_DIE_WITH_PARENT, _SIGKILL, 0, 0, 0)
    library.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    head = (ctypes.c_uint32 * 2)(_CAPABILITIES_VERSION, 0)
    library.capset(head, (ctypes.c_uint32 * _CAPABILITY_WORDS)())


def limit(resource_kind: int, most: int, beyond: int = 0) -> None:
    """Limit what this process may use of a resource.

    `most`: from which on it gets an error or a signal (the soft limit). `beyond`: how much more it
    may use until the system ends it (the hard limit).
    """
    # The system may allow less already.
    _, allowed = resource.getrlimit(resource_kind)
    if allowed != resource.RLIM_INFINITY:
        most = min(most, allowed - beyond)
    resource.setrlimit(resource_kind, (most, most + beyond))


def can_hide() -> bool:
    """Whether the system can hide files from a process: Linux 5.13 or newer, with Landlock."""
    return _landlock_version() > 0


def can_keep_signals_in() -> bool:
    """Whether the system can keep a process from signals to others: Linux 6.12 or newer."""
    return _landlock_version() >= _KNOWS_SIGNALS


def confine(hidden: Collection[Path]) -> None:
    """Hide files from this process for ever, and shut it off from other processes.

    It can no longer read these files, look into other processes, or send signals to them. Landlock
    only knows what is allowed. So all folders and files are allowed in which no hidden file is, and
    a file that is made later in a folder above a hidden one is hidden too. Where the system can do
    less (`can_hide`), less is done. Call `drop_rights` first: Landlock demands it.
    """
    version = _landlock_version()
    if version <= 0:
        return
    library = ctypes.CDLL(None)
    ruleset = _Ruleset(_READ_FILE, 0, 0)
    size = ctypes.sizeof(ctypes.c_uint64)
    if version >= _KNOWS_SIGNALS:
        ruleset.scoped = _OWN_SIGNALS_ONLY
        size = ctypes.sizeof(ruleset)
    rules = library.syscall(_CREATE_RULESET, ctypes.byref(ruleset), size, 0)
    if rules < 0:
        return
    resolved = [path.resolve() for path in hidden]
    for path in _readable(Path("/"), resolved):
        try:
            opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            # The file is gone meanwhile, or cannot be read anyway.
            continue
        rule = _PathRule(_READ_FILE, opened)
        library.syscall(_ADD_RULE, rules, _PATH_BENEATH, ctypes.byref(rule), 0)
        os.close(opened)
    library.syscall(_RESTRICT_SELF, rules, 0)
    os.close(rules)


def _landlock_version() -> int:
    """Return the version of Landlock that the system has; 0 or less: none."""
    if sys.platform != "linux" or sys.maxsize <= 2**32:
        return 0
    version: int = ctypes.CDLL(None).syscall(_CREATE_RULESET, None, 0, _TELL_VERSION)
    return version


def _readable(folder: Path, hidden: Collection[Path]) -> Iterator[Path]:
    """Yield all files and folders below a folder in which no file is hidden, as few as possible."""
    if folder in hidden:
        return
    if not any(folder in path.parents for path in hidden):
        yield folder
        return
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for entry in entries:
        if entry.is_symlink():
            # Its target is allowed or hidden by its own path.
            continue
        yield from _readable(entry, hidden)
