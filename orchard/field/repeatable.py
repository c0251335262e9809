"""Functions with the same bits on every machine: sine, cosine, atan2, log, exp, and random numbers.

They use + - * / and sqrt only. The variants of libm and of numpy differ between processors in their
last bits, so no value that the run's hash covers uses them. Each term of a series is a statement of
its own: the order of the operations decides the bits.

The series are Taylor's, from the last term inwards (Horner's scheme). They have as many terms as a
float can show for the small arguments to which each function reduces its own.

A random number depends only on (seed, name, tick), so an agent that is restarted draws the same.
"""

import hashlib
import math

# A half turn, a whole turn and a quarter turn, rad.
PI = math.pi
TURN = 2.0 * math.pi
QUARTER = 0.5 * math.pi

# pi/2 in two parts: its first 33 bits, and the rest. So a small whole multiple of the first part is
# exact, because a float holds 53 bits.
_QUARTER_HIGH = 1.5707963267341256
_QUARTER_LOW = 6.077100506506192e-11
# ln 2, in the same way.
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_SQRT_HALF = 0.7071067811865476
# arctan(0/8), arctan(1/8), ... arctan(8/8), rad.
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
    """Return sin(r) for |r| <= pi/4, r in rad.

    The divisors are 2 * 3, 4 * 5, ... 14 * 15: each term of the series follows from the one before.
    """
    s = r * r
    tail = 1.0 - s / 210.0
    tail = 1.0 - s / 156.0 * tail
    tail = 1.0 - s / 110.0 * tail
    tail = 1.0 - s / 72.0 * tail
    tail = 1.0 - s / 42.0 * tail
    tail = 1.0 - s / 20.0 * tail
    tail = 1.0 - s / 6.0 * tail
    return r * tail


def cosine_series(r: float) -> float:
    """Return cos(r) for |r| <= pi/4, r in rad.

    The divisors are 1 * 2, 3 * 4, ... 15 * 16.
    """
    s = r * r
    tail = 1.0 - s / 240.0
    tail = 1.0 - s / 182.0 * tail
    tail = 1.0 - s / 132.0 * tail
    tail = 1.0 - s / 90.0 * tail
    tail = 1.0 - s / 56.0 * tail
    tail = 1.0 - s / 30.0 * tail
    tail = 1.0 - s / 12.0 * tail
    return 1.0 - s / 2.0 * tail


def sin_cos(angle: float) -> tuple[float, float]:
    """Return the sine and cosine of an angle in rad.

    The reduction to a quadrant is exact up to some thousand turns.
    """
    quarters = math.floor(angle / QUARTER + 0.5)
    rest = (angle - quarters * _QUARTER_HIGH) - quarters * _QUARTER_LOW
    sine = sine_series(rest)
    cosine = cosine_series(rest)
    quadrant = quarters % 4
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


def arctan_unit(t: float) -> float:
    """Return the arc tangent of t for 0 <= t <= 1, rad.

    It is that of the nearest eighth, which is known, plus that of r, which is small.
    """
    eighth = int(t * 8.0 + 0.5)
    known = eighth / 8.0
    r = (t - known) / (1.0 + t * known)
    s = r * r
    tail = 1.0 / 11.0 - s / 13.0
    tail = 1.0 / 9.0 - s * tail
    tail = 1.0 / 7.0 - s * tail
    tail = 1.0 / 5.0 - s * tail
    tail = 1.0 / 3.0 - s * tail
    return _ARCTAN_OF_EIGHTHS[eighth] + r * (1.0 - s * tail)


def atan2(y: float, x: float) -> float:
    """Return the angle of the vector (x, y), rad, in (-pi, pi]; 0 for the zero vector."""
    ax = abs(x)
    ay = abs(y)
    if ax == 0.0 and ay == 0.0:
        return 0.0
    if ay <= ax:
        angle = arctan_unit(ay / ax)
    else:
        angle = QUARTER - arctan_unit(ax / ay)
    if x < 0.0:
        angle = PI - angle
    if y < 0.0:
        angle = -angle
    return angle


def wrap(angle: float) -> float:
    """Return the same direction in (-pi, pi], rad.

    An angle already in this range keeps its bits.
    """
    if -PI < angle <= PI:
        return angle
    wrapped = angle - TURN * math.floor(angle / TURN + 0.5)
    if wrapped <= -PI:
        return PI
    return wrapped


def log(x: float) -> float:
    """Return the natural logarithm of a finite x > 0.

    x = mantissa * 2**exponent, with a mantissa about 1. The logarithm of the mantissa is
    2 * (z + z**3 / 3 + z**5 / 5 + ...).
    """
    mantissa, exponent = math.frexp(x)
    if mantissa < _SQRT_HALF:
        mantissa *= 2.0
        exponent -= 1
    z = (mantissa - 1.0) / (mantissa + 1.0)
    s = z * z
    tail = 1.0 / 17.0 + s / 19.0
    tail = 1.0 / 15.0 + s * tail
    tail = 1.0 / 13.0 + s * tail
    tail = 1.0 / 11.0 + s * tail
    tail = 1.0 / 9.0 + s * tail
    tail = 1.0 / 7.0 + s * tail
    tail = 1.0 / 5.0 + s * tail
    tail = 1.0 / 3.0 + s * tail
    series = s * tail
    return exponent * _LN2_HIGH + (2.0 * z + (2.0 * z * series + exponent * _LN2_LOW))


def exp(x: float) -> float:
    """Return e to the power of x for |x| <= 700.

    It is 2**twos times e to the power of r, for which |r| <= ln(2) / 2.
    """
    twos = math.floor(x / (_LN2_HIGH + _LN2_LOW) + 0.5)
    r = (x - twos * _LN2_HIGH) - twos * _LN2_LOW
    series = 1.0
    for n in range(14, 0, -1):
        series = 1.0 + r / n * series
    return math.ldexp(series, twos)


def draw(seed: int, name: str, tick: int, count: int = 1) -> list[float]:
    """Return `count` (at most 8) random numbers, uniform in [0, 1).

    `name`: of the agent, or of what is drawn. `tick`: of the run, or another number by which draws
    of the same name differ.
    """
    # 64 bytes, the longest digest of BLAKE2b: 8 bytes for each of 8 numbers.
    digest = hashlib.blake2b(f"{seed}/{name}/{tick}".encode(), digest_size=64).digest()
    numbers = []
    for i in range(count):
        eight_bytes = digest[8 * i : 8 * i + 8]
        # A float holds 53 of the 64 bits; the 11 lowest are dropped.
        numbers.append((int.from_bytes(eight_bytes, "little") >> 11) / 2.0**53)
    return numbers


def exponential(u: float, mean: float) -> float:
    """Return an exponentially distributed number for u, uniform in [0, 1)."""
    return -mean * log(1.0 - u)


def normal(u: float, v: float) -> float:
    """Return a normally distributed number, mean 0 and deviation 1, by Box and Muller's method.

    `u` and `v`: uniform in [0, 1).
    """
    return math.sqrt(exponential(u, 2.0)) * sin_cos(TURN * v)[1]
