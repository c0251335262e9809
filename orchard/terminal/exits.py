"""How a command ends: its exit codes, and its errors in words that help a user."""

import errno
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import typer
from pydantic import ValidationError
from typer import BadParameter
from typer.exceptions import TyperException

from orchard.field.problems import ScenarioError
from orchard.terminal.output import print_error

FINISHED = 0
FAILED = 1
BAD_INPUT = 2

# pydantic's name of a fault -> what would be right
_EXPECTED = {
    "int_parsing": "a whole number",
    "float_parsing": "a number",
    "greater_than_equal": "a number from {ge:g} on",
    "less_than_equal": "a number up to {le:g}",
}
_EXTRA_WORD = re.compile(r"^Got unexpected extra .*\((.*)\)$")


@contextmanager
def exit_on_errors(*mistakes: type[Exception], code: int = BAD_INPUT) -> Iterator[None]:
    """In this context, print errors of these types and end with an exit code. Raises typer.Exit.

    A user can correct them, unless the code says otherwise.
    """
    try:
        yield
    except typer.Exit:
        # An inner context has printed the error already. It is a RuntimeError too, so it would be
        # printed again if `mistakes` has RuntimeError.
        raise
    except mistakes as error:
        print_error(in_words(error))
        raise typer.Exit(code) from None


@contextmanager
def as_typed(name: Callable[[str], str] = str) -> Iterator[None]:
    """In this context, what cannot be in a scenario is named as a user has typed it.

    `name`: path of a value in the scenario -> what was typed. Raises ScenarioError.
    """
    try:
        yield
    except ScenarioError as error:
        problems = []
        for problem in error.problems:
            problems.append(replace(problem, file="command line", path=name(problem.path)))
        raise ScenarioError(problems) from None


@contextmanager
def needs_extra(purpose: str, extra: str, otherwise: str = "") -> Iterator[None]:
    """In this context, modules are imported that need an extra. Raises typer.Exit without it.

    `purpose`: what needs it, as "A study". `otherwise`: another way to install it.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        name = missing.name or ""
        if name.startswith("orchard."):
            # No extra brings it.
            print_error(lack_of(name, purpose))
        else:
            print_error(
                f"{purpose} needs the package {name}: pip install 'orchard-sim[{extra}]'{otherwise}"
            )
        raise typer.Exit(BAD_INPUT) from None


def lack_of(package: str, purpose: str) -> str:
    """Return that a package of the Orchard, such as orchard.study, has been left out.

    `purpose`: what needs it: "A bound", or the name of a command.
    """
    return (
        f"{purpose}: this installation lacks {package}, which it needs; "
        "expected the whole package orchard-sim"
    )


def in_words(error: Exception) -> str:
    """Return what is wrong, without a number of the system: "runs: Permission denied"."""
    if isinstance(error, UnicodeEncodeError):
        return (
            f"{error.object}: this name is no text in UTF-8, which a run needs; "
            "expected another folder or file"
        )
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        return f"{error.strerror}: `ulimit -n` tells how many may be open, and can allow more"
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def fault_of(error: TyperException) -> str:
    """Return what is wrong, where, and what would be right: "--rows: x: expected a number"."""
    option = getattr(error, "option_name", "")
    if isinstance(error, BadParameter):
        return _of_parameter(error)
    if option:
        return f"{option}: {_of_option(error)}"
    return _EXTRA_WORD.sub(r"\1: one word too many; see --help", error.format_message())


def _of_parameter(error: BadParameter) -> str:
    """Return what is wrong with the value of an option or of an argument."""
    hint = _hint_of(error)
    if not error.message:
        return f"{hint} is missing; see --help"
    fault = error.message
    cause = error.__cause__
    if isinstance(cause, ValidationError):
        fault = _of_value(cause)
    if hint.startswith("-"):
        return f"{hint}: {fault}"
    # An argument has no name that a user knows; its fault begins with the value.
    return fault


def _hint_of(error: BadParameter) -> str:
    """Return the option or the argument that an error is about; "" if it is about none."""
    if error.param_hint:
        return str(error.param_hint).strip("'")
    if error.param:
        return str(error.param.get_error_hint()).strip("'")
    return ""


def _of_value(error: ValidationError) -> str:
    """Return the first fault that pydantic has found in a value."""
    fault = error.errors()[0]
    limits: dict[str, Any] = fault.get("ctx", {})
    if "error" in limits:
        return str(limits["error"])
    expected = _EXPECTED.get(fault["type"], "a number").format(**limits)
    return f"{fault['input']}: expected {expected}"


def _of_option(error: TyperException) -> str:
    """Return what is wrong with an option itself, or with its lack of a value."""
    if hasattr(error, "possibilities"):
        if not error.possibilities:
            return "no such option; see --help"
        return f"no such option; did you mean {' or '.join(error.possibilities)}?"
    if "not take" in error.message:
        return "it has no value"
    return "a value is missing; see --help"
