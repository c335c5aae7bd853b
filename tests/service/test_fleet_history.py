"""The tests of REST's histories, answered by the store and the board of a front end over three partitions."""

from test_history import *  # noqa: F403

OVER_FLEET = True
