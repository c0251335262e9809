"""A fleet control, written from the standard alone: it knows a LIF map, the messages of VDA 5050,
and the list of full bins that wait.

It imports nothing of the Orchard and nothing of the bridge. `send` takes a vehicle, a topic and a
message; messages come by `hear`.
"""

import heapq
from itertools import count, pairwise

RELEASED = 4  # nodes of the base that it releases at once
AGAIN = 5  # states without an answer to an order, after which it sends the order again
HEADER = {"timestamp": "2026-01-01T00:00:00.000Z", "version": "3.0.0", "manufacturer": "orchard"}


def is_picker(serial):
    return serial.startswith("picker")


def row_of(node):
    return int(node.rsplit("/", 1)[1])


class Master:
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
        # Vehicle -> what it has to do.
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
        self.headers = count()
        self.finished = []

    def hear(self, serial, topic, message):
        """A message of a vehicle."""
        self.newest.setdefault(topic, {})[serial] = message
        if topic == "connection" and message["connectionState"] != "ONLINE":
            self.jobs.pop(serial, None)
        if topic == "state":
            self.homes.setdefault(serial, "/".join(message["lastNodeId"].split("/")[:2]))
            if is_picker(serial) and serial not in self.rows.values():
                self.rows[row_of(message["lastNodeId"])] = serial
            self.follow(serial, message)

    @property
    def states(self):
        return self.newest.get("state", {})

    def hear_calls(self, calls):
        self.calls = calls

    # -- jobs

    def assign(self):
        """Send a free vehicle, the nearest one, to each full bin that waits, and each free picker
        on.
        """
        for serial in filter(is_picker, self.states):
            if self.is_free(serial):
                self.send_on(serial)
        served = {job["load"] for job in self.jobs.values()}
        waiting = [call for call in self.calls if call["loadId"] not in served]
        free = (
            {serial for serial in self.states if self.is_free(serial) and not is_picker(serial)}
            if waiting
            else set()
        )
        for call in waiting[: len(free)]:
            stop, _ = self.stations[call["station"]]
            ways = {serial: self.way(self.states[serial]["lastNodeId"], stop) for serial in free}
            nearest = min(free, key=lambda serial: (self.length(ways[serial]), serial))
            self.begin(nearest, call)
            free.remove(nearest)

    def is_free(self, serial):
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
        load, (stop, bin_node) = call["loadId"], self.stations[call["station"]]
        start = self.states[serial]["lastNodeId"]
        ways = [
            self.way(start, stop),
            self.way(stop, bin_node),
            self.way(bin_node, "bay"),
            self.way("bay", self.homes[serial]),
        ]
        actions = {stop: ("handOver", load), bin_node: ("pick", load), "bay": ("unload", None)}
        self.drive(serial, load, [start, *(name for way in ways for name in way[1:])], actions)
        self.jobs[serial]["call"] = call

    def drive(self, serial, load, names, actions):
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
        """Send an order or an update: from node number `first` to the end, with the base up to what
        is released.
        """
        job = self.jobs[serial]
        nodes = [self.node(job, number) for number in range(first, len(job["names"]))]
        edges = [
            {
                "edgeId": self.edges[job["names"][number], job["names"][number + 1]],
                "sequenceId": 2 * number + 1,
                "released": number + 1 <= job["base"],
                "actions": self.actions(job, (job["names"][number], job["names"][number + 1])),
            }
            for number in range(first, len(job["names"]) - 1)
        ]
        job |= {
            "silent": 0,
            "sent": {
                "orderId": job["order"],
                "orderUpdateId": job["update"],
                "nodes": nodes,
                "edges": edges,
            },
        }
        self.publish(serial, "order", job["sent"])

    def node(self, job, number):
        name = job["names"][number]
        at = self.map[name]["nodePosition"] | {"mapId": self.map[name]["mapId"]}
        return {
            "nodeId": name,
            "sequenceId": 2 * number,
            "released": number <= job["base"],
            "nodePosition": at,
            "actions": self.actions(job, name),
        }

    def actions(self, job, place):
        """The actions of a job at a node, or on the edge between two."""
        kind, load = job["actions"].get(place, ("", None))
        parameters = [{"key": "loadId", "value": load}] if load else []
        blocking = "NONE" if kind == "harvest" else "HARD"
        action = {
            "actionType": kind,
            "actionId": f"{job['order']} {kind}",
            "blockingType": blocking,
            "actionParameters": parameters,
        }
        return [action] if kind else []

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
        """Release more of a job where the base runs short. Forget it at its end."""
        if state["operatingMode"] != "AUTOMATIC":
            self.jobs.pop(serial, None)  # the vehicle has given it up
        job = self.jobs.get(serial)
        if (
            job
            and job["order"] is None
            and not state["nodeStates"]
            and state["instantActionStates"][-1]["actionStatus"] == "FINISHED"
        ):
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
            self.jobs[serial] |= {"order": None}
            self.instant(serial, "cancelOrder", orderId=state["orderId"])
        elif state["newBaseRequest"]:
            last, job["base"], job["update"] = (
                job["base"],
                job["base"] + self.released,
                job["update"] + 1,
            )
            self.order(serial, first=last)
        elif not state["nodeStates"] and all(
            one["actionStatus"] == "FINISHED" for one in state["actionStates"]
        ):
            self.finished.append(self.jobs.pop(serial)["load"])

    def instant(self, serial, kind, **parameters):
        """Send an instant action; return its id."""
        given = [{"key": key, "value": value} for key, value in parameters.items()]
        action = {
            "actionType": kind,
            "actionId": f"{kind} {next(self.headers)}",
            "blockingType": "NONE",
            "actionParameters": given,
        }
        self.publish(serial, "instantActions", {"actions": [action]})
        return action["actionId"]

    def publish(self, serial, topic, message):
        self.send(
            serial,
            topic,
            {"headerId": next(self.headers), **HEADER, "serialNumber": serial} | message,
        )

    # -- ways

    def way(self, start, end):
        """The nodes of the shortest way, both ends among them."""
        queue, known = [(0.0, [start])], set()
        while queue:
            length, names = heapq.heappop(queue)
            if names[-1] == end:
                return names
            if names[-1] not in known:
                known.add(names[-1])
                for onward in self.onward[names[-1]]:
                    heapq.heappush(
                        queue, (length + self.length([names[-1], onward]), [*names, onward])
                    )
        raise ValueError(f"no way from {start} to {end}")

    def length(self, names):
        places = [self.map[name]["nodePosition"] for name in names]
        return sum(abs(a["x"] - b["x"]) + abs(a["y"] - b["y"]) for a, b in pairwise(places))
