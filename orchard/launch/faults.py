"""What is wrong with a command line, in the words of this program."""

from pydantic import ValidationError
from typer import BadParameter
from typer.exceptions import TyperException

WANTED = {  # pydantic's name of a fault -> what would be right
    "int_parsing": "a whole number",
    "float_parsing": "a number",
    "greater_than_equal": "a number from {ge:g} on",
    "less_than_equal": "a number up to {le:g}",
}


def fault_of(error: TyperException) -> str:
    """Return what is wrong, where, and what would be right: "--rows: x: expected a whole number"."""
    hint = ""
    if isinstance(error, BadParameter) and (error.param_hint or error.param):
        hint = str(error.param_hint or (error.param and error.param.get_error_hint())).strip("'")
    if isinstance(error, BadParameter) and not error.message:
        return f"{hint} is missing; see --help"
    if option := getattr(error, "option_name", ""):
        return f"{option}: {_of_option(error)}"
    if not isinstance(error, BadParameter):
        return error.format_message()
    where = f"{hint}: " if hint.startswith("-") else ""  # an argument is named by its value
    if not isinstance(cause := error.__cause__, ValidationError):
        return f"{where}{error.message}"
    fault = cause.errors()[0]
    given = fault.get("ctx", {})
    if "error" in given:
        return f"{where}{given['error']}"
    return f"{where}{fault['input']}: expected {WANTED.get(fault['type'], 'a number').format(**given)}"


def _of_option(error: TyperException) -> str:
    """What is wrong with an option itself."""
    if not hasattr(error, "possibilities"):
        return "it has no value" if "not take" in error.message else "a value is missing; see --help"
    return f"no such option; did you mean {near}?" if (near := " or ".join(error.possibilities or [])) else "no such option; see --help"
