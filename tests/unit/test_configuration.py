"""Settings: file, environment and options, each mistake one line, and what is printed of them."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from service.cli import run
from service.configuration.load import load, origins
from service.configuration.printed import effective_text, example_text, shown
from service.configuration.tables import places
from service.errors import InputErrors
from service.settings import Settings


@pytest.fixture
def file(tmp_path):
    def written(text):
        path = tmp_path / "gear-twin.toml"
        path.write_text(text)
        return path

    return written


def mistakes(**given):
    with pytest.raises(InputErrors) as error:
        load(**given)
    return error.value.lines


def test_options_take_precedence_over_variables_and_these_over_the_file(file, monkeypatch):
    path = file('[stream]\nprefix = "file"\nqueue_frames = 100\nidle_timeout = 7.0\n')
    monkeypatch.setenv("GEAR_TWIN_QUEUE_FRAMES", "200")
    monkeypatch.setenv("GEAR_TWIN_IDLE_TIMEOUT", "8")
    given = {"config": path, "idle_timeout": 9.0, "prefix": None}
    found = load(**given)
    assert (found.prefix, found.queue_frames, found.idle_timeout) == ("file", 200, 9.0)
    where = origins(given)
    assert where["prefix"] == f"file {path}" and where["queue_frames"] == "environment GEAR_TWIN_QUEUE_FRAMES"
    assert where["idle_timeout"] == "option" and where["patience"] == "default"


def test_file_is_named_by_the_environment_too(file, monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_CONFIG", str(file("[windows]\nlength = 2.5\n")))
    assert load().window_length == 2.5
    assert Settings().window_length == 2.5


def test_paths_of_the_file_are_relative_to_its_folder(file, tmp_path):
    found = load(config=file('[twin]\nrig = "rigs/a.toml"\nbaseline = "/b.npz"\n'))
    assert found.rig == tmp_path / "rigs" / "a.toml" and found.baseline == Path("/b.npz")


def test_every_unknown_key_of_the_file_is_a_line_that_names_the_nearest(file):
    path = file(
        'http = "a:1"\npatience = 5\n[stream]\nlisten_at = []\nqueue_framse = 1\nwindow_length = 1\n[windos]\ngap = 1\n'
    )
    lines = mistakes(config=path)
    assert all(line.startswith(f"{path}: ") for line in lines)
    said = [line.removeprefix(f"{path}: ") for line in lines]
    assert said == [
        "http = 'a:1' must be a table: [http] with its keys below",
        "patience belongs to no table; it is 'patience' in [windows]",
        "[stream] has no key 'listen_at'; did you mean listen?",
        "[stream] has no key 'queue_framse'; did you mean queue_frames?",
        "[stream] has no key 'window_length'; it is 'length' in [windows]",
        "[windos] is no table of this file; did you mean windows?",
    ]


def test_every_wrong_value_is_a_line_with_its_place(file, monkeypatch):
    path = file('[windows]\nlength = -1\n[stream]\nlisten = ["nowhere"]\n')
    monkeypatch.setenv("GEAR_TWIN_PATIENCE", "few")
    lines = mistakes(config=path, http="nowhere")
    assert len(lines) == 4
    assert any(line.startswith(f"{path}: [windows] length = -1: Input should be greater than") for line in lines)
    assert any(line.startswith(f"{path}: [stream] listen") and "protocol/address" in line for line in lines)
    assert any(line.startswith("environment: setting patience (GEAR_TWIN_PATIENCE) = 'few'") for line in lines)
    assert "setting http = 'nowhere': must be HOST:PORT, such as 127.0.0.1:8080" in lines


def test_unknown_variable_is_refused_with_the_nearest_setting(monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_LISTN", "[]")
    assert mistakes() == ("environment: GEAR_TWIN_LISTN is no setting; did you mean GEAR_TWIN_LISTEN?",)


def test_variables_of_commands_and_tests_are_no_mistakes(monkeypatch):
    for name in ("URL", "NAME", "KEY", "CA", "SHARED", "TEST_ANY"):
        monkeypatch.setenv(f"GEAR_TWIN_{name}", "x")
    assert load() == Settings()


@pytest.mark.parametrize("service", ["", "_ROUTER", "_HTTP", "_HEAD_SVC"])
@pytest.mark.parametrize("address", ["10.96.0.17", "fd00:10:96::a1"])
def test_what_kubernetes_says_of_its_services_is_no_setting_and_no_mistake(monkeypatch, service, address):
    link = f"tcp://{f'[{address}]' if ':' in address else address}:7447"
    given = {
        "SERVICE_HOST": address, "SERVICE_PORT": "7447", "SERVICE_PORT_ZENOH": "7447", "PORT": link,
        "PORT_7447_TCP": link, "PORT_7447_TCP_PROTO": "tcp", "PORT_7447_TCP_PORT": "7447",
        "PORT_7447_TCP_ADDR": address, "PORT_53_UDP": link.replace("tcp", "udp"),
    }  # fmt: skip
    for name, value in given.items():
        monkeypatch.setenv(f"GEAR_TWIN{service}_{name}", value)
    assert load() == Settings()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PORT", "8080"), ("ROUTER_PORT", "7447"), ("SERVICE_HOST", "localhost"), ("SERVICE_PORT", "http"),
        ("PORT_80_TCP_ADDR", "plant"), ("PORT_80_TCP_PROTO", "http"), ("PROT", "tcp://10.0.0.1:80"),
    ],
)  # fmt: skip
def test_what_has_only_the_name_or_only_the_value_of_a_service_is_told(monkeypatch, name, value):
    monkeypatch.setenv(f"GEAR_TWIN_{name}", value)
    (line,) = mistakes()
    assert line.startswith(f"environment: GEAR_TWIN_{name} is no setting")


def test_empty_variables_set_nothing(monkeypatch):
    for name in ("DATABASE", "LISTEN", "IDLE_TIMEOUT", "CONFIG"):
        monkeypatch.setenv(f"GEAR_TWIN_{name}", "")
    assert load() == Settings()


def test_list_that_is_no_json_is_named(monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_LISTEN", "tcp/127.0.0.1:7447")
    assert mistakes()[0].startswith("environment: GEAR_TWIN_LISTEN = 'tcp/127.0.0.1:7447' must be JSON")


@pytest.mark.parametrize(("text", "said"), [("[stream\n", "is not TOML"), (None, "cannot be read")])
def test_file_that_cannot_be_read_is_one_line_and_status_2(text, said, file, tmp_path, capsys):
    path = tmp_path / "absent.toml" if text is None else file(text)
    assert run(["config", "--config", str(path)]) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and str(path) in printed and said in printed


def test_command_prints_one_line_for_each_mistake(file, capsys):
    path = file("[windows]\nlength = -1\ngap = -1\n")
    assert run(["config", "--config", str(path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_what_is_printed_is_a_file_with_the_same_settings(file, capsys, monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_WEBHOOKS", '["https://somebody:secret@example.org/hook"]')
    first = file("[windows]\nlength = 2.5\n")
    assert run(["config", "--config", str(first)]) == 0
    printed = capsys.readouterr().out
    assert "secret" not in printed and "environment GEAR_TWIN_WEBHOOKS" in printed
    assert f"# file {first}" in printed
    monkeypatch.delenv("GEAR_TWIN_WEBHOOKS")
    second = file(effective_text(load(config=first), origins({"config": first})))
    assert load(config=second).model_dump(exclude={"config", "data"}) == load(
        config=file("[windows]\nlength = 2.5\n")
    ).model_dump(exclude={"config", "data"})
    assert run(["config", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["windows"]["length"] == {"value": 10.0, "from": "default"}


def test_credentials_in_addresses_are_masked():
    assert shown(["postgresql://twin:pass@host/db"]) == ["postgresql://**********@host/db"]


def test_every_setting_has_a_table_and_a_meaning():
    assert set(places(Settings)) == set(Settings.model_fields) - {"config"}
    assert not [name for name, field in Settings.model_fields.items() if not field.description]
    assert len({(p.table, p.key) for p in places(Settings).values()}) == len(places(Settings))


def test_example_file_loads_with_the_defaults_and_with_every_setting(file):
    text = example_text()
    assert load(config=file(text)).model_dump(exclude={"config"}) == Settings().model_dump(exclude={"config"})
    path = file(re.sub(r"(?m)^#(?=\w+ = )", "", text))
    keys = {(table, key) for table, held in tomllib.loads(path.read_text()).items() for key in held}
    assert keys == {(p.table, p.key) for p in places(Settings).values()}
    load(config=path)
