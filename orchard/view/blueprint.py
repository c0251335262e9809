"""The blueprint of a recording: its views, their layout and their cameras."""

import rerun as rr
import rerun.blueprint as rrb

from orchard.field.kinds import VEHICLES
from orchard.field.layout import ROW_WEST, Layout
from orchard.view import legend, palette
from orchard.view.columns import TIMELINE
from orchard.view.names import FOCUS
from orchard.view.scenery import PLAN_CAMERA, plan_size

PIN_FAR, PIN_NEAR, PIN_ON_THE_PLAN = (
    0.6,
    0.4,
    -5.0,
)  # radius of a pin, m; a negative number is in screen points
HEADROOM = 1.6  # end of a plot's axis, in highest possible values: the legend lies above the curves
FEW = 8  # robots: up to this number, all histories fit without scrolling
TITLE, AXIS = 0.7, 0.6  # heights of a history's title and time axis, as fractions of a robot's line

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
BESIDE = (
    -12.5,
    -4.0,
    7.0,
)  # m from the focus to its camera, which looks along the rows, between the trees
BATTERIES = "metrics/batteries"  # below it the charge of each battery, 0 flat to 1 full
PICKERS, OTHERS = (
    ["world/pickers/**"],
    [f"world/{kind}s/**" for kind in VEHICLES if kind != "picker"],
)
ON_THE_PLAN = ["world/**", "plan/**", "pins/**", "talk/**", "scans/**"]


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Return the blueprint: 3-D views above the plan, or beside a high one, and histories; beside
    them figures and events.
    """
    pickers, carriers = layout.scenario.pickers, layout.scenario.carrier_count
    spaces, histories, plan = _spaces(layout), _histories(pickers, carriers + 1), _plan()
    if _is_high(layout):
        left = rrb.Vertical(spaces, histories, row_shares=[10, 10])
        pictures: rrb.Container = rrb.Horizontal(left, plan, column_shares=[12, 10])
    else:
        pictures = rrb.Vertical(
            spaces, rrb.Horizontal(plan, histories, column_shares=[1, 1]), row_shares=[11, 10]
        )
    plots = [
        _plot("Bins", "metrics/bins", layout.bins),
        _plot("Robots", "metrics/robots", max(pickers, carriers)),
    ]
    if layout.scenario.has_batteries:
        plots.append(_plot("Batteries", BATTERIES, 1))
    figures = rrb.Vertical(*plots, _events(), row_shares=[*(3 for _ in plots), 4])
    views = rrb.Horizontal(
        rrb.Vertical(pictures, _legend(), row_shares=[15, 1]), figures, column_shares=[11, 4]
    )
    return _of(views, rrb.PanelState.Collapsed)


def for_page(layout: Layout) -> rrb.Blueprint:
    """Return a small blueprint for a page that draws figures itself: 3-D views and plan, side by
    side if it is high.
    """
    both, hidden = (_spaces(layout), _plan()), rrb.PanelState.Hidden
    views = (
        rrb.Horizontal(*both, column_shares=[12, 10])
        if _is_high(layout)
        else rrb.Vertical(*both, row_shares=[12, 10])
    )
    return _of(views, hidden, rrb.TopPanel(state=hidden))


def _of(views: rrb.Container, panels: rrb.PanelState, *more: rrb.TopPanel) -> rrb.Blueprint:
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
    high, wide = plan_size(layout)
    return high >= wide


def _histories(pickers: int, others: int) -> rrb.Container:
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
    return rrb.StateTimelineView(name=name, origin="world", contents=contents, titlebar=titlebar)


def _legend() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="Colours",
        origin=legend.LEGEND,
        titlebar=False,
        background=(13, 16, 17),
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, legend.WIDTH), y_range=(0.0, legend.HEIGHT)),
    )


def _spaces(layout: Layout) -> rrb.Tabs:
    y = layout.lane(1).y
    inside = _eye((ROW_WEST - 5.5, y - 1.2, 2.2), (ROW_WEST + 14.0, y + 0.4, 1.0))
    return rrb.Tabs(
        at_work(layout),
        _space("Orchard", IN_SPACE, _outside(layout)),
        _space("Under the pergola", IN_SPACE, inside),
    )


def at_work(layout: Layout) -> rrb.Spatial3DView:
    """Return the view with a camera that goes along with the focus."""
    x, y = BESIDE[0] + ROW_WEST, BESIDE[1] + layout.lane(1).y
    return _space(
        "At work",
        BELOW_CROWNS,
        _eye((x, y, BESIDE[2]), (ROW_WEST, layout.lane(1).y, 1.0), follow=FOCUS),
        PIN_NEAR,
    )


def _outside(layout: Layout) -> rrb.EyeControls3D:
    south = layout.tree_lines[-1]
    if _is_high(layout):
        return _eye((48.0, south - 12.0, 13.0), (10.0, south + 26.0, -3.0))
    return _eye((44.5, south - 7.0, 8.0 + 0.05 * (layout.top - south)), (13.0, south + 12.0, -3.0))


def _eye(
    position: tuple[float, float, float],
    target: tuple[float, float, float],
    follow: str | None = None,
) -> rrb.EyeControls3D:
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
    pins = _of_pins(PIN_ON_THE_PLAN)
    return rrb.Spatial2DView(
        name="Plan",
        origin=PLAN_CAMERA,
        contents=ON_THE_PLAN,
        background=palette.MEADOW,
        defaults=pins,
    )


def _plot(name: str, origin: str, highest: int) -> rrb.TimeSeriesView:
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
    levels = rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR"])
    return rrb.TextLogView(
        name="Events",
        origin="events",
        rows=levels,
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
    )
