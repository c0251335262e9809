"""How fast carriers drive, and how long they take at the bay: estimates from a log.

The time from when a bin is fetched until it is unloaded (its drive) grows with its way to the bay.
A line through these times has a slope, the seconds that a metre takes, and a rest, the seconds that
a way of no length would take. Slope and rest are larger than driving and the time in the bay alone,
because carriers wait for each other. In a harvest of the event model the speed and the time in the
bay are known. So it is known how much the waits are there, and they are taken off those of the log.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import NamedTuple

import numpy as np

from orchard.calibrate.bins import LoggedBin, Silence
from orchard.calibrate.estimates import FittedValue, estimate
from orchard.calibrate.picking import MOST_TIMES_THE_MEDIAN, is_silent

# With fewer drives nothing is fitted.
LEAST_DRIVES = 12
# m from the shortest way to the longest one. Below that, drives tell the time in the bay, but no
# speed.
LEAST_METRES = 20.0
# Largest share of resamples without a slope, because all their ways are equal, with which a speed
# is fitted.
MOST_UNKNOWN = 0.02


@dataclass(frozen=True)
class BinDrives:
    """The ways of full bins from their rows to the bay, m, and how long each took, s: (n,) each."""

    metres: np.ndarray
    seconds: np.ndarray

    @property
    def reach(self) -> float:
        """How much longer the longest way is than the shortest one, m."""
        if not len(self.metres):
            return 0.0
        return float(np.ptp(self.metres))


class _Drive(NamedTuple):
    """The drive of a full bin."""

    logged: LoggedBin
    metres: float
    seconds: float


def drives_of(
    bins: Sequence[LoggedBin],
    metres_of: Mapping[str, float],
    silences: Sequence[Silence] = (),
    file: str = "",
) -> tuple[BinDrives, list[str]]:
    """Return the drives of full bins, and a sentence for each that is left out as far too long.

    `metres_of`: row -> its way to the bay, m. `file`: of the log; "" for bins of a model, of which
    no drive is left out.
    """
    known = list(_known_drives(bins, metres_of, silences))
    if not file or not known:
        return _drives(known), []
    usual = median(drive.seconds for drive in known)
    if usual <= 0.0:
        sentence = (
            f"{file}: most bins were unloaded at the very time at which they were fetched, so the"
            " drives are left out; write times to the second"
        )
        return _drives([]), [sentence]
    kept = []
    sentences = []
    for drive in known:
        times_the_usual = drive.seconds / usual
        if drive.seconds <= MOST_TIMES_THE_MEDIAN * usual:
            kept.append(drive)
            continue
        sentences.append(
            f"{file}:{drive.logged.line}: this bin was unloaded {drive.seconds / 60.0:.0f} min"
            f" after it was fetched, {times_the_usual:.1f} times as long as most; its drive is left"
            " out"
        )
    return _drives(kept), sentences


def _known_drives(
    bins: Sequence[LoggedBin], metres_of: Mapping[str, float], silences: Sequence[Silence]
) -> Iterator[_Drive]:
    """Yield the drives of bins of which row and both times are known, but not over a silence."""
    for logged in bins:
        fetched = logged.fetched
        unloaded = logged.unloaded
        if fetched is None or unloaded is None or logged.row not in metres_of:
            continue
        if not is_silent(silences, logged.day, fetched, unloaded):
            yield _Drive(logged, metres_of[logged.row], unloaded - fetched)


def _drives(drives: Sequence[_Drive]) -> BinDrives:
    """Return drives as arrays."""
    columns = np.array([(drive.metres, drive.seconds) for drive in drives]).reshape(-1, 2)
    return BinDrives(columns[:, 0], columns[:, 1])


def slope_of(metres: np.ndarray, seconds: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the seconds that a metre takes, by least squares, (...). NaN: all ways are equal.

    `metres`, `seconds`: of drives, (..., n) each. `axis`: that of drives.
    """
    away = metres - metres.mean(axis=axis, keepdims=True)
    squares = (away**2).sum(axis=axis)
    products = (away * seconds).sum(axis=axis)
    # In a resample all ways may be equal.
    unknown = np.full(squares.shape, np.nan)
    slopes: np.ndarray = np.divide(products, squares, out=unknown, where=squares > 0.0)
    return slopes


@dataclass(frozen=True)
class DrivingFit:
    """What the log tells of carriers.

    `speed`: m/s; None if the log does not tell it, and then `why` says why. `unloading`: how long a
    carrier stands in the bay, s. `count`: of drives.
    """

    speed: FittedValue | None
    unloading: FittedValue
    count: int
    why: str = ""


def fit_driving(
    drives: BinDrives,
    model: BinDrives,
    model_speed: float,
    model_unloading: float,
    confidence: float,
) -> DrivingFit | None:
    """Return what a log tells of carriers beside a model; None: there are too few drives.

    `model_speed`, `model_unloading`: those with which the drives of the model came about.
    """
    if len(drives.metres) < LEAST_DRIVES:
        return None
    mean_of_model = float(model.seconds.mean())
    metres_of_model = float(model.metres.mean())
    slope_of_model = float(slope_of(model.metres, model.seconds))
    # The seconds a metre of waits for other robots, in the model.
    lost = slope_of_model - 1.0 / model_speed

    # `estimate` gives each of these an `axis`, which is always the last one.
    def speed(metres: np.ndarray, seconds: np.ndarray, axis: int = -1) -> np.ndarray:
        """Return the speeds that follow from drives, m/s, (...). Both: (..., n)."""
        return 1.0 / (slope_of(metres, seconds) - lost)

    def unloading(metres: np.ndarray, seconds: np.ndarray, axis: int = -1) -> np.ndarray:
        """Return the times in the bay, s, (...), by the drives' own slope."""
        slope = slope_of(metres, seconds)
        rest = seconds.mean(axis=-1) - slope * metres.mean(axis=-1)
        rest_of_model = mean_of_model - slope_of_model * metres_of_model
        times: np.ndarray = rest - rest_of_model + model_unloading
        return times

    def unloading_alone(metres: np.ndarray, seconds: np.ndarray, axis: int = -1) -> np.ndarray:
        """Return the times in the bay, s, (...), by the slope of the model."""
        away = metres.mean(axis=-1) - metres_of_model
        expected = mean_of_model + slope_of_model * away
        times: np.ndarray = seconds.mean(axis=-1) - expected + model_unloading
        return times

    samples = (drives.metres, drives.seconds)
    why = ""
    fitted = None
    if drives.reach < LEAST_METRES:
        why = f"the ways to the bay differ by {drives.reach:.0f} m only"
    else:
        slopes = estimate(float(slope_of(*samples)), samples, slope_of, confidence)
        if slopes.unknown > MOST_UNKNOWN:
            why = "too few drives are of different distances"
        elif slopes.low <= lost:
            why = "times do not grow with the way to the bay for certain"
        else:
            fitted = estimate(float(speed(*samples)), samples, speed, confidence)
    rest = unloading
    if fitted is None:
        rest = unloading_alone
    handled = estimate(float(rest(*samples)), samples, rest, confidence)
    # The rest of a steep slope can be less than nothing. A time in the bay cannot.
    handled = replace(
        handled,
        value=max(0.0, handled.value),
        low=max(0.0, handled.low),
        high=max(0.0, handled.high),
    )
    return DrivingFit(fitted, handled, len(drives.metres), why)
