"""Prints each message on a key as a line of JSON. Tests start it on another machine, to hear what
is published there (`Fleet.hear` of fleet.py).

python -m listener tcp/192.168.1.10:7447 orchard/clock
"""

import json
import sys

from fleet import Client


def main(endpoint: str, key: str) -> None:
    """Print messages until this process is killed."""
    # A client puts the run's id into what it sends. This one only listens, so it needs none.
    with Client.open(endpoint, "") as client:
        heard = client.hear(key)
        while True:
            # Bytes, such as those of a scan, cannot be JSON. They are printed as null.
            print(json.dumps(heard.get(), default=lambda value: None), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
