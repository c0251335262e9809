"""The project's own sine, cosine, arc tangent, logarithm and exponential: right, exact where it matters, and the same compiled."""

import ast
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchard.field import repeatable
from orchard.sim.kernels import cache, jit

ROOT = Path(__file__).parents[2]
ERROR = 4e-16
angles = st.one_of(st.floats(-10.0, 10.0), st.floats(-6000.0, 6000.0), st.integers(-40, 40).map(lambda eighth: eighth * math.pi / 8))
lengths = st.one_of(st.floats(-100.0, 100.0), st.floats(-1e-6, 1e-6), st.integers(-3, 3).map(float))


@settings(max_examples=500)
@given(angles, lengths, lengths, st.floats(1e-300, 1e300), st.floats(-700.0, 700.0))
def test_the_functions_are_right_to_the_last_digits(angle, y, x, positive, power):
    assert repeatable.sin_cos(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=ERROR, rel=0)
    assert repeatable.atan2(y, x) == pytest.approx(math.atan2(y + 0.0, x + 0.0), abs=2 * ERROR, rel=0)
    assert repeatable.log(positive) == pytest.approx(math.log(positive), abs=ERROR, rel=ERROR)
    assert repeatable.exp(power) == pytest.approx(math.exp(power), rel=4 * ERROR, abs=0)


@settings(max_examples=300)
@given(angles, lengths, lengths, st.floats(1e-300, 1e300))
def test_compiled_and_plain_give_the_same_bits(angle, y, x, positive):
    assert jit.sin_cos(angle) == repeatable.sin_cos(angle)
    assert jit.atan2(y, x) == repeatable.atan2(y, x)
    assert jit.wrap(angle) == repeatable.wrap(angle)
    assert jit.log(positive) == repeatable.log(positive)


def test_east_is_exact():
    assert repeatable.sin_cos(0.0) == (0.0, 1.0)
    assert repeatable.atan2(0.0, 1.0) == 0.0
    assert repeatable.atan2(1.0, 0.0) == repeatable.QUARTER
    assert repeatable.atan2(0.0, -1.0) == repeatable.PI


@settings(max_examples=300)
@given(angles)
def test_wrapping_keeps_the_direction_and_what_is_wrapped_already(angle):
    wrapped = repeatable.wrap(angle)
    assert -repeatable.PI < wrapped <= repeatable.PI
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    assert repeatable.wrap(wrapped) == wrapped
    if -repeatable.PI < angle <= repeatable.PI:
        assert wrapped == angle


def test_the_bits_that_every_machine_must_give():
    """Known to the last bit, so that a compiler or a processor that gives others is found out."""
    assert [part.hex() for part in repeatable.sin_cos(0.7)] == ["0x1.49d6e694619b8p-1", "0x1.87996529f9d93p-1"]
    assert repeatable.atan2(-2.0, -0.3).hex() == "-0x1.b83d5c13f26b8p+0"


def test_what_a_kernel_is_made_from_is_all_told_to_the_cache():
    """A kernel with stale constants would move robots by yesterday's rules."""
    sources = {path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in cache._SOURCES}
    for path in (ROOT / "orchard/sim/kernels").glob("*.py"):
        imports = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
        for node in imports:
            names = {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
            is_ours = node.module.startswith("orchard.") and node.module != "orchard.folders"  # which only stores them
            assert not is_ours or names & sources, (path, node.module)


def test_kernels_use_no_other_trigonometry():
    for path in set((ROOT / "orchard/sim/kernels").glob("*.py")) - {Path(jit.__file__)}:
        called = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
        assert not called & {"sin", "cos", "tan", "arctan2", "arctan", "hypot", "exp", "log", "power", "dot", "matmul"}, path
