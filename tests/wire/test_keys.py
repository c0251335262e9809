"""keyspace.md, docs/messages.md, the contract for programs and the code say the same.

The contract is docs/asyncapi.json, from which programs can read all messages. docs/keyspace.py
generates all three from the code; EXAMPLES has one message of each type.
"""

import ast
import base64
import gzip
import json
import re
from pathlib import Path

import msgpack
import pytest
from jsonschema import Draft7Validator
from msgspec import inspect

from docs.keyspace import CLIENT, asyncapi, keyspace, messages
from docs.message_examples import EXAMPLES
from docs.message_fields import MEMBERS
from orchard.wire.keys import TABLE, Keys

# Of npm's @asyncapi/specs 6.11.1, Apache-2.0.
SCHEMA = Path(__file__).parent / "asyncapi-3.0.0.schema.json.gz"
CONTRACT = json.loads(asyncapi())
REFERENCE = messages()


def test_keyspace_fits_into_sixteen_kilobytes():
    """So an engineer reads it in ten minutes; and its client is short, at most 50 statements.

    tests/contract/test_own_agent.py runs the client.
    """
    client = CLIENT.read_text()
    statements = [node for node in ast.walk(ast.parse(client)) if isinstance(node, ast.stmt)]
    assert len(keyspace().encode()) <= 16_384
    assert len(statements) <= 50
    assert client in keyspace()


def test_every_message_of_the_table_has_an_example():
    used = {message for key in TABLE.values() for message in (key.message, *key.replies) if message}
    assert used == set(EXAMPLES)


def test_the_contract_is_asyncapi_by_the_official_schema():
    Draft7Validator(json.loads(gzip.decompress(SCHEMA.read_bytes()))).validate(CONTRACT)
    assert set(CONTRACT["channels"]) == set(TABLE)


def as_json(value):
    """Return a message as JSON has it: bytes as base64."""
    if isinstance(value, dict):
        return {key: as_json(part) for key, part in value.items()}
    if isinstance(value, list):
        return [as_json(part) for part in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


KEYS_WITH_MESSAGES = [name for name, key in TABLE.items() if key.message or key.replies]


@pytest.mark.parametrize("key_name", KEYS_WITH_MESSAGES)
def test_each_message_of_a_recorded_run_is_valid_by_the_contract(other, key_name):
    names = CONTRACT["channels"][key_name]["messages"]
    schema = {
        "anyOf": [{"$ref": f"#/components/schemas/{name}"} for name in names],
        "components": CONTRACT["components"],
    }
    validator = Draft7Validator(schema)
    for _, payload in other[key_name]:
        message = as_json(msgpack.unpackb(payload))
        validator.validate(message)
        assert not validator.is_valid(message | {"more": 1}), "an unknown field is refused"
    assert other[key_name]


def maps_in(type_):
    """Return all structs that a message has at any depth, as msgspec describes them."""
    maps = {}
    waiting = [type_]
    while waiting:
        part = waiting.pop()
        if isinstance(part, inspect.StructType) and part.cls not in maps:
            maps[part.cls] = part
            waiting += [field.type for field in part.fields]
        elif isinstance(part, inspect.NamedTupleType):
            waiting += [field.type for field in part.fields]
        elif isinstance(part, inspect.UnionType):
            waiting += part.types
        elif isinstance(part, inspect.TupleType):
            waiting += part.item_types
        else:
            for name in ("type", "item_type", "value_type"):
                if hasattr(part, name):
                    waiting.append(getattr(part, name))
    return maps.values()


@pytest.mark.parametrize("type_", EXAMPLES, ids=lambda type_: type_.__name__)
def test_every_map_in_a_message_refuses_unknown_fields(type_):
    for part in maps_in(inspect.type_info(type_)):
        assert part.forbid_unknown_fields, part.cls


def section_of(name):
    """Return what docs/messages.md says of a map. A map may have all the fields of another one:
    what is said of that one follows.
    """
    (text,) = re.findall(rf"^### {name}\n(.*?)(?=^##|\Z)", REFERENCE, re.M | re.S)
    for base in re.findall(r"^the fields of (\w+)$", text, re.M):
        text += section_of(base)
    return text


@pytest.mark.parametrize("type_", EXAMPLES, ids=lambda type_: type_.__name__)
def test_each_map_in_a_message_is_described_once(type_):
    for part in maps_in(inspect.type_info(type_)):
        if part.cls in MEMBERS:
            continue
        text = section_of(part.cls.__name__)
        # They are in every message, and are described once.
        left_out = ("run", "tick") if part.cls in EXAMPLES else ()
        for field in part.fields:
            if field.encode_name not in left_out:
                assert f"\n{field.encode_name}: " in text, field.encode_name


def test_keys_are_made_and_taken_apart():
    keys = Keys("farm/west")
    assert keys.of("velocity", "picker_01") == "farm/west/picker_01/velocity"
    assert keys.of("pose") == "farm/west/*/pose"
    assert keys.parts(keys.of("alive", "bin_02", "3fa9")) == ["alive", "bin_02", "3fa9"]


@pytest.mark.parametrize("prefix", ["", "/", "a//b", "a/*", "**", "a b", "a/", "#", "a?x"])
def test_a_prefix_that_is_no_key_is_refused(prefix):
    with pytest.raises(ValueError, match="prefix"):
        Keys(prefix)
