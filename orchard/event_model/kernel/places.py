"""Places: what a robot claims and when, and how traffic grants it.

A "claim" names the places that a robot keeps and wants, a "wish" is what it waits for in traffic's
table. Sets of places are rows of bits, (w,) words of 64. `orchard.behaviour.traffic` has the rules
of granting. Claims that are sent in one tick are heard together half a tick later.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.plans.robot import GIVEN_BACK, PATIENCE

# Quarters of a tick from a claim to when traffic hears it.
HEARD = 2
# Ticks from a claim to the tick at which its answer changes what the robot does, and the quarters
# before that at which it is heard: before traffic hears the claims of the last tick.
ANSWERED = 2
BEFORE_ACTING = 3


@inner
def tick_of(m):
    """Return the present tick, or between two ticks the next one."""
    return -(-m.desk[0].now // c.QUARTERS)


@inner
def is_subset(some, all_of):
    """Whether a set of places, (w,) bits, is part of another one."""
    for word in range(len(some)):
        if some[word] & ~all_of[word]:
            return False
    return True


@inner
def are_equal(some, others):
    """Whether two sets of places, (w,) bits, are the same."""
    for word in range(len(some)):
        if some[word] != others[word]:
            return False
    return True


@inner
def share_any(some, others):
    """Whether two sets of places, (w,) bits, have one in common."""
    for word in range(len(some)):
        if some[word] & others[word]:
            return True
    return False


@inner
def share_roads(m, robot, other):
    """Whether another robot may be in this one's way."""
    return other != robot and m.robots[other].roads == m.robots[robot].roads


@inner
def copy_set(m, robot, source, target):
    """Copy a robot's set of places to another one of its sets."""
    for word in range(m.sets.shape[2]):
        m.sets[target, robot, word] = m.sets[source, robot, word]


# -- the robot's side


@inner
def has_places(m, robot, places):
    """Whether a robot has a list of places."""
    return is_subset(m.places[places], m.sets[c.OWN, robot])


@inner
def want_places(m, robot, places, beside):
    """Claim a list of places, unless this claim is on its way.

    `beside`: the partner that may have them.
    """
    me = m.robots[robot]
    if places != me.wanted:
        me.claimed = last_claim(m, robot)
        me.wanted = places
        me.beside = beside
        plan_claim(m, robot)


@inner
def free_places(m, robot, places):
    """Give back those of a list of places that the robot has."""
    me = m.robots[robot]
    own = m.sets[c.OWN, robot]
    if share_any(own, m.places[places]):
        me.claimed = last_claim(m, robot)
        for word in range(len(own)):
            own[word] &= ~m.places[places, word]
        plan_claim(m, robot)


@inner
def plan_claim(m, robot):
    """Set when the robot claims next, if its claim would say anything new."""
    me = m.robots[robot]
    hear_answer(m, robot)
    # It may learn from the answer to its last claim that traffic knows what it has given back.
    tells = max(tick_of(m), me.claimed + GIVEN_BACK)
    known = c.COMING if me.answered <= c.QUARTERS * tells else c.ANSWERED
    gives_back = not are_equal(m.sets[known, robot], m.sets[c.OWN, robot])
    if not gives_back and me.wanted == 0:
        return
    is_same_wish = me.told_wanted == me.wanted and me.told_beside == me.beside
    if is_same_wish and are_equal(m.sets[c.TOLD, robot], m.sets[c.OWN, robot]):
        return
    due = tells if gives_back else max(tick_of(m), me.claimed + PATIENCE)
    if me.due == c.NONE or due < me.due:
        me.due = due
        m.timers[c.CLAIM, robot] = c.QUARTERS * due + HEARD


@inner
def last_claim(m, robot):
    """Return the tick of the robot's last claim before what it does now.

    While it waits it claims the same every PATIENCE ticks. That changes nothing, so it is no event.
    A claim that it sends in this tick tells what it does in this tick.
    """
    me = m.robots[robot]
    before = tick_of(m) - 1
    if me.wanted == 0 or before < me.claimed:
        return me.claimed
    return before - (before - me.claimed) % PATIENCE


@inner
def ticks_to_answer(m, robot):
    """Return the ticks, one or more, until a robot that waits hears the next answer.

    It claims each PATIENCE ticks, and hears each answer ANSWERED ticks after its claim.
    """
    me = m.robots[robot]
    answered = max(me.claimed, me.due) + ANSWERED
    return 1 + (answered - 1 - tick_of(m)) % PATIENCE


@inner
def hear_answer(m, robot):
    """Take over traffic's last answer, if it has come."""
    me = m.robots[robot]
    if me.answered <= m.desk[0].now:
        copy_set(m, robot, c.COMING, c.ANSWERED)
        copy_set(m, robot, c.COMING_ALONE, c.ALONE)
        me.answered = c.NEVER


@inner
def hear_grant(m, robot):
    """Let a robot hear that it was granted places.

    It goes on in the next tick, if it waits for that.
    """
    me = m.robots[robot]
    me.claimed = last_claim(m, robot)
    own = m.sets[c.OWN, robot]
    reserved = m.sets[c.RESERVED, robot]
    note_answer(m, robot)
    me.answered = m.desk[0].now
    hear_answer(m, robot)
    is_news = False
    for word in range(len(own)):
        granted = reserved[word] & m.places[me.granted, word] & ~own[word]
        if granted:
            is_news = True
            own[word] |= granted
    if has_places(m, robot, me.wanted):
        me.wanted = 0
    plan_claim(m, robot)
    if is_news and me.hears_grants:
        me.hears_grants = False
        me.follows = c.NONE
        m.timers[c.WAKE, robot] = c.QUARTERS * tick_of(m)


# -- traffic's side


@inner
def hear_claims(m):
    """Let traffic hear the claims of the last tick, and grant what can be granted."""
    now = m.desk[0].now
    tick = now // c.QUARTERS
    for robot in range(len(m.robots)):
        if m.timers[c.CLAIM, robot] == now:
            note_claim(m, robot, tick)
    grant(m)
    for robot in range(len(m.robots)):
        me = m.robots[robot]
        if m.timers[c.CLAIM, robot] == now:
            m.timers[c.CLAIM, robot] = c.NEVER
            note_answer(m, robot)
            me.answered = c.QUARTERS * (tick + ANSWERED) - BEFORE_ACTING
        if me.was_served:
            me.was_served = False
            # It claims again and again, and hears of the grant as the answer to its next claim.
            next_claim = tick + (me.claimed - tick) % PATIENCE
            heard = c.QUARTERS * (next_claim + ANSWERED) - BEFORE_ACTING
            m.timers[c.GRANT, robot] = min(m.timers[c.GRANT, robot], heard)


@inner
def note_claim(m, robot, tick):
    """Enter a robot's claim: what it neither keeps nor wants is free, and it waits for what it
    wants.
    """
    me = m.robots[robot]
    me.due = c.NONE
    me.claimed = tick
    me.told_wanted = me.wanted
    me.told_beside = me.beside
    copy_set(m, robot, c.OWN, c.TOLD)
    reserved = m.sets[c.RESERVED, robot]
    for word in range(len(reserved)):
        reserved[word] &= m.sets[c.OWN, robot, word] | m.places[me.wanted, word]
    if me.wanted == 0 or me.wish != me.wanted:
        me.wish_since = tick
    me.wish = me.wanted
    me.wish_beside = me.beside


@inner
def note_answer(m, robot):
    """Note what traffic answers a robot: its places, and those that it shares with no other
    robot.
    """
    copy_set(m, robot, c.RESERVED, c.COMING)
    copy_set(m, robot, c.RESERVED, c.COMING_ALONE)
    for other in range(len(m.robots)):
        if share_roads(m, robot, other):
            for word in range(m.sets.shape[2]):
                m.sets[c.COMING_ALONE, robot, word] &= ~m.sets[c.RESERVED, other, word]


@inner
def grant(m):
    """Serve the robots that wait, in the order in which they asked: as
    `orchard.behaviour.traffic.grant`.
    """
    robot = next_wish(m, c.NONE)
    if robot == c.NONE:
        return
    m.scratch[:] = 0
    while robot != c.NONE:
        # The next one is looked up first: a robot that is served no longer waits.
        following = next_wish(m, robot)
        serve(m, robot)
        robot = following


@inner
def next_wish(m, last):
    """Return the robot that asked next after another one; NONE as `last`: the first one.

    Ties by name.
    """
    best = c.NONE
    for robot in range(len(m.robots)):
        if m.robots[robot].wish == 0:
            continue
        if last != c.NONE and not asked_before(m, last, robot):
            continue
        if best == c.NONE or asked_before(m, robot, best):
            best = robot
    return best


@inner
def asked_before(m, robot, other):
    """Whether a robot asked before another one. Robots are in the order of their names."""
    since = m.robots[robot].wish_since
    since_other = m.robots[other].wish_since
    return since < since_other or (since == since_other and robot < other)


@inner
def serve(m, robot):
    """Grant a robot all that it waits for, or note that later ones must wait behind it."""
    me = m.robots[robot]
    reserved = m.sets[c.RESERVED, robot]
    waited_for = m.scratch[c.WAITED_FOR]
    missing = m.scratch[c.MISSING]
    for word in range(len(missing)):
        missing[word] = m.places[me.wish, word] & ~reserved[word]
    is_free = not is_blocked(m, robot, missing)
    is_next = not share_any(waited_for, missing) or joins_partner(m, robot, missing)
    if is_free and is_next:
        for word in range(len(missing)):
            reserved[word] |= missing[word]
        me.granted = me.wish
        me.wish = 0
        me.was_served = True
    else:
        for word in range(len(missing)):
            waited_for[word] |= missing[word]


@inner
def is_blocked(m, robot, missing):
    """Whether another robot than the partner has places that a robot misses."""
    for other in range(len(m.robots)):
        if not share_roads(m, robot, other) or other == m.robots[robot].wish_beside:
            continue
        if share_any(missing, m.sets[c.RESERVED, other]):
            return True
    return False


@inner
def joins_partner(m, robot, missing):
    """Whether the partner has all that a robot misses: it need not wait in line then."""
    partner = m.robots[robot].wish_beside
    return partner != c.NONE and is_subset(missing, m.sets[c.RESERVED, partner])


@inner
def is_alone(m, robot, places):
    """Whether traffic has a list of places for this robot only."""
    if not is_subset(m.places[places], m.sets[c.RESERVED, robot]):
        return False
    for other in range(len(m.robots)):
        is_near = share_roads(m, robot, other)
        if is_near and share_any(m.places[places], m.sets[c.RESERVED, other]):
            return False
    return True
