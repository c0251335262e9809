"""The text of a file whose encoding is not known."""

import codecs

# Byte order mark with which a text may begin -> its encoding.
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
LATIN_1 = "read as Latin-1 text, as it is no UTF-8"


def text_of(content: bytes) -> tuple[str, tuple[str, ...]]:
    """Return the text of some bytes, and what was assumed of its encoding, a sentence each.

    Latin-1 can decode any bytes, so it comes last.
    """
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return content.decode(encoding, errors="replace"), ()
    try:
        return content.decode(), ()
    except UnicodeDecodeError:
        return content.decode("latin-1"), (LATIN_1,)
