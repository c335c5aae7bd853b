"""The tests of REST's routes, answered by the store and the board of a front end over three partitions."""

from test_api import *  # noqa: F403

OVER_FLEET = True
