"""The bridges that the settings ask for; the packages of the others are not loaded."""

from __future__ import annotations

from collections.abc import Callable

from service.access.access import Access
from service.bridges.bridge import Bridge, Bridges, Helper
from service.bridges.kept import KeptNumbers
from service.errors import InputError
from service.results.asset_table import AssetTable
from service.results.sql_store import SqlStore
from service.settings import Settings

FOLDER = "bridges"  # in the data directory


def bridges_of(
    settings: Settings, table: AssetTable, store: SqlStore, offer: Callable[[str, bytes], bool], access: Access
) -> Bridges:
    """All bridges; InputError where a setting or a package is missing.

    offer   takes a frame to the stream's inbox: topic, payload → whether there was room
    access  who may read where clients connect to the service
    """
    bridges: list[Bridge] = []
    helpers: list[Helper] = []
    if settings.mqtt is not None:
        from service.bridges.mqtt import MqttBridge
        from service.bridges.slow_inputs import SlowInputs, load_inputs

        kept = KeptNumbers(settings.data / FOLDER / "mqtt.json")
        inputs = None
        if settings.mqtt_inputs is not None:
            inputs = SlowInputs(load_inputs(settings.mqtt_inputs), offer, kept, settings.prefix)
            helpers.append(inputs)
        bridges.append(MqttBridge(settings, table, store, kept, inputs))
    elif settings.mqtt_inputs is not None:
        raise InputError("setting mqtt_inputs: slow values come from a broker; give it in the setting mqtt")
    if settings.opcua is not None:
        from service.bridges.opcua import OpcUaBridge

        bridges.append(OpcUaBridge(settings, table, access))
    return Bridges(bridges, helpers)
