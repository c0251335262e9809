"""keyspace.md and the code say the same, and the examples in it are what they claim to be."""

import re
from pathlib import Path

import msgpack
import pytest
from msgspec import inspect

from docs.keyspace import document
from docs.message_examples import EXAMPLES
from orchard.wire.keys import TABLE, Keys
from orchard.wire.types import SubMessage, read

KEYSPACE = Path(__file__).parents[2] / "keyspace.md"


def test_keyspace_is_what_the_table_says():
    assert KEYSPACE.read_text() == document(), "run: make docs"


def test_every_message_of_the_table_has_an_example():
    used = {message for key in TABLE.values() for message in (key.message, *key.replies) if message}
    assert used == set(EXAMPLES)


def test_the_hex_examples_are_these_messages():
    blocks = re.findall(r"```hex\n([0-9a-f\n]+)```", KEYSPACE.read_text())
    maps = [msgpack.unpackb(bytes.fromhex(block.replace("\n", ""))) for block in blocks]
    shown = [type_ for key in TABLE.values() for type_ in dict.fromkeys((key.message, *key.replies)) if type_]
    assert len(maps) == len(shown)
    for map_, type_, block in zip(maps, shown, blocks, strict=True):
        assert set(map_) >= {"run"}
        assert read(bytes.fromhex(block.replace("\n", "")), type_) == EXAMPLES[type_]


def maps_in(type_):
    """The maps of a message, at any depth."""
    found, waiting = {}, [type_]
    while waiting:
        part = waiting.pop()
        if isinstance(part, inspect.StructType) and part.cls not in found:
            found[part.cls] = part
            waiting += [field.type for field in part.fields]
        elif isinstance(part, inspect.NamedTupleType):
            waiting += [field.type for field in part.fields]
        elif isinstance(part, inspect.UnionType):
            waiting += part.types
        elif isinstance(part, inspect.TupleType):
            waiting += part.item_types
        else:
            waiting += [getattr(part, name) for name in ("type", "item_type", "value_type") if hasattr(part, name)]
    return found.values()


@pytest.mark.parametrize("type_", EXAMPLES, ids=lambda type_: type_.__name__)
def test_every_map_in_a_message_refuses_unknown_fields_as_keyspace_says(type_):
    assert [part.cls for part in maps_in(inspect.type_info(type_)) if not part.forbid_unknown_fields] == []


@pytest.mark.parametrize("type_", EXAMPLES, ids=lambda type_: type_.__name__)
def test_the_table_of_a_message_has_the_fields_of_every_map_in_it(type_):
    table = KEYSPACE.read_text().split(f"**{type_.__name__}**")[1].split("For example")[0]
    parts = [part for part in maps_in(inspect.type_info(type_)) if issubclass(part.cls, SubMessage)]
    fields = [(part.cls.__name__, field.encode_name) for part in parts for field in part.fields]
    assert [f"{name}.{field}" for name, field in fields if not re.search(rf"[`.]{field}[`.]", table)] == []


def test_keys_are_made_and_taken_apart():
    keys = Keys("farm/west")
    assert keys.of("velocity", "picker_01") == "farm/west/picker_01/velocity"
    assert keys.of("pose") == "farm/west/*/pose"
    assert keys.parts(keys.of("alive", "bin_02", "3fa9")) == ["alive", "bin_02", "3fa9"]


@pytest.mark.parametrize("prefix", ["", "/", "a//b", "a/*", "**", "a b", "a/", "#", "a?x"])
def test_a_prefix_that_is_no_key_is_refused(prefix):
    with pytest.raises(ValueError, match="prefix"):
        Keys(prefix)
