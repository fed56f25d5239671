"""The manifests for Kubernetes (docs/hosting/kubernetes.yaml): the options of their commands exist, and they are consistent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dask.config
import yaml
from distributed.cli import dask_scheduler, dask_worker

from kilwa_dask import __version__, cli, clusters

FILE = Path(__file__).resolve().parents[3] / "docs" / "hosting" / "kubernetes.yaml"


def manifests() -> dict[tuple[str, str], Any]:
    """Return the manifests by kind and name."""
    return {(each["kind"], each["metadata"]["name"]): each for each in yaml.safe_load_all(FILE.read_text())}


def container(kind: str, name: str) -> Any:
    """Return the only container of a manifest's pods."""
    (only,) = manifests()[kind, name]["spec"]["template"]["spec"]["containers"]
    return only


def test_the_options_of_the_commands_exist() -> None:
    """The options of Dask and of kilwa-dask; all commands use the scheduler's service."""
    service = manifests()["Service", "kilwa-scheduler"]["spec"]["ports"][0]
    address = f"tcp://kilwa-scheduler:{service['port']}"
    dask_program, verb, *options = container("Deployment", "kilwa-scheduler")["command"]
    scheduler = dask_scheduler.main.make_context("scheduler", list(options)).params
    assert (dask_program, verb, int(scheduler["port"])) == ("dask", "scheduler", service["port"])
    dask_program, verb, *options = container("Deployment", "kilwa-worker")["command"]
    worker = dask_worker.main.make_context("worker", list(options)).params
    assert (dask_program, verb, worker["scheduler"], worker["nthreads"]) == ("dask", "worker", address, 1)
    program, *options = container("Job", "kilwa-build")["command"]
    build = cli.parser().parse_args(options)
    assert (program, build.verb, build.scheduler) == ("kilwa-dask", "build", address)


def test_the_scheduler_has_the_same_settings_as_those_of_kilwa_dask() -> None:
    """They are environment variables, as Dask reads them."""
    variables = {each["name"]: each["value"] for each in container("Deployment", "kilwa-scheduler")["env"]}
    read = dask.config.collect_env(variables)
    wanted = {key: value for key, value in clusters._CONFIG.items() if key.startswith("distributed.scheduler.")}
    assert {key: dask.config.get(key, config=read) for key in wanted} == wanted


def test_the_manifests_are_consistent() -> None:
    """Selectors, volumes, the version, and the network policy."""
    found = manifests()
    pods = {key: each["spec"]["template"] for key, each in found.items() if "template" in each["spec"]}
    (policy,) = (each["spec"] for (kind, _), each in found.items() if kind == "NetworkPolicy")
    for (kind, name), pod in pods.items():
        labels = pod["metadata"]["labels"]
        assert labels.items() >= policy["podSelector"]["matchLabels"].items()
        if kind == "Deployment":
            assert labels.items() >= found[kind, name]["spec"]["selector"]["matchLabels"].items()
        assert container(kind, name)["image"].endswith(f"/kilwa-dask:{__version__}")
        volumes = {volume["name"]: volume for volume in pod["spec"].get("volumes", [])}
        assert {mount["name"] for mount in container(kind, name).get("volumeMounts", [])} == set(volumes)
        for claim in (volume["persistentVolumeClaim"] for volume in volumes.values() if "persistentVolumeClaim" in volume):
            assert ("PersistentVolumeClaim", claim["claimName"]) in found
