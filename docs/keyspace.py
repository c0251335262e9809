"""The text of keyspace.md: how a client takes part (`HEAD`), the table of keys, and each message with its fields and an example."""

from pathlib import Path
from typing import Any, get_args

import msgspec

from docs import carrier
from docs.message_examples import EXAMPLES, SESSION, TICK, WRITTEN
from docs.message_fields import UNIONS, field_rows, struct_of, type_name
from orchard.contract.agent import MOST_HOLD, MOST_REQUESTS, MOST_ZONES, Heard, Mail, Reply
from orchard.contract.mail import digest_of
from orchard.contract.messages import MAX_PAYLOAD, Claim, Places, pack
from orchard.contract.zone import ACROSS
from orchard.field.kinds import AROUND, KINDS
from orchard.field.scenario import TIME_STEP
from orchard.net.bus import CONNECT_SECONDS, FULL_QUEUE_US, GET_SECONDS, LEASE_MS
from orchard.net.ending import GOES_SECONDS
from orchard.net.host import JOIN_TRIES
from orchard.net.mailbox import DOUBT_SECONDS, STALE_TICKS
from orchard.net.refusals import NO_TOKEN
from orchard.net.requests import AGAIN_SECONDS as ASK_SECONDS
from orchard.server.advice import ADVICE_TICKS
from orchard.server.lockstep import AGAIN_SECONDS
from orchard.server.realtime import SLACK, WATCHDOG, WATCHDOG_TICKS
from orchard.server.roster import MOST_TOKENS
from orchard.wire.keys import QUERY, TABLE, Key, Keys
from orchard.wire.types import SubMessage

HEAD = Path(__file__).parent / "templates" / "keyspace.md"  # Markdown with the figures' names in braces


def document() -> str:
    """Return the text of keyspace.md."""
    table = "\n".join(map(_table_row, TABLE.values()))
    times = {
        "hold": MOST_HOLD,
        "zones": MOST_ZONES,
        "across": ACROSS,
        "watchdog": WATCHDOG,
        "ticks": WATCHDOG_TICKS,
        "slack": SLACK,
        "stale": STALE_TICKS,
        "advice": ADVICE_TICKS,
        "advice_seconds": ADVICE_TICKS * TIME_STEP,
    }
    times |= {"again": AGAIN_SECONDS, "doubt": DOUBT_SECONDS, "full_queue": FULL_QUEUE_US / 1e6, "goes": GOES_SECONDS}
    times |= {"connect": round(CONNECT_SECONDS * 1000), "lease": LEASE_MS, "get": GET_SECONDS, "join": JOIN_TRIES * ASK_SECONDS}
    front, shown = KINDS["carrier"].laser.beams, _digest_example()
    lasers = {"around": AROUND.beams, "around_step": AROUND.increment, "front": front, "gaps": front - 1}
    work = {"kinds": carrier.bodies(), "carrier": carrier.chapter(), "digest_of": shown[0], "digest": shown[1]}
    head = HEAD.read_text().format(
        table=table, most=MAX_PAYLOAD, requests=MOST_REQUESTS, tokens=MOST_TOKENS, no_token=NO_TOKEN, **times, **lasers, **work
    )
    return "\n".join([head, *(_section(what, key) for what, key in TABLE.items()), *(_union(*item) for item in UNIONS.items())])


def _digest_example() -> tuple[str, str]:
    """The mail of an example, and its digest in hexadecimal."""
    call = Heard("bin_01", TICK - 1, 0, WRITTEN.requests[0][1])
    answer = Reply("traffic", 0, Claim([], ["east/D/3"], ""), Places(["east/D/3"], [], []))
    packed = [[(call.sender, call.tick, call.number, call.body)], [(answer.sender, answer.number, answer.body)]]
    return msgspec.json.encode(packed).decode(), digest_of(Mail([call], [answer])).hex()


def _table_row(key: Key) -> str:
    message = key.message.__name__ if key.message else "none"
    return f"| `{key.template}` | {message} | {key.sender} | {key.rate} | {key.delivery} |"


def _section(what: str, key: Key) -> str:
    example = Keys().of(what, "bin_01" if "{bin}" in key.template else "picker_01", SESSION)
    parts = [f"### {what}\n\n`{key.template}`, for example `{example}`. {key.meaning}\n"]
    if key.message:
        parts.append(_message("Query" if key.delivery == QUERY else "", key.message))
    parts += [_message("Reply", reply) for reply in key.replies if reply is not key.message]
    return "\n".join(parts)


def _message(role: str, type_: type) -> str:
    rows = "\n".join(f"| `{path}` | {name} | {note} |" for path, name, note in field_rows(struct_of(type_)))
    title = f"{role} **{type_.__name__}**".strip()
    example = EXAMPLES[type_]
    doc = " ".join((type_.__doc__ or "").split())
    return f"{title}: {doc}\n\n| field | type | meaning |\n| --- | --- | --- |\n{rows}\n\n{_example(example)}\n"


def _example(message: SubMessage) -> str:
    data = pack(message).hex()
    lines = "\n".join(data[i : i + 128] for i in range(0, len(data), 128))
    shown = msgspec.json.encode(_readable(msgspec.to_builtins(message, builtin_types=(bytes,)))).decode()
    return f"For example `{shown}`:\n\n```hex\n{lines}\n```"


def _readable(value: Any) -> Any:
    """Plain data with bytes as text, so that JSON can show it."""
    if isinstance(value, dict):
        return {key: _readable(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(part) for part in value]
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else value


def _union(title: str, union: Any) -> str:
    rows = []
    for member in get_args(union):
        info = struct_of(member)
        fields = ", ".join(f"`{field.encode_name}` {type_name(field.type)}" for field in info.fields)
        rows.append(f"| `{info.tag}` | {fields or 'none'} | {' '.join(member.__doc__.split())} |")
    lines = "\n".join(rows)
    return f"### The {title}\n\nA map with `type` and these fields.\n\n| `type` | fields | meaning |\n| --- | --- | --- |\n{lines}\n"
