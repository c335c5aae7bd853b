"""Rig files of assets that were renamed, or whose stream was found to be another machine's."""

from __future__ import annotations

import tomllib

import pytest
from memory_transport import MemoryNetwork
from service_streams import RIG

from service.results.data_folder import DATABASE
from service.results.names import Names
from service.results.sql_store import SqlStore
from service.runtime.begun import Begun
from service.runtime.rig_sources import GivenRigs, OfferedRigs
from service.settings import Settings

GIVEN = tomllib.loads(RIG.read_text())
OWN_WIDTH, WIDTH = 0.025, 0.02  # of the rig file of one asset, and of that for all [m]


class Nobody:
    def find(self, asset):
        return None


@pytest.fixture
def own(tmp_path):
    """A rig file of one asset."""
    file = tmp_path / "own.toml"
    file.write_text(RIG.read_text().replace("face_width = 0.020", f"face_width = {OWN_WIDTH}"))
    return file


def begun(data, of_all=None, new_assets=None, **own):
    settings = Settings(data=data, rig=of_all, asset_rigs=own, new_assets=new_assets)
    return Begun.of(settings, GivenRigs.read(of_all, own), lambda: SqlStore(data / DATABASE))


def width_of(begun, asset):
    return begun.rigs.of(asset, Nobody()).get("gears.face_width")


def rename(store, asset, name):
    Names(store.database).rename(asset, name)


# -- those of the settings -------------------------------------------------------------------------------


def test_rig_file_that_the_settings_give_one_asset_is_that_of_the_asset_under_each_of_its_later_names(tmp_path, own):
    """After a restart it had the rig file for all, which replaced its own."""
    with begun(tmp_path, RIG, unsw=own) as first:
        first.store.note("other", [])
        assert (width_of(first, "unsw"), width_of(first, "other")) == (OWN_WIDTH, WIDTH)
        for name in ("press-7", "press-8"):
            rename(first.store, "unsw", name)
            assert width_of(first, "unsw") == OWN_WIDTH  # while it runs
    with begun(tmp_path, RIG, **{"press-7": own}) as again:
        assert (width_of(again, "unsw"), width_of(again, "other")) == (OWN_WIDTH, WIDTH)
        assert again.rigs.given_where("unsw") == str(own) and again.rigs.given_where("other") == str(RIG)


def test_rig_file_under_the_present_name_goes_before_one_under_a_former_name(tmp_path, own):
    with begun(tmp_path) as first:
        first.store.note("unsw", [])
        rename(first.store, "unsw", "press-7")
    with begun(tmp_path, **{"unsw": own, "press-7": RIG}) as again:
        assert width_of(again, "unsw") == WIDTH


@pytest.mark.parametrize("renamed", [False, True])
def test_rig_file_of_an_asset_whose_stream_is_another_machines_stays_with_the_asset(tmp_path, own, renamed):
    with begun(tmp_path, RIG, unsw=own) as first:
        assert width_of(first, "unsw") == OWN_WIDTH
        Names(first.store.database).give_streams("unsw", "bench-2")
        if renamed:
            rename(first.store, "unsw", "unsw-old")
    with begun(tmp_path, RIG, unsw=own) as again:
        assert width_of(again, "bench-2") == WIDTH
        assert width_of(again, "unsw") == OWN_WIDTH


# -- those that publishers offer -------------------------------------------------------------------------


def offering(**rigs):
    """A network on which publishers answer whoever asks for the rig file of their stream."""
    network = MemoryNetwork()
    network.rigs |= {stream: f"name = '{name}'".encode() for stream, name in rigs.items()}
    return network


def test_rig_file_of_a_renamed_asset_is_that_which_its_publisher_offers_under_the_streams_name(tmp_path):
    """The network was asked for the present name, for which no publisher answers."""
    offered = OfferedRigs(offering(unsw="of the stream"))
    with begun(tmp_path) as running:
        running.store.note("unsw", [])
        for name in ("press-7", "press-8"):
            rename(running.store, "unsw", name)
        assert running.rigs.of("unsw", offered).name == "of the stream"


def test_rig_file_that_is_offered_under_an_assets_own_name_goes_before_that_of_another_stream(tmp_path):
    offered = OfferedRigs(offering(**{"unsw": "of the stream", "press-7": "of the name"}))
    with begun(tmp_path) as running:
        running.store.note("unsw", [])
        rename(running.store, "unsw", "press-7")
        assert running.rigs.of("unsw", offered).name == "of the name"


def test_rig_file_that_is_offered_for_a_stream_is_not_that_of_the_asset_which_had_the_stream_before(tmp_path):
    """The gears of the other machine were taken for its own by the next start."""
    offered = OfferedRigs(offering(unsw="of the other machine"))
    with begun(tmp_path) as running:
        running.store.note("unsw", [])
        Names(running.store.database).give_streams("unsw", "bench-2")
        assert running.rigs.of("unsw", offered).name == "unnamed"
        assert running.rigs.of("bench-2", offered).name == "of the other machine"


def test_rig_file_that_is_offered_for_a_stream_is_a_proposal_for_its_renamed_asset_where_people_are_asked(tmp_path):
    offered = OfferedRigs(offering(unsw="of the stream"))
    with begun(tmp_path, new_assets="ask") as running:
        running.store.note("unsw", [])
        rename(running.store, "unsw", "press-7")
        running.table.changed("unsw")
        assert running.rigs.of("unsw", offered).name == "unnamed"
        assert running.store.asset("unsw").rig is None
        assert running.rigs.proposed == {"unsw": {"name": "of the stream"}}
