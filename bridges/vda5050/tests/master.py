"""A fleet control, written from the standard alone.

It knows a map in the Layout Interchange Format (LIF) of the VDMA, the messages of VDA 5050, and
the list of full bins that wait. It imports nothing of the Orchard and nothing of the bridge.

The words of the standard:

- An order is a way: a list of nodes with the edges between them, and actions at some of both.
- Its base is the part that is released: the vehicle may drive it. The rest is its horizon.
- An update of an order begins at the last node of the base and releases more.
- Nodes and edges of an order are numbered alternately by `sequenceId`: node number n of the way
  has 2 n, the edge after it 2 n + 1.
"""

import heapq
from itertools import count, pairwise

RELEASED = 4  # nodes that it releases at once
AGAIN = 5  # states without an answer to an order, after which it sends the order again
# What each message begins with, but for its number and the vehicle.
HEADER = {"timestamp": "2026-01-01T00:00:00.000Z", "version": "3.0.0", "manufacturer": "orchard"}


def is_picker(serial):
    """Whether a vehicle is a picker, by its serial number; else it is a carrier."""
    return serial.startswith("picker")


def row_of(node):
    """The row of a node of the pickers' map, such as `west/out/3`."""
    return int(node.rsplit("/", 1)[1])


class Master:
    """The fleet control.

    A vehicle is named by its serial number. A job is a dict with what a vehicle has to do:

    - `load`: the bin that it fetches; empty if it fetches none.
    - `order`, `update`: the ids of its order. The order is None while it is being cancelled.
    - `names`: the nodes of its way, from first to last.
    - `actions`: for a node, or for a pair of nodes with an edge between them, what is done there:
      the kind of the action, and the bin or None.
    - `base`: the number, among `names`, of the last node that is released.
    - `sent`: the order or update as it was sent last.
    - `silent`: how many states came since then that did not answer it.
    - `call`: the waiting bin that it serves, if any.

    Parameters
    ----------
    lif
        The map.
    send
        A function that takes a vehicle, a topic and a message, and sends it.
    released
        How many nodes it releases at once.

    """

    def __init__(self, lif, send, released=RELEASED):
        (layout,) = lif["layouts"]
        self.map = {node["nodeId"]: node for node in layout["nodes"]}
        self.edges = {
            (edge["startNodeId"], edge["endNodeId"]): edge["edgeId"] for edge in layout["edges"]
        }
        self.stations = {
            station["stationId"]: station["interactionNodeIds"] for station in layout["stations"]
        }
        self.onward = {name: [] for name in self.map}
        for start, end in self.edges:
            self.onward[start].append(end)
        # Topic -> vehicle -> its newest message.
        self.newest = {}
        # Vehicle -> its job.
        self.jobs = {}
        # The full bins that wait.
        self.calls = []
        # Vehicle -> the line of the queue in which it was first seen: it goes back there.
        self.homes = {}
        # Row -> the picker that picks it: first the picker that was first seen there.
        self.rows = {}
        # Rows that are picked.
        self.picked = set()
        self.send = send
        self.released = released
        # Numbers for messages, orders and actions: none comes twice.
        self.headers = count()
        # The loads of the orders that were done.
        self.finished = []

    def hear(self, serial, topic, message):
        """Take a message of a vehicle, and go on with its job."""
        self.newest.setdefault(topic, {})[serial] = message
        if topic == "connection" and message["connectionState"] != "ONLINE":
            self.jobs.pop(serial, None)
        if topic == "state":
            line = "/".join(message["lastNodeId"].split("/")[:2])
            self.homes.setdefault(serial, line)
            if is_picker(serial) and serial not in self.rows.values():
                self.rows[row_of(message["lastNodeId"])] = serial
            self.follow(serial, message)

    @property
    def states(self):
        """The newest state of each vehicle that has sent one."""
        return self.newest.get("state", {})

    def hear_calls(self, calls):
        """Take the list of the full bins that wait: each has a `loadId` and a `station`."""
        self.calls = calls

    # -- jobs

    def assign(self):
        """Send each free picker on, and the nearest free carrier to each full bin that waits."""
        for serial in filter(is_picker, self.states):
            if self.is_free(serial):
                self.send_on(serial)
        served = {job["load"] for job in self.jobs.values()}
        waiting = [call for call in self.calls if call["loadId"] not in served]
        if not waiting:
            return
        free = {serial for serial in self.states if self.is_free(serial) and not is_picker(serial)}
        for call in waiting[: len(free)]:
            stop, _ = self.stations[call["station"]]
            ways = {serial: self.way(self.states[serial]["lastNodeId"], stop) for serial in free}
            nearest = min(free, key=lambda serial: (self.length(ways[serial]), serial))
            self.begin(nearest, call)
            free.remove(nearest)

    def is_free(self, serial):
        """Whether a vehicle can be given a job now."""
        state = self.states[serial]
        statuses = {action["actionStatus"] for action in state["actionStates"]}
        is_idle = not state["nodeStates"] and statuses <= {"FINISHED", "FAILED"}
        is_automatic = state["operatingMode"] == "AUTOMATIC" and not state["paused"]
        connection = self.newest.get("connection", {}).get(serial, {})
        is_here = connection.get("connectionState", "ONLINE") == "ONLINE"
        # A carrier needs an empty bin.
        is_ready = bool(state["loads"]) or is_picker(serial)
        return is_here and is_idle and is_automatic and serial not in self.jobs and is_ready

    def send_on(self, serial):
        """Order a picker's next piece of work: to pick a row, to change bins at its end, or to park
        after the last one.
        """
        state = self.states[serial]
        last = state["lastNodeId"]
        loads = state["loads"]
        row = row_of(last)
        # A node of the pickers' map is SIDE/SPOT/ROW. The spots at an end of a row: at `out` a
        # picker stands that has come through the row, at `wait` it waits for its empty bin, at
        # `aside` it holds up no carrier, and at `park` it stays when it has finished. Its first
        # row it begins at `in`.
        side, spot, _ = last.split("/")
        other_side = "west" if side == "east" else "east"
        has_next = f"row/{row + 1}" in self.stations and self.rows.get(row + 1, serial) == serial
        is_full = bool(loads) and loads[0]["loadType"] == "full bin"
        wait = f"{side}/wait/{row}"
        through = (last, f"{other_side}/out/{row}")
        if spot == "out":
            self.picked.add(row)
            drops = is_full or (loads and not has_next)
            self.drive(serial, "", [last, wait], {last: ("drop", None)} if drops else {})
        elif spot == "aside":
            self.drive(serial, "", [last, wait], {})
        elif spot == "wait" and not loads:
            self.drive(serial, "", [wait], {wait: ("pick", None)})
        # It has picked its row, came back, and has its full bin still: it brings the bin to the
        # other end, where it drops it.
        elif spot == "wait" and is_full:
            self.drive(serial, "", [*through], {})
        elif spot == "wait" and row in self.picked and has_next:
            self.rows[row + 1] = serial
            self.drive(serial, "", [wait, f"{side}/wait/{row + 1}"], {})
        elif spot == "wait" and row in self.picked:
            self.drive(serial, "", [wait, f"{side}/park/{row}"], {})
        elif spot != "park":
            self.drive(serial, "", [*through], {through: ("harvest", None)})

    def begin(self, serial, call):
        """Order a carrier to exchange its empty bin for a full one that waits, and to unload it.

        It hands over its empty bin at the station's stop, beside the picker, couples the full one
        at the station's second node, unloads it in the bay, and goes back to its queue.
        """
        load = call["loadId"]
        stop, bin_node = self.stations[call["station"]]
        start = self.states[serial]["lastNodeId"]
        ways = [
            self.way(start, stop),
            self.way(stop, bin_node),
            self.way(bin_node, "bay"),
            self.way("bay", self.homes[serial]),
        ]
        names = [start]
        for way in ways:
            names += way[1:]
        actions = {stop: ("handOver", load), bin_node: ("pick", load), "bay": ("unload", None)}
        self.drive(serial, load, names, actions)
        self.jobs[serial]["call"] = call

    def drive(self, serial, load, names, actions):
        """Give a vehicle a job (the parameters are named as its parts) and send its first order."""
        order = f"{load} {next(self.headers)}"
        self.jobs[serial] = {
            "load": load,
            "order": order,
            "update": 0,
            "names": names,
            "actions": actions,
            "base": self.released,
        }
        self.order(serial, first=0)

    def order(self, serial, first):
        """Send an order or an update: the nodes and edges from node number `first` to the end."""
        job = self.jobs[serial]
        nodes = [self.node(job, number) for number in range(first, len(job["names"]))]
        edges = [self.edge(job, number) for number in range(first, len(job["names"]) - 1)]
        job["silent"] = 0
        job["sent"] = {
            "orderId": job["order"],
            "orderUpdateId": job["update"],
            "nodes": nodes,
            "edges": edges,
        }
        self.publish(serial, "order", job["sent"])

    def node(self, job, number):
        """Node number `number` of a job's way, as the standard writes it."""
        name = job["names"][number]
        at = self.map[name]["nodePosition"] | {"mapId": self.map[name]["mapId"]}
        return {
            "nodeId": name,
            "sequenceId": 2 * number,
            "released": number <= job["base"],
            "nodePosition": at,
            "actions": self.actions(job, name),
        }

    def edge(self, job, number):
        """The edge after node number `number` of a job's way, as the standard writes it."""
        ends = (job["names"][number], job["names"][number + 1])
        return {
            "edgeId": self.edges[ends],
            "sequenceId": 2 * number + 1,
            "released": number + 1 <= job["base"],
            "actions": self.actions(job, ends),
        }

    def actions(self, job, place):
        """The actions of a job at a node, or on the edge between two: one or none."""
        if place not in job["actions"]:
            return []
        kind, load = job["actions"][place]
        parameters = [{"key": "loadId", "value": load}] if load else []
        action = {
            "actionType": kind,
            "actionId": f"{job['order']} {kind}",
            # A picker drives while it picks; all else is done while the vehicle stands.
            "blockingType": "NONE" if kind == "harvest" else "HARD",
            "actionParameters": parameters,
        }
        return [action]

    def send_again(self, serial, job, errors):
        """Repeat an order that the vehicle has not taken; forget it if the vehicle is elsewhere."""
        for error in errors:
            orders = [reference["referenceValue"] for reference in error["errorReferences"]]
            if error["errorType"] == "START_NODE_OUT_OF_RANGE" and job["order"] in orders:
                self.jobs.pop(serial)
                return
        job["silent"] += 1
        if job["silent"] % AGAIN == 0:
            self.publish(serial, "order", job["sent"])

    def follow(self, serial, state):
        """Release more of a job where the base runs short. Forget it at its end.

        A job of which an action has failed is cancelled, and the carrier is sent home.
        """
        if state["operatingMode"] != "AUTOMATIC":
            self.jobs.pop(serial, None)  # the vehicle has given it up
        job = self.jobs.get(serial)
        if job and job["order"] is None and is_cancelled(state):
            self.jobs.pop(serial)
            if not is_picker(serial):
                self.drive(serial, "", self.way(state["lastNodeId"], self.homes[serial]), {})
            job = self.jobs.get(serial)
        if job is None or job["order"] is None:
            return
        if (state["orderId"], state["orderUpdateId"]) != (job["order"], job["update"]):
            self.send_again(serial, job, state["errors"])
            return
        if any(error["errorType"] == "ACTION_FAILED" for error in state["errors"]):
            job["order"] = None
            self.instant(serial, "cancelOrder", orderId=state["orderId"])
        elif state["newBaseRequest"]:
            last = job["base"]
            job["base"] += self.released
            job["update"] += 1
            self.order(serial, first=last)
        elif not state["nodeStates"] and all(
            action["actionStatus"] == "FINISHED" for action in state["actionStates"]
        ):
            self.finished.append(self.jobs.pop(serial)["load"])

    def instant(self, serial, kind, **parameters):
        """Send an instant action, which a vehicle does at once beside its order. Return its id."""
        key_values = [{"key": key, "value": value} for key, value in parameters.items()]
        action = {
            "actionType": kind,
            "actionId": f"{kind} {next(self.headers)}",
            "blockingType": "NONE",
            "actionParameters": key_values,
        }
        self.publish(serial, "instantActions", {"actions": [action]})
        return action["actionId"]

    def publish(self, serial, topic, message):
        """Send a message after a header is added to it, in which it may overwrite fields."""
        header = {"headerId": next(self.headers), **HEADER, "serialNumber": serial}
        self.send(serial, topic, header | message)

    # -- ways

    def way(self, start, end):
        """The nodes of the shortest way, both ends among them (Dijkstra's search)."""
        queue = [(0.0, [start])]
        known = set()
        while queue:
            length, names = heapq.heappop(queue)
            last = names[-1]
            if last == end:
                return names
            if last in known:
                continue
            known.add(last)
            for onward in self.onward[last]:
                longer = length + self.length([last, onward])
                heapq.heappush(queue, (longer, [*names, onward]))
        raise ValueError(f"no way from {start} to {end}")

    def length(self, names):
        """The length of a way in m. Each edge runs east and west or north and south."""
        places = [self.map[name]["nodePosition"] for name in names]
        return sum(abs(a["x"] - b["x"]) + abs(a["y"] - b["y"]) for a, b in pairwise(places))


def is_cancelled(state):
    """Whether the vehicle that sent this state has done the last instant action, a cancelling."""
    last_action = state["instantActionStates"][-1]
    return not state["nodeStates"] and last_action["actionStatus"] == "FINISHED"
