"""The full model's word about the best two settings of a race, beside that of the fast model."""

from functools import partial

from orchard.study.racing import Race
from orchard.study.replications import Replications
from orchard.study.result import Check, Interval
from orchard.study.statistics import interval

CHECKS = 5  # replications by the full model of each of the best two
LEAST_CHECKS = 3  # fewer are told


class Confirmation:
    """The full model harvests the best two settings, on the seeds of the fast model. `run` does it; then `checks` and `notes` tell."""

    def __init__(self, race: Race, replications: Replications) -> None:
        self.race, self.replications, self.settings = race, replications, replications.settings
        self.checks: dict[int, Check] = {}
        self.notes: list[str] = []

    def run(self, until: float) -> None:
        """Have the full model harvest, as far as the time allows."""
        if self.race.best is None or self.replications.is_stopped():
            return
        two = [self.race.best, *self._runner_up()]
        wanted = CHECKS if any(self.settings[i].is_random for i in two) else 1
        step = max(1, self.replications.workers.count // len(two))
        for count in (*range(step, wanted, step), wanted):
            if count > step and not self.replications.fits(two, "full", count, until):
                break
            if not self.replications.do(two, "full", count, until):
                break
        for i in two:
            if self.replications.known(i, "full"):
                self.checks[i] = self._check(i)
            self.notes += self._notes(i, wanted)

    def _runner_up(self) -> list[int]:
        """The second best setting. If some cannot be told apart from the best, and there are prices, it is the cheapest of these."""
        race, mean = self.race, self.replications.mean
        left = [i for i in race.left if i != race.best]
        others = left or [i for i in race.out if i not in race.jammed]
        if left and self.settings[0].has_prices:
            return [min(left, key=lambda i: mean(i, "fast", lambda record: self.settings[i].cost_per_bin(record.bins_per_hour) or 0.0))]
        sign = -1.0 if race.is_max else 1.0
        return sorted(others, key=lambda i: sign * mean(i, "fast", partial(self.replications.value, i)))[:1]

    def _check(self, i: int) -> Check:
        """What the full model says of a setting, beside the fast one on the same seeds."""
        full, fast = self.replications.known(i, "full"), self.replications.known(i, "fast")
        rates = [record.bins_per_hour for record in full if record.ended != "jammed"]
        beside = fast if self.settings[i].is_random else fast * len(full)
        pairs = [(one, other) for one, other in zip(full, beside, strict=False) if one.ended != "jammed"]
        found = interval(rates, self.race.confidence) if rates else Interval(mean=0.0, low=0.0, high=0.0)
        difference = 1.0 - sum(other.bins_per_hour for _, other in pairs) / sum(one.bins_per_hour for one, _ in pairs) if pairs else 0.0
        return Check(bins_per_hour=found, difference=difference, replications=len(full), jammed=len(full) - len(rates))

    def _notes(self, i: int, wanted: int) -> list[str]:
        """What the budget did not allow, and what jams only in the full model."""
        words, check, notes = self.settings[i].words or "the scenario", self.checks.get(i), []
        if check is None:
            return [f"the budget did not allow a run of {words} by the simulator: the fast model alone answers"]
        if check.replications < wanted:
            least = f"; {LEAST_CHECKS} are the least for a sound check" if check.replications < min(LEAST_CHECKS, wanted) else ""
            notes.append(f"the budget allowed {check.replications} of {wanted} runs of {words} by the simulator{least}")
        if check.jammed:
            notes.append(f"{words}: {check.jammed} of {check.replications} runs jammed in the simulator, and none in the fast model")
        return notes
