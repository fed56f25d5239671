"""Runs the program kilwa as a subprocess of a worker.

Where the program setpriv (util-linux, Linux only) exists, kilwa is terminated when its worker is killed: the kernel sends
SIGTERM to a process whose parent died. Elsewhere the orphan keeps running, but writes only to its own folder (`task`).
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any


class ProgramFailed(Exception):
    """kilwa failed; the text is its own error message."""


class MayPass(Exception):
    """A failure that may be the machine's: another attempt, perhaps on another machine, may succeed."""


class ProgramKilled(MayPass):
    """kilwa was killed by a signal that kilwa-dask did not send, for example because memory ran out."""


class RunStopped(Exception):
    """The run that this task belongs to was stopped."""


_lock = threading.Lock()
_running: dict[str, set[subprocess.Popen[str]]] = {}
_stopped: set[str] = set()
_versions: dict[tuple[str, int, int], str] = {}


def find(program: str) -> str:
    """Return the path of kilwa on this machine; raises `ProgramFailed` if it is not there."""
    found = shutil.which(program)
    if found is None:
        raise ProgramFailed(f"the program {program!r} was not found on this machine; install kilwa or use --kilwa PATH")
    return found


def version(program: str) -> str:
    """Return what `kilwa --version` prints, for example "kilwa 0.1.0"; cached until the file changes."""
    path = find(program)
    stat = Path(path).stat()
    known = (path, stat.st_size, stat.st_mtime_ns)
    if known not in _versions:
        try:
            ended = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
        except OSError as error:
            raise ProgramFailed(f"cannot start {path}: {error.strerror}") from error
        text = ended.stdout.strip()
        if ended.returncode != 0 or not text:
            raise ProgramFailed(f"`{path} --version` failed: {ended.stderr.strip() or ended.returncode}")
        _versions[known] = text
    return _versions[known]


def run_json(program: str, arguments: list[str], *, run: str, locks: Sequence[int] = ()) -> dict[str, Any]:
    """Run kilwa with `arguments` (which include --json) and return its report.

    `run` is the run that `stop` may end; `locks` are descriptors that the subprocess inherits. Raises `ProgramFailed`,
    `ProgramKilled` or `RunStopped`.
    """
    command = [find(program), *arguments]
    guard = shutil.which("setpriv")
    if guard is not None:
        command = [guard, "--pdeathsig", "TERM", *command]
    with _lock:
        if run in _stopped:
            raise RunStopped
        # A separate session: Ctrl-C in the driver's terminal does not reach it; `stop` ends it.
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            pass_fds=locks,
            start_new_session=True,
        )
        _running.setdefault(run, set()).add(process)
    try:
        output, messages = process.communicate()
    except BaseException:
        # Ctrl-C in the driver.
        process.terminate()
        process.wait()
        raise
    finally:
        with _lock:
            _running[run].discard(process)
    verb = f"kilwa {arguments[0]}"
    if run in _stopped:
        raise RunStopped
    if process.returncode < 0 or process.returncode > 128:
        number = -process.returncode if process.returncode < 0 else process.returncode - 128
        raise ProgramKilled(f"{verb} was killed by signal {_name(number)}; perhaps memory ran out")
    # `kilwa verify` reports damage as JSON and exits with 1; the error message, if any, is on standard error.
    if process.returncode != 0:
        raise ProgramFailed(_message(messages) or _message(output) or f"{verb} failed with exit code {process.returncode}")
    try:
        report = json.loads(output)
    except ValueError as error:
        raise ProgramFailed(f"{verb} did not print JSON: {output[:200]!r}") from error
    if not isinstance(report, dict):
        raise ProgramFailed(f"{verb} printed {type(report).__name__} instead of an object")
    return report


def stop(run: str) -> None:
    """Terminate the programs that this process runs for a run, and start no more for it."""
    with _lock:
        _stopped.add(run)
        for process in _running.get(run, ()):
            process.send_signal(signal.SIGTERM)


def _message(text: str) -> str:
    """Return the last 2000 characters of what a program printed, without the prefix "kilwa: "."""
    return text.strip()[-2000:].removeprefix("kilwa: ").strip()


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)


def host() -> str:
    """Return the name of this machine."""
    return os.uname().nodename
