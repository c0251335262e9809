"""Starts the processes that host agents, for a run that begins here or for a run elsewhere.

distributed.py uses it for a run that begins here. With `--only` and `--connect` harvest.py calls
`join_run`, for a run that goes on elsewhere.
"""

from orchard.field.kinds import select_agents
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest, Shares, agent_names
from orchard.launch.supervisor import BAD_ORDER, ProcessSpec, Supervisor, allow_processes
from orchard.net.bus import Inbox, Signal
from orchard.net.endpoints import from_elsewhere, is_public
from orchard.net.options import HostOptions
from orchard.net.requests import fetch_run
from orchard.net.zenoh_bus import client
from orchard.report.progress import Progress
from orchard.terminal.typed import typed
from orchard.wire.keys import Keys

# All of these are in s of wall time.
# In which a router must answer at an endpoint that a user gave.
LOOK_SECONDS = 5.0
# That the processes may take to close their files after Ctrl-C.
STOP_SECONDS = 2.0
# Between two checks whether the processes have ended.
POLL_SECONDS = 0.02
# Between two looks at the processes while nothing comes from the bus.
POLL_BUS_SECONDS = 0.2
# That an agent may still think after a run has ended by itself.
THINK_SECONDS = 5.0


def hosted(request: RunRequest) -> tuple[list[str], list[str]]:
    """Return the names of the agents that are hosted here, and of all agents of a run."""
    names = agent_names(request.scenario)
    return select_agents(names, [], request.options.without or []), names


def start_hosts(
    supervisor: Supervisor, endpoint: str, shares: Shares, credentials: Credentials
) -> None:
    """Start the processes that host agents. `shares`: name of a process -> its agents."""
    options = credentials.options
    for name, agents in shares:
        order = HostOptions(
            connect=endpoint,
            secure=credentials.folder(name),
            only=list(agents),
            check_agents=options.check_agents,
            replay=None if options.replay is None else str(options.replay.resolve()),
            from_first_stamp=options.from_first_stamp,
        )
        supervisor.start(
            ProcessSpec(name, "orchard.processes.agents", order, again=True, agents=agents)
        )


def how_to_join(options: HarvestOptions, endpoint: str) -> str:
    """Return how other machines join the run; "" if they cannot.

    If agents are left to other processes, it is the command that runs them. Else it is the address
    of the run.
    """
    there = from_elsewhere(endpoint)
    if options.without:
        command: list[str] = ["--connect", there]
        if options.secure:
            command += ["--secure", "DIR/ROLE"]
        for agents in options.without:
            command += ["--only", agents]
        return f"{', '.join(options.without)}: left to other processes: {typed(*command)}"
    if is_public(endpoint):
        return f"Other machines reach this run at {there}"
    return ""


def join_run(
    endpoint: str, only: list[str], without: list[str], credentials: Credentials, progress: Progress
) -> int:
    """Host these agents of a run elsewhere until it ends. Return the exit code.

    `only`, `without`: names or kinds of agents. Raises BusError or ValueError.
    """
    with client(endpoint, seconds=LOOK_SECONDS, identity=credentials.only_identity()) as bus:
        all_names = fetch_run(bus, Keys()).agents
    names = select_agents(all_names, only, without)
    shares = credentials.shares(names, all_names)
    allow_processes(len(shares))
    inbox = Inbox()
    inbox.take_signals()
    with Supervisor(progress.say) as supervisor:
        start_hosts(supervisor, endpoint, shares, credentials)
        progress.say(f"hosting {', '.join(names)} at {endpoint}")
        # A process that is given up is not in `running` any more.
        while not all(map(supervisor.is_over, supervisor.running)):
            if isinstance(inbox.take(POLL_BUS_SECONDS), Signal):
                supervisor.stop(STOP_SECONDS)
                return 0
            if supervisor.has_refused():
                return BAD_ORDER
            supervisor.watch()
        if supervisor.given_up:
            return 1
        return 0


# -- the end of a run


def await_exits(supervisor: Supervisor, names: list[str], inbox: Inbox, seconds: float) -> None:
    """Wait until all processes have ended, at most `seconds`. After THINK_SECONDS kill `names`."""
    begin = supervisor.clock()
    waited = 0.0
    while supervisor.is_any_left() and waited < seconds:
        if isinstance(inbox.take(POLL_SECONDS), Signal):
            supervisor.stop(STOP_SECONDS)
        waited = supervisor.clock() - begin
        if waited >= THINK_SECONDS:
            _kill_running(supervisor, names)


def _kill_running(supervisor: Supervisor, names: list[str]) -> None:
    """Kill those of some processes that still run, and say so."""
    for name in names:
        if not supervisor.is_running(name):
            continue
        agents = ", ".join(supervisor.running[name].program.agents)
        hosted = f"; its agents: {agents}" if agents else ""
        supervisor.say(
            f"{name} has not ended {THINK_SECONDS:g} s after the run, and is ended by force{hosted}"
        )
        supervisor.kill(name)
