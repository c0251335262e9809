"""One run of a study: one setting with one seed by one model, in one process; what came out is a
flat record.
"""

import ast
import hashlib
import inspect
import json
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec, resolve_name
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

import orchard
from orchard.behaviour.dispatcher import PolicyFault
from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.field.layout import lay_out
from orchard.field.plugins import (
    MISTAKES,
    is_own,
    load_plugin,
    place_of_error,
    reraise_ctrl_c,
    text_of,
)
from orchard.field.scenario import END, Scenario
from orchard.local import Local
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question, with_seed
from orchard.report.long_run import long_run
from orchard.report.metrics import HarvestFigures, harvest_figures
from orchard.sim.engine import Engine
from orchard.study.result import Horizon, Model

LEAST_RATE = 1e-6  # bins an hour; the limits are for what comes from a store
Amount = Annotated[float, Meta(ge=0.0, lt=1e12)]
WORK = 2.0  # of the solver for a bound: at most some 8 s
Ended = Literal["harvested", "jammed", "violated"]

DECIDING = (
    "behaviour",
    "contract",
    "discrete",
    "dispatch",
    "event_model",
    "field",
    "optimum",
    "plans",
    "report",
    "sim",
)  # packages that, with two files, decide what a run gives
# Keys of the scenario: the seed has a column of its own, and the others change no run.
NOT_DECIDING = (
    "seed",
    "prices",
    "shift",
)


@dataclass(frozen=True)
class PlannedRun:
    """A run to do. `scenario` has the seed of this replication."""

    scenario: Scenario
    model: Model
    horizon: Horizon = "harvest"

    @classmethod
    def of(cls, scenario: Scenario, seed: int, model: Model, horizon: Horizon) -> "PlannedRun":
        """Return the run of a scenario with another seed."""
        return cls(with_seed(scenario, seed), model, horizon)

    @cached_property
    def key(self) -> str:
        """The digest of all that decides what the run gives: scenario, seed, model, horizon,
        software, own classes.
        """
        return digest(
            self.scenario_digest,
            self.scenario.seed,
            self.model,
            self.horizon,
            software(),
            self.own_source,
        )

    @cached_property
    def own_source(self) -> str:
        """The digest of the files of own classes; '' if there are none. Raises ScenarioError."""
        classes = self.scenario.own_classes
        return digest(*own_source(tuple(classes.items()))) if classes else ""

    @cached_property
    def scenario_digest(self) -> str:
        """The digest of the scenario without its seed, prices and shift."""
        return digest(self.scenario.model_dump_json(exclude=set(NOT_DECIDING)))

    def do(self, until: float) -> "RunRecord | None":
        """Do the run in this process.

        Return None if a full one is not over at `until`, as time.time().
        """
        begun = time.perf_counter()
        outcome: RunResult | None
        if self.model == "proven":
            outcome = _proven(self.scenario)
        elif self.model == "full":
            outcome = _full(self.scenario, until)
        else:
            outcome = _fast(self.scenario, self.horizon)
        if outcome is None:
            return None
        return RunRecord(
            key=self.key,
            scenario=self.scenario_digest,
            seed=self.scenario.seed,
            model=self.model,
            horizon=self.horizon,
            policy=self.scenario.dispatch,
            own_source=self.own_source,
            version=software(),
            wall_seconds=time.perf_counter() - begun,
            **vars(outcome),
        )


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """How a run went.

    Of a jammed run the bins, the time, the rate, the wait and the utilisation mean nothing.
    """

    sim_seconds: Amount = 0.0
    bins: Annotated[int, Meta(ge=0)]
    # Of bins that may be part full; in a long run of full ones, in rows that take their mean times.
    bins_per_hour: Amount = 0.0
    picker_waiting_seconds: Amount = 0.0
    carrier_utilisation: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    bound_bins_per_hour: Annotated[
        float, Meta(ge=LEAST_RATE, lt=1e12)
    ]  # by `bottleneck`, without traffic: of its own rows; of a long run, of rows of mean times
    bottleneck: str
    ended: Ended
    violations: str = ""  # a line for each
    # A line for each: of own classes, refused orders and broken agents; why a run by the fast model
    # jammed.
    faults: str = ""


@dataclass(frozen=True, kw_only=True)
class RunRecord(RunResult):
    """A run and how it went, flat: one row of the store."""

    key: str
    scenario: str  # digest of all of it that decides what runs give, but for the seed
    seed: int
    model: Model
    horizon: Horizon
    policy: str
    own_source: str  # digest of the files of own classes; '' if there are none
    version: str
    wall_seconds: Amount

    @property
    def counted_bins(self) -> int | None:
        """The bins of a whole harvest; None of a long run, which is a part of one."""
        return self.bins if self.horizon == "harvest" else None

    def __post_init__(self) -> None:
        if self.ended != "jammed" and self.bins_per_hour < LEAST_RATE:
            raise ValueError(f"bins_per_hour = {self.bins_per_hour} of a run that has not jammed")
        if self.key != digest(
            self.scenario, self.seed, self.model, self.horizon, self.version, self.own_source
        ):
            raise ValueError("these are not the values of the run with its key")


class RunFailed(Exception):
    """A run raised an error, as one with an own class may do: the text says which run, what, and
    where.
    """


def do(run: PlannedRun, until: float) -> RunRecord | None:
    """Do a run in a worker: see `PlannedRun.do`. Raises RunFailed."""
    which = f"seed {run.scenario.seed}, {run.model} model, {run.scenario.dispatch}"
    try:
        return run.do(until)
    except PolicyFault as fault:
        raise RunFailed(f"{which}: {fault}") from None
    except MISTAKES as error:  # SystemExit too: it would end the study, and say nothing
        reraise_ctrl_c(error)
        raise RunFailed(
            f"{which}: {type(error).__name__}: {text_of(error)}{place_of_error(error)}"
        ) from None


def digest(*parts: object) -> str:
    """Return 32 hexadecimal digits that differ if any part does."""
    return hashlib.sha256(json.dumps([str(part) for part in parts]).encode()).hexdigest()[:32]


@cache
def software() -> str:
    """Return the version of this software, with a digest of the files that decide what a run gives:
    "0.1.0+1f3a9c2b".
    """
    root = Path(inspect.getfile(orchard)).parent
    files = [
        root / "local.py",
        Path(__file__),
        *(path for package in DECIDING for path in sorted((root / package).rglob("*.py"))),
    ]
    content = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
    release = "clone"  # not installed, as `run.py` allows
    with suppress(PackageNotFoundError):
        release = version("orchard-sim")
    return f"{release}+{content[:8]}"


# -- the models


def _fast(scenario: Scenario, horizon: Horizon) -> RunResult:
    """Return how a harvest, or a long run, goes in the event model."""
    layout = lay_out(scenario)
    bounds = Bounds(layout)
    is_long = horizon == "long"
    limit = limit_of_question(scenario) if is_long else bounds
    known: dict[str, Any] = {
        "bound_bins_per_hour": limit.bins_per_hour,
        "bottleneck": limit.bottleneck,
    }
    try:
        if is_long:
            figures = vars(long_run(layout, bounds=bounds, limit=limit))
        else:
            figures = vars(DiscreteHarvest(layout).run().figures())
    except Jam as jam:
        return RunResult(bins=0, ended="jammed", faults=str(jam), **known)
    return RunResult(ended="harvested", **figures, **known)


def _proven(scenario: Scenario) -> RunResult:
    """Return what is proven of the shortest harvest, as if it were one."""
    # It is an extra, and takes half a second to load.
    from orchard.optimum.schedule import optimum

    layout = lay_out(scenario)
    proof = optimum(layout, WORK)
    bounds = Bounds(layout)
    return RunResult(
        sim_seconds=proof.proven_seconds,
        bins=proof.bins,
        bins_per_hour=3600.0 * proof.bins / proof.proven_seconds,
        bound_bins_per_hour=bounds.bins_per_hour,
        bottleneck=bounds.bottleneck,
        ended="harvested",
    )


def _full(scenario: Scenario, until: float) -> RunResult | None:
    """Return how a harvest goes in the simulator; None if the clock is at `until` before it ends.

    It has no hash.
    """
    local = Local(scenario, is_hashed=False)
    engine = local.engine
    figures = HarvestFigures()
    ends_at_refusal = scenario.dispatch_errors == END
    while not engine.over and not figures.jammed(engine.world):
        if ends_at_refusal and figures.orders_refused:
            break
        figures.update(engine.world, local.tick(), local.answers)
        if time.time() > until:
            return None
    summary = harvest_figures(engine.world, figures)
    violations = engine.violations()
    return RunResult(
        sim_seconds=summary["sim_seconds"],
        bins=summary["bins_delivered"],
        bins_per_hour=summary["bins_delivered"] * 3600.0 / summary["sim_seconds"],
        picker_waiting_seconds=summary["picker_waiting_seconds"],
        carrier_utilisation=summary["carrier_utilisation"],
        bound_bins_per_hour=summary["limit_bins_per_hour"],
        bottleneck=summary["bottleneck"],
        ended=_end_of(engine, violations),
        violations="\n".join(violations),
        faults="\n".join(_faults(summary)),
    )


def _end_of(engine: Engine, violations: Sequence[str]) -> Ended:
    """Return how a harvest in the simulator has ended."""
    if violations:
        return "violated"
    return "harvested" if engine.over else "jammed"


def _faults(summary: dict[str, Any]) -> list[str]:
    """Return what has gone wrong in a run, a line each."""
    faults = [f"{agent} was broken" for agent in summary["broken_agents"]]
    if summary["orders_refused"]:
        faults.insert(0, f"refused decisions of the dispatch policy: {summary['orders_refused']}")
    return faults


# -- the source of the user's own classes


@cache
def own_source(classes: tuple[tuple[str, str], ...]) -> tuple[bytes, ...]:
    """Return the files of own classes, and the user's files that these import: a run is known while
    these stay the same.
    """
    for key, path in classes:
        load_plugin(key if key in Scenario.model_fields else f"agents.{key}", path)
    files: dict[str, bytes] = {}
    left = [path.replace(":", ".").rpartition(".")[0] for _, path in classes]
    packages = {
        module.partition(".")[0] for module in left
    }  # one that is installed as a library is the user's too
    while left:
        name = left.pop()
        file = _file(name, packages)
        if file is not None and name not in files:
            files[name] = file.read_bytes()
            left += _imported(
                files[name], name if file.stem == "__init__" else name.rpartition(".")[0]
            )
    return tuple(files[name] for name in sorted(files))


def _file(name: str, packages: set[str]) -> Path | None:
    """The file of a module if it is the user's.

    A library is not even looked into, because that would import it.
    """
    whole = name.partition(".")[0]
    with suppress(ImportError, ValueError):
        top = find_spec(whole)
        if top is not None and (whole in packages or top.origin is None or is_own(top.origin)):
            found = find_spec(name)
            return (
                Path(found.origin)
                if found and found.origin and found.origin.endswith(".py")
                else None
            )
    return None


def _imported(source: bytes, package: str) -> Iterator[str]:
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            with suppress(
                ImportError
            ):  # of no package: such an import fails, and the module may do without
                whole = resolve_name("." * node.level + (node.module or ""), package)
                names += [whole, *(f"{whole}.{alias.name}" for alias in node.names)]
    return (part for name in names for part in accumulate(name.split("."), "{}.{}".format))
