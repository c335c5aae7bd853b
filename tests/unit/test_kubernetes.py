"""The example for Kubernetes: it names what is there, and its commands and settings are those of this program."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from typer.main import get_command

from service.cli.commands import app
from service.fleet.cluster import QUIET, ROOM
from service.settings import Settings

ROOT = Path(__file__).parents[2]
IMAGE = "gear-twin-fleet"
TEXT = (ROOT / "docker" / "kubernetes" / "fleet.yaml").read_text(encoding="utf-8")
OBJECTS = list(yaml.safe_load_all(TEXT))
SECRETS = dict(re.findall(r"create secret generic (\S+) --from-literal=(\w+)=", TEXT))


def named(kind):
    return {each["metadata"]["name"]: each for each in OBJECTS if each["kind"] == kind}


def templates():
    """The templates of pods, by what they are of."""
    found = {name: each["spec"]["template"] for name, each in named("Deployment").items()}
    for name, cluster in named("RayCluster").items():
        found[f"{name}-head"] = cluster["spec"]["headGroupSpec"]["template"]
        for group in cluster["spec"]["workerGroupSpecs"]:
            found[f"{name}-{group['groupName']}"] = group["template"]
    return found


TEMPLATES = templates()


def container(name):
    (only,) = TEMPLATES[name]["spec"]["containers"]
    return only


def labelled(selector):
    """The templates whose pods have these labels."""
    return [n for n, t in TEMPLATES.items() if selector.items() <= t["metadata"]["labels"].items()]


@pytest.mark.parametrize("name", TEMPLATES)
def test_a_pod_refers_to_what_is_there(name):
    spec, own = TEMPLATES[name]["spec"], container(name)
    assert own["image"].partition(":")[0] == IMAGE
    for source in own.get("envFrom", []):
        assert source["configMapRef"]["name"] in named("ConfigMap")
    for variable in own.get("env", []):
        if "valueFrom" in variable:
            secret = variable["valueFrom"]["secretKeyRef"]
            assert SECRETS[secret["name"]] == secret["key"]
    assert {m["name"] for m in own["volumeMounts"]} == {v["name"] for v in spec["volumes"]}
    for volume in spec["volumes"]:
        if "persistentVolumeClaim" in volume:
            assert volume["persistentVolumeClaim"]["claimName"] in named("PersistentVolumeClaim")
    ports = {port["name"] for port in own.get("ports", [])}
    for probe in ("readinessProbe", "livenessProbe"):
        if "tcpSocket" in own.get(probe, {}):
            assert own[probe]["tcpSocket"]["port"] in ports
    assert own["securityContext"]["allowPrivilegeEscalation"] is False and spec["securityContext"]["runAsNonRoot"]
    assert {"requests", "limits"} == set(own["resources"])


def test_services_and_policies_choose_pods_that_are_there():
    for service in named("Service").values():
        if service["spec"].get("type") == "ExternalName":
            continue
        (chosen,) = labelled(service["spec"]["selector"])
        ports = {port["name"] for port in container(chosen)["ports"]}
        assert {port["targetPort"] for port in service["spec"]["ports"]} <= ports
    for policy in named("NetworkPolicy").values():
        chosen = labelled(policy["spec"]["podSelector"]["matchLabels"])
        assert chosen
        for rule in policy["spec"]["ingress"]:
            for port in rule.get("ports", []):
                assert all(port["port"] in {p["name"] for p in container(name)["ports"]} for name in chosen)
    assert set(labelled(named("NetworkPolicy")["gear-twin"]["spec"]["podSelector"]["matchLabels"])) == set(TEMPLATES)
    for deployment in named("Deployment").values():
        labels = deployment["spec"]["template"]["metadata"]["labels"]
        assert deployment["spec"]["selector"]["matchLabels"].items() <= labels.items()


def test_commands_are_those_of_the_program():
    probes = [own[p]["exec"]["command"] for own in map(container, TEMPLATES)
              for p in ("readinessProbe", "livenessProbe") if "exec" in own.get(p, {})]  # fmt: skip
    called = [container(name)["args"] for name in named("Deployment")]
    for words in [*called, *(words[1:] for words in probes)]:
        command = get_command(app)
        while words and not words[0].startswith("-") and words[0] in getattr(command, "commands", {}):
            command, words = command.commands[words[0]], words[1:]
        assert not getattr(command, "commands", {})
        command.make_context(command.name, list(words))  # which refuses what is no option or value
    assert {tuple(words[:2]) for words in called} == {("fleet", "router"), ("fleet", "up"), ("fleet", "front")}


def test_settings_are_those_of_the_program():
    given = {}
    for name in TEMPLATES:
        own = container(name)
        for source in own.get("envFrom", []):
            given |= named("ConfigMap")[source["configMapRef"]["name"]]["data"]
        given |= {variable["name"]: variable.get("value") for variable in own.get("env", [])}
    ours = {n.removeprefix("GEAR_TWIN_").lower(): v for n, v in given.items() if n.startswith("GEAR_TWIN_")}
    assert set(ours) <= set(Settings.model_fields)
    values = {n: json.loads(v) if v.startswith("[") else v for n, v in ours.items()}
    settings = Settings.model_validate(values)
    offered = {
        f"tcp/{name}:{port['port']}"
        for name, each in named("Service").items()
        for port in each["spec"].get("ports", [])
    }
    assert settings.connect and set(settings.connect) <= offered
    assert settings.database is not None
    host = settings.database.get_secret_value().partition("@")[2].partition("/")[0]
    assert host in named("Service") and ":" not in settings.database.get_secret_value().partition("//")[2]
    assert {name: given[name] for name in QUIET} == QUIET


def test_every_node_has_room_for_all_partitions():
    (cluster,) = named("RayCluster").values()
    partitions = int(named("ConfigMap")["gear-twin"]["data"]["GEAR_TWIN_FLEET_PARTITIONS"])
    for group in cluster["spec"]["workerGroupSpecs"]:
        assert json.loads(json.loads(group["rayStartParams"]["resources"])) == {ROOM: partitions}
        assert group["minReplicas"] >= 2
    port = container("gear-twin-head")["ports"][0]["containerPort"]
    assert container("gear-twin-fleet")["args"][3] == f"{cluster['metadata']['name']}-head-svc:{port}"
    assert (ROOT / "requirements-fleet.lock").read_text().count(f"\nray=={cluster['spec']['rayVersion']} ") == 1
