"""The blueprint of a recording: its views, their layout and their cameras.

Rerun shows a recording as its blueprint says. Places and targets of cameras are x, y, z (metres) on
the map. They, and the shares of the views, were chosen by eye in a window of usual size.
"""

import rerun as rr
import rerun.blueprint as rrb

from orchard.field.kinds import VEHICLES
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import Layout
from orchard.view import legend, palette
from orchard.view.columns import TIMELINE
from orchard.view.focus import FOCUS
from orchard.view.scenery import PLAN_CAMERA, plan_size

# Radius of a pin, m. A negative number is in screen points.
PIN_FAR = 0.6
PIN_NEAR = 0.4
PIN_ON_THE_PLAN = -5.0
# A plot's axis ends at so many times the highest possible value. So the legend lies above the
# curves.
HEADROOM = 1.6
# Up to this number of robots, all histories fit without scrolling.
FEW = 8
# Heights of a history's title and time axis, as fractions of a robot's line.
TITLE = 0.7
AXIS = 0.6

IN_SPACE = ["world/**", "canopy/**", "scans/**", "pins/**", "talk/**"]
BELOW_CROWNS = [
    "world/**",
    "scans/**",
    "pins/**",
    "talk/**",
    "focus",
    "canopy/wires",
    "canopy/crowns",
    "canopy/shade",
]
# m from the focus to its camera, which looks along the rows, between the trees.
BESIDE = (-12.5, -4.0, 7.0)
# Below this path is the charge of each battery, 0 flat to 1 full.
BATTERIES = "metrics/batteries"
PICKERS = ["world/pickers/**"]
OTHERS = [f"world/{kind}s/**" for kind in VEHICLES if kind != "picker"]
ON_THE_PLAN = ["world/**", "plan/**", "pins/**", "talk/**", "scans/**"]


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Return the blueprint: 3-D views above the plan, or beside a plan that is higher than wide,
    and histories; on the right figures and events.
    """
    pictures = rrb.Vertical(_pictures(layout), _legend(), row_shares=[15, 1])
    views = rrb.Horizontal(pictures, _figures(layout), column_shares=[11, 4])
    return _of(views, rrb.PanelState.Collapsed)


def _pictures(layout: Layout) -> rrb.Container:
    """Return 3-D views, plan and histories."""
    spaces = _spaces(layout)
    plan = _plan()
    tractors = 1
    others = layout.scenario.carrier_count + tractors
    histories = _histories(layout.scenario.pickers, others)
    if _is_high(layout):
        left = rrb.Vertical(spaces, histories, row_shares=[10, 10])
        return rrb.Horizontal(left, plan, column_shares=[12, 10])
    below = rrb.Horizontal(plan, histories, column_shares=[1, 1])
    return rrb.Vertical(spaces, below, row_shares=[11, 10])


def _figures(layout: Layout) -> rrb.Container:
    """Return the plots of bins, robots and batteries, if there are any, and the events."""
    most_robots = max(layout.scenario.pickers, layout.scenario.carrier_count)
    plots = [
        _plot("Bins", "metrics/bins", layout.bins),
        _plot("Robots", "metrics/robots", most_robots),
    ]
    if layout.scenario.has_batteries:
        plots.append(_plot("Batteries", BATTERIES, 1))
    return rrb.Vertical(*plots, _events(), row_shares=[3] * len(plots) + [4])


def for_page(layout: Layout) -> rrb.Blueprint:
    """Return a small blueprint for a page that draws figures itself: 3-D views and plan, side by
    side if it is high.
    """
    both = (_spaces(layout), _plan())
    if _is_high(layout):
        views: rrb.Container = rrb.Horizontal(*both, column_shares=[12, 10])
    else:
        views = rrb.Vertical(*both, row_shares=[12, 10])
    hidden = rrb.PanelState.Hidden
    return _of(views, hidden, rrb.TopPanel(state=hidden))


def _of(views: rrb.Container, panels: rrb.PanelState, *more: rrb.TopPanel) -> rrb.Blueprint:
    """Return a blueprint of some views. `panels`: whether those at the sides are open."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=TIMELINE, playback_speed=4.0),
        rrb.BlueprintPanel(state=panels),
        rrb.SelectionPanel(state=panels),
        *more,
        auto_views=False,
        auto_layout=False,
    )


def _is_high(layout: Layout) -> bool:
    """Whether the plan is at least as high as it is wide."""
    height, width = plan_size(layout)
    return height >= width


def _histories(pickers: int, others: int) -> rrb.Container:
    """Return what each robot did when, one below the other, or in tabs if there are many.

    `others`: carriers and tractor.
    """
    if pickers + others > FEW:
        return rrb.Tabs(
            _history("What the pickers do", PICKERS),
            _history("What carriers and tractor do", OTHERS),
        )
    both = (
        _history("What the robots do", PICKERS),
        _history("Carriers and tractor", OTHERS, titlebar=False),
    )
    return rrb.Vertical(*both, row_shares=[TITLE + AXIS + pickers, AXIS + others])


def _history(name: str, contents: list[str], titlebar: bool = True) -> rrb.StateTimelineView:
    """Return the history of some bodies. `contents`: filters of their paths."""
    return rrb.StateTimelineView(name=name, origin="world", contents=contents, titlebar=titlebar)


def _legend() -> rrb.Spatial2DView:
    """Return the legend of colours."""
    return rrb.Spatial2DView(
        name="Colours",
        origin=legend.LEGEND,
        titlebar=False,
        background=(13, 16, 17),
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, legend.WIDTH), y_range=(0.0, legend.HEIGHT)),
    )


def _spaces(layout: Layout) -> rrb.Tabs:
    """Return the 3-D views as tabs."""
    y = layout.lane(1).y
    # From west of the first row, at the height of a person, along it.
    inside = _eye((ROW_WEST - 5.5, y - 1.2, 2.2), (ROW_WEST + 14.0, y + 0.4, 1.0))
    return rrb.Tabs(
        at_work(layout),
        _space("Orchard", IN_SPACE, _outside(layout)),
        _space("Under the pergola", IN_SPACE, inside),
    )


def at_work(layout: Layout) -> rrb.Spatial3DView:
    """Return the view with a camera that goes along with the focus."""
    target = (ROW_WEST, layout.lane(1).y, 1.0)
    along, across, up = BESIDE
    position = (along + target[0], across + target[1], up)
    return _space("At work", BELOW_CROWNS, _eye(position, target, follow=FOCUS), PIN_NEAR)


def _outside(layout: Layout) -> rrb.EyeControls3D:
    """Return a camera that sees the whole orchard from beyond its southern end."""
    # y of the southern line of trees: `layout.tree_lines` go from north to south.
    south = layout.tree_lines[-1]
    if _is_high(layout):
        return _eye((48.0, south - 12.0, 13.0), (10.0, south + 26.0, -3.0))
    camera_z = 8.0 + 0.05 * (layout.top - south)
    return _eye((44.5, south - 7.0, camera_z), (13.0, south + 12.0, -3.0))


def _eye(
    position: tuple[float, float, float],
    target: tuple[float, float, float],
    follow: str | None = None,
) -> rrb.EyeControls3D:
    """Return a camera: where it is and what it looks at, m, and which entity it follows."""
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=position,
        look_target=target,
        eye_up=(0, 0, 1),
        tracking_entity=follow,
    )


def _space(
    name: str, contents: list[str], eye: rrb.EyeControls3D, pin: float = PIN_FAR
) -> rrb.Spatial3DView:
    """Return a 3-D view. `contents`: filters of paths. `pin`: radius of pins, m."""
    return rrb.Spatial3DView(
        name=name,
        origin="/",
        contents=contents,
        background=rrb.Background(kind="SolidColor", color=palette.SKY),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
        defaults=_of_pins(pin),
    )


def _of_pins(radius: float) -> list[rr.Points3D]:
    """Return what holds for pins that say nothing else: a robot without an agent has no state."""
    return [
        rr.Points3D.from_fields(
            radii=[radius], colors=[palette.STATES["resting"]], show_labels=False
        )
    ]


def _plan() -> rrb.Spatial2DView:
    """Return the plan, as the camera far above the orchard sees it."""
    pins = _of_pins(PIN_ON_THE_PLAN)
    return rrb.Spatial2DView(
        name="Plan",
        origin=PLAN_CAMERA,
        contents=ON_THE_PLAN,
        background=palette.MEADOW,
        defaults=pins,
    )


def _plot(name: str, origin: str, highest: int) -> rrb.TimeSeriesView:
    """Return a plot of all series below a path. `highest`: the highest possible value.

    The axis begins a little below 0, so that a curve at 0 is seen.
    """
    whole_run = rr.TimeRange(
        start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite()
    )
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        plot_legend=rrb.Corner2D.LeftTop,
        axis_x=rrb.TimeAxis(view_range=whole_run),
        axis_y=rrb.ScalarAxis(range=(-0.05 * highest, HEADROOM * highest)),
    )


def _events() -> rrb.TextLogView:
    """Return the log of events, without those of level DEBUG."""
    levels = rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR"])
    return rrb.TextLogView(
        name="Events",
        origin="events",
        rows=levels,
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
    )
