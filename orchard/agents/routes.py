"""The routes by name, and the one that a scenario names: a built-in route, or a user's class."""

from orchard.agents.route import OneWay
from orchard.agents.two_way import TwoWay
from orchard.field.layout import Layout
from orchard.field.plugins import make_plugin
from orchard.field.queue import ONE_WAY, TWO_WAY

ROUTES = {ONE_WAY: OneWay, TWO_WAY: TwoWay}


def route_of(layout: Layout) -> OneWay:
    """The route that the scenario names. Raises ScenarioError for one that cannot be used."""
    route: OneWay = make_plugin("route", layout.scenario.route, ROUTES, layout, base=OneWay)
    return route
