"""The tests of REST's routes, answered by the store and the board of a front end over three partitions."""

from test_api import *  # noqa: F403

OVER_FLEET = True

del test_metrics_that_wait_for_the_store_hold_no_other_request_up  # noqa: F821  # it holds up a store of one database
