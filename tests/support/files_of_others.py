"""Files that another program has written, and what a command says that would replace them."""

from collections.abc import Sequence
from pathlib import Path

from command_line import orchard

# Name -> text. Each looks much like a file of that name that the Orchard writes, and is none.
OTHERS = {
    "summary.json": '{\n  "hash": "of another program",\n  "name": "thesis"\n}\n',
    "table.csv": "carriers,bins\n3,11\n",
    "picture.svg": '<?xml version="1.0"?>\n<svg><dc:title>Matplotlib</dc:title></svg>\n',
    "picture.png": "\x89PNG, which somebody has drawn",
    "report.html": "<!DOCTYPE html>\n<title>My orchard</title>\n",
    "trace.txt": "a year's work\n",
    "map.json": '{\n "metaInformation": {\n  "creator": "another program"\n }\n}\n',
}


def words_of_refusal(command: Sequence[object], folder: Path) -> tuple[list[str], str]:
    """Let a command write into files of a user. Return their names, and what the command says.

    `command`: its words. A word with a space is an option and a name of `OTHERS`, which is made
    first: `--table table.csv`. It is asserted that the command refuses, and that the files stay.
    """
    # Some of the commands go on from a folder of snapshots, and must find one of this name.
    (folder / "run.snapshots").mkdir()
    words: list[str] = []
    written = []
    for word in map(str, command):
        option, _, name = word.partition(" ")
        if name:
            (folder / name).write_text(OTHERS[name])
            written.append(name)
        words += filter(None, (option, name))
    err = orchard(*words, code=2, folder=folder).stderr
    assert "that the Orchard has written, and is not replaced; expected another name" in err
    assert all((folder / name).read_text() == OTHERS[name] for name in written)
    return written, err
