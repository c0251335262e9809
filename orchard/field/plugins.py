"""Loads the users' classes and functions that a scenario names, or refuses them with the reason and
its place.
"""

import ctypes
import decimal
import dis
import importlib
import inspect
import os
import signal
import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from contextvars import copy_context
from importlib.machinery import PathFinder
from types import ModuleType
from typing import Any, TypeVar

from orchard.field.problems import Problem, ScenarioError, printable

# Raised by a user's code: whatever it is, it must not end other agents or the run (see
# `reraise_ctrl_c`).
MISTAKES = BaseException
LEFT_SECONDS = 2.0  # that threads of a user's code may still run when the program is over
IMPORTED = (
    "modules are imported from the directory in which you run the program, or from PYTHONPATH"
)
_RAISE = dis.opmap["RAISE_VARARGS"]
_PACKAGE = __file__.removesuffix("field/plugins.py")
_LIBRARIES = tuple(
    {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
)


# Resets the processor's floating-point flags of this thread, if it gets FE_DFL_ENV, as Linux
# defines that.
_SET_FLAGS = ctypes.CDLL(None).fesetenv if sys.platform == "linux" else bool
_DEFAULT_FLAGS = ctypes.c_void_p(-1)
Result = TypeVar("Result")


def contained(call: Callable[..., Result], *arguments: Any) -> Result:
    """Call a user's code, which may set what counts for a whole thread: numpy's treatment of
    errors, decimal's context, Python's recursion limit and, on Linux, the processor's
    floating-point flags. At its end they are as before, so no agent changes what others compute.
    """
    limit = sys.getrecursionlimit()
    try:
        return copy_context().run(_with_own_decimals, call, *arguments)
    finally:
        sys.setrecursionlimit(limit)
        _SET_FLAGS(_DEFAULT_FLAGS)


def _with_own_decimals(call: Callable[..., Result], *arguments: Any) -> Result:
    """Call a user's code with a decimal context that it may change."""
    decimal.setcontext(decimal.Context())
    return call(*arguments)


def end_soon(code: int, show: Callable[[str], None]) -> None:
    """Let this process, which is about to end, not wait for threads that a user's code has left:
    `show` gets their names, and it ends.
    """
    timer = threading.Timer(LEFT_SECONDS, _end_threads, (code, show))
    timer.daemon = True
    timer.start()


def _end_threads(code: int, show: Callable[[str], None]) -> None:
    """End this process at once if threads keep it from its end."""
    remaining = []
    for thread in threading.enumerate():
        if not thread.daemon and thread is not threading.main_thread():
            remaining.append(thread.name)
    if remaining:
        show(
            f"own classes have left threads that still run: {', '.join(remaining)}; the program"
            " ends without them"
        )
        os._exit(code)


def import_own(module: str) -> ModuleType:
    """Import a user's module, which may be in the folder in which the program runs.

    That folder comes last on the path, and only now: its files never take the place of Python's
    own modules or of those of a package, and none runs unless a class of the user's is named.
    Raises what the module raises.
    """
    # The folder may have been removed.
    with suppress(OSError):
        folder = os.getcwd()
        if folder not in sys.path:
            sys.path.append(folder)
    return contained(importlib.import_module, module)


def load_plugin(key: str, path: str) -> Any:
    """Return the object at `path`, 'module.name' or 'module:name', which the scenario names in
    `key`. Raises ScenarioError.
    """
    module, _, name = path.replace(":", ".").rpartition(".")
    try:
        return getattr(import_own(module), name)
    except MISTAKES as error:
        raise unusable(key, path, error) from error


def make_plugin(
    key: str,
    path: str,
    builtin: Mapping[str, Callable[..., Result]],
    *arguments: Any,
    methods: Sequence[str] = (),
    base: type = object,
) -> Result:
    """Return an object of the class that `path` names, built-in or a user's.

    Raises ScenarioError if that fails or a method is missing.
    """
    class_: Callable[..., Result] = builtin[path] if path in builtin else load_plugin(key, path)
    try:
        plugin = made_of(class_, *arguments)
        if not issubclass(type(plugin), base):
            raise TypeError(f"it must be a class that is derived from {base.__name__}")
        missing = [method for method in methods if not hasattr(plugin, method)]
        if missing:
            raise TypeError(f"it has no {' and no '.join(missing)}")
    except MISTAKES as error:
        raise unusable(key, path, error, place=place_of_class(class_)) from error
    return plugin


def made_of(class_: Callable[..., Result], *arguments: Any) -> Result:
    """Call a user's class.

    Raises what it raises; a TypeError of the call itself says with what the program calls it.
    """
    try:
        return contained(class_, *arguments)
    except TypeError as error:
        last_frame = traceback.extract_tb(error.__traceback__)[-1]
        is_of_call = last_frame.name == _with_own_decimals.__name__
        if not is_of_call:
            raise
        names = ", ".join(map(_name_of_argument, arguments))
        raise TypeError(f"{error}; the program calls it with ({names})") from None


def unusable(
    key: str, path: str, error: BaseException, wanted: str = "", place: str = ""
) -> ScenarioError:
    """Return the error for a plug-in that cannot be used: the scenario's key, the fault, its place
    in the user's files, what is allowed.
    """
    reraise_ctrl_c(error)
    fault = printable(f"{type(error).__name__}: {text_of(error)}", 500)
    own_place = place_of_error(error) or place or _place_of_unimported(path)
    words = f"cannot be used: {fault}{own_place}"
    if wanted:
        words = f"{words}; it must be {wanted}"
    elif _is_not_found(error, path):
        words = f"{words}; {IMPORTED}"
    return ScenarioError([Problem("scenario", words, key, path)])


def _name_of_argument(argument: object) -> str:
    """Return what an error calls an argument: 'name' for a text, else its class."""
    if isinstance(argument, str):
        return "name"
    return type(argument).__name__.lower()


def _place_of_unimported(path: str) -> str:
    """Return the file of the module that could not be imported, as ' (FILE)'; '' if it is unknown.

    `path`: of a class. Python does not say which file it could not read, as one with a null byte.
    """
    module = path.replace(":", ".").rpartition(".")[0]
    parts = module.split(".")
    folders = None
    for count in range(1, len(parts) + 1):
        name = ".".join(parts[:count])
        if name in sys.modules:
            folders = getattr(sys.modules[name], "__path__", None)
            continue
        try:
            spec = PathFinder.find_spec(name, folders)
        except (ImportError, OSError, ValueError):
            return ""
        if spec is not None and spec.origin:
            return f" ({spec.origin})"
        return ""
    return ""


def _is_not_found(error: BaseException, path: str) -> bool:
    """Whether the module of a path is missing itself, and not one that it imports."""
    if not isinstance(error, ModuleNotFoundError):
        return False
    dotted_path = path.replace(":", ".")
    return f"{dotted_path}.".startswith(f"{error.name}.")


def text_of(error: BaseException) -> str:
    """Return the text of an error of a user's code. Its `__str__` may itself raise one."""
    try:
        return str(error)
    except MISTAKES as second:
        reraise_ctrl_c(second)
        return "its text cannot be read"


def reraise_ctrl_c(error: BaseException) -> None:
    """Raise an error again if a signal's handler raised it, as for Ctrl-C at the terminal, and not
    a user's code by itself.
    """
    codes = []
    last_instruction = -1
    entry = error.__traceback__
    while entry is not None:
        codes.append(entry.tb_frame.f_code)
        last_instruction = entry.tb_lasti
        entry = entry.tb_next
    on_ctrl_c, on_alarm = (signal.getsignal(number) for number in (signal.SIGINT, signal.SIGALRM))
    for handler in (on_ctrl_c, on_alarm):
        if getattr(handler, "__code__", None) in codes:
            raise error
    if not isinstance(error, KeyboardInterrupt) or on_ctrl_c is not signal.default_int_handler:
        return
    # Python's own handler has no frame, and needs no `raise`.
    is_raised_by_code = bool(codes) and codes[-1].co_code[last_instruction] == _RAISE
    if not is_raised_by_code:
        raise error


def place_of_error(error: BaseException) -> str:
    """Return the place in the user's files where an error was raised, as ' (FILE, line N)', also if
    a library raised it; '' without one.
    """
    if isinstance(error, SyntaxError) and error.filename is not None:
        return f" ({error.filename}, line {error.lineno})"
    # The innermost places, from the outside to the inside, in any file but the program's own.
    innermost = ""
    innermost_of_user = ""
    for frame in traceback.extract_tb(error.__traceback__):
        if "importlib" in frame.filename or frame.filename.startswith(_PACKAGE):
            continue
        innermost = f" ({frame.filename}, line {frame.lineno})"
        if not frame.filename.startswith(_LIBRARIES):
            innermost_of_user = innermost
    if innermost_of_user:
        return innermost_of_user
    if error.__cause__ is not None:
        return place_of_error(error.__cause__) or innermost
    return innermost


def is_own(file: str) -> bool:
    """Return whether a file of Python is the user's own: neither of this package nor of a
    library.
    """
    return file.endswith(".py") and not file.startswith((_PACKAGE, *_LIBRARIES))


def place_of_class(class_: Callable[..., Any]) -> str:
    """Return the place where a class or a function begins, as ' (FILE, line N)'; '' if it is
    unknown.
    """
    try:
        _, line = inspect.getsourcelines(class_)
        return f" ({inspect.getsourcefile(class_)}, line {line})"
    except (OSError, TypeError):
        return ""
