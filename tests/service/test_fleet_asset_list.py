"""The tests of REST's list of assets, answered by the store and the board of a front end over three partitions."""

from test_asset_list import *  # noqa: F403

OVER_FLEET = True
