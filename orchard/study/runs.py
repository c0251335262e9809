"""One run of a study: one setting with one seed by one model, in one worker process.

Its result is a flat record, which the store keeps. The key of a record is a digest of everything
that decides the result: the scenario, the seed, the model, the version of this software, and the
source of the user's own classes. So a run of the same key need not be done again.
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
    fault_words,
    is_own,
    load_plugin,
    place_of_error,
    reraise_ctrl_c,
)
from orchard.field.scenario import END, Scenario
from orchard.local import Local
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question, with_seed
from orchard.report.long_run import long_run
from orchard.report.metrics import HarvestFigures, harvest_figures
from orchard.sim.engine import Engine
from orchard.study.result import Horizon, Model

# Bins an hour, the least rate of a run that has not jammed. These limits find damage in a store.
LEAST_RATE = 1e-6
Amount = Annotated[float, Meta(ge=0.0, lt=1e12)]
# Work of the solver for a proof (`orchard.optimum.schedule`): at most about 8 s.
WORK = 2.0
# "violated": an invariant of the simulator did not hold.
Ended = Literal["harvested", "jammed", "violated"]

# The packages that decide the result of a run, with local.py and this file.
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
)
# Keys of the scenario that are not in its digest: the seed has a column of its own in the store,
# and the others change no run.
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

    @property
    def name(self) -> str:
        """The run in words, for messages."""
        return f"seed {self.scenario.seed}, {self.model} model, {self.scenario.dispatch}"

    @cached_property
    def key(self) -> str:
        """The digest of all that decides the run's result."""
        return key_of_run(
            scenario=self.scenario_digest,
            seed=self.scenario.seed,
            model=self.model,
            horizon=self.horizon,
            version=software(),
            own_source=self.own_source,
        )

    @cached_property
    def own_source(self) -> str:
        """The digest of the files of own classes; '' if there are none. Raises ScenarioError."""
        classes = self.scenario.own_classes
        if not classes:
            return ""
        return digest(*own_source(tuple(classes.items())))

    @cached_property
    def scenario_digest(self) -> str:
        """The digest of the scenario without its seed, prices and shift."""
        return digest(self.scenario.model_dump_json(exclude=set(NOT_DECIDING)))

    def do(self, until: float) -> "RunRecord | None":
        """Do the run in this process.

        Return None if a run of the simulator is not over at `until`, a time of time.time().
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

    In a jammed run only the bound, the bottleneck, `ended`, `violations` and `faults` have a
    meaning.
    """

    sim_seconds: Amount = 0.0
    bins: Annotated[int, Meta(ge=0)]
    # Of one harvest: of its bins, which may be part full. Of a long run: of full bins, in rows that
    # take their mean times.
    bins_per_hour: Amount = 0.0
    picker_waiting_seconds: Amount = 0.0
    carrier_utilisation: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    # The limit without traffic, which `bottleneck` sets. Of one harvest: of the rows of its seed.
    # Of a long run: of rows that take their mean times.
    bound_bins_per_hour: Annotated[float, Meta(ge=LEAST_RATE, lt=1e12)]
    bottleneck: str
    ended: Ended
    # Of invariants, a line for each.
    violations: str = ""
    # Of own classes, a line for each: refused orders and broken agents. If the fast model jammed:
    # why.
    faults: str = ""

    @property
    def is_jammed(self) -> bool:
        """Whether robots waited for ever, so that the harvest did not end."""
        return self.ended == "jammed"

    @property
    def first_fault(self) -> str:
        """The first line of `faults`. Raises IndexError if there is none."""
        return self.faults.splitlines()[0]


@dataclass(frozen=True, kw_only=True)
class RunRecord(RunResult):
    """A run and how it went, flat: one row of the store."""

    key: str
    # The digest of all of it that decides what runs give, but for the seed.
    scenario: str
    seed: int
    model: Model
    horizon: Horizon
    policy: str
    # The digest of the files of own classes; '' if there are none.
    own_source: str
    version: str
    wall_seconds: Amount

    @property
    def counted_bins(self) -> int | None:
        """The bins of a whole harvest; None for a long run, which has no last bin."""
        if self.horizon == "long":
            return None
        return self.bins

    def __post_init__(self) -> None:
        if not self.is_jammed and self.bins_per_hour < LEAST_RATE:
            raise ValueError(f"bins_per_hour = {self.bins_per_hour} of a run that has not jammed")
        key = key_of_run(
            scenario=self.scenario,
            seed=self.seed,
            model=self.model,
            horizon=self.horizon,
            version=self.version,
            own_source=self.own_source,
        )
        if self.key != key:
            raise ValueError("these are not the values of the run with its key")


class RunFailed(Exception):
    """A run raised an error, as a class of the user's own may do.

    The text says which run, which error, and where.
    """


def do(run: PlannedRun, until: float) -> RunRecord | None:
    """Do a run in a worker: see `PlannedRun.do`. Raises RunFailed."""
    try:
        return run.do(until)
    except PolicyFault as fault:
        raise RunFailed(f"{run.name}: {fault}") from None
    # SystemExit is among MISTAKES: it would end the worker, and say nothing.
    except MISTAKES as error:
        reraise_ctrl_c(error)
        raise RunFailed(f"{run.name}: {fault_words(error)}{place_of_error(error)}") from None


def outcome_of(run: PlannedRun, until: float) -> RunRecord | RunFailed | None:
    """Do a run in a worker: see `PlannedRun.do`. Return the error of a run that fails.

    So the worker's other runs are not lost.
    """
    try:
        return do(run, until)
    except RunFailed as failure:
        return failure


def key_of_run(
    *, scenario: str, seed: int, model: Model, horizon: Horizon, version: str, own_source: str
) -> str:
    """Return the key of a run. `scenario`, `own_source`: digests; `version`: of the software."""
    parts = (scenario, seed, model, horizon, version, own_source)
    return digest(*parts)


def digest(*parts: object) -> str:
    """Return 32 hexadecimal digits that differ if any part does."""
    return hashlib.sha256(json.dumps([str(part) for part in parts]).encode()).hexdigest()[:32]


@cache
def software() -> str:
    """Return the version of this software, with a digest of the files that decide the result of a
    run: "0.1.0+1f3a9c2b".
    """
    root = Path(inspect.getfile(orchard)).parent
    files = [root / "local.py", Path(__file__)]
    for package in DECIDING:
        files += sorted((root / package).rglob("*.py"))
    content = hashlib.sha256()
    for file in files:
        content.update(file.read_bytes())
    # In a clone that is not installed, as for `run.py`, there is no version.
    release = "clone"
    with suppress(PackageNotFoundError):
        release = version("orchard-sim")
    return f"{release}+{content.hexdigest()[:8]}"


# -- the models


def _fast(scenario: Scenario, horizon: Horizon) -> RunResult:
    """Return how a harvest, or a long run, goes in the event model."""
    layout = lay_out(scenario)
    bounds = Bounds(layout)
    is_long = horizon == "long"
    limit = bounds
    if is_long:
        limit = limit_of_question(scenario)
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
    """Return what is proven of the shortest harvest, in the form of a run for the store."""
    # OR-tools is in an extra, and takes half a second to load.
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
    """Return how a harvest goes in the simulator; None if it has not ended at the time `until`.

    The run computes no hash, so that it is faster.
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
        faults="\n".join(faults_of(summary)),
    )


def _end_of(engine: Engine, violations: Sequence[str]) -> Ended:
    """Return how a harvest in the simulator has ended."""
    if violations:
        return "violated"
    if engine.over:
        return "harvested"
    return "jammed"


def faults_of(summary: dict[str, Any]) -> list[str]:
    """Return what classes of the user's own did wrong in a run, a line each."""
    faults = [f"{agent} was broken" for agent in summary["broken_agents"]]
    if summary["orders_refused"]:
        faults.insert(0, f"refused decisions of the dispatch policy: {summary['orders_refused']}")
    return faults


# -- the source of the user's own classes


@cache
def own_source(classes: tuple[tuple[str, str], ...]) -> tuple[bytes, ...]:
    """Return the content of the files of own classes, and of the user's files that these import.

    A run is known while these stay the same.
    """
    for key, path in classes:
        field = key
        if key not in Scenario.model_fields:
            field = f"agents.{key}"
        load_plugin(field, path)
    # A class is named as "package.module.Class" or "package.module:Class".
    modules = [path.replace(":", ".").rpartition(".")[0] for _, path in classes]
    # A package with an own class counts as the user's even if it is installed as a library.
    packages = {_top_package(module) for module in modules}
    contents: dict[str, bytes] = {}
    while modules:
        module = modules.pop()
        file = _file(module, packages)
        if file is not None and module not in contents:
            contents[module] = file.read_bytes()
            modules += _imported(contents[module], _package_of(module, file))
    return tuple(contents[module] for module in sorted(contents))


def _top_package(module: str) -> str:
    return module.partition(".")[0]


def _package_of(module: str, file: Path) -> str:
    """Return the package in which a module stands: relative imports start from it."""
    if file.stem == "__init__":
        return module
    return module.rpartition(".")[0]


def _file(module: str, packages: set[str]) -> Path | None:
    """Return the file of a module; None if it is not the user's.

    `packages`: the user's packages. A module of a library is not looked for, because to find a
    submodule Python imports its package.
    """
    package = _top_package(module)
    with suppress(ImportError, ValueError):
        top = find_spec(package)
        if top is None:
            return None
        if package in packages or top.origin is None or is_own(top.origin):
            origin = _origin(module)
            if origin.endswith(".py"):
                return Path(origin)
    return None


def _origin(module: str) -> str:
    """Return from where a module would be loaded; '' for one that is not there.

    Raises ImportError or ValueError.
    """
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return ""
    return spec.origin


def _imported(source: bytes, package: str) -> Iterator[str]:
    """Yield the modules that a source may import: for "import a.b.c" a, a.b and a.b.c."""
    for node in ast.walk(ast.parse(source)):
        for name in _names_imported(node, package):
            yield from accumulate(name.split("."), "{}.{}".format)


def _names_imported(node: ast.AST, package: str) -> Iterator[str]:
    """Yield the names that a statement may import. `package`: in which it stands."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield alias.name
    elif isinstance(node, ast.ImportFrom):
        try:
            module = resolve_name("." * node.level + (node.module or ""), package)
        except ImportError:
            # The dots lead out of all packages. Such an import fails, and the module may handle
            # that.
            return
        yield module
        for alias in node.names:
            yield f"{module}.{alias.name}"
