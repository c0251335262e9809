"""The blueprint of a recording: its views, their layout and their cameras."""

import rerun as rr
import rerun.blueprint as rrb

from orchard.field.layout import ROW_WEST, TOP, Layout
from orchard.view import palette
from orchard.view.scenery import PLAN_CAMERA, plan_size

TIMELINE = "sim_time"
PIN_RADIUS, PIN_RADIUS_PLAN = 0.6, -5.0  # radius of a pin: m in the 3-D views; on the plan a negative number, in screen points
HEADROOM = 1.6  # upper end of a plot's axis, as a multiple of the highest possible value: the legend lies above the curves
FEW = 8  # robots: up to this number, all histories fit without scrolling
TITLE, AXIS = 0.7, 0.6  # heights of a history's title and time axis, as fractions of a robot's line

IN_SPACE = ["world/**", "canopy/**", "scans/**", "pins/**", "talk/**"]
WITHOUT_ROOF = ["world/**", "scans/**", "pins/**", "talk/**", "canopy/wires", "canopy/fruit/**"]
PICKERS, OTHERS = ["world/pickers/**"], ["world/carriers/**", "world/tractors/**"]
ON_THE_PLAN = ["world/**", "plan/**", "pins/**", "talk/**", "scans/**"]


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Return the blueprint: the 3-D views above the plan and the histories, with the figures and events beside them.

    The plan of an orchard that is at least as high as wide gets a column of its own.
    """
    pickers, carriers = layout.scenario.pickers, layout.scenario.carrier_count
    spaces, histories, plan = _spaces(layout), _histories(pickers, carriers + 1), _plan()
    if _is_high(layout):
        left = rrb.Vertical(spaces, histories, row_shares=[10, 10])
        pictures: rrb.Container = rrb.Horizontal(left, plan, column_shares=[12, 10])
    else:
        pictures = rrb.Vertical(spaces, rrb.Horizontal(plan, histories, column_shares=[1, 1]), row_shares=[12, 10])
    plots = _plot("Bins", "metrics/bins", layout.scenario.rows), _plot("Robots", "metrics/robots", max(pickers, carriers))
    figures = rrb.Vertical(*plots, _events(), row_shares=[3, 3, 4])
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(pictures, _legend(), row_shares=[22, 1]), figures, column_shares=[11, 4]),
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=TIMELINE, playback_speed=4.0),
        rrb.BlueprintPanel(state=rrb.PanelState.Collapsed),
        rrb.SelectionPanel(state=rrb.PanelState.Collapsed),
        auto_views=False,
        auto_layout=False,
    )


def _is_high(layout: Layout) -> bool:
    high, wide = plan_size(layout)
    return high >= wide


def _histories(pickers: int, others: int) -> rrb.Container:
    """Return the histories of all robots, pickers first: stacked for up to FEW robots, else in two tabs."""
    if pickers + others > FEW:
        return rrb.Tabs(_history("What the pickers do", PICKERS), _history("What carriers and tractor do", OTHERS))
    both = _history("What the robots do", PICKERS), _history("Carriers and tractor", OTHERS, titlebar=False)
    return rrb.Vertical(*both, row_shares=[TITLE + AXIS + pickers, AXIS + others])


def _history(name: str, contents: list[str], titlebar: bool = True) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(name=name, origin="world", contents=contents, titlebar=titlebar)


def _legend() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="Colours",
        origin=palette.LEGEND,
        titlebar=False,
        background=(13, 16, 17),
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, palette.ENDS[-1]), y_range=(0.0, palette.LINE)),
    )


def _spaces(layout: Layout) -> rrb.Tabs:
    """Return three views: from outside the orchard, from below its roof, and following the first picker without the roof."""
    first = next(start for start in layout.starts if start.kind == "picker").name
    y = layout.lane(layout.blocks[first][0]).y
    inside = _eye((ROW_WEST - 5.5, y - 1.2, 2.2), (ROW_WEST + 14.0, y + 0.4, 1.0))
    following = _eye((ROW_WEST - 14.0, y - 12.0, 9.0), (ROW_WEST, y, 0.0), follow=f"world/pickers/{first}")
    return rrb.Tabs(
        _space("Orchard", IN_SPACE, _outside(layout)),
        _space("Under the pergola", IN_SPACE, inside),
        _space(f"With {first}", WITHOUT_ROOF, following),
        active_tab="Orchard",
    )


def _outside(layout: Layout) -> rrb.EyeControls3D:
    """Return a low camera at the south-east corner, where the robots leave the rows. It is a little higher for a large orchard."""
    south = layout.tree_lines[-1]
    if _is_high(layout):
        return _eye((48.0, south - 12.0, 13.0), (10.0, south + 26.0, -3.0))
    return _eye((44.5, south - 7.0, 8.0 + 0.05 * (TOP - south)), (13.0, south + 12.0, -3.0))


def _eye(position: tuple[float, float, float], target: tuple[float, float, float], follow: str | None = None) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=(0, 0, 1), tracking_entity=follow)


def _space(name: str, contents: list[str], eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        name=name,
        origin="/",
        contents=contents,
        background=rrb.Background(kind="SolidColor", color=palette.SKY),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
        defaults=[rr.Points3D.from_fields(radii=[PIN_RADIUS], show_labels=False)],
    )


def _plan() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name="Plan",
        origin=PLAN_CAMERA,
        contents=ON_THE_PLAN,
        background=palette.MEADOW,
        defaults=[rr.Points3D.from_fields(radii=[PIN_RADIUS_PLAN], show_labels=False)],
    )


def _plot(name: str, origin: str, highest: int) -> rrb.TimeSeriesView:
    """Return a plot of the whole run with its legend above the curves. `highest`: the highest possible value."""
    whole_run = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        plot_legend=rrb.Corner2D.LeftTop,
        axis_x=rrb.TimeAxis(view_range=whole_run),
        axis_y=rrb.ScalarAxis(range=(-0.05 * highest, HEADROOM * highest)),
    )


def _events() -> rrb.TextLogView:
    levels = rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR"])
    return rrb.TextLogView(name="Events", origin="events", rows=levels, columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]))
