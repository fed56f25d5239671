"""Command lines that are refused, each with a message that says why and exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from kilwa_dask import clusters
from kilwa_dask.cli import main


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "there are no meshes"),
        (["--publish", "store"], "--publish needs --metadata"),
        (["--hosts", "a,b"], "--hosts is for --cluster ssh"),
        (["--", "--output", "x"], "--output is not allowed after --"),
        (["--", "--threads=2"], "--threads=2 is not allowed after --"),
        (["--", "-opack.kilwa"], "-opack.kilwa is not allowed after --"),
    ],
)
def test_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Before anything is started."""
    (tmp_path / "in").mkdir()
    assert main(["build-all", str(tmp_path / "in"), str(tmp_path / "out"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--", "--work", "x"], "--work is not allowed after --"),
        (["--", "--json"], "--json is not allowed after --"),
        (["--hosts", "a,b"], "--hosts is for --cluster ssh"),
        (["--output", "."], "is a folder; give the name of the pack"),
    ],
)
def test_refused_for_one_build(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str) -> None:
    """Before anything is started as well."""
    assert main(["build", "a.ply", "--output", str(tmp_path / "a.kilwa"), "--work", str(tmp_path / "work"), *options]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [["--workers", "0"], ["--cluster", "cloud"], ["--cluster", "ssh", "--scheduler", "x"]])
def test_refused_by_the_parser(options: list[str]) -> None:
    """With exit code 2 as well."""
    with pytest.raises(SystemExit) as ended:
        main(["build-all", "in", "out", *options])
    assert ended.value.code == 2


@pytest.mark.parametrize(
    ("cluster", "message"),
    [
        (["slurm"], "pip install 'kilwa-dask[slurm]'"),
        (["ssh", "--hosts", "a"], "pip install 'kilwa-dask[ssh]'"),
        (["ssh"], "needs --hosts"),
    ],
)
def test_a_missing_extra_is_named(
    tmp_path: Path,
    kilwa: str,
    cluster: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With the command that installs it."""
    (tmp_path / "a.ply").write_text("x")
    monkeypatch.setattr(clusters, "find_spec", lambda _: None)
    assert main(["build-all", str(tmp_path), str(tmp_path / "out"), "--kilwa", kilwa, "--cluster", *cluster]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out/.kilwa-dask").exists()


def test_a_missing_program_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the option that says where it is."""
    (tmp_path / "a.ply").write_text("x")
    assert main(["build-all", str(tmp_path), str(tmp_path / "out"), "--kilwa", "no-such-kilwa"]) == 1
    assert "use --kilwa PATH" in capsys.readouterr().err
