"""How long a test waits for what must happen."""

# s of wall time. A hang ends the test; a busy machine does not. No test asserts how long
# something took: by this much, processors that others use would decide. Beside four busy loops on
# one core a harvest of many processes took more than 300 s.
PATIENCE = 900.0
