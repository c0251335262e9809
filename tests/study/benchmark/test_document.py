"""The figures of docs/benchmark.md that no generator writes: they are those of its JSON files.

docs/benchmark.json has the harvests of all policies, with the times that are proven possible, s.
"""

import json
import re
from pathlib import Path
from statistics import fmean

from orchard.field.scenario import DISPATCH_POLICIES
from orchard.study.benchmark.instances import instances

DOCS = Path(__file__).parents[3] / "docs"
TEXT = " ".join((DOCS / "benchmark.md").read_text().split())
MEASURED = json.loads((DOCS / "benchmark.json").read_text())


def percent_of(policy: str, split: str) -> str:
    """Return the score of a policy in the orchards whose names end in `split`, in %, as a document
    has it. A harvest that is never finished (no seconds) scores 0.
    """
    scores = []
    for one in MEASURED["harvests"]:
        if one["policy"] == policy and one["orchard"].endswith(split):
            pairs = zip(one["proven"], one["seconds"], strict=True)
            scores.append(fmean(proven / seconds if seconds else 0.0 for proven, seconds in pairs))
    return f"{100.0 * fmean(scores):.1f}"


def test_the_text_tells_the_score_of_rolling():
    (told,) = re.findall(r"`rolling` has (\S+) % of what is proven\.", TEXT)
    assert told == percent_of("rolling", "")


def test_the_text_tells_the_scores_beside_learning():
    """They are those of the split for the test."""
    wanted = r"`rolling` has (\S+) there, `predictive` (\S+), and `predictive-farthest` (\S+)\. "
    (told,) = re.findall(wanted, TEXT)
    policies = ("rolling", "predictive", "predictive-farthest")
    assert told == tuple(percent_of(policy, "-test") for policy in policies)


def test_the_text_tells_what_learning_ends_at():
    curves = json.loads((DOCS / "learning.json").read_text())["curves"].values()
    ends = [100.0 * points[-1][-1] for points in curves]
    (told,) = re.findall(r"It ends at (\S+) to (\S+), (\S+) on average\.", TEXT)
    assert told == tuple(f"{end:.1f}" for end in (min(ends), max(ends), fmean(ends)))


def test_the_text_tells_what_batteries_cost():
    wanted = r"`small-batteries-test` `predictive` has (\S+), and `rolling` (\S+)\. "
    (told,) = re.findall(wanted, TEXT)
    policies = ("predictive", "rolling")
    assert told == tuple(percent_of(policy, "small-batteries-test") for policy in policies)


def best_of(name: str) -> str:
    """Return the score of the best known schedules of an orchard, as a document has it."""
    draws = instances()[name].draws
    return f"{100.0 * fmean(draw.proven_seconds / draw.best.seconds for draw in draws):.1f}"


def test_the_table_of_searches_has_what_the_files_have():
    """The best order found is the schedule in the instance's file."""
    table = TEXT.partition("| best order found, % |")[2].partition("So orders")[0]
    rows = re.findall(r"\| (\S+) \| (\S+) \| (\S+) \| (\S+) \|", table)
    assert len(rows) == 12, "as many as there are in the document"
    for name, rolling, best_policy, found in rows:
        assert rolling == percent_of("rolling", name)
        scores = [float(percent_of(policy, name)) for policy in DISPATCH_POLICIES]
        assert float(best_policy) == max(scores)
        assert found == best_of(name)


def test_the_text_tells_what_all_searches_found():
    (told,) = re.findall(r"The best known schedules of all 38 orchards have (\S+) %", TEXT)
    scores = []
    for instance in instances().values():
        draws = instance.draws
        scores.append(fmean(draw.proven_seconds / draw.best.seconds for draw in draws))
    assert told == f"{100.0 * fmean(scores):.1f}"
