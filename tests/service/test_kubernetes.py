"""The example for Kubernetes: it names what is there, and its commands and settings are those of this program."""

from __future__ import annotations

import copy
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import kubernetes_validate
import pytest
import yaml
from service_streams import free_port, wait_until
from typer.main import get_command

from service.cli.commands import app
from service.settings import Settings

ROOT = Path(__file__).parents[2]
IMAGE = "gear-twin-fleet"
TEXT = (ROOT / "docker" / "kubernetes" / "fleet.yaml").read_text(encoding="utf-8")
OBJECTS = list(yaml.safe_load_all(TEXT))
SECRETS = dict(re.findall(r"create secret generic (\S+) --from-literal=(\w+)=", TEXT))


RELEASE = "1.34"  # of Kubernetes, whose schemas the example is held against


def named(kind):
    return {each["metadata"]["name"]: each for each in OBJECTS if each["kind"] == kind}


def templates():
    """The templates of pods, by what they are of."""
    return {name: each["spec"]["template"] for name, each in WORKLOADS.items()}


WORKLOADS = named("Deployment") | named("StatefulSet")
TEMPLATES = templates()


def container(name):
    (only,) = TEMPLATES[name]["spec"]["containers"]
    return only


def labelled(selector):
    """The templates whose pods have these labels."""
    return [n for n, t in TEMPLATES.items() if selector.items() <= t["metadata"]["labels"].items()]


@pytest.mark.parametrize("each", OBJECTS, ids=lambda each: f"{each['kind']} {each['metadata']['name']}")
def test_a_manifest_has_only_fields_that_kubernetes_knows(each):
    kubernetes_validate.validate(each, RELEASE, strict=True)


@pytest.mark.parametrize("name", TEMPLATES)
def test_a_template_is_a_pod(name):
    head = {"apiVersion": "v1", "kind": "Pod"}
    kubernetes_validate.validate(head | copy.deepcopy(TEMPLATES[name]), RELEASE, strict=True)


def test_a_field_of_another_name_or_kind_is_found():
    for field, value in (("enableServiceLink", False), ("enableServiceLinks", "false")):
        spoiled = copy.deepcopy(named("Deployment")["gear-twin-front"])
        spoiled["spec"]["template"]["spec"][field] = value
        with pytest.raises(kubernetes_validate.ValidationError, match=str(value) if value else field):
            kubernetes_validate.validate(spoiled, RELEASE, strict=True)


def cluster_variables(name):
    """What a cluster that gives pods the variables of its Services sets in a container, and what the example does."""
    given = {"KUBERNETES_SERVICE_HOST": "10.96.0.1"}
    services = [(n, s["spec"]["ports"]) for n, s in named("Service").items() if "ports" in s["spec"]]
    for number, (service, ports) in enumerate(services):
        start, address = service.upper().replace("-", "_"), f"10.96.0.{number + 2}"
        given |= {f"{start}_SERVICE_HOST": address, f"{start}_SERVICE_PORT": str(ports[0]["port"])}
        given[f"{start}_PORT"] = f"tcp://{address}:{ports[0]['port']}"
        for port in ports:
            one, link = f"{start}_PORT_{port['port']}_TCP", f"tcp://{address}:{port['port']}"
            given |= {one: link, f"{one}_PROTO": "tcp", f"{one}_PORT": str(port["port"]), f"{one}_ADDR": address}
            given[f"{start}_SERVICE_PORT_{port['name'].upper()}"] = str(port["port"])
    for source in container(name).get("envFrom", []):
        given |= named("ConfigMap")[source["configMapRef"]["name"]]["data"]
    return given | {v["name"]: v.get("value", "a secret") for v in container(name).get("env", [])}


# What a command says in a pod of which nothing else is there.
SAYS = {
    "gear-twin-router": ("routing at", ()),
    "gear-twin-host": ("cannot be used now (connection lost)", ()),
    "gear-twin-front": ("cannot be used now (connection lost)", (["remote", "ready"],)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TEMPLATES)
def test_a_container_and_its_probes_run_with_the_variables_that_its_cluster_sets(name, tmp_path):
    assert TEMPLATES[name]["spec"]["enableServiceLinks"] is False  # though they do no harm
    given = cluster_variables(name) | {"GEAR_TWIN_DATA": str(tmp_path), "PYTHONPATH": str(ROOT)}
    given |= {n: v.replace("@gear-twin-postgresql", "@127.0.0.1:1") for n, v in given.items() if n.endswith("DATABASE")}
    for variable in ("GEAR_TWIN_LISTEN", "GEAR_TWIN_HTTP", "GEAR_TWIN_CONNECT"):
        if variable in given:
            given[variable] = re.sub(r"[\w.-]+:\d+", f"127.0.0.1:{free_port()}", given[variable])
    says, probes = SAYS[name]
    assert_says(container(name)["args"], says, given, tmp_path)
    for words in probes:
        assert_says(words, "no service answers" if words[-1] == "ready" else says, given, tmp_path)


def assert_says(words, expected, environment, folder):
    """A command says what it should, and nothing of settings, before it ends or is ended."""
    out = folder / "said"
    with out.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "service", *words], cwd=folder, stdout=file, stderr=file,
            env={"PATH": os.environ["PATH"], **environment},
        )  # fmt: skip
        try:
            wait_until(lambda: expected in out.read_text() or process.poll() is not None, 30.0)
        finally:
            process.terminate()
            process.wait(20)
    assert expected in out.read_text() and "is no setting" not in out.read_text()


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
    for workload in WORKLOADS.values():
        labels = workload["spec"]["template"]["metadata"]["labels"]
        assert workload["spec"]["selector"]["matchLabels"].items() <= labels.items()


def test_commands_are_those_of_the_program():
    probes = [own[p]["exec"]["command"] for own in map(container, TEMPLATES)
              for p in ("readinessProbe", "livenessProbe") if "exec" in own.get(p, {})]  # fmt: skip
    called = [container(name)["args"] for name in WORKLOADS]
    for words in [*called, *(words[1:] for words in probes)]:
        command = get_command(app)
        while words and not words[0].startswith("-") and words[0] in getattr(command, "commands", {}):
            command, words = command.commands[words[0]], words[1:]
        assert not getattr(command, "commands", {})
        command.make_context(command.name, list(words))  # which refuses what is no option or value
    assert {tuple(words[:2]) for words in called} == {("fleet", "router"), ("fleet", "host"), ("fleet", "front")}


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
