"""Loads the classes and functions of users that a scenario names.

Such code is called a plug-in, or the user's own. It may fail in any way. So it is called through
`contained`, and its errors become a ScenarioError with the place in the user's files (`unusable`).
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

# What is caught where a user's code is called: all that it may raise, also SystemExit, so that it
# ends neither other agents nor the run. Ctrl-C is not the code's (see `reraise_ctrl_c`).
MISTAKES = BaseException
# For how long threads of a user's code may still run when the program is over, s.
LEFT_SECONDS = 2.0
# Characters of an error of a user's code that are shown at most.
LONGEST_FAULT = 500
IMPORTED = (
    "modules are imported from the directory in which you run the program, or from PYTHONPATH"
)
# Python's instruction for the statement `raise`.
_RAISE = dis.opmap["RAISE_VARARGS"]
# The folder of the package `orchard`, and the folders of Python's own modules and of libraries,
# which tell the user's own files from all others.
_PACKAGE = __file__.removesuffix("field/plugins.py")
_LIBRARIES = tuple(
    {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
)


# The function fesetenv of C sets the processor's floating-point flags of this thread. Linux defines
# its argument FE_DFL_ENV, the default flags, as the pointer -1. Elsewhere `bool` takes its place,
# which does nothing.
_SET_FLAGS = ctypes.CDLL(None).fesetenv if sys.platform == "linux" else bool
_DEFAULT_FLAGS = ctypes.c_void_p(-1)
Result = TypeVar("Result")


def contained(call: Callable[..., Result], *arguments: Any) -> Result:
    """Call a user's code, and return what it returns.

    The code may change settings of the whole thread: numpy's treatment of errors, decimal's
    context, Python's recursion limit and, on Linux, the processor's floating-point flags. After the
    call they are as before, so no agent changes what others compute.
    """
    limit = sys.getrecursionlimit()
    try:
        # numpy and decimal keep their settings in the context, of which the code gets a copy.
        return copy_context().run(_with_own_decimals, call, *arguments)
    finally:
        sys.setrecursionlimit(limit)
        _SET_FLAGS(_DEFAULT_FLAGS)


def _with_own_decimals(call: Callable[..., Result], *arguments: Any) -> Result:
    """Call a user's code with a decimal context that it may change."""
    decimal.setcontext(decimal.Context())
    return call(*arguments)


def end_soon(code: int, show: Callable[[str], None]) -> None:
    """End this process with the exit code `code` in LEFT_SECONDS, if it has not ended by then.

    Call it when the process is about to end: Python would wait for all threads that a user's code
    has left. `show` then gets a sentence with their names.
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
    """Return the object at `path`, 'module.name' or 'module:name'.

    `key`: the scenario's key with this path, for errors. Raises ScenarioError.
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

    `key`: the scenario's key with this path, for errors. `builtin`: name -> built-in class.
    `arguments`: what the class is called with. `methods`: those that the object must have. `base`:
    of which the class must be derived. Raises ScenarioError if the object cannot be made, or is not
    of that kind.
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
    """Return an object of a user's class.

    Raises what the class raises. If its `__init__` takes other arguments, the TypeError says with
    which arguments the program calls it.
    """
    try:
        return contained(class_, *arguments)
    except TypeError as error:
        last_frame = traceback.extract_tb(error.__traceback__)[-1]
        # The call itself failed, before any code of the class ran.
        is_of_call = last_frame.name == _with_own_decimals.__name__
        if not is_of_call:
            raise
        names = ", ".join(map(_name_of_argument, arguments))
        raise TypeError(f"{error}; the program calls it with ({names})") from None


def unusable(
    key: str, path: str, error: BaseException, wanted: str = "", place: str = ""
) -> ScenarioError:
    """Return the error for a plug-in that cannot be used.

    `key` and `path`: the scenario's key, and the plug-in that it names. `error`: what was raised.
    `wanted`: what is allowed, in words. `place`: where the plug-in begins, used if the error has no
    place in the user's files. Ctrl-C is raised again instead.
    """
    reraise_ctrl_c(error)
    fault = printable(fault_words(error), LONGEST_FAULT)
    own_place = place_of_error(error) or place or _file_of_module(path)
    words = f"cannot be used: {fault}{own_place}"
    if wanted:
        words = f"{words}; it must be {wanted}"
    elif _is_not_found(error, path):
        words = f"{words}; {IMPORTED}"
    return ScenarioError([Problem("scenario", words, key, path)])


def _name_of_argument(argument: object) -> str:
    """Return what an error calls an argument: 'name' for a text, else its class in small letters.

    Texts that the program gives to a user's class are names of agents.
    """
    if isinstance(argument, str):
        return "name"
    return type(argument).__name__.lower()


def _file_of_module(path: str) -> str:
    """Return the file of the module of a class, as ' (FILE)'; '' if it is unknown.

    `path`: of the class. It is needed where Python's error has no file: the module has no such
    class, or it has a null byte, so that it could not be imported.
    """
    module = path.replace(":", ".").rpartition(".")[0]
    file = getattr(sys.modules.get(module), "__file__", None)
    if file:
        return f" ({file})"
    parts = module.split(".")
    # Where the next part is looked for; None: on Python's path, as for the first part.
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
    # A dot at the end of both, so that `my` is no part of `my_package.MyPicker`.
    return f"{dotted_path}.".startswith(f"{error.name}.")


def fault_words(error: BaseException) -> str:
    """Return the class and the text of an error of a user's code: "KeyError: 'bin_07'".

    An error without a text has its class alone.
    """
    text = text_of(error)
    if not text:
        return type(error).__name__
    return f"{type(error).__name__}: {text}"


def text_of(error: BaseException) -> str:
    """Return the text of an error of a user's code, also if its `__str__` raises one itself."""
    try:
        return str(error)
    except MISTAKES as second:
        reraise_ctrl_c(second)
        return "its text cannot be read"


def reraise_ctrl_c(error: BaseException) -> None:
    """Raise an error again if a signal's handler raised it, and not a user's code by itself.

    So Ctrl-C at the terminal ends the program, also where all errors of a user's code are caught.
    """
    # The code of each frame in the traceback, from the outermost, and the place in the innermost
    # one where the error was raised.
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
    # Python's own handler of Ctrl-C has no frame: it interrupts any instruction. A user's code that
    # raises KeyboardInterrupt itself does so by `raise`.
    is_raised_by_code = bool(codes) and codes[-1].co_code[last_instruction] == _RAISE
    if not is_raised_by_code:
        raise error


def place_of_error(error: BaseException) -> str:
    """Return the place in the user's files from which an error comes, as ' (FILE, line N)'.

    If a library raised it, that is where the user's code called the library. Without a place in the
    user's files it is that in the library; '' if there is none either.
    """
    if isinstance(error, SyntaxError) and error.filename is not None:
        return f" ({error.filename}, line {error.lineno})"
    # The innermost place in any file but the program's own, and in a file of the user.
    innermost = ""
    innermost_of_user = ""
    # From the outermost frame to the innermost one, so the last place stays.
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
    """Whether a Python file is the user's own: neither of this package nor of a library."""
    return file.endswith(".py") and not file.startswith((_PACKAGE, *_LIBRARIES))


def place_of_class(class_: Callable[..., Any]) -> str:
    """Return the place where a class or a function begins, as ' (FILE, line N)'; '' if unknown."""
    try:
        _, line = inspect.getsourcelines(class_)
        return f" ({inspect.getsourcefile(class_)}, line {line})"
    except (OSError, TypeError):
        return ""
