"""A broker, an orchard and a bridge as processes of this machine, and a fleet control."""

import json
import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from master import Master
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

FOLDER = Path(__file__).parents[1]
BEGIN_SECONDS = 120.0  # the first start of an orchard on a machine compiles
# The broker of MQTT. Debian puts it where only root looks.
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")


def free_port():
    """A port of this machine that is free now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@contextmanager
def started(words, log):
    """A process that is ended by its id at the end."""
    with (
        open(log, "ab") as output,
        subprocess.Popen(words, stdout=output, stderr=subprocess.STDOUT, cwd=log.parent) as process,
    ):
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def answers(port):
    """Whether something listens at a port of this machine."""
    with socket.socket() as caller:
        return caller.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def broker(folder, port, lets_in="true"):
    """A broker on loopback that answers. `lets_in`: "false" makes it refuse all clients."""
    assert MOSQUITTO, "mosquitto is missing: apt-get install mosquitto"
    config = folder / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous {lets_in}\n")
    log = folder / "broker.log"
    with started([MOSQUITTO, "-c", str(config)], log) as process:
        end = time.monotonic() + 20.0
        while not answers(port):
            assert time.monotonic() < end and process.poll() is None, log.read_text()
            time.sleep(0.02)
        yield process


class Control(Master):
    """The fleet control with a client of MQTT.

    It acts in the client's thread, on each message that arrives.
    """

    def __init__(self, lif, port):
        super().__init__(lif, self.publish_to)
        # All messages of vehicles so far: the vehicle, the topic and the message.
        self.heard = []
        # Whether it orders anything.
        self.is_active = True
        self.client = Client(CallbackAPIVersion.VERSION2, client_id="control")
        self.client.reconnect_delay_set(1, 1)
        self.client.on_connect = self.connected
        self.client.on_message = self.arrived
        self.client.connect("127.0.0.1", port, 5)
        self.client.loop_start()

    def publish_to(self, serial, topic, message):
        self.client.publish(f"vda5050/v3/orchard/{serial}/{topic}", json.dumps(message))

    def connected(self, client, *_):
        for topic in ("vda5050/v3/orchard/#", "vda5050/calls"):
            client.subscribe(topic)

    def arrived(self, _client, _data, message):
        *_, serial, topic = message.topic.split("/")
        body = json.loads(message.payload)
        if topic == "calls":
            self.hear_calls(body)
        elif topic in ("state", "connection", "factsheet"):
            self.heard.append((serial, topic, body))
            self.hear(serial, topic, body)
        if self.is_active:
            self.assign()

    def follow(self, serial, state):
        if self.is_active:
            super().follow(serial, state)

    def close(self):
        self.client.disconnect()
        self.client.loop_stop()

    def until(self, condition, seconds=30.0):
        """Wait until a condition is true; return what it is."""
        end = time.monotonic() + seconds
        while not (value := condition()):
            assert time.monotonic() < end, f"not within {seconds} s: {self.newest}"
            time.sleep(0.01)
        return value

    def connection(self, serial):
        """The state of a vehicle's connection, such as ONLINE; None before one is heard."""
        return self.newest.get("connection", {}).get(serial, {}).get("connectionState")


class Scene:
    """An orchard, and a bridge to it."""

    def __init__(self, folder, endpoint, orchard, bridge):
        self.folder = folder
        self.endpoint = endpoint
        self.orchard = orchard
        self.bridge = bridge

    def bridge_log(self):
        """All that the bridge has said."""
        return (self.folder / "bridge.log").read_text()


def bridging(endpoint, broker_port, folder, *words):
    """A process that is a bridge."""
    command = [
        sys.executable,
        "-m",
        "orchard_vda5050",
        "drive",
        endpoint,
        "--broker",
        f"mqtt://127.0.0.1:{broker_port}",
        *words,
    ]
    return started(command, folder / "bridge.log")


@contextmanager
def scene(folder, scenario, broker_port, orchard_words=(), bridge_words=()):
    """An orchard and a bridge that makes its carriers vehicles, for a broker at a port.

    `orchard_words` and `bridge_words` are further options of their commands.
    """
    (folder / "orchard.yaml").write_text(json.dumps(scenario))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = [
        *shlex.split(os.environ["ORCHARD"]),
        str(folder / "orchard.yaml"),
        *("--without", "carrier"),
        *("--without", "dispatch"),
        *("--listen", endpoint),
        *("--record", "none"),
        *orchard_words,
    ]
    os.environ |= {"ORCHARD_RUNS": str(folder / "runs"), "PYTHONPATH": str(FOLDER)}
    with (
        started(words, folder / "orchard.log") as orchard,
        bridging(endpoint, broker_port, folder, *bridge_words) as bridge,
    ):
        yield Scene(folder, endpoint, orchard, bridge)


def lif(folder):
    """The map of the orchard in a folder, as `orchard layout export` writes it."""
    words = [
        *shlex.split(os.environ["ORCHARD"]),
        "layout",
        "export",
        "orchard.yaml",
        "--lif",
        "map.lif.json",
    ]
    subprocess.run(words, cwd=folder, check=True, capture_output=True, timeout=60)
    return json.loads((folder / "map.lif.json").read_text())
