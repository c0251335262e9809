"""Functions with the same bits on every machine: sine, cosine, atan2, log and exp from + - * / and sqrt only, and random numbers.

libm and numpy's SIMD variants of these functions differ between processors, so no value that the run's hash covers uses them.
A random number depends only on (seed, name, tick), so an agent that is restarted draws the same numbers.
"""

import hashlib
import math

PI = math.pi
TURN = 2.0 * math.pi
QUARTER = 0.5 * math.pi

_QUARTER_HIGH = 1.5707963267341256  # pi/2, its first 33 bits
_QUARTER_LOW = 6.077100506506192e-11  # pi/2 less the above
_LN2_HIGH = 0.6931471803691238  # ln 2, its first 33 bits
_LN2_LOW = 1.9082149292705877e-10  # ln 2 less the above
_SQRT_HALF = 0.7071067811865476
_ARCTAN_OF_EIGHTHS = (
    0.0,
    0.12435499454676144,
    0.24497866312686414,
    0.35877067027057225,
    0.4636476090008061,
    0.5585993153435624,
    0.6435011087932844,
    0.7188299996216245,
    0.7853981633974483,
)


def sine_series(r: float) -> float:
    """Return sin(r) for |r| <= pi/4."""
    s = r * r
    return r * (
        1.0
        - s
        / 6.0
        * (
            1.0
            - s
            / 20.0
            * (
                1.0
                - s
                / 42.0
                * (1.0 - s / 72.0 * (1.0 - s / 110.0 * (1.0 - s / 156.0 * (1.0 - s / 210.0))))
            )
        )
    )


def cosine_series(r: float) -> float:
    """Return cos(r) for |r| <= pi/4."""
    s = r * r
    return 1.0 - s / 2.0 * (
        1.0
        - s
        / 12.0
        * (
            1.0
            - s
            / 30.0
            * (
                1.0
                - s
                / 56.0
                * (1.0 - s / 90.0 * (1.0 - s / 132.0 * (1.0 - s / 182.0 * (1.0 - s / 240.0))))
            )
        )
    )


def sin_cos(angle: float) -> tuple[float, float]:
    """Return the sine and cosine of an angle in radians. The reduction to a quadrant is exact up to some thousand turns."""
    quarters = math.floor(angle / QUARTER + 0.5)
    rest = (angle - quarters * _QUARTER_HIGH) - quarters * _QUARTER_LOW
    s, c = sine_series(rest), cosine_series(rest)
    if quarters % 2:
        s, c = c, -s
    return (-s, -c) if quarters % 4 >= 2 else (s, c)


def arctan_unit(t: float) -> float:
    """Return the arc tangent of t for 0 <= t <= 1, rad."""
    eighth = int(t * 8.0 + 0.5)
    known = eighth / 8.0
    r = (t - known) / (1.0 + t * known)
    s = r * r
    series = r * (
        1.0
        - s
        * (
            1.0 / 3.0
            - s * (1.0 / 5.0 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0))))
        )
    )
    return _ARCTAN_OF_EIGHTHS[eighth] + series


def atan2(y: float, x: float) -> float:
    """Return the angle of the vector (x, y), rad, in (-pi, pi]; 0 for the zero vector."""
    ax, ay = abs(x), abs(y)
    if ax == 0.0 and ay == 0.0:
        return 0.0
    angle = arctan_unit(ay / ax) if ay <= ax else QUARTER - arctan_unit(ax / ay)
    angle = PI - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


def wrap(angle: float) -> float:
    """Return the same direction in (-pi, pi], rad. An angle already in this range keeps its bits."""
    if -PI < angle <= PI:
        return angle
    wrapped = angle - TURN * math.floor(angle / TURN + 0.5)
    return PI if wrapped <= -PI else wrapped


def log(x: float) -> float:
    """Return the natural logarithm of a finite x > 0."""
    mantissa, exponent = math.frexp(x)
    if mantissa < _SQRT_HALF:
        mantissa, exponent = mantissa * 2.0, exponent - 1
    z = (mantissa - 1.0) / (mantissa + 1.0)
    s = z * z
    tail = 1.0 / 13.0 + s * (1.0 / 15.0 + s * (1.0 / 17.0 + s / 19.0))
    series = s * (
        1.0 / 3.0
        + s * (1.0 / 5.0 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s * (1.0 / 11.0 + s * tail))))
    )
    return exponent * _LN2_HIGH + (2.0 * z + (2.0 * z * series + exponent * _LN2_LOW))


def exp(x: float) -> float:
    """Return e to the power of x for |x| <= 700."""
    twos = math.floor(x / (_LN2_HIGH + _LN2_LOW) + 0.5)
    r = (x - twos * _LN2_HIGH) - twos * _LN2_LOW
    series = 1.0
    for n in range(14, 0, -1):
        series = 1.0 + r / n * series
    return math.ldexp(series, twos)


def draw(seed: int, name: str, tick: int, count: int = 1) -> list[float]:
    """Return `count` (at most 8) random numbers, uniform in [0, 1), for one agent at one tick."""
    digest = hashlib.blake2b(f"{seed}/{name}/{tick}".encode(), digest_size=64).digest()
    return [
        (int.from_bytes(digest[8 * i : 8 * i + 8], "little") >> 11) / 2.0**53 for i in range(count)
    ]


def exponential(u: float, mean: float) -> float:
    """Return an exponentially distributed number for u, uniform in [0, 1)."""
    return -mean * log(1.0 - u)


def normal(u: float, v: float) -> float:
    """Return a normally distributed number, mean 0 and deviation 1, for u and v, uniform in [0, 1): Box and Muller's method."""
    return math.sqrt(exponential(u, 2.0)) * sin_cos(TURN * v)[1]
