"""gear-twin from Python: assess a recording here, or ask a running service.

import gear_twin

result = gear_twin.assess("recordings/short-campaign.mcap")
result.plot()

with gear_twin.Client("http://127.0.0.1:8080") as service:
    for machine in service.assets():
        print(machine.asset, machine.status.level)
"""

from gear_twin.client import Client, Event
from gear_twin.result import Result, assess
from service.access.http_client import ServiceError

__all__ = ["Client", "Event", "Result", "ServiceError", "assess"]
