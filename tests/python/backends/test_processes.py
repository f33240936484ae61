"""Processes that the package starts: who can reach them, what code they read, and what they need."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

NOBODY = 65534
# Tries every port with two kinds of greeting, and where one is answered, has the user of that process told.
INTRUDER = """
import asyncio, json, os, sys
from distributed import Security
from distributed.core import connect
from distributed.protocol.pickle import dumps
own = Security.temporary()
user, *places = sys.argv[1:]
if user != "-":
    os.setgroups([])
    os.setgid(int(user))
    os.setuid(int(user))
    assert os.getuid() == int(user)
async def attempt(scheme, place, operation):
    try:
        given = own.get_connection_args("client") if scheme == "tls" else {}
        comm = await connect(f"{scheme}://{place}", timeout=2, **given)
        await comm.write({"op": operation, "function": dumps(os.getuid), "reply": True})
        answer = await asyncio.wait_for(comm.read(), 2)
        return f"{operation}: {answer['result'] if isinstance(answer, dict) else answer}"
    except (OSError, ValueError, asyncio.TimeoutError):  # (ValueError: an answer that is no handshake)
        return "refused"
async def main():
    each = [(s, p, o) for p in places for s in ("tcp", "tls") for o in ("run", "run_function")]
    print(json.dumps(await asyncio.gather(*(attempt(*one) for one in each))))
asyncio.run(main())
"""


def intrude(places, user="-"):
    """Return what another program without keys is answered at some places."""
    command = [sys.executable, "-c", INTRUDER, user, *places]
    told = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert told.returncode == 0, told.stderr
    return set(json.loads(told.stdout))


def listening(pids):
    """Return where some processes take connections."""
    sockets = set()
    for pid in pids:
        for one in Path(f"/proc/{pid}/fd").iterdir():
            try:
                sockets.add(os.readlink(one))
            except FileNotFoundError:
                continue
    found = set()
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        parts = line.split()
        if parts[3] == "0A" and f"socket:[{parts[9]}]" in sockets:
            address, port = parts[1].split(":")
            host = ".".join(str(byte) for byte in reversed(bytes.fromhex(address)))
            found.add(f"{host}:{int(port, 16)}")
    return found


def worker_folder(dask_worker):
    return dask_worker.local_directory


def test_only_who_has_the_keys_reaches_processes_of_a_command(cluster):
    pytest.importorskip("cryptography", reason="no cryptography: pip install 'sheetsplat[distributed]'")
    from sheetsplat.cli.cluster import started

    before = listening([os.getpid()])
    with started(1) as client:
        (address, pid), (folder,) = *client.run(os.getpid).items(), client.run(worker_folder).values()
        places = listening([os.getpid(), pid]) - before
        # A scheduler, a worker and what watches it; no pages.
        assert len(places) == 3 and address.removeprefix("tls://") in places
        assert all(place.startswith("127.0.0.1:") for place in places)
        assert intrude(places) == {"refused"}
        if os.getuid() == 0:
            assert intrude(places, str(NOBODY)) == {"refused"}
        # What it reads back as pickles nobody else can replace.
        closed = [one for one in Path(folder).parents if one.name.startswith("sheetsplat-")]
        assert [one.stat().st_mode & 0o777 for one in closed] == [0o700]
        assert list(client.run(pow, 2, 3).values()) == [8]
    # A cluster without keys lets everybody in.
    open_places = [one.removeprefix("tcp://") for one in cluster.nthreads()]
    assert f"run: {os.getuid()}" in intrude(open_places)


@pytest.mark.skipif(os.getuid() != 0, reason="another user's process can be started by root alone")
def test_another_user_reaches_what_has_no_keys(cluster):
    """The negative control of the test before."""
    places = [one.removeprefix("tcp://") for one in cluster.nthreads()]
    assert f"run: {os.getuid()}" in intrude(places, str(NOBODY))


COMMANDS = {
    "bricks": ["render", "v.npy", "-o", "x.png", "--workers", "1", "--brick", "16"],
    "frames": ["turntable", "v.npy", "-o", "film", "--workers", "2", "--frames", "2"],
}
SMALL = ["--size", "24", "--quality", "draft", "--backend", "cpu"]


def run(folder, name, **options):
    command = [sys.executable, "-m", "sheetsplat", *COMMANDS[name], *SMALL]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, **options)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_folder_that_another_user_made_is_not_used(name, tmp_path, monkeypatch):
    """Dask's own place for what it writes has a name that everybody knows, in a folder that everybody can write."""
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", np.random.default_rng(0).random((20, 20, 20), np.float32))
    victim, own = tmp_path / "victim", tmp_path / "everybody"
    victim.write_text("mine")
    (own / "dask-scratch-space").mkdir(parents=True)
    (own / "dask-scratch-space" / "global.lock").symlink_to(victim)
    monkeypatch.setenv("TMPDIR", str(own))
    assert run(tmp_path, name).returncode == 0
    assert victim.read_text() == "mine"
    assert sorted(one.name for one in (own / "dask-scratch-space").iterdir()) == ["global.lock"]
    assert not [one for one in own.iterdir() if one.name.startswith("sheetsplat-")]


def test_processes_that_hang_while_they_start_are_given_up():
    from sheetsplat.cli import cluster as module

    began = time.monotonic()
    with pytest.raises(TimeoutError, match="ready within 0.2 s"):
        module._launched(lambda: time.sleep(20), 0.2)
    assert time.monotonic() - began < 10.0
    assert module._launched(lambda: signal.pthread_sigmask(signal.SIG_BLOCK, []), 20.0) == {signal.SIGINT}
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.parametrize("name", COMMANDS)
def test_processes_take_no_code_from_the_current_folder(name, tmp_path):
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", np.random.default_rng(0).random((20, 20, 20), np.float32))
    for module in ("pickle", "multiprocessing", "json", "socket", "numpy"):
        (tmp_path / f"{module}.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'w').close()\n")
    told = run(tmp_path, name)
    assert told.returncode == 0, told.stderr
    assert not (tmp_path / "mark").exists()
    subprocess.run([sys.executable, "-c", "import pickle"], cwd=tmp_path, check=True)
    assert (tmp_path / "mark").exists()


@pytest.mark.parametrize(("name", "files"), [("bricks", 16), ("bricks", 32), ("frames", 16)])
def test_few_open_files_are_an_error_of_one_line(name, files, tmp_path):
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", np.random.default_rng(0).random((20, 20, 20), np.float32))
    limits = (files, files)
    told = run(tmp_path, name, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, limits))
    (line,) = told.stderr.splitlines()
    assert told.returncode == 1 and f"a limit of {files} open files" in line


def test_a_limit_of_open_files_is_raised_as_far_as_the_system_lets_it(tmp_path):
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", np.random.default_rng(0).random((20, 20, 20), np.float32))
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    limits = (24, hard)
    told = run(tmp_path, "bricks", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, limits))
    assert told.returncode == 0, told.stderr
