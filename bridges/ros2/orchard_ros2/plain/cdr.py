"""Messages as the bytes that ROS 2 sends and keeps in bags.

They are plain CDR, version 1 of XCDR, in the byte order of this machine.

Each value begins at a multiple of its own size, counted from after the four bytes at the beginning.
An array, here, is of fixed length if it is of float64, as the covariances are; all others have
their length before them, as texts and lists do.
"""

import sys
from array import array
from collections.abc import Callable, Mapping
from struct import Struct
from typing import Any

from .messages import Message, UInt8

HEAD = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
# The types in which numbers with a point are float32.
OF_FLOAT32 = {
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/BatteryState",
    "nav_msgs/msg/MapMetaData",
}


def encoded(message: Message) -> bytes:
    """Return a message as bytes."""
    out = bytearray(HEAD)
    _put_message(out, message)
    return bytes(out)


def _align(out: bytearray, size: int) -> None:
    """Fill up to a multiple of a size."""
    over = (len(out) - len(HEAD)) % size
    if over:
        out += bytes(size - over)


def _put_message(out: bytearray, message: Message) -> None:
    put = _OF_FLOAT32 if message.type in OF_FLOAT32 else _OF_FLOAT64
    for value in message.fields.values():
        put[type(value)](out, value)


def _put_byte(out: bytearray, value: int) -> None:
    out.append(value)


def _put_as(number: Struct) -> Callable[[bytearray, float], None]:
    """Return a function that adds a number in a format."""

    def put(out: bytearray, value: float) -> None:
        _align(out, number.size)
        out += number.pack(value)

    return put


_put_int32 = _put_as(Struct("=i"))
_put_float32 = _put_as(Struct("=f"))
_put_float64 = _put_as(Struct("=d"))


def _put_text(out: bytearray, value: str) -> None:
    data = value.encode() + b"\0"
    _put_int32(out, len(data))
    out += data


def _put_array(out: bytearray, value: "array[Any]") -> None:
    if value.typecode != "d":
        _put_int32(out, len(value))
    _align(out, value.itemsize)
    out += value.tobytes()


def _put_list(out: bytearray, value: list[Message]) -> None:
    _put_int32(out, len(value))
    for message in value:
        _put_message(out, message)


_Put = Mapping[type, Callable[[bytearray, Any], None]]
_OF_FLOAT64: _Put = {
    float: _put_float64,
    int: _put_int32,
    UInt8: _put_byte,
    bool: _put_byte,
    str: _put_text,
    array: _put_array,
    list: _put_list,
    Message: _put_message,
}
_OF_FLOAT32: _Put = {**_OF_FLOAT64, float: _put_float32}
