"""The options that start a process of a run.

Each is declared once, as a field of a class. run.py writes them as a JSON line into the standard
input of the process (lifeline.py), and a user types them on its command line.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import Annotated, Any, NoReturn, TypeVar, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from orchard.field.problems import printable
from orchard.net.host import GONE_SECONDS
from orchard.wire.keys import PREFIX

# Characters of an error.
MOST_SHOWN = 500
# The only argument of a process that reads its options from its standard input.
FROM_STDIN = "-"
FACTORY = "orchard.behaviour.catalogue:make_agents"
# The limit refuses infinity, and both refuse NaN.
Positive = Annotated[float, Meta(gt=0.0, le=1e12)]
Options = TypeVar("Options", bound="ProcessOptions")


def option(metavar: str, description: str, **words: str) -> Meta:
    """Return the note that makes a field an option of a command line.

    `metavar`: what stands for its value in --help; '' for a flag. `words`: further parameters of
    `ArgumentParser.add_argument`.
    """
    return Meta(description=description, extra={"metavar": metavar, **words})


class ProcessOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The options of every process."""

    secure: Annotated[
        str | None,
        option(
            "DIR", "directory of the role; endpoints are tls/..., and rights depend on the role"
        ),
    ] = None


class RouterOptions(ProcessOptions, frozen=True, kw_only=True):
    """Route messages between the processes of an orchard."""

    listen: Annotated[
        str | None,
        option("ENDPOINT", "default: tcp/127.0.0.1:7447; with --secure tls/127.0.0.1:7447"),
    ] = None


class ClientOptions(ProcessOptions, frozen=True, kw_only=True):
    """The options of a process of one run that is no router."""

    connect: Annotated[
        str, option("ENDPOINT", "endpoint of physics or a router, such as tcp/127.0.0.1:7447")
    ]
    prefix: Annotated[str, option("PREFIX", "first part of every key")] = PREFIX


class HostOptions(ClientOptions, frozen=True, kw_only=True):
    """Host agents of an orchard."""

    only: Annotated[list[str], option("KIND|NAME", "host these (repeatable)")] = []
    without: Annotated[list[str], option("KIND|NAME", "host all but these (repeatable)")] = []
    share: Annotated[
        str, option("I/N", "of these, host the I-th (from 0) and every N-th after it")
    ] = "0/1"
    patience: Annotated[Positive, option("SECONDS", "time that physics may be gone, above 0")] = (
        GONE_SECONDS
    )
    check_agents: Annotated[bool, option("", "check that own agents are repeatable")] = False
    agents: Annotated[
        str, option("MODULE:FUNCTION", "factory: (layout, names) -> {name: agent}")
    ] = FACTORY
    replay: Annotated[
        str | None, option("FILE.mcap", "a bag: the velocities in it drive its robots")
    ] = None
    from_first_stamp: Annotated[
        bool, option("", "the times in the bag count from its first velocity")
    ] = False


class LoggerOptions(ClientOptions, frozen=True, kw_only=True):
    """Record a run for Rerun."""

    record: Annotated[
        str | None,
        option("FILE.rrd", "write a recording, or a further part of one of the same run"),
    ] = None
    serve: Annotated[int | None, option("PORT", "serve live viewers on this port of 127.0.0.1")] = (
        None
    )
    session: Annotated[
        str, option("ID", "session id in the liveliness token: letters and digits")
    ] = ""


class CommandLine(argparse.ArgumentParser):
    """A command line with errors that are harmless in a terminal, whatever was typed."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, as one short line, and end the process with exit code 2."""
        super().error(printable(message, MOST_SHOWN))


def read_options(kind: type[Options], module: str, argv: Sequence[str] | None = None) -> Options:
    """Return the options in a process' command line, or in the JSON line at its standard input.

    Raises SystemExit.
    """
    if argv is None:
        argv = sys.argv[1:]
    words = list(argv)
    if words == [FROM_STDIN]:
        return msgspec.json.decode(sys.stdin.readline(), type=kind)
    parser = CommandLine(
        prog=f"python -m {module}", description=kind.__doc__, argument_default=argparse.SUPPRESS
    )
    required = {field.name for field in msgspec.structs.fields(kind) if field.required}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is Annotated:
            _add(parser, name, hint, name in required)
    try:
        return msgspec.convert(vars(parser.parse_args(words)), kind)
    except msgspec.ValidationError as error:
        parser.error(str(error))


def _add(parser: CommandLine, name: str, hint: Any, is_required: bool) -> None:
    """Add a field to the parser.

    `hint`: its annotation, `Annotated[type, ..., note]`, with the note that `option` has made.
    """
    type_ = hint.__origin__
    note = hint.__metadata__[-1]
    flag = f"--{name.replace('_', '-')}"
    words = {"help": note.description, "required": is_required}

    def value(text: str) -> Any:
        """Return the value that a text stands for. Raises ArgumentTypeError."""
        try:
            return msgspec.convert(text, hint, strict=False)
        except msgspec.ValidationError:
            raise argparse.ArgumentTypeError(
                f"{text}: expected {note.extra['metavar']}: {note.description}"
            ) from None

    # It stands alone, without a flag.
    if "nargs" in note.extra:
        parser.add_argument(name, help=note.description, **note.extra)
    elif type_ is bool:
        parser.add_argument(flag, action="store_true", **words)
    elif get_origin(type_) is list:
        parser.add_argument(flag, action="append", **note.extra, **words)
    else:
        parser.add_argument(flag, type=value, **note.extra, **words)
