"""One build through an object store: SeaweedFS, which `cargo xtask test` installs in the folder KILWA_SEAWEED."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import subprocess
import tempfile
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import OneMesh, end_all, tree, until

BUCKET = "museum"
# The keys of kilwa; the tests themselves send anonymous requests.
IDENTITIES = {
    "identities": [
        {"name": "test", "credentials": [{"accessKey": "test", "secretKey": "secret-of-the-test"}], "actions": ["Admin"]},
        {"name": "anonymous", "actions": ["Admin"]},
    ]
}
PORTS = ("master.port", "master.port.grpc", "volume.port", "volume.port.grpc", "filer.port", "filer.port.grpc", "s3.port")


@dataclass
class Store:
    """A store with one bucket."""

    url: str

    def ask(self, key: str, method: str = "GET", body: bytes | None = None, timeout: float = 20) -> bytes:
        """Send a request for an object, or for the bucket, and return the response. Sending may take `timeout` seconds."""
        request = urllib.request.Request(f"{self.url}/{BUCKET}{key}", data=body, method=method)
        with urllib.request.urlopen(request, timeout=timeout) as answer:
            content: bytes = answer.read()
            return content

    def list(self, query: str = "list-type=2", what: str = "Key") -> list[str]:
        """Return the keys of all objects, or the values of another element in the list of the bucket."""
        root = ET.fromstring(self.ask(f"?{query}"))
        return [element.text or "" for element in root.iter() if element.tag.rpartition("}")[2] == what]


@contextmanager
def serving(volume_mb: int = 64) -> Iterator[Store]:
    """Start a store whose data fills at most 100 volumes of this size; stop it and remove its data at the end."""
    packages = os.environ.get("KILWA_SEAWEED")
    if packages is None:
        pytest.skip("KILWA_SEAWEED is not set (cargo xtask test sets it)")
    folder = Path(tempfile.mkdtemp(prefix="kilwa-store-"))
    (folder / "data").mkdir()
    (folder / "s3.json").write_text(json.dumps(IDENTITIES))
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in (*PORTS, "s3.port.grpc")]
    ports = [held.getsockname()[1] for held in sockets]
    for held in sockets:
        held.close()
    numbered = [f"-{name}={port}" for name, port in zip((*PORTS, "s3.port.grpc"), ports, strict=True)]
    options = ["-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-filer", "-s3", "-master.electionTimeout=1s", "-volume.max=100"]
    places = [f"-dir={folder}/data", f"-s3.config={folder}/s3.json", f"-filer.localSocket={folder}/socket"]
    more = [f"-master.volumeSizeLimitMB={volume_mb}", "-master.telemetry=false", "-s3.port.iceberg=0", "-s3.port.lance=0"]
    weed = [os.path.join(packages, "bin", "weed"), "server", *options, *more, *places, *numbered]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(weed, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    made = Store(f"http://127.0.0.1:{ports[PORTS.index('s3.port')]}")

    def ready() -> bool:
        try:
            made.ask("/begin", "PUT", b"1")
            made.ask("/begin", "DELETE")
        except (urllib.error.URLError, OSError):
            return False
        return True

    try:
        until(ready, "the store is ready")
        yield made
    finally:
        process.kill()
        process.wait()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def store() -> Iterator[Store]:
    """Return a store for the tests of one module."""
    with serving() as made:
        yield made


def set_keys(store: Store, environment: pytest.MonkeyPatch) -> None:
    """Give the programs that are started from now on the address and the keys of a store."""
    environment.setenv("AWS_ENDPOINT_URL", store.url)
    environment.setenv("AWS_ACCESS_KEY_ID", "test")
    environment.setenv("AWS_SECRET_ACCESS_KEY", "secret-of-the-test")
    environment.setenv("AWS_REGION", "us-east-1")


@dataclass
class Stored(OneMesh):
    """A mesh in a store, and the place of its build."""

    store: Store | None = None
    output: str = f"s3://{BUCKET}/packs/mesh.kilwa"

    def make(self, triangles: str) -> None:
        """Make the mesh, and put it into the store."""
        assert self.store is not None
        command = [self.kilwa, "synth", "wall", "--triangles", triangles, "--output", str(self.mesh), "--force"]
        subprocess.run(command, check=True, capture_output=True)
        self.store.ask("/in/mesh.ply", "PUT", self.mesh.read_bytes())

    def start(self, *options: str, kilwa: str | None = None) -> subprocess.Popen[str]:
        """Start a driver."""
        files = [f"s3://{BUCKET}/in/mesh.ply", "-o", self.output, "--work", f"s3://{BUCKET}/work"]
        options = ("--task-triangles", "3k", "--scratch", str(self.scratch), "--json", str(self.report), *options)
        return self.launch("build", *files, *options, kilwa=kilwa)

    def run(self, *options: str, code: int = 0) -> str:
        """Run a driver to its end and return what it printed."""
        return self.end(self.start(*options), code)

    def check(self) -> None:
        """Check the pack, and that nothing else remains: no object, no upload, no file."""
        assert self.store is not None
        pack = Path(self.output).read_bytes() if self.output.startswith("/") else self.store.ask("/packs/mesh.kilwa")
        assert hashlib.sha256(pack).hexdigest() == self.sha256_of_plain_build(self.mesh)
        assert [key for key in self.store.list() if key.startswith("work/")] == []
        assert self.store.list("uploads", "UploadId") == []
        assert not self.scratch.exists() or list(self.scratch.iterdir()) == []


@pytest.fixture
def stored(tmp_path: Path, kilwa: str, store: Store, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stored]:
    """Return a mesh in the store."""
    set_keys(store, monkeypatch)
    made = Stored(tmp_path, kilwa, store=store)
    made.make("20k")
    yield made
    end_all(made)
    for key in store.list():
        store.ask(f"/{key}", "DELETE")


def test_inputs_work_and_pack_in_a_store(stored: Stored) -> None:
    """The pack is equal to that of kilwa build; the same command finds it, and a different one is refused."""
    text = stored.run()
    told = json.loads(stored.report.read_text())
    assert told["pack"]["sha256"] == stored.sha256_of_plain_build(stored.mesh)
    assert f"SHA-256 {told['pack']['sha256']}" in text
    stored.check()
    stored.run()
    assert json.loads(stored.report.read_text())["pack"] == told["pack"]
    stored.check()
    text = stored.run("--workers", "2", "--", "--title", "another", code=1)
    assert f"{stored.output} already exists; use --force" in text
    stored.check()


def test_work_in_a_store_and_output_in_a_file(stored: Stored) -> None:
    """The second time, the existing output is refused."""
    stored.output = str(stored.root / "packs" / "mesh.kilwa")
    stored.run()
    stored.check()
    assert "use --force" in stored.run(code=2)
    assert [path.name for path in Path(stored.output).parent.iterdir()] == ["mesh.kilwa"]


def test_a_build_continues_after_its_driver_died(stored: Stored) -> None:
    """The driver is killed with all its workers when some tasks are done."""
    assert stored.store is not None
    driver = stored.start()
    until(lambda: sum("/done/level" in key for key in stored.store.list()) > 1, "tasks are done")  # type: ignore[union-attr]
    for process in tree(driver):
        process.kill()
    driver.wait()
    stored.run()
    earlier = {stage["stage"]: stage["earlier"] for stage in json.loads(stored.report.read_text())["stages"]}
    assert earlier["ingest"] == earlier["tree"] == 1
    assert sum(done for stage, done in earlier.items() if stage.startswith("level")) > 1
    stored.check()
