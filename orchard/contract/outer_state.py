"""The state outside its memory that an agent's code can reach: its attributes, class attributes, module globals, closures, defaults.

It is described as plain data, so that two descriptions can be compared. What is of this package, of Python or of an installed package
counts as constant.
"""

import sys
from collections.abc import Callable, Iterator
from functools import partial
from types import CodeType, FunctionType, ModuleType
from typing import Any

import msgspec
import numpy as np

Reader = Callable[[], Any]  # returns a value; raises KeyError or ValueError if there is none now
PLAIN = (int, float, str, bytes, bool, type(None))


class OuterState:
    """All places outside its memory where an agent could keep something, found once, by following the names in its code."""

    def __init__(self, agent: Any) -> None:
        self._agent = agent
        self._places: dict[str, Reader] = {}
        self._classes: list[type] = []
        self._todo: list[Any] = [type(value) for value in (agent, *vars(agent).values())] if hasattr(agent, "__dict__") else [type(agent)]
        seen: set[int] = set()
        while self._todo:
            if id(item := self._todo.pop()) not in seen and _is_users(getattr(item, "__module__", None)):
                seen.add(id(item))
                self._follow(item)

    def described(self) -> dict[str, Any]:
        """Return place -> the description of its present value."""
        found = {f"its attribute self.{name}": describe(value) for name, value in _attributes(self._agent)}
        for class_ in self._classes:
            names = [name for name, value in vars(class_).items() if not name.startswith("__") and _is_data(value)]
            found |= {f"the class attribute {class_.__name__}.{name}": describe(vars(class_)[name]) for name in names}
        for place, read in self._places.items():
            try:
                value = read()
            except (KeyError, ValueError):
                continue
            if not isinstance(value, FunctionType | ModuleType | type):
                found[place] = describe(value)
        return found

    def _follow(self, item: Any) -> None:
        if isinstance(item, type):
            self._todo += item.__mro__
            self._todo += [getattr(value, "__func__", None) or getattr(value, "fget", None) or value for value in vars(item).values()]
            self._classes.append(item)
        elif isinstance(item, FunctionType):
            self._follow_function(item)
        elif wrapped := getattr(item, "__wrapped__", None):
            self._todo.append(wrapped)

    def _follow_function(self, function: FunctionType) -> None:
        names, where = set(_names_in(function.__code__)), function.__qualname__
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
            self._places[f"the variable {name} around {where}"] = partial(getattr, cell, "cell_contents")
        for i, default in enumerate(function.__defaults__ or ()):
            self._places[f"default {i} of {where}"] = partial(_itself, default)
        self._follow_names(names, function.__globals__)
        for module in [value for name in names if isinstance(value := function.__globals__.get(name), ModuleType)]:
            if _is_users(module.__name__):
                self._follow_names(names, vars(module))

    def _follow_names(self, names: set[str], namespace: dict[str, Any]) -> None:
        self._places |= {f"the global {namespace.get('__name__')}.{name}": _reader(namespace, name) for name in names if name[:2] != "__"}
        self._todo += [namespace[name] for name in names if name in namespace and not isinstance(namespace[name], ModuleType)]
        self._todo += [type(namespace[name]) for name in names if name in namespace]


def _reader(namespace: Any, name: str) -> Reader:
    return lambda: namespace[name]


def _itself(value: Any) -> Any:
    return value


def _names_in(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names_in(constant)


def _is_data(value: Any) -> bool:
    return not (callable(value) or hasattr(value, "__get__"))


def _is_users(module: str | None) -> bool:
    """Whether a module is neither of this package nor of Python nor installed."""
    top = (module or "orchard").partition(".")[0]
    file = getattr(sys.modules.get(module or ""), "__file__", None) or ""
    return top != "orchard" and top not in sys.stdlib_module_names and "site-packages" not in file


def _attributes(thing: Any) -> list[tuple[str, Any]]:
    slots = [name for class_ in type(thing).__mro__ for name in _names_of_slots(class_) if hasattr(thing, name)]
    return [*getattr(thing, "__dict__", {}).items(), *((name, getattr(thing, name)) for name in slots)]


def _names_of_slots(class_: type) -> list[str]:
    slots = class_.__dict__.get("__slots__", ())
    return [name for name in ([slots] if isinstance(slots, str) else slots) if not name.startswith("__")]


def describe(value: Any, within: tuple[int, ...] = ()) -> Any:
    """Return a value as plain data that compares by content. What is constant or cannot be looked into is described by its identity."""
    if isinstance(value, PLAIN):
        return value
    if id(value) in within:
        return "itself"
    inner = (*within, id(value))
    if isinstance(value, np.ndarray):
        return [str(value.dtype), list(value.shape), value.tobytes() if value.dtype != object else describe(value.tolist(), inner)]
    if isinstance(value, dict):
        return {key if isinstance(key, PLAIN) else repr(describe(key, inner)): describe(item, inner) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [describe(item, inner) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(repr(describe(item, inner)) for item in value)
    if isinstance(value, msgspec.Struct):
        return {name: describe(getattr(value, name), inner) for name in value.__struct_fields__}
    if isinstance(value, FunctionType | ModuleType | type) or type(value).__module__.startswith("orchard."):
        return _identity(value)
    return _describe_object(value, inner)


def _identity(value: Any) -> str:
    return f"{type(value).__name__} {id(value):#x}"


def _describe_object(value: Any, inner: tuple[int, ...]) -> Any:
    """By its attributes, if all its classes are a user's; else by what a copy of it would be made from."""
    if all(_is_users(class_.__module__) or class_ is object for class_ in type(value).__mro__):
        return {name: describe(item, inner) for name, item in _attributes(value)}
    try:
        _, *parts = value.__reduce_ex__(4)
        return [describe(list(part) if isinstance(part, Iterator) else part, inner) for part in parts]
    except Exception:  # whatever its class raises: it cannot be copied, as a lock or a file
        return _identity(value)
