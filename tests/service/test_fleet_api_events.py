"""The tests of REST's events, answered by the store and the board of a front end over three partitions."""

from test_api_events import *  # noqa: F403

OVER_FLEET = True
