"""The tests of REST's inspections, answered by the store and the board of a front end over three partitions."""

from test_inspections import *  # noqa: F403

OVER_FLEET = True
