"""Prints what is put on a key, as a line of JSON each: for tests to hear what is said on another
machine.

python -m listener tcp/192.168.1.10:7447 orchard/clock
"""

import json
import sys

from fleet import Client


def main(endpoint: str, key: str) -> None:
    with Client.open(endpoint, "") as client:
        heard = client.hear(key)
        while True:
            print(json.dumps(heard.get(), default=lambda value: None), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
