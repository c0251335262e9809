"""The random draws of a batch, compiled: the same numbers as `orchard.event_model.draws` gives.

A draw is made by the seed of the episode, what it is for, and the name of the robot. Its kinds:
failures, encounters (people and animals on the way), and looks (how long a robot stands before a
turn). In a harvest all robots have the same number of draws of a kind: so many as the robot needs
that has used the most. The draws of one robot stand behind those of the robot before.

Arguments: `b` is the batch, `m` the model of one of its harvests, `i` the number of that harvest.
"""

import numpy as np

from orchard.event_model import columns
from orchard.event_model.batch import columns as bc
from orchard.event_model.batch.compiled import inner
from orchard.event_model.bystanders import ticks_of_look, ticks_of_meeting
from orchard.field.repeatable import exponential
from orchard.sim.kernels.arrays import WORDS

# So many draws of each kind for each robot are made at the start, and so many more at a time.
MORE = 4
# Where a robot has used all but so many, more are drawn. The machine wants one in reserve.
RESERVE = 1

_exponential = inner(exponential)
_ticks_of_meeting = inner(ticks_of_meeting)
_ticks_of_look = inner(ticks_of_look)

# Where the machine reads how many draws there are for each robot. The words of an array are its
# address and its lengths, so this is its second length.
_LENGTH = 2
_NAMES = list(columns.ARRAYS)
FAILURES_LENGTH = WORDS * _NAMES.index("failures") + _LENGTH
ENCOUNTERS_LENGTH = WORDS * _NAMES.index("encounters") + _LENGTH
LOOKS_LENGTH = WORDS * _NAMES.index("looks") + _LENGTH


@inner
def draw_first(b, i):
    """Make the first draws of a harvest."""
    episode = b.episodes[i]
    episode.failures = 0
    episode.encounters = 0
    episode.looks = 0
    if b.rules[0].has_failures:
        draw_failures(b, i)
    if b.rules[0].has_people:
        draw_encounters(b, i)
        draw_looks(b, i)


@inner
def draw_more(b, m, i):
    """Draw more of what a robot has used up. Return whether there was room for it."""
    episode = b.episodes[i]
    rules = b.rules[0]
    failures, encounters, looks = most_used(m)
    lacks_failures = rules.has_failures and failures + RESERVE >= episode.failures
    lacks_encounters = rules.has_people and encounters + RESERVE >= episode.encounters
    lacks_looks = rules.has_people and looks + RESERVE >= episode.looks
    if lacks_failures and not has_room(m, episode.failures, b.failures):
        return False
    if lacks_encounters and not has_room(m, episode.encounters, b.encounters):
        return False
    if lacks_looks and not has_room(m, episode.looks, b.looks):
        return False
    if lacks_failures:
        draw_failures(b, i)
    if lacks_encounters:
        draw_encounters(b, i)
    if lacks_looks:
        draw_looks(b, i)
    m.desk[0].lacks_draws = False
    return True


@inner
def most_used(m):
    """Return how many failures, encounters and looks a robot has used at most."""
    failures = 0
    encounters = 0
    looks = 0
    for robot in range(len(m.robots)):
        me = m.robots[robot]
        failures = max(failures, me.failures)
        encounters = max(encounters, me.meetings)
        looks = max(looks, me.turns)
    return failures, encounters, looks


@inner
def has_room(m, count, drawn):
    """Whether all draws of a kind have room for more of each robot. `count`: of each so far."""
    return len(m.robots) * (count + MORE) <= drawn.shape[1]


@inner
def draw_failures(b, i):
    """Draw more failures of each robot."""
    episode = b.episodes[i]
    count = episode.failures
    drawn = b.failures[i]
    # Each robot gets more draws, so those of all but the first one move back. It begins with the
    # last robot, so that no draw is overwritten before it has moved.
    for robot in range(len(b.nearness) - 1, -1, -1):
        first = robot * (count + MORE)
        for number in range(count - 1, -1, -1):
            drawn[first + number] = drawn[robot * count + number]
        for number in range(count, count + MORE):
            draw(b, episode.seed, bc.FAILING, robot, number)
            drawn[first + number].until = _exponential(b.chances[0], 1.0)
            drawn[first + number].repair = _exponential(b.chances[1], 1.0)
    episode.failures = count + MORE
    b.addresses[i, FAILURES_LENGTH] = count + MORE


@inner
def draw_encounters(b, i):
    """Draw more people and animals that each robot meets."""
    episode = b.episodes[i]
    count = episode.encounters
    drawn = b.encounters[i]
    for robot in range(len(b.nearness) - 1, -1, -1):
        first = robot * (count + MORE)
        for number in range(count - 1, -1, -1):
            drawn[first + number] = drawn[robot * count + number]
        for number in range(count, count + MORE):
            draw(b, episode.seed, bc.WAY, robot, number)
            drawn[first + number].metres = _exponential(b.chances[0], b.rules[0].metres)
            draw(b, episode.seed, bc.STANDING, robot, number)
            drawn[first + number].ticks = _ticks_of_meeting(b.chances[0])
    episode.encounters = count + MORE
    b.addresses[i, ENCOUNTERS_LENGTH] = count + MORE


@inner
def draw_looks(b, i):
    """Draw how long each robot stands before more turns. Turns count from 1."""
    episode = b.episodes[i]
    count = episode.looks
    drawn = b.looks[i]
    for robot in range(len(b.nearness) - 1, -1, -1):
        first = robot * (count + MORE)
        for number in range(count - 1, -1, -1):
            drawn[first + number] = drawn[robot * count + number]
        for number in range(count, count + MORE):
            draw(b, episode.seed, bc.LOOKING, robot, number + 1)
            is_near = b.chances[0]
            stays = b.chances[1]
            look = drawn[first + number]
            look.ticks = _ticks_of_look(is_near, stays, b.nearness[robot, 0])
            look.ticks_towing = _ticks_of_look(is_near, stays, b.nearness[robot, 1])
    episode.looks = count + MORE
    b.addresses[i, LOOKS_LENGTH] = count + MORE


# -- a draw: BLAKE2b of a short text, as `orchard.field.repeatable.draw` has it from hashlib

SIXTY_FOUR = np.uint64(64)
# Bits by which words are turned in a round.
TO_THE_RIGHT = (np.uint64(32), np.uint64(24), np.uint64(16), np.uint64(63))
ROUNDS = 12
# The order of the words of the text in each round; the rounds after the last one begin again.
SIGMA = np.array(
    [
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
        [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
        [11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4],
        [7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8],
        [9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13],
        [2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9],
        [12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11],
        [13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10],
        [6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5],
        [10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0],
    ],
    np.int64,
)
# The words with which the mixing begins.
START = np.array(
    [
        0x6A09E667F3BCC908,
        0xBB67AE8584CAA73B,
        0x3C6EF372FE94F82B,
        0xA54FF53A5F1D36F1,
        0x510E527FADE682D1,
        0x9B05688C2B3E6C1F,
        0x1F83D9ABFB41BD6B,
        0x5BE0CD19137E2179,
    ],
    np.uint64,
)
# A digest of 64 bytes, without a key.
PARAMETERS = np.uint64(0x01010040)
ALL_BITS = np.uint64(0xFFFFFFFFFFFFFFFF)
# A float holds 53 bits.
LOST_BITS = np.uint64(11)
TWO_TO_53 = 2.0**53
BYTE = np.uint64(8)
DIGIT_ZERO = 48
SLASH = 47
# Of `words`: 16 that are mixed, then 16 of text.
MIXED = 16


@inner
def draw(b, seed, kind, robot, number):
    """Draw the two numbers with this number for a robot, into `chances`."""
    length = write_text(b, seed, kind, robot, number)
    words = b.words
    for at in range(16):
        word = np.uint64(0)
        for byte in range(7, -1, -1):
            word = (word << BYTE) | np.uint64(b.text[8 * at + byte])
        words[MIXED + at] = word
    for at in range(8):
        words[at] = START[at]
        words[8 + at] = START[at]
    words[0] ^= PARAMETERS
    # The length of the text, and the mark of its last block: it has only one.
    words[12] ^= np.uint64(length)
    words[14] ^= ALL_BITS
    for turn in range(ROUNDS):
        mix(words, turn % len(SIGMA))
    first = START[0] ^ PARAMETERS ^ words[0] ^ words[8]
    second = START[1] ^ words[1] ^ words[9]
    b.chances[0] = np.float64(first >> LOST_BITS) / TWO_TO_53
    b.chances[1] = np.float64(second >> LOST_BITS) / TWO_TO_53


@inner
def write_text(b, seed, kind, robot, number):
    """Write what is hashed, and zeros behind it. Return its length."""
    text = b.text
    for at in range(len(text)):
        text[at] = 0
    end = write_number(text, 0, seed)
    text[end] = SLASH
    end += 1
    for at in range(b.lengths[kind, robot]):
        text[end + at] = b.names[kind, robot, at]
    end += b.lengths[kind, robot]
    text[end] = SLASH
    return write_number(text, end + 1, number)


@inner
def write_number(text, begin, number):
    """Write a whole number, 0 or more, in digits. Return where it ends."""
    digits = 1
    rest = number // 10
    while rest > 0:
        digits += 1
        rest //= 10
    rest = number
    for at in range(begin + digits - 1, begin - 1, -1):
        text[at] = DIGIT_ZERO + rest % 10
        rest //= 10
    return begin + digits


@inner
def mix(words, turn):
    """Mix all words in a round: by columns, then by diagonals."""
    order = SIGMA[turn]
    for column in range(4):
        x = words[MIXED + order[2 * column]]
        y = words[MIXED + order[2 * column + 1]]
        mix_four(words, (column, 4 + column, 8 + column, 12 + column), x, y)
    for column in range(4):
        x = words[MIXED + order[8 + 2 * column]]
        y = words[MIXED + order[8 + 2 * column + 1]]
        second = 4 + (column + 1) % 4
        third = 8 + (column + 2) % 4
        fourth = 12 + (column + 3) % 4
        mix_four(words, (column, second, third, fourth), x, y)


@inner
def mix_four(words, four, x, y):
    """Mix four words with two of the text. `four`: the indices of the words."""
    first, second, third, fourth = four
    words[first] += words[second] + x
    words[fourth] = turned(words[fourth] ^ words[first], TO_THE_RIGHT[0])
    words[third] += words[fourth]
    words[second] = turned(words[second] ^ words[third], TO_THE_RIGHT[1])
    words[first] += words[second] + y
    words[fourth] = turned(words[fourth] ^ words[first], TO_THE_RIGHT[2])
    words[third] += words[fourth]
    words[second] = turned(words[second] ^ words[third], TO_THE_RIGHT[3])


@inner
def turned(word, bits):
    """Return a word turned to the right by some bits."""
    return (word >> bits) | (word << (SIXTY_FOUR - bits))
